//! Single splats at any position: their tiles hold every pixel that they reach.

use super::compare::{TOLERANCE, oracle};
use super::device::{Gpu, PLAIN, camera};
use crate::common::oracle::Sample;
use crate::common::scenes::{exact, random_rotation};
use glam::DVec3;
use vbgs_studio::math::image::Image;
use vbgs_studio::math::rng::{Purpose, Rng};
use vbgs_studio::model::splat::splats::Splat;
use vbgs_studio::render::{ALPHA_CUT, Antialias, Lens, RenderMethod, RenderOptions, Response};

/// Number of splats; slow software drivers draw only the first few.
const N_SPLATS: usize = 250;
const N_SPLATS_OF_SOFTWARE: usize = 45;

/// Balls, needles and pancakes in front of, behind, beside and around the camera.
fn splats(n: usize) -> Vec<Splat> {
    let mut rng = Rng::new(31, Purpose::Synthetic, 0);
    (0..n)
        .map(|i| {
            let reach = rng.range(0.3, 4.0);
            let size = reach * 10f64.powf(rng.range(-2.0, 0.3));
            let thin = size * 10f64.powf(rng.range(-2.0, -0.5));
            let scale = [[size, size, size], [size, thin, thin], [size, size, thin]][i % 3];
            Splat {
                mean: [0; 3].map(|_| (reach * rng.range(-1.0, 1.0)) as f32),
                opacity: rng.range(0.3, 2.0) as f32,
                color: [1.0; 3],
                scale: scale.map(|s| s as f32),
                rotation: random_rotation(&mut rng),
            }
        })
        .collect()
}

#[test]
fn no_pixel_of_a_splat_is_outside_its_tiles() {
    let Some(gpu) = Gpu::new() else { return };
    let n_splats = if gpu.is_software() { N_SPLATS_OF_SOFTWARE } else { N_SPLATS };
    let narrow = camera(60, 44, DVec3::new(0.2, -0.1, 0.1), 1.2);
    let wide = camera(60, 44, DVec3::new(0.2, -0.1, 0.1), 150f64.to_radians());
    let mut fisheye = narrow;
    (fisheye.intrinsics.fx, fisheye.intrinsics.fy) = (13.0, 11.0);
    let mut scene = gpu.scene(&[Splat::default()]);
    for (name, view, method) in [
        ("projected", narrow, RenderMethod::PROJECTED),
        ("exact", narrow, exact(Response::Ray, Antialias::None, Lens::Pinhole)),
        ("exact, wide", wide, RenderMethod::EXACT),
        ("fisheye", fisheye, exact(Response::Ray, Antialias::Footprint, Lens::Fisheye)),
    ] {
        let options = RenderOptions { method, ..PLAIN };
        let is_whole = |splat: &&Splat| {
            scene.update(&gpu.device, &gpu.queue, &[0], &[**splat]).unwrap();
            let image = gpu.image_of(&scene, &view, &options);
            let truth = oracle(&[**splat], &view, &options).render();
            assert_whole(&image, &truth, &format!("{name}: {splat:?}"));
            truth.data.iter().any(|sample| sample.rgba[3] > 0.0)
        };
        let n_seen = splats(n_splats).iter().filter(is_whole).count();
        println!("{name}: {n_seen} of {n_splats} visible, none clipped");
        assert!(n_seen * 4 > n_splats, "{name}: {n_seen} in sight");
    }
    gpu.assert_no_faults();
}

fn assert_whole(image: &Image<[f32; 4]>, truth: &Image<Sample>, label: &str) {
    for (index, (found, expected)) in image.data.iter().zip(&truth.data).enumerate() {
        let (alpha, at) = (expected.rgba[3], [index % image.width, index / image.width]);
        let found = f64::from(found[3]);
        // Rounding in f32 shifts the alpha cut a little.
        let at_cut = found.min(alpha) == 0.0 && found.max(alpha) < ALPHA_CUT * 1.01;
        assert!(at_cut || (found > 0.0) == (alpha > 0.0), "{label} {at:?}: {found} for {alpha}");
        assert!((found - alpha).abs() < TOLERANCE, "{label} {at:?}: {found} for {alpha}");
    }
}
