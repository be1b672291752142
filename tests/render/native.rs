//! Splats with native appearance (`rendering.md`, Native appearance): the oracle against the definition,
//! the CPU renderer against the oracle.

use crate::agreement;
use crate::common::oracle::{AppearanceF64, Oracle, Sample, SplatF64};
use crate::common::ray::GaussianOnRay;
use crate::common::scenes::{
    METHODS, NATIVE_SCENES, Scene, camera, camera_of, exact, options, random_appearance,
    textured_splats,
};
use glam::{DVec2, DVec3};
use std::sync::Arc;
use vbgs_studio::math::camera::Camera;
use vbgs_studio::math::pose::Pose;
use vbgs_studio::model::scene::texels::{Observed, TextureSums};
use vbgs_studio::model::splat::appearance::{Appearance, Finishing, SplatSet, SplatView};
use vbgs_studio::model::splat::pose_log::{ExposureLog, FrameExposure};
use vbgs_studio::model::splat::splats::Splat;
use vbgs_studio::render::Exposing;
use vbgs_studio::render::cpu::CpuRenderer;
use vbgs_studio::render::finish::MARKER_COLOR;
use vbgs_studio::render::{Antialias, Lens, RenderMethod, RenderOptions, Response};

const EXACT: RenderMethod = exact(Response::Ray, Antialias::None, Lens::Pinhole);

#[test]
fn no_appearance_and_one_of_zeros_look_the_same() {
    let splats = NATIVE_SCENES[1].splats(1);
    let zeros = vec![Appearance::default(); splats.len()];
    let view = SplatView::new(&splats, &zeros).unwrap();
    for method in METHODS {
        let (camera, options) = (camera_of(method), options(method));
        let [plain, zeros] = [SplatView::from(&splats), view]
            .map(|view| Oracle::of(view, &camera, &options).render());
        assert_eq!(plain, zeros, "{method:?}");
        assert!(plain.data.iter().any(|sample| sample.rgba[3] > 0.5), "{method:?}");
    }
}

#[test]
fn whole_native_images_agree_with_the_oracle() {
    for (seed, scene) in NATIVE_SCENES.iter().enumerate() {
        let splats = scene.splats(20 + seed as u64);
        let appearance = random_appearance(&splats, 20 + seed as u64);
        let view = SplatView::new(&splats, &appearance).unwrap();
        for method in METHODS {
            let label = format!("native {} {method:?}", scene.name);
            let agreement = agreement(view, &camera_of(method), &options(method), &label);
            agreement.assert_close(0.05, &label);
            assert!(agreement.mean < 1e-5, "{label}: {agreement:?}");
            assert!(agreement.n_covered * 20 > agreement.n_pixels, "{label}: {agreement:?}");
        }
    }
}

/// Pixels count as full from a coverage of 0.4, and the exposure is that of the only frame.
#[test]
fn finished_images_agree_with_the_oracle() {
    for (seed, scene) in NATIVE_SCENES.iter().enumerate() {
        let splats = scene.splats(40 + seed as u64);
        let appearance = random_appearance(&splats, 40 + seed as u64);
        let frames = vec![FrameExposure::new(&Pose::IDENTITY, [2.0, 1.0, 0.8])];
        let finishing = Finishing {
            full_coverage: 0.4,
            exposures: Some(Arc::new(ExposureLog::new(frames, 0.1))),
            ..Finishing::default()
        };
        let set = SplatSet::new(splats, appearance).finished(finishing);
        for method in METHODS {
            let label = format!("finished {} {method:?}", scene.name);
            let options = RenderOptions { exposure_mode: Exposing::Recorded, ..options(method) };
            let camera = camera_of(method);
            let agreement = agreement(set.view(), &camera, &options, &label);
            agreement.assert_close(0.05, &label);
            let [open, closed] =
                [SplatSet::new(set.to_vec(), set.view().appearance().to_vec()), set.clone()]
                    .map(|set| Oracle::of(&set, &camera, &options).render());
            for (open, closed) in open.data.iter().zip(&closed.data) {
                let coverage = (open.rgba[3] / 0.4).min(1.0);
                assert!((closed.rgba[3] - coverage).abs() < 1e-6, "{label}");
                assert!((closed.depth - open.depth).abs() < 1e-9, "{label}");
            }
        }
    }
}

#[test]
fn textured_images_agree_with_the_oracle() {
    for seed in 60..63 {
        let mut set = textured_splats(seed);
        set.splats_mut()[0].color = MARKER_COLOR;
        let untextured = SplatSet::new(set.to_vec(), set.view().appearance().to_vec());
        for method in METHODS {
            let label = format!("textures {seed} {method:?}");
            let (camera, options) = (camera_of(method), options(method));
            let agreement = agreement(set.view(), &camera, &options, &label);
            agreement.assert_close(0.05, &label);
            assert!(agreement.mean < 1e-5, "{label}: {agreement:?}");
            let [textured, plain] =
                [&set, &untextured].map(|set| Oracle::of(set, &camera, &options).render());
            let pairs = textured.data.iter().zip(&plain.data);
            let n_changed = pairs.filter(|(a, b)| (a.rgba[0] - b.rgba[0]).abs() > 0.02).count();
            assert!(10 * n_changed > plain.data.len(), "{label}: {n_changed} pixels");
        }
    }
}

#[test]
fn textures_composed_as_they_are_read_give_the_same_picture() {
    let splats = NATIVE_SCENES[1].splats(64);
    let learned = |(id, splat): (usize, &Splat)| {
        let mut texture = TextureSums::new(splat, 0.3);
        texture.refine(1 + (id % 3) as u8);
        texture.predicted = [[1 << 24, 1 << 25 >> (id % 2)], [0, 1 << 24]];
        for i in (0..texture.index.len() * 16).filter(|i| (i / 16 + id) % 5 > 0) {
            let color = [0, 1, 2].map(|c| ((i * 37 + id * 91 + c * 400) % 1200) as i16);
            texture.open().add(&Observed {
                texel: i as u16,
                weight: 1 + (i * 29 % 256) as u16,
                color,
            });
        }
        (id % 7 > 0).then(|| Arc::new(texture))
    };
    let learned: Vec<_> = splats.iter().enumerate().map(learned).collect();
    let compose = |texture: &Option<Arc<TextureSums>>| Some(Arc::new(texture.as_ref()?.drawn()));
    let composed = Some(Arc::new(learned.iter().map(compose).collect()));
    let finishing = Finishing { textures: composed, ..Finishing::default() };
    let plain = SplatView::from(&splats);
    for method in METHODS {
        let views = [plain, plain.with_finishing(&finishing), plain.with_learned(&learned)];
        let [plain, composed, learned] =
            views.map(|view| CpuRenderer::new().render(view, &camera_of(method), &options(method)));
        assert_eq!(composed.color, learned.color, "{method:?}");
        let n_changed = plain.color.data.iter().zip(&learned.color.data).filter(|(a, b)| a != b);
        assert!(10 * n_changed.count() > plain.color.data.len(), "{method:?}");
    }
}

/// Splats with appearance, faint enough that no channel saturates over black.
fn faint(seed: u64) -> (Vec<Splat>, Vec<Appearance>) {
    let scene = Scene { opacity: (0.6, 0.6), n_splats: 60, ..NATIVE_SCENES[1] };
    let splats = scene.splats(seed);
    let appearance = random_appearance(&splats, seed);
    (splats, appearance)
}

/// Colour of the only splat in a pixel, if its alpha exceeds 0.05.
fn color(sample: Sample) -> Option<DVec3> {
    let [r, g, b, alpha] = sample.rgba;
    (alpha > 0.05).then(|| DVec3::new(r, g, b) / alpha)
}

fn alone(splat: &Splat, appearance: &Appearance, method: RenderMethod) -> Oracle {
    let view = SplatView::new(std::slice::from_ref(splat), std::slice::from_ref(appearance));
    Oracle::of(view.unwrap(), &camera(), &RenderOptions::evaluation(method, [0.0; 3]))
}

/// The gradient applies at the point of maximum response, here found by search.
#[test]
fn exact_colour_follows_the_gradient_to_the_point_of_maximum_response() {
    let camera = camera();
    let eye = camera.pose.centre();
    let (splats, appearance) = faint(2);
    let (mut worst, mut n_compared, mut n_limited) = (0f64, 0, 0);
    for (splat, appearance) in splats.iter().zip(&appearance) {
        let oracle = alone(splat, appearance, EXACT);
        let (wide, extra) = (SplatF64::from(splat), AppearanceF64::from(appearance));
        let base = wide.color + extra.directional * (wide.mean - eye).normalize();
        let base = base.clamp(DVec3::ZERO, DVec3::ONE);
        for (i, j) in (0..77).flat_map(|j| (0..107).map(move |i| (i, j))).step_by(7) {
            let Some(found) = color(oracle.pixel(i, j)) else { continue };
            let direction = camera.pose.rotation() * camera.intrinsics.ray(i, j).normalize();
            let (peak, _) = GaussianOnRay::new(&wide, eye, direction).maximum();
            let change = extra.gradient * (eye + direction * peak - wide.mean);
            n_limited += usize::from(change.abs().max_element() > 0.5);
            let limited = change.clamp(DVec3::splat(-0.5), DVec3::splat(0.5));
            let expected = (base + limited).max(DVec3::ZERO);
            worst = worst.max((found - expected).abs().max_element());
            n_compared += 1;
        }
    }
    println!("exact gradient: {n_compared} pixels, {n_limited} at the limit, worst {worst:.1e}");
    assert!(worst < 1e-6, "{worst:e}");
    assert!(n_compared > 1000 && n_limited > 50, "{n_compared} {n_limited}");
}

/// At the splat's centre, where both renderers agree, their colour slopes are equal.
#[test]
fn projected_gradient_is_tangent_to_the_exact_one() {
    let (splats, appearance) = faint(3);
    let (mut worst, mut n_compared) = (0f64, 0);
    for (splat, appearance) in splats.iter().zip(appearance) {
        let splat = Splat { color: [0.5; 3], ..*splat };
        let appearance = Appearance { directional: [[0.0; 3]; 3], ..appearance };
        let (centre, _) = camera().project(SplatF64::from(&splat).mean);
        let [projected, exact] = [RenderMethod::PROJECTED, EXACT].map(|method| {
            let oracle = alone(&splat, &appearance, method);
            let h = 1e-3;
            [DVec2::X, DVec2::Y].map(|axis| {
                let [ahead, behind] =
                    [h, -h].map(|step| color(oracle.at(centre + axis * step)).unwrap());
                (ahead - behind) / (2.0 * h)
            })
        });
        for (a, b) in projected.iter().zip(exact) {
            let size = b.abs().max_element();
            worst = worst.max((*a - b).abs().max_element() / size);
            n_compared += 1;
        }
    }
    println!("projected gradient: {n_compared} slopes, worst relative difference {worst:.1e}");
    assert!(worst < 1e-4, "{worst:e}");
}

#[test]
fn view_dependence_is_linear_in_the_direction_and_clamped() {
    let directional = [[0.3, 0.0, 0.0], [0.0, 0.0, 0.0], [-1.0, 0.0, 0.0]];
    let appearance = Appearance { directional, ..Appearance::default() };
    for method in [RenderMethod::PROJECTED, EXACT] {
        // The unit viewing direction is (x, 0, 4)/5.
        for (x, expected) in [(-3.0, [0.32, 0.5, 1.0]), (3.0, [0.68, 0.5, 0.0])] {
            let splat = Splat { mean: [x, 0.0, 4.0], ..blob() };
            let view = [splat];
            let view = SplatView::new(&view, std::slice::from_ref(&appearance)).unwrap();
            let options = RenderOptions::evaluation(method, [0.0; 3]);
            let centre = facing().project(SplatF64::from(&splat).mean).0;
            let found = color(Oracle::of(view, &facing(), &options).at(centre)).unwrap();
            let error = (found - DVec3::from_array(expected)).abs().max_element();
            assert!(error < 1e-7, "{method:?} {x}: {found}");
        }
    }
}

/// For `o > 1` the cap makes a plateau, and the support grows to √(2 ln(255·o)) deviations.
#[test]
fn opacity_over_one_has_a_flat_top() {
    let (sigma, distance) = (0.2, 4.0);
    let splat = Splat { opacity: 3.0, scale: [sigma as f32; 3], ..blob() };
    let oracle = Oracle::of(&[splat], &facing(), &RenderOptions::evaluation(EXACT, [0.0; 3]));
    let k = facing().intrinsics;
    // Isotropic closed form: D = (r/σ)·sin θ.
    let at = |deviations: f64| {
        let tangent = (deviations * f64::from(splat.scale[0]) / distance).asin().tan();
        oracle.at(DVec2::new(k.cx + k.fx * tangent, k.cy)).rgba[3]
    };
    let flat = (2.0 * (3.0f64 / 0.99).ln()).sqrt();
    let reach = (2.0 * (255.0f64 * 3.0).ln()).sqrt();
    assert!([0.0, 0.5 * flat, 0.999 * flat].map(at).iter().all(|a| (a - 0.99).abs() < 1e-12));
    assert!(at(1.01 * flat) < 0.99 - 1e-3);
    assert!((at(2.0) - 3.0 * (-2.0f64).exp()).abs() < 1e-9);
    assert!(at(0.999 * reach) > 0.0 && at(1.001 * reach) == 0.0);
}

/// Splat ahead of the camera [`facing`].
fn blob() -> Splat {
    Splat { mean: [0.0, 0.0, 4.0], color: [0.5; 3], ..crate::ball(0.6) }
}

/// Camera at the origin facing +z.
fn facing() -> Camera {
    Camera { pose: Pose::IDENTITY, ..camera() }
}
