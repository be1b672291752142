//! The exact renderer of the GPU against maxima found by search (see `common/exactness.rs`).

use super::device::Gpu;
use crate::common::exactness::{N_SPLATS, Tolerance, check};
use vbgs_studio::model::splat::splats::Splat;
use vbgs_studio::render::gpu::DrawPath;

/// Half floats hold alpha to 5e-4; a real driver's arithmetic adds a little.
const TOLERANCE: Tolerance = Tolerance { alpha: 2e-3, cut_band: 5e-3 };

#[test]
#[ignore = "half a minute or more: more than a thousand pictures"]
fn no_awkward_splat_is_wrong_or_missing() {
    let Some(gpu) = Gpu::new() else { return };
    // By tiles five of every kind in every view: cores draw one of those in a sixth of a second, most of it
    // for workgroups that find nothing to do.
    for (path, n_splats) in [(DrawPath::Quads, N_SPLATS), (DrawPath::Tiles, 240)] {
        let mut renderer = gpu.renderer();
        renderer.set_path(path);
        // One scene throughout: its pipelines take longer than a picture.
        let mut scene = gpu.scene(&[Splat::default()]);
        let figures = check(
            n_splats,
            |case| {
                let splats = [case.splat];
                scene.update(&gpu.device, &gpu.queue, &[0], &splats).unwrap();
                gpu.draw(&mut renderer, &mut scene, &splats, &case.camera, &case.options);
                gpu.read(&renderer).map(|&[.., alpha]| f64::from(alpha))
            },
            TOLERANCE,
        );
        println!("{path}: {figures:?}");
        assert_eq!(figures.n_splats, n_splats);
        assert!(figures.n_on_cut * 100 < figures.n_rays, "{figures:?}");
    }
    gpu.assert_no_faults();
}
