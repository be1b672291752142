//! Invalid splats, and empty or enormous scenes and viewports.

use super::compare::{TOLERANCE, error, largest_difference, oracle};
use super::device::{Gpu, PLAIN, camera, outside, random_scene};
use glam::DVec3;
use vbgs_studio::model::splat::splats::{MAX_LENGTH, Splat};
use vbgs_studio::render::{RenderMethod, RenderOptions};

#[test]
fn empty_scenes_and_viewports() {
    let Some(gpu) = Gpu::new() else { return };
    let eye = DVec3::new(4.0, -3.0, 1.0);
    let empty = gpu.image(&[], &camera(20, 10, eye, 0.8), &PLAIN);
    assert_eq!(empty.data, vec![[0.0; 4]; 200]);

    let splats = random_scene(4, 10, 0.3);
    let scene = gpu.scene(&splats);
    for (width, height) in [(0, 10), (10, 0), (0, 0), (1, 1), (30, 20), (0, 0)] {
        let mut view = camera(32, 32, eye, 0.8);
        (view.intrinsics.width, view.intrinsics.height) = (width, height);
        let image = gpu.image_of(&scene, &view, &PLAIN);
        assert_eq!((image.width, image.height), (width as usize, height as usize));
        assert_eq!(image.data.len(), (width * height) as usize);
    }
    // A scene created empty accepts splats later.
    let view = camera(32, 32, eye, 0.8);
    let mut scene = gpu.scene(&[]);
    scene.update(&gpu.device, &gpu.queue, &[], &splats).unwrap();
    let late = gpu.image_of(&scene, &view, &PLAIN);
    assert_eq!(largest_difference(&late, &gpu.image(&splats, &view, &PLAIN)), 0.0);
    gpu.assert_no_faults();
}

#[test]
fn hostile_splats_leave_the_rest_of_the_picture_alone() {
    let Some(gpu) = Gpu::new() else { return };
    let view = outside(64, 48);
    let good = random_scene(7, 80, 0.2);
    let template = good[0];
    let mut all = good.clone();
    for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        for axis in 0..3 {
            let with = |change: &dyn Fn(&mut Splat)| {
                let mut splat = template;
                change(&mut splat);
                splat
            };
            all.push(with(&|s| s.mean[axis] = bad));
            all.push(with(&|s| s.scale[axis] = bad));
            all.push(with(&|s| s.color[axis] = bad));
            all.push(with(&|s| s.rotation[axis] = bad));
            all.push(with(&|s| s.opacity = bad));
        }
    }
    all.push(Splat { rotation: [0.0; 4], ..template });
    all.push(Splat { opacity: -1.0, ..template });
    all.push(Splat { opacity: 0.0, ..template });
    all.push(Splat { opacity: 1.0 / 256.0, ..template });
    // Finite values, but their variance or position overflows f32.
    all.push(Splat { scale: [3e38; 3], ..template });
    all.push(Splat { mean: [3e38, -3e38, 3e38], ..template });
    let expected = gpu.image(&good, &view, &PLAIN);
    let found = gpu.image(&all, &view, &PLAIN);
    assert!(found.data.iter().flatten().all(|v| v.is_finite()));
    assert_eq!(largest_difference(&expected, &found), 0.0);

    // A splat of zero scale is drawn as the low-pass filter's kernel, as in f64.
    let point = Splat { scale: [0.0; 3], mean: [0.1, 0.2, 0.0], opacity: 0.9, ..template };
    let image = gpu.image(&[point], &view, &PLAIN);
    let oracle = oracle(&[point], &view, &PLAIN);
    for [i, j] in [[31, 23], [32, 24], [33, 24], [36, 24]] {
        assert!(error(image.at(i, j), &oracle.pixel(i, j)) < TOLERANCE, "{i},{j}");
    }
    gpu.assert_no_faults();
}

#[test]
fn enormous_splats_fill_the_picture() {
    let Some(gpu) = Gpu::new() else { return };
    let view = outside(40, 30);
    let wall = Splat { opacity: 0.7, color: [0.3; 3], scale: [MAX_LENGTH; 3], ..Splat::default() };
    let sheet = Splat { scale: [MAX_LENGTH, MAX_LENGTH, 1e-3], ..wall };
    for splat in [wall, sheet] {
        for method in [RenderMethod::PROJECTED, RenderMethod::EXACT] {
            let options = RenderOptions { method, ..PLAIN };
            let image = gpu.image(&[splat], &view, &options);
            let truth = oracle(&[splat], &view, &options).render();
            for (found, expected) in image.data.iter().zip(&truth.data) {
                assert!(error(found, expected) < TOLERANCE, "{method:?}: {found:?} {expected:?}");
            }
        }
    }
    gpu.assert_no_faults();
}
