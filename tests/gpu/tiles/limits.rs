//! More tile entries than the buffers hold, and the error reported for it.

use crate::common::oracle::Oracle;
use crate::compare::{TOLERANCE, error, largest_difference};
use crate::device::{Gpu, camera};
use glam::DVec3;
use vbgs_studio::math::camera::Camera;
use vbgs_studio::math::image::Image;
use vbgs_studio::model::splat::splats::Splat;
use vbgs_studio::render::gpu::GpuError;
use vbgs_studio::render::gpu::renderer::SplatRenderer;
use vbgs_studio::render::gpu::scene::GpuScene;
use vbgs_studio::render::{RenderMethod, RenderOptions};

/// Splats that each cover the whole image, one behind the other.
fn curtains(n: usize, opacity: f32) -> Vec<Splat> {
    (0..n)
        .map(|i| Splat {
            mean: [0.0, 1e-4 * i as f32, 0.0],
            opacity,
            color: [(i % 3) as f32 / 2.0, (i % 5) as f32 / 4.0, (i % 7) as f32 / 6.0],
            scale: [100.0, 0.01, 100.0],
            rotation: [1.0, 0.0, 0.0, 0.0],
        })
        .collect()
}

/// Draws until the entry buffer has grown to the size it needs.
fn settled(
    gpu: &Gpu,
    renderer: &mut SplatRenderer,
    scene: &GpuScene,
    camera: &Camera,
    options: &RenderOptions,
) -> Image<[f32; 4]> {
    for _ in 0..4 {
        gpu.drawn(renderer, scene, camera, options);
    }
    gpu.drawn(renderer, scene, camera, options)
}

#[test]
fn room_for_entries_grows_after_the_image_that_needed_more() {
    let Some(gpu) = Gpu::new() else { return };
    // 1200 tiles by 150 splats; the first buffer holds 65,536 entries.
    let view = camera(640, 480, DVec3::new(0.0, -5.0, 0.0), 0.8);
    let options = RenderOptions::evaluation(RenderMethod::PROJECTED, [0.0; 3]);
    let splats = curtains(150, 0.02);
    let scene = gpu.scene(&splats);
    let mut renderer = gpu.renderer();
    let first = gpu.drawn(&mut renderer, &scene, &view, &options);
    assert!(first.data.iter().flatten().all(|v| v.is_finite()));
    let last = settled(&gpu, &mut renderer, &scene, &view, &options);
    assert!(largest_difference(&first, &last) > 0.1, "the farthest splats did not fit");
    // A few pixels are enough, because every splat covers all of them.
    let oracle = Oracle::of(&splats, &view, &options);
    for [i, j] in [[0, 0], [639, 0], [320, 240], [13, 467], [639, 479]] {
        let (found, expected) = (last.at(i, j), oracle.pixel(i, j));
        assert!(error(found, &expected) < TOLERANCE, "{i},{j}: {found:?} for {expected:?}");
    }
    assert_eq!(renderer.shortage(), None);
    gpu.assert_no_faults();
}

#[test]
fn what_no_buffer_holds_is_said_and_the_nearest_are_drawn() {
    // 4 MiB hold 524,288 entries; 900 splats need 1,080,000.
    let Some(gpu) = Gpu::with_buffers_up_to(4 << 20) else { return };
    let view = camera(640, 480, DVec3::new(0.0, -5.0, 0.0), 0.8);
    let options = RenderOptions::evaluation(RenderMethod::PROJECTED, [0.0; 3]);
    let splats = curtains(900, 0.05);
    let scene = gpu.scene(&splats);
    let mut renderer = gpu.renderer();
    let image = settled(&gpu, &mut renderer, &scene, &view, &options);
    let expected = GpuError::TooManyEntries { needed: 1_080_000, capacity: 524_288 };
    assert_eq!(renderer.shortage(), Some(&expected));
    // The 400 nearest saturate every pixel, so the others are not visible.
    let nearest = gpu.scene(&splats[..400]);
    let whole = settled(&gpu, &mut gpu.renderer(), &nearest, &view, &options);
    assert_eq!(largest_difference(&image, &whole), 0.0);
    gpu.assert_no_faults();
}

#[test]
fn ten_thousand_splats_over_the_whole_image_end() {
    let Some(gpu) = Gpu::new() else { return };
    let view = camera(64, 48, DVec3::new(0.0, -5.0, 0.0), 0.8);
    let options = RenderOptions::evaluation(RenderMethod::EXACT, [0.0; 3]);
    // Opacity just above the cut, so that pixels saturate only after thousands of splats; then opaque.
    for opacity in [0.004, 1.0] {
        let splats = curtains(10_000, opacity);
        let scene = gpu.scene(&splats);
        let image = settled(&gpu, &mut gpu.renderer(), &scene, &view, &options);
        // One opaque splat covers 0.99, so the second falls below the transmittance stop.
        let full = image.data.iter().all(|p| p[3] > 0.98 && p.iter().all(|v| v.is_finite()));
        assert!(full, "opacity {opacity}: {:?}", image.at(32, 24));
    }
    gpu.assert_no_faults();
}
