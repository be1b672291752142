//! The fast preparation against the oracle, and against itself on other instruction sets.

use super::oracle;
use crate::common::shared;
use glam::{DVec3, Vec3};
use vbgs_studio::dataset::surface::{Preparer, SurfaceSettings};
use vbgs_studio::dataset::synthetic::{self, SyntheticParams};
use vbgs_studio::dataset::{Dataset, LoadOptions, open};
use vbgs_studio::math::image::Image;
use vbgs_studio::math::simd::Isa;
use vbgs_studio::observation::surface::{Observation, SurfacePoint};

/// Largest share of differing pixels: f32 puts a depth or a neighbour on the other side of a threshold.
const DIFFERING: f64 = 2e-4;
/// Largest relative error of lengths: ten roundings.
const LENGTH: f32 = 1e-6;
/// Error of normals: the slope of a plane is a difference of depths over few pixels, and f32
/// resolves depths only to 6e-8 of their value.
const NORMAL: f32 = 1e-4;
/// Error of unit directions.
const DIRECTION: f32 = 1e-6;
/// Error of colours: a few ten-thousandths of a pixel times a step from black to white.
const COLOR: f32 = 1e-4;

fn assert_agrees(dataset: &Dataset, settings: &SurfaceSettings, index: usize) {
    let split = dataset.splits.iter().position(|s| s.has_depth).unwrap();
    let frame = dataset.load(split, index).unwrap();
    let (expected, fates) = oracle::prepare(&frame, settings);
    let mut preparer = Preparer::new();
    let mut found = Observation::empty();
    preparer.prepare(&frame, settings, &mut found).unwrap();
    assert_eq!(expected.origin, found.origin);
    assert_eq!(expected.tolerance, found.tolerance);
    assert_ranges_agree(&expected.ranges, &found.ranges);
    let pairs = fates.data.iter().zip(&preparer.statuses().data);
    let mut differing = pairs.filter(|(a, b)| a != b).count();
    let mut others = found.points.iter();
    for point in &expected.points {
        let pixel = point.pixel as usize;
        // Both lists have the same order, but each may lack points of the other.
        if fates.data[pixel] == preparer.statuses().data[pixel] {
            let other = others.find(|p| p.pixel == point.pixel).unwrap();
            let allowed = [LENGTH, NORMAL, DIRECTION, COLOR];
            let is_near = errors(point, other).iter().zip(allowed).all(|(e, most)| *e <= most);
            differing += usize::from(!is_near);
        }
    }
    let (n, allowed) = (expected.points.len(), (DIFFERING * fates.data.len() as f64) as usize);
    assert!(n > 1000 && differing <= allowed, "{}: {n} points, {differing} differ", dataset.name);
}

/// Relative error of lengths, then errors of the normal, the direction and the colour.
fn errors(a: &SurfacePoint, b: &SurfacePoint) -> [f32; 4] {
    let distance = |a: [f32; 3], b: [f32; 3]| Vec3::from(a).distance(Vec3::from(b));
    let relative = |x: f32, y: f32| (x / y - 1.0).abs();
    let length = (distance(a.position, b.position) / a.range)
        .max(relative(a.range, b.range))
        .max(relative(a.noise, b.noise))
        .max(relative(a.footprint, b.footprint));
    [
        length,
        distance(a.normal, b.normal),
        distance(a.direction, b.direction),
        distance(a.color, b.color),
    ]
}

fn assert_ranges_agree(a: &Image<f32>, b: &Image<f32>) {
    assert_eq!((a.width, a.height), (b.width, b.height));
    for (x, y) in a.data.iter().zip(&b.data) {
        let same = x.to_bits() == y.to_bits() || x.is_nan() && y.is_nan();
        assert!(same || (x / y - 1.0).abs() < LENGTH, "{x} {y}");
    }
}

/// Settings with every stage on, and with each stage off.
fn variants(settings: &SurfaceSettings) -> [SurfaceSettings; 5] {
    let all = || settings.clone();
    [
        all(),
        SurfaceSettings { plane_fit: false, ..all() },
        SurfaceSettings { flying_pixels: false, ..all() },
        SurfaceSettings { cosine: false, ..all() },
        SurfaceSettings { calibration: None, ..all() },
    ]
}

#[test]
fn lego() {
    let Some(path) = shared("data/lego400") else { return };
    let dataset = open(&path, &LoadOptions::default()).unwrap();
    let settings = SurfaceSettings::new(&dataset, DVec3::new(0.1, -0.2, 0.3));
    for settings in variants(&settings) {
        assert_agrees(&dataset, &settings, 20);
    }
    for index in [0, 60, 100, 160] {
        assert_agrees(&dataset, &settings, index);
    }
}

#[test]
fn kinect() {
    let Some(path) = shared("data/kinect_office") else { return };
    let dataset = open(&path, &LoadOptions::default()).unwrap();
    for settings in variants(&SurfaceSettings::new(&dataset, DVec3::ONE)) {
        assert_agrees(&dataset, &settings, 4);
    }
}

#[test]
fn synthetic() {
    // Sizes that are not multiples of eight.
    for depth_noise in [0.0, 0.5] {
        let params = SyntheticParams {
            width: 203,
            height: 147,
            n_train: 2,
            depth_noise,
            ..SyntheticParams::demo()
        };
        let dataset = synthetic::dataset(&params).unwrap();
        for settings in variants(&SurfaceSettings::new(&dataset, DVec3::ZERO)) {
            assert_agrees(&dataset, &settings, 1);
        }
    }
}

#[test]
fn every_instruction_set_gives_the_same_bits() {
    let params = SyntheticParams { n_train: 1, depth_noise: 0.5, ..SyntheticParams::demo() };
    let dataset = synthetic::dataset(&params).unwrap();
    let frame = dataset.load(0, 0).unwrap();
    let settings = SurfaceSettings::new(&dataset, DVec3::ZERO);
    let prepare = |isa| {
        let (mut preparer, mut out) = (Preparer::on(isa), Observation::empty());
        preparer.prepare(&frame, &settings, &mut out).unwrap();
        let points: &[u8] = bytemuck::cast_slice(&out.points);
        let ranges: &[u8] = bytemuck::cast_slice(&out.ranges.data);
        (points.to_vec(), ranges.to_vec(), preparer.statuses().clone())
    };
    let Some(avx2) = Isa::avx2() else { return };
    assert!(prepare(Isa::PORTABLE) == prepare(avx2));
}
