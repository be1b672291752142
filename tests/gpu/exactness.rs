//! The exact GPU renderer against maxima found by search (`common/exactness.rs`).

use super::device::Gpu;
use crate::common::exactness::{N_SPLATS, Tolerance, check};
use vbgs_studio::model::splat::splats::Splat;

/// Half floats resolve alpha to 5e-4; real drivers add a little rounding.
const TOLERANCE: Tolerance = Tolerance { alpha: 2e-3, cut_band: 5e-3 };

#[test]
#[ignore = "half a minute or more: hundreds of pictures"]
fn no_awkward_splat_is_wrong_or_missing() {
    let Some(gpu) = Gpu::new() else { return };
    // On a slow driver, two splats of each kind per view.
    let n_splats = if gpu.is_software() { 96 } else { N_SPLATS };
    let mut renderer = gpu.renderer();
    // One scene for all splats: creating its pipelines takes longer than drawing.
    let mut scene = gpu.scene(&[Splat::default()]);
    let figures = check(
        n_splats,
        |case| {
            scene.update(&gpu.device, &gpu.queue, &[0], &[case.splat]).unwrap();
            gpu.drawn(&mut renderer, &scene, &case.camera, &case.options)
                .map(|&[.., alpha]| f64::from(alpha))
        },
        TOLERANCE,
    );
    println!("{figures:?}");
    assert_eq!(figures.n_splats, n_splats);
    assert!(figures.n_on_cut * 100 < figures.n_rays, "{figures:?}");
    gpu.assert_no_faults();
}
