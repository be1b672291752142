//! Invalid and extreme splats and cameras.

use crate::common::scenes::{METHODS, SCENES, camera, camera_of, options};
use crate::{ball, bits, draw};
use glam::DVec3;
use proptest::prelude::*;
use vbgs_studio::math::camera::{Camera, Intrinsics};
use vbgs_studio::math::pose::Pose;
use vbgs_studio::model::splat::splats::{MAX_LENGTH, Splat};
use vbgs_studio::render::cpu::Rendered;
use vbgs_studio::render::{RenderMethod, RenderOptions, Response};

fn is_empty(image: &Rendered, background: [f32; 3]) -> bool {
    let planes = image.coverage.data.iter().chain(&image.depth.data);
    image.color.data.iter().all(|c| *c == background) && planes.copied().all(|v| v == 0.0)
}

#[test]
fn nothing_to_draw_is_background() {
    let behind = Splat { mean: [9.0, -9.0, 2.0], ..ball(0.9) };
    for method in METHODS {
        let (view, options) = (camera_of(method), options(method));
        for splats in [&[][..], &[Splat::default(); 3000], &[ball(0.003)], &[behind]] {
            let image = draw(splats, &view, &options);
            assert!(is_empty(&image, options.background), "{method:?} {:?}", splats.first());
            assert_eq!(image.n_invalid, 0);
        }
        for (width, height) in [(0, 0), (0, 5), (5, 0)] {
            let mut camera = view;
            (camera.intrinsics.width, camera.intrinsics.height) = (width, height);
            let image = draw(&[ball(0.9)], &camera, &options);
            assert_eq!((image.color.width, image.color.height), (width as usize, height as usize));
            assert!(image.color.data.is_empty() && image.depth.data.is_empty());
        }
    }
}

#[test]
fn broken_splats_are_counted_and_not_drawn() {
    let sound = ball(0.9);
    let broken = [
        Splat { mean: [0.0, f32::NAN, 0.0], ..sound },
        Splat { mean: [0.0, 0.0, 2.0 * MAX_LENGTH], ..sound },
        Splat { opacity: f32::NAN, ..sound },
        Splat { opacity: f32::INFINITY, ..sound },
        Splat { color: [f32::NEG_INFINITY, 0.0, 0.0], ..sound },
        Splat { scale: [0.0; 3], ..sound },
        Splat { scale: [1.0, 1.0, -0.1], ..sound },
        Splat { scale: [1e15, 0.1, 0.1], ..sound },
        Splat { scale: [0.1, f32::NAN, 0.1], ..sound },
        Splat { rotation: [0.0; 4], ..sound },
        Splat { rotation: [2.0, 0.0, 0.0, 0.0], ..sound },
        Splat { rotation: [f32::NAN, 0.0, 0.0, 1.0], ..sound },
    ];
    for method in METHODS {
        let (camera, options) = (camera_of(method), options(method));
        for splat in broken {
            let image = draw(&[splat], &camera, &options);
            assert!(is_empty(&image, options.background), "{method:?}: {splat:?}");
            assert_eq!(image.n_invalid, 1, "{method:?}: {splat:?}");
        }
    }
}

#[test]
fn extreme_splats_draw_what_the_formulas_say() {
    for method in [RenderMethod::PROJECTED, RenderMethod::EXACT] {
        assert_extremes(|splats| draw(splats, &camera(), &options(method)));
    }
}

fn assert_extremes(render: impl Fn(&[Splat]) -> Rendered) {
    // A splat much larger than the scene covers every pixel with its opacity. One of scale 0 is a point
    // that the low-pass widens to a variance of 0.3 px².
    let centre = |image: &Rendered| *image.coverage.at(58, 38);
    for scale in [1e4, 1e8, MAX_LENGTH] {
        let veil = render(&[Splat { scale: [scale; 3], ..ball(0.6) }]);
        assert!(veil.coverage.data.iter().all(|a| (a - 0.6).abs() < 1e-3), "{scale:e}");
    }
    for scale in [[0.0, 0.0, 1e-30], [1e-30; 3]] {
        let point = render(&[Splat { scale, ..ball(0.9) }]);
        assert!(centre(&point) > 0.3, "{scale:?}: {}", centre(&point));
        assert!(point.coverage.data.iter().filter(|a| **a > 0.0).count() < 16);
    }
    for opacity in [1e3, 1e30, f32::MAX] {
        let disc = render(&[ball(opacity)]);
        assert!((centre(&disc) - 0.99).abs() < 1e-6);
        assert!(disc.coverage.data.iter().all(|a| (0.0..=0.9901).contains(a)), "{opacity:e}");
    }
    let inside = Splat { mean: [1.9, -2.3, 0.9], scale: [2.0; 3], ..ball(0.6) };
    assert!(render(&[inside]).coverage.data.iter().all(|a| (0.3..=0.6001).contains(a)));
    let bright = Splat { color: [9.0, -9.0, 0.5], scale: [50.0; 3], ..ball(0.9) };
    let [r, g, b] = *render(&[bright]).color.at(58, 38);
    assert_eq!(r, 1.0);
    assert!((g - 0.05).abs() < 1e-4 && (b - 0.54).abs() < 1e-4, "{g} {b}");
}

/// Any number, often an extreme or non-finite one.
fn number() -> impl Strategy<Value = f32> {
    prop_oneof![
        6 => -3.0f32..3.0,
        1 => any::<f32>(),
        1 => proptest::sample::select(vec![
            0.0, -0.0, f32::NAN, f32::INFINITY, f32::NEG_INFINITY, f32::MAX, f32::MIN_POSITIVE,
            1e30, -1e30, 1e-40,
        ]),
    ]
}

fn hostile_splat() -> impl Strategy<Value = Splat> {
    let unit = proptest::array::uniform3(0f32..1.0);
    let vector = || proptest::array::uniform3(number());
    let scale = prop_oneof![3 => proptest::array::uniform3(0f32..3.0), 1 => vector()];
    let normalized = |q: [f32; 4]| {
        let length = q.iter().map(|v| v * v).sum::<f32>().sqrt();
        q.map(|v| v / length)
    };
    let turn = prop_oneof![
        4 => proptest::array::uniform4(-1f32..1.0).prop_map(normalized),
        1 => proptest::array::uniform4(-1f32..1.0),
        1 => proptest::array::uniform4(number()),
        1 => Just([0.0; 4]),
    ];
    let color = prop_oneof![3 => unit, 1 => vector()];
    let opacity = prop_oneof![3 => 0f32..1.0, 1 => number()];
    (vector(), opacity, color, scale, turn).prop_map(|(mean, opacity, color, scale, rotation)| {
        Splat { mean, opacity, color, scale, rotation }
    })
}

/// True for an invalid splat that is not an empty slot.
fn is_broken(splat: &Splat) -> bool {
    let is_slot = splat.opacity <= 0.0;
    !is_slot && !splat.is_valid()
}

proptest! {
    // No file of counterexamples: they become cases of the tests above.
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn hostile_splats_neither_break_the_image_nor_touch_the_others(
        hostile in proptest::collection::vec(hostile_splat(), 0..40),
        near in prop_oneof![Just(0.2), Just(0.0), Just(-1.0), Just(1e-30)],
        method in proptest::sample::select(METHODS.to_vec()),
        inside in any::<bool>(),
    ) {
        let mut camera = camera_of(method);
        if inside {
            camera.pose = Pose::look_at(DVec3::new(0.1, 0.2, 0.0), DVec3::X, DVec3::Z).unwrap();
        }
        let options = RenderOptions { near, ..options(method) };
        let image = draw(&hostile, &camera, &options);
        prop_assert!(image.color.data.as_flattened().iter().all(|v| (0.0..=1.0).contains(v)));
        prop_assert!(image.coverage.data.iter().all(|v| (0.0..=0.9999).contains(v)));
        let looks_behind = matches!(method, RenderMethod::Exact(e) if e.response == Response::Line);
        let in_front = |depth: f32| depth.is_finite() && (looks_behind || depth >= 0.0);
        prop_assert!(image.depth.data.iter().all(|depth| in_front(*depth)));
        prop_assert_eq!(image.n_invalid, hostile.iter().filter(|s| is_broken(s)).count());

        let sound: Vec<Splat> = hostile.into_iter().filter(Splat::is_drawable).collect();
        prop_assert_eq!(bits(&image), bits(&draw(&sound, &camera, &options)));
    }

    #[test]
    fn hostile_cameras_end(
        values in proptest::array::uniform4(number()),
        size in 1u32..70,
        method in proptest::sample::select(METHODS.to_vec()),
    ) {
        let [fx, fy, cx, cy] = values.map(f64::from);
        let intrinsics = Intrinsics { width: size, height: 33, fx, fy, cx, cy };
        let camera = Camera { intrinsics, pose: camera().pose };
        let image = draw(&SCENES[1].splats(1)[..50], &camera, &options(method));
        prop_assert!(image.color.data.as_flattened().iter().all(|v| (0.0..=1.0).contains(v)));
    }
}
