//! Textures as small splats (`files.md`, Textures as splats).

use super::set;
use crate::common::scenes::textured_splats;
use std::sync::Arc;
use vbgs_studio::export::mapping::Mapping;
use vbgs_studio::export::{ModelFormat, WriteOptions, WriteSelection, read_back};
use vbgs_studio::math::camera::{Camera, Intrinsics};
use vbgs_studio::math::pose::Pose;
use vbgs_studio::model::splat::appearance::{Appearance, Finishing, SplatSet, SplatView};
use vbgs_studio::model::splat::splats::Splat;
use vbgs_studio::model::splat::texture::{Lattice, PATCH, TEXELS, Texel, Texture};
use vbgs_studio::render::cpu::CpuRenderer;
use vbgs_studio::render::{RenderMethod, RenderOptions};

/// Two discs beside each other, 2 in front of the camera. The left one has a texture of 32 × 32 texels: a
/// chessboard of 4 × 4 squares, whose texels vary by `grain`.
fn discs(grain: f32) -> SplatSet {
    let disc = |x: f32| Splat {
        mean: [x, 0.0, 2.0],
        opacity: 2.0,
        color: [0.5; 3],
        scale: [0.25, 0.25, 0.002],
        ..Splat::default()
    };
    let axes = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
    let lattice = Lattice { anchor: [-0.5, 0.0, 2.0], axes, half: 0.4, level: 3 };
    let side = lattice.side() / PATCH;
    let patch = |i: usize| -> [Texel; TEXELS] {
        let is_light = (i % side / 2 + i / side / 2).is_multiple_of(2);
        let color = if is_light { [0.9, 0.8, 0.2] } else { [0.1, 0.2, 0.6] };
        let texel = |k: usize| color.map(|c| c + grain * ((5 * i + 7 * k) % 11) as f32 / 11.0);
        std::array::from_fn(|k| Texel::new(texel(k), 1.0))
    };
    let n = side * side;
    let texture =
        Texture { lattice, index: (0..n as u16).collect(), patches: (0..n).map(patch).collect() };
    let textures = Some(Arc::new(vec![Some(Arc::new(texture)), None]));
    let finishing = Finishing { textures, ..Finishing::default() };
    set(&[disc(-0.5), disc(0.5)], &[Appearance::default(); 2]).finished(finishing)
}

fn written(scene: &SplatSet, detail: Option<usize>, selection: WriteSelection<'_>) -> SplatSet {
    let mapping = Mapping { detail, ..Mapping::default() };
    let options = WriteOptions { mapping, selection, ..WriteOptions::new(ModelFormat::Ply) };
    read_back(scene, &options).unwrap().splats
}

/// Mean squared difference of the pictures of two scenes in the region of the left disc.
fn difference<'a>(a: impl Into<SplatView<'a>>, b: impl Into<SplatView<'a>>) -> f32 {
    let intrinsics = Intrinsics::from_horizontal_fov(160, 120, 1.0);
    let camera = Camera { intrinsics, pose: Pose::IDENTITY };
    let options = RenderOptions::evaluation(RenderMethod::PROJECTED, [0.0; 3]);
    let picture = |view: SplatView<'a>| CpuRenderer::new().render(view, &camera, &options).color;
    let (a, b) = (picture(a.into()), picture(b.into()));
    let pixels = (40..80).flat_map(|y| (25..65).map(move |x| (x, y)));
    let errors = pixels.flat_map(|(x, y)| {
        let (a, b) = (*a.at(x, y), *b.at(x, y));
        (0..3).map(move |c| (a[c] - b[c]).powi(2))
    });
    errors.sum::<f32>() / (40.0 * 40.0 * 3.0)
}

#[test]
fn small_splats_show_the_texture() {
    let scene = discs(0.1);
    let plain = written(&scene, None, WriteSelection::default());
    assert_eq!(plain.len(), 2);
    let mut before = difference(scene.view(), plain.view());
    assert!(before > 0.05, "{before}");
    // Splats as large as the chessboard's squares blur them.
    for (most, better) in [(20, 0.95), (900, 0.6)] {
        let small = written(&scene, Some(most), WriteSelection::default());
        assert!(small.len() > most / 2 && small.len() <= most + 1, "{} of {most}", small.len());
        let after = difference(scene.view(), small.view());
        assert!(after < better * before, "{most} splats: {after} instead of {before}");
        before = after;
        // The disc without a texture is written as before.
        let of_right = |splats: &SplatSet| splats.iter().copied().find(|s| s.mean[0] == 0.5);
        assert_eq!(of_right(&small), of_right(&plain));
    }
}

#[test]
fn even_colours_take_few_splats() {
    let n = |grain, most| written(&discs(grain), Some(most), WriteSelection::default()).len();
    assert_eq!(n(0.0, 1_000_000), 1 + 16, "squares of 8 × 8 texels, and the other disc");
    assert!(n(0.1, 1_000_000) > 800, "{}", n(0.1, 1_000_000));
    assert_eq!(n(0.1, 1), 1 + 1);
}

#[test]
fn small_splats_are_selected_by_their_own_place() {
    let scene = discs(0.1);
    // The left half of the left disc.
    let crop = Some([[-2.0, -2.0, 0.0].into(), [-0.5, 2.0, 4.0].into()]);
    let half = written(&scene, Some(900), WriteSelection { crop, ..WriteSelection::default() });
    let all = written(&scene, Some(900), WriteSelection::default());
    assert!(half.iter().all(|splat| splat.mean[0] <= -0.5));
    // The grain differs between the halves.
    assert!(half.len().abs_diff(all.len() / 2) < 100, "{} of {}", half.len(), all.len());
}

#[test]
fn scenes_without_textures_and_odd_ones_are_written_whole() {
    let plain = discs(0.1).finished(Finishing::default());
    let none = written(&plain, None, WriteSelection::default());
    assert_eq!(written(&plain, Some(100), WriteSelection::default()), none);
    for seed in 0..5 {
        let scene = textured_splats(seed);
        let small = written(&scene, Some(2000), WriteSelection::default());
        assert!(small.len() >= scene.len() / 4, "{}", small.len());
        assert!(small.iter().all(|splat| splat.is_drawable()));
        // The same file again, although hash maps have random orders.
        assert_eq!(small, written(&scene, Some(2000), WriteSelection::default()));
    }
}
