//! Back-to-front order of the visible splats, computed on a CPU thread off the frame path.

use crate::math::camera::Camera;
use crate::model::splats::Splat;
use glam::DVec3;

const DIGIT_BITS: u32 = 11;
const N_BUCKETS: usize = 1 << DIGIT_BITS;
/// Three digits cover the 32 bits of a key.
const N_PASSES: usize = 3;

/// Memory reused from sort to sort.
#[derive(Debug, Default)]
pub struct SortScratch {
    /// Key in the upper half, splat index in the lower.
    entries: Vec<u64>,
    swap: Vec<u64>,
    order: Vec<u32>,
}

/// Indices of the drawable splats with view depth `z > near` (world units, ≥ 0), farthest first. Ties
/// put the later splat first, since the earlier one is in front (`rendering.md` (b) 7). Indices are
/// u32: at most 2³² splats.
pub fn back_to_front<'a>(
    splats: &[Splat],
    camera: &Camera,
    near: f32,
    scratch: &'a mut SortScratch,
) -> &'a [u32] {
    let (forward, centre) = (camera.pose.forward(), camera.pose.centre());
    scratch.entries.clear();
    scratch.entries.extend(splats.iter().enumerate().rev().filter_map(|(index, splat)| {
        let depth = (DVec3::from_array(splat.mean.map(f64::from)) - centre).dot(forward) as f32;
        let visible = depth > near.max(0.0) && splat.is_drawable();
        visible.then(|| u64::from(far_first_key(depth)) << 32 | index as u64)
    }));
    radix_sort(&mut scratch.entries, &mut scratch.swap);
    scratch.order.clear();
    scratch.order.extend(scratch.entries.iter().map(|&entry| entry as u32));
    &scratch.order
}

/// Bits of positive floats compare as integers; inverted, the farthest comes first.
fn far_first_key(depth: f32) -> u32 {
    !depth.to_bits()
}

/// Stable LSD radix sort by the upper 32 bits; the result is in `entries`.
fn radix_sort(entries: &mut Vec<u64>, swap: &mut Vec<u64>) {
    let mut counts = [[0usize; N_BUCKETS]; N_PASSES];
    for &entry in entries.iter() {
        for (pass, count) in counts.iter_mut().enumerate() {
            count[digit(entry, pass)] += 1;
        }
    }
    swap.resize(entries.len(), 0);
    for (pass, count) in counts.iter_mut().enumerate() {
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

    fn camera() -> Camera {
        Camera {
            intrinsics: Intrinsics::from_horizontal_fov(64, 48, 1.0),
            pose: Pose::look_at(DVec3::new(3.0, -2.0, 1.0), DVec3::ZERO, DVec3::Z).unwrap(),
        }
    }

    fn depth(splat: &Splat, camera: &Camera) -> f32 {
        let from_camera = DVec3::from_array(splat.mean.map(f64::from)) - camera.pose.centre();
        from_camera.dot(camera.pose.forward()) as f32
    }

    #[test]
    fn agrees_with_a_stable_sort_at_every_size() {
        let mut scratch = SortScratch::default();
        for (seed, n) in [(0, 0), (1, 1), (2, 2), (3, 1000), (4, 40_000), (5, 37)] {
            let mut rng = Rng::new(seed, Purpose::Synthetic, 0);
            // A coarse grid makes many exact ties; a wide one spans 30 binary orders.
            let splats: Vec<Splat> = (0..n)
                .map(|_| {
                    let reach = 2f64.powi(rng.below(30) as i32 - 10);
                    let mut at = || (rng.range(-4.0, 4.0).round() * reach) as f32;
                    Splat { mean: [at(), at(), at()], opacity: 0.5, ..Splat::default() }
                })
                .collect();
            let ours = back_to_front(&splats, &camera(), 0.2, &mut scratch).to_vec();
            let key = |i: &u32| depth(&splats[*i as usize], &camera());
            let mut stable: Vec<u32> = (0..n as u32).rev().filter(|i| key(i) > 0.2).collect();
            stable.sort_by(|a, b| key(b).total_cmp(&key(a)));
            assert_eq!(ours, stable, "{n} splats");
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
        assert_eq!(back_to_front(&splats, &ahead, 0.2, &mut scratch), [7, 8, 0]);
        assert_eq!(back_to_front(&splats, &ahead, -9.0, &mut scratch), [7, 8, 0, 1]);
    }
}
