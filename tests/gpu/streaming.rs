//! Uploads: changed records only, growth and shrinking.

use super::compare::largest_difference;
use super::device::{Gpu, PLAIN, outside, random_scene};
use crate::common::scenes::random_appearance;
use vbgs_studio::model::splat::appearance::{Appearance, SplatView};
use vbgs_studio::model::splat::splats::Splat;

#[test]
fn sparse_updates_equal_a_whole_upload() {
    let Some(gpu) = Gpu::new() else { return };
    let view = outside(80, 60);
    let mut splats = random_scene(5, 1000, 0.1);
    let mut scene = gpu.scene(&splats);
    assert_eq!((scene.n_splats(), scene.capacity()), (1000, 1000));

    let others = random_scene(6, 1300, 0.2);
    let changed: Vec<u32> = (0..150).map(|i| (i * 37) % 1000).chain([7, 7]).collect();
    for &id in &changed {
        splats[id as usize] = others[id as usize];
    }
    // Ids past the end come from a dirty list older than the scene; they are ignored.
    let stale: Vec<u32> = changed[..140].iter().copied().chain([1000, u32::MAX]).collect();
    let bytes = scene.update(&gpu.device, &gpu.queue, &stale, &splats).unwrap();
    assert_eq!(bytes, 140 * 80, "140 of 1000 splats are uploaded as sparse records");
    let bytes = scene.update(&gpu.device, &gpu.queue, &changed[140..], &splats).unwrap();
    assert_eq!(bytes, 12 * 80);
    let sparse = gpu.image_of(&scene, &view, &PLAIN);
    assert_eq!(largest_difference(&sparse, &gpu.image(&splats, &view, &PLAIN)), 0.0);

    assert_eq!(scene.update(&gpu.device, &gpu.queue, &[], &splats).unwrap(), 0);
    let many: Vec<u32> = (0..200).collect();
    assert_eq!(scene.update(&gpu.device, &gpu.queue, &many, &splats).unwrap(), 64_000);

    // The new capacity fits 50 more.
    splats.extend_from_slice(&others[1000..1001]);
    assert_eq!(scene.update(&gpu.device, &gpu.queue, &[], &splats).unwrap(), 64 * 1001);
    assert_eq!(scene.capacity(), 1500);
    splats.extend_from_slice(&others[1001..1051]);
    assert_eq!(scene.update(&gpu.device, &gpu.queue, &[], &splats).unwrap(), 50 * 80);
    let grown = gpu.image_of(&scene, &view, &PLAIN);
    assert_eq!(largest_difference(&grown, &gpu.image(&splats, &view, &PLAIN)), 0.0);

    splats.truncate(900);
    scene.update(&gpu.device, &gpu.queue, &[], &splats).unwrap();
    assert_eq!((scene.n_splats(), scene.capacity()), (900, 1500));
    let shrunk = gpu.image_of(&scene, &view, &PLAIN);
    assert_eq!(largest_difference(&shrunk, &gpu.image(&splats, &view, &PLAIN)), 0.0);
    gpu.assert_no_faults();
}

#[test]
fn five_percent_changed_cost_less_than_fifteen_percent_of_the_bytes() {
    let Some(gpu) = Gpu::new() else { return };
    let splats = random_scene(17, 2000, 0.1);
    let appearance = random_appearance(&splats, 17);
    let changed: Vec<u32> = (0..100).map(|i| i * 20).collect();
    for view in [SplatView::from(&splats), SplatView::new(&splats, &appearance).unwrap()] {
        let mut scene = gpu.scene(&splats[..1]);
        let whole = scene.update(&gpu.device, &gpu.queue, &[], view).unwrap();
        let sparse = scene.update(&gpu.device, &gpu.queue, &changed, view).unwrap();
        println!("{sparse} of {whole} bytes");
        assert!(whole >= 2000 * 64 && sparse > 0);
        assert!(sparse * 100 <= whole * 15, "{sparse} of {whole} bytes");
    }
    gpu.assert_no_faults();
}

#[test]
fn appearance_follows_sparse_updates_and_comes_and_goes() {
    let Some(gpu) = Gpu::new() else { return };
    let view = outside(80, 60);
    let mut splats = random_scene(18, 400, 0.2);
    let mut appearance = random_appearance(&splats, 18);
    let mut scene = gpu.scene(SplatView::new(&splats, &appearance).unwrap());

    let (others, other_looks) = (random_scene(19, 400, 0.2), random_appearance(&splats, 19));
    let changed: Vec<u32> = (0..50).map(|i| i * 7).collect();
    for &id in &changed {
        splats[id as usize] = others[id as usize];
        appearance[id as usize] = other_looks[id as usize];
    }
    let all = SplatView::new(&splats, &appearance).unwrap();
    let bytes = scene.update(&gpu.device, &gpu.queue, &changed, all).unwrap();
    assert_eq!(bytes, 50 * (80 + 112), "sparse records");
    let sparse = gpu.image_of(&scene, &view, &PLAIN);
    let whole = gpu.image(all, &view, &PLAIN);
    assert_eq!(largest_difference(&sparse, &whole), 0.0);

    let bytes = scene.update(&gpu.device, &gpu.queue, &[], &splats).unwrap();
    assert_eq!(bytes, 400 * 64, "removal changes every splat");
    let plain = gpu.image_of(&scene, &view, &PLAIN);
    assert_eq!(largest_difference(&plain, &gpu.image(&splats, &view, &PLAIN)), 0.0);
    assert!(largest_difference(&plain, &whole) > 0.1);
    assert_eq!(scene.update(&gpu.device, &gpu.queue, &[], all).unwrap(), 400 * (64 + 108));
    let again = gpu.image_of(&scene, &view, &PLAIN);
    assert_eq!(largest_difference(&again, &whole), 0.0);
    gpu.assert_no_faults();
}

#[test]
fn broken_splats_are_counted_through_every_kind_of_update() {
    let Some(gpu) = Gpu::new() else { return };
    let mut splats = random_scene(20, 200, 0.2);
    splats[3].mean[1] = f32::NAN;
    splats[9].rotation = [0.0; 4];
    splats[10] = Splat::default();
    let mut scene = gpu.scene(&splats);
    assert_eq!(scene.n_invalid(), 2, "an empty slot is not invalid");
    splats[3] = splats[0];
    splats[4].scale[0] = -1.0;
    splats[5].opacity = f32::INFINITY;
    scene.update(&gpu.device, &gpu.queue, &[3, 4, 5, 4], &splats).unwrap();
    assert_eq!(scene.n_invalid(), 3);
    splats.truncate(9);
    scene.update(&gpu.device, &gpu.queue, &[], &splats).unwrap();
    assert_eq!(scene.n_invalid(), 2);
    let mut appearance = vec![Appearance::default(); 9];
    appearance[8].gradient[2][0] = f32::NAN;
    let native = SplatView::new(&splats, &appearance).unwrap();
    scene.update(&gpu.device, &gpu.queue, &[], native).unwrap();
    assert_eq!(scene.n_invalid(), 3, "an appearance can be invalid too");
    scene.update(&gpu.device, &gpu.queue, &[], &[]).unwrap();
    assert_eq!(scene.n_invalid(), 0);
    gpu.assert_no_faults();
}
