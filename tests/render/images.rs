//! Whole images: the CPU renderer against the oracle, and invariance to threads, splat order and position.

use crate::common::scenes::{METHODS, SCENES, Scene, camera, camera_of, options};
use crate::{agreement, bits, draw};
use glam::DVec3;
use vbgs_studio::math::camera::Camera;
use vbgs_studio::math::pose::Pose;
use vbgs_studio::math::rng::{Purpose, Rng};
use vbgs_studio::model::splat::appearance::SplatView;
use vbgs_studio::model::splat::splats::Splat;
use vbgs_studio::render::cpu::{CpuRenderer, Rendered};
use vbgs_studio::render::{Antialias, RenderMethod, RenderOptions};

#[test]
fn whole_images_agree_with_the_oracle() {
    for (seed, scene) in SCENES.iter().enumerate() {
        for method in METHODS.into_iter().filter(|method| resolves(*method, scene)) {
            let label = format!("{} {method:?}", scene.name);
            let splats = scene.splats(seed as u64);
            let view = SplatView::from(&splats);
            let agreement = agreement(view, &camera_of(method), &options(method), &label);
            agreement.assert_close(0.01, &label);
            assert!(agreement.mean < 1e-5, "{label}: {agreement:?}");
            assert!(agreement.worst_depth < 1e-3, "{label}: {agreement:?}");
            let in_picture = agreement.n_covered * 20 > agreement.n_pixels;
            assert!(in_picture, "{label}: the scene covers too few pixels");
        }
    }
}

/// True if f32 resolves every splat. Without antialiasing, needles of a hundredth of a pixel change within
/// the rounding of a pixel's position.
fn resolves(method: RenderMethod, scene: &Scene) -> bool {
    match method {
        RenderMethod::Projected => true,
        RenderMethod::Exact(exact) => {
            exact.antialias == Antialias::Footprint || scene.scale.0 > 1e-3
        }
    }
}

#[test]
fn thread_count_and_history_do_not_show() {
    let pool = |n| rayon::ThreadPoolBuilder::new().num_threads(n).build().unwrap();
    let mut reused = CpuRenderer::new();
    for method in METHODS {
        let (camera, options) = (camera_of(method), options(method));
        for scene in SCENES {
            let splats = scene.splats(11);
            let one = pool(1).install(|| draw(&splats, &camera, &options));
            let two = pool(2).install(|| draw(&splats, &camera, &options));
            let again = pool(3).install(|| reused.render(&splats, &camera, &options));
            for other in [&two, &again] {
                assert_eq!(bits(&one), bits(other), "{} {method:?}", scene.name);
            }
        }
    }
}

fn render(splats: &[Splat]) -> Rendered {
    draw(splats, &camera(), &options(RenderMethod::PROJECTED))
}

#[test]
fn order_of_splats_with_distinct_depths_does_not_show() {
    // Enough splats for more than one chunk of the preparation.
    let scene = Scene { n_splats: 9000, radius: 0.5, ..SCENES[1] };
    let (rotation, translation) = camera().pose.inverse();
    let depth =
        |s: &Splat| (rotation * DVec3::from_array(s.mean.map(f64::from)) + translation).z as f32;
    let mut splats = scene.splats(5);
    splats.sort_by(|a, b| depth(a).total_cmp(&depth(b)));
    splats.dedup_by(|a, b| depth(a) == depth(b));
    assert!(splats.len() > 8500);
    let sorted = render(&splats);
    let mut rng = Rng::new(3, Purpose::Order, 0);
    for _ in 0..3 {
        rng.shuffle(&mut splats);
        assert_eq!(bits(&sorted), bits(&render(&splats)));
    }
}

#[test]
fn equal_depths_keep_the_order_of_the_input() {
    let facing = |color| Splat {
        mean: [0.0, 0.0, 3.0],
        opacity: 0.9,
        color,
        scale: [0.2; 3],
        rotation: [1.0, 0.0, 0.0, 0.0],
    };
    let (red, blue) = (facing([1.0, 0.0, 0.0]), facing([0.0, 0.0, 1.0]));
    for method in METHODS {
        let camera = Camera { intrinsics: camera_of(method).intrinsics, pose: Pose::IDENTITY };
        for (splats, front) in [([red, blue], 0), ([blue, red], 2)] {
            let image = draw(&splats, &camera, &RenderOptions::evaluation(method, [0.0; 3]));
            let (i, j) = (camera.intrinsics.cx as usize, camera.intrinsics.cy as usize);
            let pixel = image.color.at(i, j);
            assert!(pixel[front] > 0.8 && pixel[2 - front] < 0.2, "{method:?}: {pixel:?}");
        }
    }
}

#[test]
fn a_scene_far_from_the_origin_looks_the_same() {
    // All coordinates are multiples of 2⁻⁸, so a shift by 4096 is exact in f32.
    let dyadic = |v: f32| (v * 256.0).round() / 256.0;
    let splats: Vec<Splat> =
        SCENES[0].splats(2).into_iter().map(|s| Splat { mean: s.mean.map(dyadic), ..s }).collect();
    let far: Vec<Splat> =
        splats.iter().map(|s| Splat { mean: s.mean.map(|v| v + 4096.0), ..*s }).collect();
    for method in METHODS {
        let camera = camera_of(method);
        let eye = camera.pose.centre() + 4096.0;
        let pose = Pose::look_at(eye, DVec3::splat(4096.0), DVec3::Z).unwrap();
        let moved = draw(&far, &Camera { pose, ..camera }, &options(method));
        assert_eq!(bits(&draw(&splats, &camera, &options(method))), bits(&moved), "{method:?}");
    }
}
