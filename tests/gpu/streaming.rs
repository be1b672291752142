//! Uploads: changed records only, growth and shrinking.

use super::compare::largest_difference;
use super::device::{Gpu, PLAIN, outside, random_scene};
use crate::common::scenes::{random_appearance, random_textures, textured_splats};
use std::sync::Arc;
use vbgs_studio::model::splat::appearance::{Finishing, SplatSet, SplatView};
use vbgs_studio::model::splat::texture::{Texture, Textures};
use vbgs_studio::render::gpu::GpuError;
use vbgs_studio::render::gpu::scene::GpuScene;

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

fn with_textures(set: &SplatSet, textures: &Textures) -> SplatSet {
    let textures = Some(Arc::new(textures.clone()));
    set.clone().finished(Finishing { textures, ..Finishing::default() })
}

#[test]
fn only_changed_textures_are_uploaded() {
    let Some(gpu) = Gpu::new() else { return };
    let view = outside(80, 60);
    let mut set = textured_splats(8);
    let mut textures = set.finishing().textures.as_deref().unwrap().clone();
    let others = random_textures(&set, 9);
    let mut scene = gpu.scene(&set);
    let update = |scene: &mut GpuScene, set: &SplatSet| {
        let bytes = scene.update(&gpu.device, &gpu.queue, &[], set).unwrap();
        let [found, fresh] = [&*scene, &gpu.scene(set)].map(|s| gpu.image_of(s, &view, &PLAIN));
        assert_eq!(largest_difference(&found, &fresh), 0.0);
        bytes
    };
    set = with_textures(&set, &textures);
    assert_eq!(update(&mut scene, &set), 0, "the same textures in another list");

    textures[4] = others[4].clone();
    let words = 11 + 4 + 16 * textures[4].as_ref().unwrap().patches.len();
    set = with_textures(&set, &textures);
    assert_eq!(update(&mut scene, &set), 4 * words as u64, "one texture in its place");

    textures[0] = others[5].clone();
    textures[2] = None;
    set = with_textures(&set, &textures);
    let bytes = update(&mut scene, &set);
    assert!(bytes > 0 && bytes < 10_000, "{bytes}");

    // Every texture moves in turn, so that the buffer is packed again.
    for i in 0..40 {
        textures[i] = others[(i + 1) % 40].clone();
        set = with_textures(&set, &textures);
        update(&mut scene, &set);
    }
    textures.truncate(30);
    set = with_textures(&set, &textures);
    update(&mut scene, &set);
    set = set.finished(Finishing::default());
    assert_eq!(update(&mut scene, &set), 0, "no textures");
    set = with_textures(&set, &others);
    update(&mut scene, &set);
    gpu.assert_no_faults();
}

#[test]
fn textures_that_do_not_fit_are_left_out_with_a_message() {
    let Some(gpu) = Gpu::with_buffers_up_to(1 << 20) else { return };
    let mut set = textured_splats(8);
    let mut large = Texture::clone(set.finishing().textures.as_ref().unwrap()[0].as_ref().unwrap());
    large.lattice.level = 5;
    (large.index, large.patches) = ((0..1024).collect(), vec![large.patches[0]; 1024]);
    // 15 of 68 KiB fit.
    set = with_textures(&set, &vec![Some(Arc::new(large)); 40]);
    let view = outside(80, 60);
    let scene = gpu.scene(&set);
    let mut renderer = gpu.renderer();
    let image = gpu.drawn(&mut renderer, &scene, &view, &PLAIN);
    let shortage = renderer.shortage().unwrap();
    assert!(matches!(shortage, GpuError::TexturesLeftOut { n_splats: 25, .. }), "{shortage}");
    assert!(image.data.iter().any(|pixel| pixel[3] > 0.5));
    gpu.assert_no_faults();
}
