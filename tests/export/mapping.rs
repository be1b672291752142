//! Mapping native splats to plain ones: areas, moments and colours (`files.md`, Native splats as plain
//! ones).

use super::{distance, read_bytes, set, written};
use crate::common::scenes::{NATIVE_SCENES, Scene, random_appearance};
use glam::{DMat3, DQuat, DVec3};
use vbgs_studio::export::mapping::{GradientSplit, Mapping, OpacityMapping, is_plain, to_plain};
use vbgs_studio::export::{ModelFormat, WriteOptions, write};
use vbgs_studio::math::camera::{Camera, Intrinsics};
use vbgs_studio::math::pose::Pose;
use vbgs_studio::math::rng::{Purpose, Rng};
use vbgs_studio::model::splat::appearance::{Appearance, SplatSet, SplatView};
use vbgs_studio::model::splat::splats::Splat;
use vbgs_studio::render::cpu::CpuRenderer;
use vbgs_studio::render::{RenderMethod, RenderOptions};

const SPLITS: [GradientSplit; 3] = [GradientSplit::One, GradientSplit::Two, GradientSplit::Four];
const OPACITIES: [OpacityMapping; 2] = [OpacityMapping::EqualArea, OpacityMapping::Clip];

fn mappings() -> impl Iterator<Item = Mapping> {
    SPLITS
        .into_iter()
        .flat_map(|split| OPACITIES.map(|opacity| Mapping { opacity, split, detail: None }))
}

/// Random splats with gradients and view dependence, with opacities in a range.
fn native(opacity: (f64, f64), seed: u64) -> SplatSet {
    let scene = Scene { opacity, n_splats: 300, ..NATIVE_SCENES[1] };
    let splats = scene.splats(seed);
    set(&splats, &random_appearance(&splats, seed))
}

fn wide(v: [f32; 3]) -> DVec3 {
    DVec3::from_array(v.map(f64::from))
}

fn matrix(rows: [[f32; 3]; 3]) -> DMat3 {
    DMat3::from_cols_array_2d(&rows.map(|row| row.map(f64::from))).transpose()
}

#[test]
fn what_plain_files_hold_passes_unchanged() {
    let scene = Scene { opacity: (0.01, 1.0), n_splats: 200, ..NATIVE_SCENES[0] };
    let splats = scene.splats(1);
    // Degree-1 colour alone needs no mapping, so exported splats can be exported again.
    let directional = random_appearance(&splats, 1)
        .into_iter()
        .map(|a| Appearance { gradient: [[0.0; 3]; 3], ..a })
        .collect::<Vec<_>>();
    let directed = set(&splats, &directional);
    for view in [SplatView::from(&splats), directed.view()] {
        assert!(is_plain(view));
        for format in [ModelFormat::Ply, ModelFormat::Glb] {
            let plain = written(view, &WriteOptions::new(format));
            for mapping in mappings() {
                assert!(to_plain(view, mapping).is_none());
                let options = WriteOptions { mapping, ..WriteOptions::new(format) };
                assert!(written(view, &options) == plain, "{format} {mapping:?}");
            }
        }
    }
}

#[test]
fn mapped_scenes_are_plain_and_keep_their_view_dependence() {
    let native = native((0.5, 3.0), 2);
    assert!(!is_plain(native.view()));
    for mapping in mappings() {
        let plain = to_plain(native.view(), mapping).unwrap();
        let n = match mapping.split {
            GradientSplit::One => 1,
            GradientSplit::Two => 2,
            GradientSplit::Four => 4,
        };
        assert_eq!(plain.len(), n * native.len());
        assert!(is_plain(plain.view()) && plain.iter().all(|s| s.is_drawable()));
        for (i, (piece, extra)) in plain.iter().zip(plain.view().appearance()).enumerate() {
            let (whole, original) = (native[i / n], native.view().appearance()[i / n]);
            assert!((piece.opacity - whole.opacity.min(0.99)).abs() < 1e-6);
            assert_eq!(extra.directional, original.directional);
            assert_eq!(extra.gradient, [[0.0; 3]; 3]);
        }
    }
}

/// Numerical integral `∫ min(0.99, o·exp(−r²/2)) dA` over the plane.
fn covered_area(opacity: f64) -> f64 {
    let step = 1e-3;
    let radii = (0..10_000).map(|i| (f64::from(i) + 0.5) * step);
    radii.map(|r| (opacity * (-0.5 * r * r).exp()).min(0.99) * r * step).sum::<f64>()
        * std::f64::consts::TAU
}

#[test]
fn equal_area_covers_what_the_flat_top_covered() {
    // Split splats are not widened further, so only the factor of the flat top remains.
    let mapping =
        Mapping { opacity: OpacityMapping::EqualArea, split: GradientSplit::Two, detail: None };
    let widened = |opacity: f32| {
        let splat = Splat { opacity, scale: [0.3, 0.2, 0.1], ..Splat::default() };
        let gradient = [[1.0, 0.0, 0.0], [0.0; 3], [0.0; 3]];
        let native = set(&[splat], &[Appearance { gradient, ..Appearance::default() }]);
        let plain = to_plain(native.view(), mapping).unwrap();
        f64::from(plain[0].scale[1] / splat.scale[1])
    };
    for opacity in [0.991, 1.0, 1.3, 2.0, 3.0] {
        let factor = widened(opacity);
        let area = covered_area(0.99) * factor * factor;
        let expected = covered_area(f64::from(opacity));
        assert!((area / expected - 1.0).abs() < 1e-5, "{opacity}: {area} {expected}");
    }
    // The factor is continuous where the flat top begins.
    assert_eq!(widened(0.98), 1.0);
    assert!((widened(0.99001) - 1.0).abs() < 1e-5);
}

#[test]
fn single_splats_are_widened_as_measured() {
    let native = native((0.5, 0.9), 3);
    for (opacity, factor) in
        [(OpacityMapping::EqualArea, 1.3 / 1.2), (OpacityMapping::Clip, 1.5 / 1.2)]
    {
        let mapping = Mapping { opacity, split: GradientSplit::One, detail: None };
        let plain = to_plain(native.view(), mapping).unwrap();
        for (a, b) in native.iter().zip(plain.iter()) {
            assert_eq!(a.mean, b.mean);
            let expected = a.scale.map(|s| (f64::from(s) * factor) as f32);
            assert!(distance(expected, b.scale) < 1e-7, "{:?} {:?}", a.scale, b.scale);
        }
    }
    let opaque = Splat { opacity: 3.0, scale: [0.2; 3], ..Splat::default() };
    let clipped =
        Mapping { opacity: OpacityMapping::Clip, split: GradientSplit::One, detail: None };
    let plain = to_plain(SplatView::from(&[opaque]), clipped).unwrap();
    assert_eq!((plain[0].opacity, plain[0].scale), (0.99, [0.25; 3]));
}

/// Pieces of equal weight together have the mean, covariance, colour and gradient of the native splat.
#[test]
fn pieces_have_the_moments_of_the_whole() {
    for (split, n) in [(GradientSplit::Two, 2), (GradientSplit::Four, 4)] {
        let native = native((0.3, 0.9), 4);
        let plain = to_plain(native.view(), Mapping::for_split(split)).unwrap();
        let mut worst = [0f64; 4];
        for (i, (whole, extra)) in native.iter().zip(native.view().appearance()).enumerate() {
            let pieces = &plain[n * i..n * (i + 1)];
            let (mean, color) = (wide(whole.mean), wide(whole.color));
            let largest = f64::from(whole.scale.iter().fold(0.0, |a: f32, b| a.max(*b)));
            let share = 1.0 / n as f64;
            let (mut centre, mut tint) = (DVec3::ZERO, DVec3::ZERO);
            let mut covariance = DMat3::ZERO;
            for piece in pieces {
                let offset = wide(piece.mean) - mean;
                centre += share * offset;
                tint += share * (wide(piece.color) - color);
                covariance += share
                    * (piece.covariance().to_mat3()
                        + DMat3::from_cols(
                            offset * offset.x,
                            offset * offset.y,
                            offset * offset.z,
                        ));
                let change = matrix(extra.gradient) * offset;
                let change = change.clamp(DVec3::splat(-0.5), DVec3::splat(0.5));
                let off = (wide(piece.color) - color - change).abs().max_element();
                worst[3] = worst[3].max(off);
            }
            let difference = covariance - whole.covariance().to_mat3();
            let norm = difference.to_cols_array().iter().fold(0f64, |a, v| a.max(v.abs()));
            worst[0] = worst[0].max(centre.length() / largest);
            worst[1] = worst[1].max(norm / largest.powi(2));
            worst[2] = worst[2].max(tint.abs().max_element());
        }
        println!("{split:?}: centre, covariance, mean colour, colour of a piece: {worst:?}");
        // Bounds follow from f32 means up to 1, scales of 0.05 or more, and gradients up to 5 per unit.
        assert!(worst[0] < 3e-6 && worst[1] < 1e-5 && worst[2] < 1e-6 && worst[3] < 1e-5);
    }
}

#[test]
fn the_longest_axes_are_split() {
    let q = DQuat::from_xyzw(0.3, -0.5, 0.1, 0.8).normalize();
    let rotation = [q.w, q.x, q.y, q.z].map(|v| v as f32);
    let splat = Splat { opacity: 0.5, scale: [0.1, 0.001, 0.4], rotation, ..Splat::default() };
    let gradient = [[0.1, 0.0, 0.0], [0.0; 3], [0.0; 3]];
    let native = set(&[splat], &[Appearance { gradient, ..Appearance::default() }]);
    let two = to_plain(native.view(), Mapping::for_split(GradientSplit::Two)).unwrap();
    for (piece, sign) in two.iter().zip([-1.0, 1.0]) {
        let expected = q * DVec3::Z * (0.75 * 0.4 * sign);
        assert!((wide(piece.mean) - expected).length() < 1e-6, "{piece:?}");
        let shrunk = 0.4 * (1.0f32 - 0.75 * 0.75).sqrt();
        assert!(distance(piece.scale, [0.1, 0.001, shrunk]) < 1e-6);
    }
    let four = to_plain(native.view(), Mapping::for_split(GradientSplit::Four)).unwrap();
    for piece in four.iter() {
        let local = (q.inverse() * wide(piece.mean)).abs();
        assert!((local - DVec3::new(0.06, 0.0, 0.24)).length() < 1e-6, "{local}");
        assert!(distance(piece.scale, [0.08, 0.001, 0.32]) < 1e-6);
    }
}

#[test]
fn awkward_splats() {
    let gradient = [[1.0, 2.0, 3.0], [0.0; 3], [-1e30, 1e30, 0.0]];
    let extra = Appearance { gradient, ..Appearance::default() };
    let base = Splat { opacity: 2.0, color: [0.5; 3], scale: [0.1; 3], ..Splat::default() };
    let broken = |a: f32| Appearance { directional: [[0.0, a, 0.0], [0.0; 3], [0.0; 3]], ..extra };
    let cases = [
        (base, extra, 4),
        (base, broken(f32::NAN), 0),
        (base, broken(f32::INFINITY), 0),
        (Splat { opacity: f32::NAN, ..base }, extra, 0),
        (Splat { opacity: 0.0, ..base }, extra, 0),
        (Splat { mean: [0.0, f32::INFINITY, 0.0], ..base }, extra, 0),
        // An opacity far above the usual range, a point, a needle and a disc: axes without extent
        // are not split.
        (Splat { opacity: 1e30, ..base }, extra, 4),
        (Splat { scale: [0.0; 3], ..base }, extra, 1),
        (Splat { scale: [0.0, 0.1, 0.0], ..base }, extra, 2),
        (Splat { scale: [0.1, 0.0, 0.1], ..base }, extra, 4),
        (Splat { rotation: [0.0; 4], ..base }, extra, 4),
    ];
    let (splats, extras): (Vec<_>, Vec<_>) = cases.iter().map(|c| (c.0, c.1)).unzip();
    let native = set(&splats, &extras);
    let n_broken = cases.iter().filter(|c| c.2 == 0).count();
    let expected: usize = cases.iter().map(|c| c.2).sum();
    let folder = tempfile::tempdir().unwrap();
    for opacity in OPACITIES {
        let mapping = Mapping { opacity, split: GradientSplit::Four, detail: None };
        let plain = to_plain(native.view(), mapping).unwrap();
        assert_eq!(plain.len(), expected);
        for splat in plain.iter() {
            assert!(splat.is_drawable() && splat.opacity == 0.99, "{splat:?}");
            assert!(splat.color.iter().all(|c| (0.0..=1.0).contains(c)), "{splat:?}");
        }
        for format in [ModelFormat::Ply, ModelFormat::Glb] {
            let path = folder.path().join(format.name());
            let options = WriteOptions { mapping, ..WriteOptions::new(format) };
            let summary = write(&path, &native, &options).unwrap();
            assert_eq!((summary.n_written, summary.n_skipped), (expected, n_broken));
            let bytes = std::fs::read(path).unwrap();
            assert_eq!(read_bytes(&bytes).unwrap().splats.len(), expected);
        }
    }
}

#[test]
fn point_clouds_are_not_mapped() {
    let native = native((0.5, 3.0), 5);
    let options = WriteOptions {
        mapping: Mapping::for_split(GradientSplit::Four),
        confidence: Some(&vec![1.0; native.len()]),
        ..WriteOptions::new(ModelFormat::PointCloudPly)
    };
    let cloud = read_bytes(&written(&native, &options)).unwrap();
    assert_eq!(cloud.splats.len(), native.len());
    assert!(cloud.splats.iter().zip(native.iter()).all(|(a, b)| a.mean == b.mean));
}

/// Opaque discs on a plane, with colour and gradient from a smooth texture.
fn textured_plane() -> SplatSet {
    let texture = |x: f64, y: f64| {
        let waves = [(9.0 * x).sin() * (7.0 * y).cos(), (5.0 * x + 6.0 * y).sin(), (8.0 * y).cos()];
        waves.map(|w| 0.5 + 0.4 * w)
    };
    let mut rng = Rng::new(6, Purpose::Synthetic, 0);
    let spacing = 0.05;
    let mut discs = SplatSet::default();
    for (i, j) in (-24..=24).flat_map(|j| (-24..=24).map(move |i| (i, j))) {
        let mut at = |k: i32| spacing * (f64::from(k) + rng.range(-0.2, 0.2));
        let (x, y) = (at(i), at(j));
        let h = 1e-4;
        let slope = |channel: usize| {
            let along = |dx, dy| {
                (texture(x + dx, y + dy)[channel] - texture(x - dx, y - dy)[channel]) / (2.0 * h)
            };
            [along(h, 0.0) as f32, along(0.0, h) as f32, 0.0]
        };
        let splat = Splat {
            mean: [x as f32, y as f32, 0.0],
            opacity: rng.range(2.0, 2.9) as f32,
            color: texture(x, y).map(|c| c as f32),
            // Deviation of points spread evenly over a cell, times the native factor.
            scale: [0.3, 0.28, 0.02].map(|s: f64| (1.2 * s * spacing) as f32),
            rotation: [1.0, 0.0, 0.0, 0.0],
        };
        let gradient = std::array::from_fn(slope);
        discs.push(splat, Appearance { gradient, ..Appearance::default() });
    }
    discs
}

/// A small version of the figures in `files.md`, Native splats as plain ones: splits restore gradients,
/// and no mapping opens holes.
#[test]
fn mapped_scenes_look_like_native_ones() {
    let eye = DVec3::new(1.5, -2.0, 3.0);
    let pose = Pose::look_at(eye, DVec3::ZERO, DVec3::Z).unwrap();
    let camera = Camera { intrinsics: Intrinsics::from_horizontal_fov(160, 120, 0.4), pose };
    let options = RenderOptions::evaluation(RenderMethod::PROJECTED, [0.0; 3]);
    let draw = |view: SplatView| CpuRenderer::new().render(view, &camera, &options);
    let native = textured_plane();
    let reference = draw(native.view());
    let psnr = |split| {
        let image = draw(to_plain(native.view(), Mapping::for_split(split)).unwrap().view());
        let pairs = image.color.data.iter().zip(&reference.color.data);
        let squares = pairs.map(|(a, b)| (wide(*a) - wide(*b)).length_squared() / 3.0);
        let psnr = -10.0 * (squares.sum::<f64>() / image.color.data.len() as f64).log10();
        let holes = image.coverage.data.iter().filter(|&&a| a < 0.7).count();
        println!("{split:?}: {psnr:.2} dB against the native image, {holes} holes");
        assert!(holes * 100 < image.coverage.data.len());
        psnr
    };
    let [one, two, four] = SPLITS.map(psnr);
    assert!(one > 24.0 && two > one + 1.0 && four > two, "{one} {two} {four}");
}
