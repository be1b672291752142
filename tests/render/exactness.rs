//! The exact renderer against response maxima found by search (see `common/exactness.rs`).

use crate::common::exactness::{Figures, N_SPLATS, Tolerance, check};
use crate::common::oracle::Oracle;
use vbgs_studio::render::cpu::CpuRenderer;

#[test]
fn the_oracle_is_exact() {
    let tolerance = Tolerance { alpha: 1e-9, cut_band: 1e-9 };
    let figures = check(
        N_SPLATS,
        |case| {
            let oracle = Oracle::of(&[case.splat], &case.camera, &case.options);
            oracle.render().map(|sample| sample.rgba[3])
        },
        tolerance,
    );
    report("oracle", &figures);
}

/// The tolerance follows `rendering.md`, Rational conic: the rational form in f32 errs by up to 1.9e-5.
#[test]
fn the_cpu_renderer_is_exact() {
    let tolerance = Tolerance { alpha: 2e-5, cut_band: 1e-3 };
    let mut renderer = CpuRenderer::new();
    let figures = check(
        N_SPLATS,
        |case| {
            let image = renderer.render(&[case.splat], &case.camera, &case.options);
            image.coverage.map(|alpha| f64::from(*alpha))
        },
        tolerance,
    );
    report("CPU", &figures);
}

fn report(name: &str, figures: &Figures) {
    println!("{name}: {figures:?}");
    assert_eq!(figures.n_splats, N_SPLATS);
    assert!(figures.n_rays > 100_000 && figures.n_integrated > 50_000, "{figures:?}");
    assert!(figures.n_on_cut * 1000 < figures.n_rays, "{figures:?}");
}
