//! Photometric comparison on the GPU against the CPU.

use super::device::{Gpu, outside, random_scene};
use super::fixture::Fixture;
use crate::common::scenes::cone;
use glam::Vec3;
use vbgs_studio::math::camera::Camera;
use vbgs_studio::math::image::Image;
use vbgs_studio::math::measured_pixel::MeasuredPixel;
use vbgs_studio::math::rng::{Purpose, Rng};
use vbgs_studio::math::simd::{Isa, Kernel, Vector};
use vbgs_studio::model::splat::appearance::{Appearance, SplatView};
use vbgs_studio::model::splat::splats::Splat;
use vbgs_studio::render::EVALUATION_NEAR;
use vbgs_studio::render::cpu::photometric::{
    ParameterSums, PhotometricComparer, PhotometricSums, PhotometricWalk, PixelRule, RowSubset,
    ViewBuffers, VisibleSplat,
};
use vbgs_studio::render::gpu::photometric::GpuComparer;

/// A comparer on a test device.
pub fn comparer(fixture: &Fixture) -> GpuComparer {
    GpuComparer::new(fixture.headless())
}

/// Splats, some with flat tops, whose colours vary over the splat and with the direction.
struct Scene {
    splats: Vec<Splat>,
    appearance: Vec<Appearance>,
    camera: Camera,
    photograph: Image<MeasuredPixel>,
    rule: PixelRule,
    rows: RowSubset,
}

fn scene(seed: u64, n: usize, (width, height): (u32, u32), rows: RowSubset) -> Scene {
    let mut rng = Rng::new(seed, Purpose::Synthetic, 1);
    let mut splats = random_scene(seed, n, 0.3);
    for splat in &mut splats {
        splat.opacity *= rng.range(0.5, 2.0) as f32;
    }
    let mut table = |size: f64| [(); 3].map(|()| [(); 3].map(|()| rng.range(-size, size) as f32));
    let mut varied =
        || Appearance { gradient: table(1.5), directional: table(0.2), observed: cone(table(0.5)) };
    let appearance = (0..n).map(|_| varied()).collect();
    let (columns, lines) = (width as usize, height as usize);
    let pixel = |i: usize| {
        let (x, y) = ((i % columns) as f32, (i / columns) as f32);
        let color = Vec3::new((0.2 * x).sin(), (0.3 * y).cos(), (0.1 * (x + y)).sin());
        // Surface, background, unknown and partial coverage.
        let coverage = [1.0, 0.0, f32::NAN, 0.7][(i / 5) % 4];
        let pixel = MeasuredPixel::without_depth((0.5 + 0.4 * color).extend(coverage).to_array());
        // A slope through the splats, and pixels without depth.
        let depth = [0.0, 2.0 + 0.03 * x, 2.0 + 0.03 * x][(i / 7) % 3];
        pixel.with_depth(depth, [0.1, 0.05])
    };
    let photograph = Image::from_vec(columns, lines, (0..columns * lines).map(pixel).collect());
    let full_coverage = if seed.is_multiple_of(2) { 0.6 } else { 1.0 };
    let rule = PixelRule { full_coverage, tau: 0.5, coverage: 1.0, depth: 0.7 };
    Scene { splats, appearance, camera: outside(width, height), photograph, rule, rows }
}

/// Complete result of a comparison.
#[derive(Clone, Debug, PartialEq)]
struct Found {
    squared_error: f64,
    pixels: f64,
    /// By splat: gradients and curvature blocks of all its parameters.
    splats: Vec<(u32, Vec<f32>)>,
}

struct Lift<'a>(&'a PhotometricSums<'a>, VisibleSplat, Splat, Appearance);

impl Kernel for Lift<'_> {
    type Output = Vec<f32>;

    #[inline(always)]
    fn run<V: Vector>(self) -> Vec<f32> {
        let Self(compared, seen, splat, appearance) = self;
        let ParameterSums { gradient, curvature, color, color_curvature } =
            compared.parameter_sums::<V>(&[(seen, splat, appearance)]);
        let lanes = [&gradient[..], &curvature, color.as_flattened(), &color_curvature].concat();
        lanes.into_iter().map(|lanes| lanes.to_array()[0]).collect()
    }
}

/// Compares on the device, or on the CPU without one.
fn found(device: Option<&mut GpuComparer>, scene: &Scene) -> Found {
    let Scene { splats, appearance, camera, photograph, rule, rows } = scene;
    let (mut buffers, mut processor) = (ViewBuffers::default(), PhotometricWalk::default());
    let view = SplatView::new(splats, appearance).unwrap();
    let view = buffers.prepare(view, camera, EVALUATION_NEAR, photograph.height);
    let compared = match device {
        Some(device) => device.compare(&view, photograph, *rule, *rows).unwrap(),
        None => processor.compare(&view, photograph, *rule, *rows),
    };
    let lift = |seen: VisibleSplat| {
        let id = seen.id as usize;
        let look = appearance.get(id).copied().unwrap_or_default();
        (seen.id, Isa::best().run(Lift(&compared, seen, splats[id], look)))
    };
    let (squared_error, pixels) = (compared.squared_error, compared.pixels);
    let splats = compared.visible_splats(0.0).into_iter().map(lift).collect();
    Found { squared_error, pixels, splats }
}

/// Largest difference of a value from the CPU's, relative to the root mean square of that value
/// over all splats.
fn difference(processor: &Found, device: &Found) -> f64 {
    let ids = |found: &Found| found.splats.iter().map(|(id, _)| *id).collect::<Vec<_>>();
    assert_eq!(ids(processor), ids(device));
    assert_eq!(processor.pixels, device.pixels);
    let error = (device.squared_error / processor.squared_error - 1.0).abs();
    let n = processor.splats.len();
    assert!(n > 20, "only {n} splats are visible");
    let of_number = |k: usize| {
        let wide = |found: &Found| -> Vec<f64> {
            found.splats.iter().map(|(_, values)| f64::from(values[k])).collect()
        };
        let (ours, theirs) = (wide(processor), wide(device));
        let size = (ours.iter().map(|x| x * x).sum::<f64>() / n as f64).sqrt();
        let pairs = ours.iter().zip(&theirs);
        let worst = pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        if size > 0.0 { worst / size } else { worst }
    };
    (0..processor.splats[0].1.len()).map(of_number).fold(error, f64::max)
}

/// Sizes that are not multiples of a tile, several row subsets, with and without crack filling.
#[test]
fn sums_are_the_processors() {
    let Some(gpu) = Gpu::new() else { return };
    let mut comparer = comparer(&gpu);
    let mut worst = 0.0f64;
    for (seed, n, size, rows) in [
        (1, 300, (70, 53), RowSubset::ALL),
        (2, 300, (64, 48), RowSubset::new(4, 3)),
        (3, 150, (33, 65), RowSubset::new(2, 1)),
        (4, 600, (90, 40), RowSubset::new(8, 5)),
        (6, 300, (70, 53), RowSubset::new(16, 9)),
        (8, 900, (50, 50), RowSubset::ALL),
    ] {
        let scene = scene(seed, n, size, rows);
        let expected = found(None, &scene);
        let difference = difference(&expected, &found(Some(&mut comparer), &scene));
        println!("{n} splats, {size:?}, {rows:?}: {difference:.1e}");
        worst = worst.max(difference);
    }
    gpu.assert_no_faults();
    assert!(worst < 1e-3, "{worst:e}");
}

#[test]
fn plain_splats_need_no_appearance() {
    let Some(gpu) = Gpu::new() else { return };
    let scene = Scene { appearance: Vec::new(), ..scene(2, 200, (50, 37), RowSubset::ALL) };
    let expected = found(None, &scene);
    let difference = difference(&expected, &found(Some(&mut comparer(&gpu)), &scene));
    assert!(difference < 1e-3, "{difference:e}");
}

#[test]
fn every_run_gives_the_same_bits() {
    let Some(gpu) = Gpu::new() else { return };
    let scenes = [RowSubset::ALL, RowSubset::new(4, 1)].map(|rows| scene(5, 400, (61, 47), rows));
    let mut first = comparer(&gpu);
    let once: Vec<Found> = scenes.iter().map(|scene| found(Some(&mut first), scene)).collect();
    // Buffers that held another view must give the same bits as fresh ones.
    let again = found(Some(&mut first), &scenes[0]);
    let fresh: Vec<Found> =
        scenes.iter().map(|scene| found(Some(&mut comparer(&gpu)), scene)).collect();
    assert_eq!(once, fresh);
    assert_eq!(once[0], again);
}

#[test]
fn nothing_in_view_says_nothing() {
    let Some(gpu) = Gpu::new() else { return };
    let empty = Scene {
        splats: Vec::new(),
        appearance: Vec::new(),
        ..scene(1, 1, (20, 20), RowSubset::ALL)
    };
    let mut comparer = comparer(&gpu);
    let full = scene(1, 50, (20, 20), RowSubset::ALL);
    for _ in 0..2 {
        let nothing = Found { squared_error: 0.0, pixels: 0.0, splats: Vec::new() };
        assert_eq!(found(Some(&mut comparer), &empty), nothing);
        assert!(!found(Some(&mut comparer), &full).splats.is_empty());
    }
}
