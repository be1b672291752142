//! Display options: styles and paints.

use super::compare::{assert_close, largest_difference, oracle};
use super::device::{Gpu, PLAIN, outside, random_scene};
use crate::common::scenes::random_appearance;
use vbgs_studio::model::splat::appearance::SplatView;
use vbgs_studio::render::finish::MARKER_COLOR;
use vbgs_studio::render::{DisplayStyle, Paint, RenderMethod, RenderOptions};

/// Two compilations of the same formulas may differ by one step of a half float.
const ROUNDING: f32 = 1e-3;

#[test]
fn looks_and_paints_agree_with_the_oracle() {
    let Some(gpu) = Gpu::new() else { return };
    let view = outside(61, 45);
    let mut splats = random_scene(14, 200, 0.2);
    // Marked splats keep their colour under every paint.
    splats.iter_mut().step_by(7).for_each(|splat| splat.color = MARKER_COLOR);
    let appearance = random_appearance(&splats, 14);
    let native = SplatView::new(&splats, &appearance).unwrap();
    let looks = [
        DisplayStyle { scale: 0.5, ..DisplayStyle::PLAIN },
        DisplayStyle { scale: 2.0, opacity_cut: 0.5, ..DisplayStyle::PLAIN },
        DisplayStyle { paint: Paint::Depth([3.0, 7.0]), ..DisplayStyle::PLAIN },
        DisplayStyle { paint: Paint::Normal, ..DisplayStyle::PLAIN },
    ];
    for method in [RenderMethod::PROJECTED, RenderMethod::EXACT] {
        let plain = gpu.image(native, &view, &RenderOptions { method, ..PLAIN });
        for look in looks {
            let options = RenderOptions { method, style: look, ..PLAIN };
            let image = gpu.image(native, &view, &options);
            let label = format!("{method:?} {look:?}");
            assert_close(&image, &oracle(native, &view, &options), &label);
            assert!(largest_difference(&image, &plain) > 0.1, "{label}: nothing changed");
        }
        let painted = RenderOptions { method, style: looks[3], ..PLAIN };
        let difference = largest_difference(
            &gpu.image(native, &view, &painted),
            &gpu.image(&splats, &view, &painted),
        );
        assert!(difference < ROUNDING, "{method:?}: {difference}: a paint hides the appearance");
    }
    gpu.assert_no_faults();
}

#[test]
fn an_appearance_of_zeros_is_none() {
    let Some(gpu) = Gpu::new() else { return };
    let view = outside(61, 45);
    let splats = random_scene(16, 200, 0.2);
    let zeros = vec![Default::default(); splats.len()];
    let native = SplatView::new(&splats, &zeros).unwrap();
    for method in [RenderMethod::PROJECTED, RenderMethod::EXACT] {
        let options = RenderOptions { method, ..PLAIN };
        let plain = gpu.image(&splats, &view, &options);
        let difference = largest_difference(&plain, &gpu.image(native, &view, &options));
        assert!(difference < ROUNDING, "{method:?}: {difference}");
        assert!(plain.data.iter().any(|p| p[3] > 0.5), "some pixels are covered");
    }
}
