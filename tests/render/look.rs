//! Display styles of the viewer: the oracle against the definition, the CPU renderer against the oracle.

use crate::common::oracle::{Oracle, Sample};
use crate::common::scenes::{METHODS, SCENES, camera_of, options, random_appearance};
use crate::{agreement, ball};
use vbgs_studio::math::camera::Camera;
use vbgs_studio::math::image::Image;
use vbgs_studio::math::pose::Pose;
use vbgs_studio::model::splat::appearance::SplatView;
use vbgs_studio::model::splat::splats::Splat;
use vbgs_studio::render::{DisplayStyle, Paint, RenderMethod, RenderOptions, finish};

fn image<'a>(
    splats: impl Into<SplatView<'a>>,
    method: RenderMethod,
    look: DisplayStyle,
) -> Image<Sample> {
    let options = RenderOptions { style: look, ..options(method) };
    Oracle::of(splats, &camera_of(method), &options).render()
}

#[test]
fn scale_and_opacity_cut_are_what_they_say() {
    let splats = SCENES[1].splats(4);
    let large: Vec<Splat> =
        splats.iter().map(|s| Splat { scale: s.scale.map(|v| 2.0 * v), ..*s }).collect();
    let solid: Vec<Splat> = splats.iter().filter(|s| s.opacity >= 0.3).copied().collect();
    assert!(!solid.is_empty() && solid.len() < splats.len());
    for method in METHODS {
        let scaled = image(&splats, method, DisplayStyle { scale: 2.0, ..DisplayStyle::PLAIN });
        assert_eq!(scaled, image(&large, method, DisplayStyle::PLAIN), "{method:?}");
        let cut = image(&splats, method, DisplayStyle { opacity_cut: 0.3, ..DisplayStyle::PLAIN });
        assert_eq!(cut, image(&solid, method, DisplayStyle::PLAIN), "{method:?}");
        assert_ne!(cut, scaled);
    }
}

#[test]
fn whole_changed_images_agree_with_the_oracle() {
    let looks = [
        DisplayStyle { scale: 1.7, ..DisplayStyle::PLAIN },
        DisplayStyle { opacity_cut: 0.3, ..DisplayStyle::PLAIN },
        DisplayStyle { paint: Paint::Depth([2.0, 5.0]), ..DisplayStyle::PLAIN },
        DisplayStyle { scale: 0.6, opacity_cut: 0.1, paint: Paint::Normal },
    ];
    let mut splats = SCENES[1].splats(9);
    splats.iter_mut().step_by(7).for_each(|splat| splat.color = finish::MARKER_COLOR);
    let appearance = random_appearance(&splats, 9);
    let view = SplatView::new(&splats, &appearance).unwrap();
    for method in METHODS {
        for look in looks {
            let options = RenderOptions { style: look, ..options(method) };
            let label = format!("{look:?} {method:?}");
            let agreement = agreement(view, &camera_of(method), &options, &label);
            agreement.assert_close(0.01, &label);
            assert!(agreement.mean < 1e-5, "{label}: {agreement:?}");
        }
    }
}

/// Colour at the centre of one splat, 4 units ahead of a camera facing +z.
fn painted(splat: Splat, method: RenderMethod, paint: Paint) -> [f64; 3] {
    let splat = Splat { mean: [0.0, 0.0, 4.0], ..splat };
    let camera = Camera { pose: Pose::IDENTITY, ..camera_of(method) };
    let options = RenderOptions {
        style: DisplayStyle { paint, ..DisplayStyle::PLAIN },
        ..RenderOptions::evaluation(method, [0.0; 3])
    };
    let view = [splat];
    let appearance = random_appearance(&view, 1);
    let view = SplatView::new(&view, &appearance).unwrap();
    let centre = glam::DVec2::new(camera.intrinsics.cx, camera.intrinsics.cy);
    let [r, g, b, alpha] = Oracle::of(view, &camera, &options).at(centre).rgba;
    [r, g, b].map(|v| v / alpha)
}

fn assert_color(found: [f64; 3], expected: [f32; 3], label: &str) {
    let worst = found.iter().zip(expected).map(|(f, e)| (f - f64::from(e)).abs());
    assert!(worst.fold(0.0, f64::max) < 1e-6, "{label}: {found:?} for {expected:?}");
}

#[test]
fn a_mark_is_seen_under_every_paint() {
    for method in METHODS {
        for paint in [Paint::Depth([0.0, 8.0]), Paint::Normal] {
            let marked = Splat { color: finish::MARKER_COLOR, ..ball(0.9) };
            assert_color(
                painted(marked, method, paint),
                finish::MARKER_COLOR,
                &format!("{method:?}"),
            );
        }
    }
}

#[test]
fn depth_is_painted_by_distance() {
    for method in METHODS {
        for ([near, far], share) in [([0.0, 8.0], 0.5), ([3.0, 5.0], 0.5), ([5.0, 9.0], 0.0)] {
            let found = painted(ball(0.9), method, Paint::Depth([near, far]));
            assert_color(found, finish::ramp(share), &format!("{method:?} {near} {far}"));
        }
    }
}

#[test]
fn normals_are_the_shortest_axis_towards_the_camera() {
    // A quarter turn about x maps y to z.
    let quarter = std::f32::consts::FRAC_1_SQRT_2;
    let cases = [
        ([0.3, 0.2, 0.1], [1.0, 0.0, 0.0, 0.0], [0.5, 0.5, 0.0]),
        ([0.3, 0.1, 0.2], [quarter, quarter, 0.0, 0.0], [0.5, 0.5, 0.0]),
        // Turned by 180° about y: the axis points away from the camera and is flipped.
        ([0.3, 0.2, 0.1], [0.0, 0.0, 1.0, 0.0], [0.5, 0.5, 0.0]),
    ];
    for method in METHODS {
        for (scale, rotation, expected) in cases {
            let splat = Splat { scale, rotation, ..ball(0.9) };
            let found = painted(splat, method, Paint::Normal);
            assert_color(found, expected, &format!("{method:?} {rotation:?}"));
        }
    }
    // Of equal axes the first counts; edge-on, either sign is correct.
    let found = painted(ball(0.9), METHODS[0], Paint::Normal);
    assert!([0.0, 1.0].iter().any(|red| (found[0] - red).abs() < 1e-6), "{found:?}");
}
