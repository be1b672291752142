//! Sorts the visible splats back to front on a CPU thread, outside the frame loop.
//!
//! Three passes of 11 bits cover a 32-bit key, and 2¹¹ counters fit L1. A pass is skipped if all keys share
//! its digit. Keys of 16 bits visibly swapped splats (`rendering.md`, Tried and dropped). The sort runs
//! on the CPU because quads use no other compute; the tile path sorts on the GPU (`super::tiles`).

use crate::math::camera::Camera;
use crate::model::splat::splats::Splat;
use crate::render::options::{Lens, RenderOptions, Renderer};
use glam::DVec3;

const DIGIT_BITS: u32 = 11;
const N_BUCKETS: usize = 1 << DIGIT_BITS;
const N_PASSES: usize = 3;

/// Reusable buffers of [`back_to_front`].
#[derive(Debug, Default)]
pub struct SortScratch {
    /// Key in the upper half, splat index in the lower half.
    entries: Vec<u64>,
    swap: Vec<u64>,
    order: Vec<u32>,
}

/// Indices of the drawable splats beyond the near plane, farthest first. The key is view depth for the
/// projected renderer and distance for the exact one. For ties the later splat comes first, because the
/// earlier one is drawn in front (`rendering.md`, Blending). Indices are u32: at most 2³² splats.
pub fn back_to_front<'a>(
    splats: &[Splat],
    camera: &Camera,
    options: &RenderOptions,
    scratch: &'a mut SortScratch,
) -> &'a [u32] {
    let (forward, centre) = (camera.pose.forward(), camera.pose.centre());
    let near = options.near.max(0.0) as f32;
    let by_depth = options.method.renderer() == Renderer::Projected;
    let near_by_depth = options.method.lens() == Lens::Pinhole;
    scratch.entries.clear();
    // Reversed, because the sort is stable and the earlier of two splats at equal depth must be drawn
    // later.
    scratch.entries.extend(splats.iter().enumerate().rev().filter_map(|(index, splat)| {
        let from_camera = DVec3::from_array(splat.mean.map(f64::from)) - centre;
        let depth = from_camera.dot(forward) as f32;
        let distance = from_camera.length() as f32;
        let ahead = if near_by_depth { depth } else { distance };
        let key = far_first_key(if by_depth { depth } else { distance });
        (ahead > near && splat.is_drawable()).then(|| u64::from(key) << 32 | index as u64)
    }));
    radix_sort(&mut scratch.entries, &mut scratch.swap);
    scratch.order.clear();
    scratch.order.extend(scratch.entries.iter().map(|&entry| entry as u32));
    &scratch.order
}

/// Inverted bits of a positive float: integer order, farthest first.
fn far_first_key(depth: f32) -> u32 {
    !depth.to_bits()
}

/// Sorts `entries` by their upper 32 bits with a stable LSD radix sort.
fn radix_sort(entries: &mut Vec<u64>, swap: &mut Vec<u64>) {
    let mut counts = [[0usize; N_BUCKETS]; N_PASSES];
    for &entry in entries.iter() {
        for (pass, count) in counts.iter_mut().enumerate() {
            count[digit(entry, pass)] += 1;
        }
    }
    swap.resize(entries.len(), 0);
    for (pass, count) in counts.iter_mut().enumerate() {
        // All keys share this digit, so the pass would change nothing.
        if count.contains(&entries.len()) {
            continue;
        }
        let mut start = 0;
        for slot in count.iter_mut() {
            start += std::mem::replace(slot, start);
        }
        for &entry in entries.iter() {
            let slot = &mut count[digit(entry, pass)];
            swap[*slot] = entry;
            *slot += 1;
        }
        std::mem::swap(entries, swap);
    }
}

fn digit(entry: u64, pass: usize) -> usize {
    (entry >> (32 + DIGIT_BITS as usize * pass)) as usize & (N_BUCKETS - 1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::camera::Intrinsics;
    use crate::math::pose::Pose;
    use crate::math::rng::{Purpose, Rng};
    use crate::render::options::{Antialias, ExactOptions, RenderMethod, Response};

    fn camera() -> Camera {
        Camera {
            intrinsics: Intrinsics::from_horizontal_fov(64, 48, 1.0),
            pose: Pose::look_at(DVec3::new(3.0, -2.0, 1.0), DVec3::ZERO, DVec3::Z).unwrap(),
        }
    }

    const FISHEYE: RenderMethod = RenderMethod::Exact(ExactOptions {
        response: Response::Ray,
        antialias: Antialias::Footprint,
        lens: Lens::Fisheye,
    });

    fn options(method: RenderMethod, near: f64) -> RenderOptions {
        RenderOptions { near, ..RenderOptions::evaluation(method, [0.0; 3]) }
    }

    /// Depth tested against the near plane, and sort key.
    fn keys(splat: &Splat, camera: &Camera, method: RenderMethod) -> (f32, f32) {
        let from_camera = DVec3::from_array(splat.mean.map(f64::from)) - camera.pose.centre();
        let depth = from_camera.dot(camera.pose.forward()) as f32;
        let distance = from_camera.length() as f32;
        match method.renderer() {
            Renderer::Projected => (depth, depth),
            Renderer::Exact if method == FISHEYE => (distance, distance),
            Renderer::Exact => (depth, distance),
        }
    }

    #[test]
    fn agrees_with_a_stable_sort_at_every_size() {
        let mut scratch = SortScratch::default();
        for (seed, n) in [(0, 0), (1, 1), (2, 2), (3, 1000), (4, 40_000), (5, 37)] {
            let mut rng = Rng::new(seed, Purpose::Synthetic, 0);
            // A coarse grid creates many exact ties; a wide one spans 30 powers of two.
            let splats: Vec<Splat> = (0..n)
                .map(|_| {
                    let reach = 2f64.powi(rng.below(30) as i32 - 10);
                    let mut at = || (rng.range(-4.0, 4.0).round() * reach) as f32;
                    Splat { mean: [at(), at(), at()], opacity: 0.5, ..Splat::default() }
                })
                .collect();
            for method in [RenderMethod::PROJECTED, RenderMethod::EXACT, FISHEYE] {
                let keys = |i: &u32| keys(&splats[*i as usize], &camera(), method);
                let options = options(method, 0.2);
                let ours = back_to_front(&splats, &camera(), &options, &mut scratch).to_vec();
                let mut stable: Vec<u32> =
                    (0..n as u32).rev().filter(|i| keys(i).0 > 0.2).collect();
                stable.sort_by(|a, b| keys(b).1.total_cmp(&keys(a).1));
                assert_eq!(ours, stable, "{n} splats, {method:?}");
            }
        }
    }

    #[test]
    fn drops_what_no_renderer_draws() {
        let at = |z: f32| Splat { mean: [0.0, 0.0, z], opacity: 0.5, ..Splat::default() };
        let ahead = Camera { pose: Pose::IDENTITY, ..camera() };
        let splats = [
            at(1.0),
            at(0.2),
            at(-3.0),
            at(f32::NAN),
            at(f32::INFINITY),
            Splat { opacity: 0.0, ..at(2.0) },
            Splat { scale: [f32::NAN; 3], ..at(2.0) },
            at(5.0),
            at(1.0),
        ];
        let mut scratch = SortScratch::default();
        let mut order = |method, near| {
            back_to_front(&splats, &ahead, &options(method, near), &mut scratch).to_vec()
        };
        assert_eq!(order(RenderMethod::PROJECTED, 0.2), [7, 8, 0]);
        assert_eq!(order(RenderMethod::PROJECTED, -9.0), [7, 8, 0, 1]);
        assert_eq!(order(RenderMethod::EXACT, 0.2), [7, 8, 0]);
        assert_eq!(
            order(FISHEYE, 0.2),
            [7, 2, 8, 0],
            "a fisheye shows splats behind the camera plane"
        );
    }
}
