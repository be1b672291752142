//! Derivatives of the photometric walk against finite differences of the oracle, which shares no
//! arithmetic with it, and its blocks against the dense Gauss-Newton matrix.

use crate::common::oracle::{AppearanceF64, Oracle, SplatF64};
use glam::{DMat2, DMat3, DQuat, DVec2, DVec3};
use vbgs_studio::math::camera::{Camera, Intrinsics};
use vbgs_studio::math::cholesky::Cholesky;
use vbgs_studio::math::image::Image;
use vbgs_studio::math::measured_pixel::MeasuredPixel;
use vbgs_studio::math::pose::Pose;
use vbgs_studio::math::rng::{Purpose, Rng};
use vbgs_studio::math::simd::{Isa, Kernel, Vector};
use vbgs_studio::model::scene::photometric::{
    N_COLOR, N_COLOR_PRECISION, N_FORM, N_FORM_PRECISION,
};
use vbgs_studio::model::splat::appearance::{Appearance, SplatView};
use vbgs_studio::model::splat::splats::Splat;
use vbgs_studio::render::cpu::photometric::{
    PhotometricSums, PhotometricWalk, PixelRule, RowSubset, ViewBuffers, VisibleSplat,
};
use vbgs_studio::render::{EVALUATION_NEAR, RenderMethod, RenderOptions};
use vbgs_studio::train::scene::photometric::rule::PhotometricRule;

const SIZE: u32 = 40;
/// Robust threshold far above all residuals, so that every pixel has full weight.
const ALL: f32 = 1e6;
/// Parameters of a splat: its form, then seven coefficients per channel.
const N: usize = N_FORM + 3 * N_COLOR;

fn camera() -> Camera {
    Camera { intrinsics: Intrinsics::from_horizontal_fov(SIZE, SIZE, 0.9), pose: Pose::IDENTITY }
}

/// Overlapping splats, some with flat tops; `varied` adds colour gradients.
fn scene(varied: bool) -> (Vec<Splat>, Vec<Appearance>) {
    let mut rng = Rng::new(3, Purpose::Synthetic, 0);
    let mut draw = |lo: f64, hi: f64| rng.range(lo, hi) as f32;
    let mut splats = Vec::new();
    let mut appearance = Vec::new();
    for _ in 0..12 {
        let q = [draw(0.2, 1.0), draw(-1.0, 1.0), draw(-1.0, 1.0), draw(-1.0, 1.0)];
        let norm = q.iter().map(|x| x * x).sum::<f32>().sqrt();
        splats.push(Splat {
            mean: [draw(-0.6, 0.6), draw(-0.6, 0.6), draw(2.5, 4.0)],
            opacity: draw(0.3, 1.6),
            color: [draw(0.3, 0.6), draw(0.3, 0.6), draw(0.3, 0.6)],
            scale: [draw(0.1, 0.4), draw(0.1, 0.4), draw(0.05, 0.2)],
            rotation: q.map(|x| x / norm),
        });
        let mut rows = |size: f64| [(); 3].map(|()| [(); 3].map(|()| draw(-size, size)));
        let directional = rows(0.1);
        let gradient = if varied { rows(0.15) } else { [[0.0; 3]; 3] };
        appearance.push(Appearance { gradient, directional, ..Appearance::default() });
    }
    (splats, appearance)
}

fn wide(splats: &[Splat], appearance: &[Appearance]) -> Vec<SplatF64> {
    let wide = splats.iter().zip(appearance);
    let wide = wide.map(|(splat, appearance)| SplatF64 {
        appearance: Some(AppearanceF64::from(appearance)),
        ..SplatF64::from(splat)
    });
    wide.collect()
}

fn options() -> RenderOptions {
    RenderOptions::evaluation(RenderMethod::PROJECTED, [0.0; 3])
}

/// Smooth photograph within `[0.2, 0.7]`, unrelated to the scene; every third pixel has a depth within the
/// range of the splats.
fn photograph() -> Image<MeasuredPixel> {
    let n = SIZE as usize;
    let pixel = |i: usize| {
        let (x, y) = ((i % n) as f32 / n as f32, (i / n) as f32 / n as f32);
        let [r, g] = [0.45 + 0.2 * (5.0 * x).sin(), 0.4 + 0.2 * (4.0 * y).cos()];
        let pixel = MeasuredPixel::without_depth([r, g, 0.3 + 0.3 * x * y, 1.0]);
        let depth = if i.is_multiple_of(3) { 3.0 + 0.5 * x } else { 0.0 };
        pixel.with_depth(depth, MARGIN)
    };
    Image::from_vec(n, n, (0..n * n).map(pixel).collect())
}

/// Weights of the coverage and depth residuals relative to colour.
const COVERAGE: f64 = 0.7;
const DEPTH: f64 = 0.4;
/// Tolerance of a surface's distance from a measured depth.
const MARGIN: [f32; 2] = [0.2, 0.05];
/// Values per pixel: three colours, coverage, depth penalty.
const N_VALUES: usize = 5;

/// Depth penalty of each splat at each pixel with a measured depth. It is constant under the derivatives,
/// because points alone place splats in depth.
struct Wrongness(Vec<Option<Vec<f64>>>);

impl Wrongness {
    fn of(splats: &[SplatF64]) -> Self {
        let k = camera().intrinsics;
        let n = SIZE as usize;
        let of_pixel = |(i, pixel): (usize, &MeasuredPixel)| {
            let at = DVec2::new((i % n) as f64 + 0.5, (i / n) as f64 + 0.5);
            let far = |splat: &SplatF64| {
                (surface_depth(splat, &k, at) - f64::from(pixel.depth))
                    * f64::from(pixel.per_tolerance)
            };
            let wrong = |splat| far(splat).powi(2) / (1.0 + far(splat).powi(2));
            (pixel.per_tolerance > 0.0).then(|| splats.iter().map(wrong).collect())
        };
        Self(photograph().data.iter().enumerate().map(of_pixel).collect())
    }
}

/// Expected depth of a splat's distribution at a point of the image, to first order.
fn surface_depth(splat: &SplatF64, k: &Intrinsics, at: DVec2) -> f64 {
    const LOW_PASS: f64 = 0.3;
    let m = splat.mean;
    let axes = DMat3::from_quat(splat.rotation) * DMat3::from_diagonal(splat.scale);
    let covariance = axes * axes.transpose();
    let to_image = [
        DVec3::new(k.fx / m.z, 0.0, -k.fx * m.x / (m.z * m.z)),
        DVec3::new(0.0, k.fy / m.z, -k.fy * m.y / (m.z * m.z)),
    ];
    let with = |a: DVec3, b: DVec3| a.dot(covariance * b);
    let column = |i: usize| {
        DVec2::new(with(to_image[0], to_image[i]), with(to_image[1], to_image[i]))
            + LOW_PASS * DVec2::AXES[i]
    };
    let place = DMat2::from_cols(column(0), column(1));
    let with_depth = DVec2::new(with(to_image[0], DVec3::Z), with(to_image[1], DVec3::Z));
    let centre = DVec2::new(k.fx * m.x / m.z + k.cx, k.fy * m.y / m.z + k.cy);
    m.z + with_depth.dot(place.inverse() * (at - centre))
}

/// Finished colours of all pixels, with weighted coverage and depth penalty.
fn picture(splats: &[SplatF64], wrongness: &Wrongness, full_coverage: f64) -> Vec<f64> {
    let oracle = Oracle::new(splats, &camera(), &options());
    let n = SIZE as usize;
    let value = |i: usize| {
        let [r, g, b, a] = oracle.pixel(i % n, i / n).rgba;
        let fill = if a > 0.0 { (1.0 / full_coverage).min(1.0 / a) } else { 0.0 };
        let wrong = wrongness.0[i].as_ref().map_or(0.0, |wrongness| {
            // Renders the depth penalty of each splat as its brightness.
            let shade = |(splat, wrong): (&SplatF64, &f64)| SplatF64 {
                appearance: None,
                color: DVec3::splat(*wrong),
                ..*splat
            };
            let shaded: Vec<SplatF64> = splats.iter().zip(wrongness).map(shade).collect();
            Oracle::new(&shaded, &camera(), &options()).pixel(i % n, i / n).rgba[0]
        });
        [r * fill, g * fill, b * fill, a * COVERAGE.sqrt(), wrong * DEPTH.sqrt()]
    };
    (0..n * n).flat_map(value).collect()
}

fn changed(splat: SplatF64, parameter: usize, by: f64) -> SplatF64 {
    let mut out = splat;
    let axis = |i: usize| DVec3::AXES[i] * by;
    match parameter {
        0..3 => out.mean += axis(parameter),
        3..6 => out.scale[parameter - 3] *= by.exp(),
        6..9 => out.rotation = splat.rotation * DQuat::from_scaled_axis(axis(parameter - 6)),
        9 => out.opacity *= by.exp(),
        _ => {
            let (k, i) = ((parameter - N_FORM) / N_COLOR, (parameter - N_FORM) % N_COLOR);
            let look = out.appearance.as_mut().unwrap();
            let entry = |m: &mut DMat3, j: usize| m.col_mut(j)[k] += by;
            match i {
                0 => out.color[k] += by,
                1..4 => entry(&mut look.directional, i - 1),
                _ => entry(&mut look.gradient, i - 4),
            }
        }
    }
    out
}

/// Derivatives of all values of the picture with respect to one parameter of one splat.
fn derivatives(
    splats: &[SplatF64],
    wrongness: &Wrongness,
    i: usize,
    parameter: usize,
    full: f64,
) -> Vec<f64> {
    // Small enough that hardly any pixel crosses the alpha cut between the two pictures.
    const STEP: f64 = 1e-7;
    let at = |by: f64| {
        let mut splats = splats.to_vec();
        splats[i] = changed(splats[i], parameter, by);
        picture(&splats, wrongness, full)
    };
    let (ahead, back) = (at(STEP), at(-STEP));
    ahead.iter().zip(&back).map(|(a, b)| (a - b) / (2.0 * STEP)).collect()
}

/// Sums of the photometric walk for one splat.
struct Said {
    gradient: [f64; N],
    /// Lower triangles of the Gauss-Newton blocks of the form and of the colour of a channel.
    form: [f64; N_FORM_PRECISION],
    color: [f64; N_COLOR_PRECISION],
}

struct Lift<'a>(&'a PhotometricSums<'a>, VisibleSplat, Splat, Appearance);

impl Kernel for Lift<'_> {
    type Output = Said;

    #[inline(always)]
    fn run<V: Vector>(self) -> Said {
        let Self(compared, seen, splat, appearance) = self;
        let sums = compared.parameter_sums::<V>(&[(seen, splat, appearance)]);
        let first = |lanes: V| f64::from(lanes.to_array()[0]);
        let color = sums.color.as_flattened();
        let gradient = std::array::from_fn(|i| {
            first(if i < N_FORM { sums.gradient[i] } else { color[i - N_FORM] })
        });
        Said { gradient, form: sums.curvature.map(first), color: sums.color_curvature.map(first) }
    }
}

fn rule(full: f64) -> PixelRule {
    PixelRule {
        full_coverage: full as f32,
        tau: ALL,
        coverage: COVERAGE as f32,
        depth: DEPTH as f32,
    }
}

fn found(splats: &[Splat], appearance: &[Appearance], full: f64) -> Vec<(u32, Said)> {
    let view = SplatView::new(splats, appearance).unwrap();
    let (mut buffers, mut walk) = (ViewBuffers::default(), PhotometricWalk::default());
    let view = buffers.prepare(view, &camera(), EVALUATION_NEAR, SIZE as usize);
    let compared = walk.compare(&view, &photograph(), rule(full), RowSubset::ALL);
    let lift = |seen: VisibleSplat| {
        let id = seen.id as usize;
        (seen.id, Isa::best().run(Lift(&compared, seen, splats[id], appearance[id])))
    };
    compared.visible_splats(0.0).into_iter().map(lift).collect()
}

/// Photograph minus picture.
fn residual(splats: &[SplatF64], wrongness: &Wrongness, full: f64) -> Vec<f64> {
    let target = photograph();
    let values = |p: &MeasuredPixel| -> [f64; N_VALUES] {
        let [r, g, b] = p.color.map(f64::from);
        [r, g, b, f64::from(p.coverage) * COVERAGE.sqrt(), 0.0]
    };
    let target = target.data.iter().flat_map(values);
    target.zip(picture(splats, wrongness, full)).map(|(y, c)| y - c).collect()
}

/// Relative RMS error of each group of derivatives, over all splats.
fn errors(varied: bool, full: f64) -> [f64; 4] {
    let (splats, appearance) = scene(varied);
    let wide = wide(&splats, &appearance);
    let wrongness = Wrongness::of(&wide);
    let residual = residual(&wide, &wrongness, full);
    let groups = [0..3, 3..9, 9..10, 10..N];
    let mut groups_of = [(0.0f64, 0.0f64); 4];
    for (id, found) in found(&splats, &appearance, full) {
        for (group, (error, size)) in groups.iter().zip(&mut groups_of) {
            for parameter in group.clone() {
                let slope = derivatives(&wide, &wrongness, id as usize, parameter, full);
                let truth: f64 = slope.iter().zip(&residual).map(|(d, r)| d * r).sum();
                *error += (found.gradient[parameter] - truth).powi(2);
                *size += truth * truth;
            }
        }
    }
    groups_of.map(|(error, size)| (error / size).sqrt())
}

#[test]
fn every_derivative_is_the_pictures() {
    for full in [1.0, 0.6] {
        let [mean, form, opacity, color] = errors(false, full);
        println!(
            "full coverage {full}: mean {mean:.1e} form {form:.1e} opacity {opacity:.1e} colour {color:.1e}"
        );
        assert!(mean < 1e-4 && form < 1e-4 && opacity < 1e-4 && color < 1e-4);
    }
}

/// The derivatives by mean and form neglect how the plane of a splat turns under its colour gradient, so
/// the bounds are looser.
#[test]
fn colours_that_vary_change_little() {
    let [mean, form, opacity, color] = errors(true, 0.6);
    println!("varied: mean {mean:.1e} form {form:.1e} opacity {opacity:.1e} colour {color:.1e}");
    assert!(mean < 0.03 && form < 0.05 && opacity < 1e-4 && color < 1e-4);
}

/// The sums over disjoint row subsets add up to the sums over all rows.
#[test]
fn rows_add_up_to_the_whole() {
    let (splats, appearance) = scene(true);
    let view = SplatView::new(&splats, &appearance).unwrap();
    let (mut buffers, mut walk) = (ViewBuffers::default(), PhotometricWalk::default());
    let view = buffers.prepare(view, &camera(), EVALUATION_NEAR, SIZE as usize);
    let mut compared = |rows: RowSubset| {
        let found = walk.compare(&view, &photograph(), rule(0.6), rows);
        (found.squared_error, found.pixels, found.visible_splats(0.0).len())
    };
    let (error, pixels, n_seen) = compared(RowSubset::ALL);
    let quarters: Vec<_> = (0..4).map(|turn| compared(RowSubset::new(4, turn))).collect();
    let sum = quarters.iter().fold((0.0, 0.0), |sum, part| (sum.0 + part.0, sum.1 + part.1));
    assert!(
        (sum.0 - error).abs() < 1e-9 * error && sum.1 == pixels,
        "{sum:?} of {error}, {pixels}"
    );
    assert!(quarters.iter().all(|part| part.1 < 0.3 * pixels && part.2 <= n_seen));
    assert_eq!(compared(RowSubset::new(7, 6)), quarters[2], "7 rounds down to a power of two");
}

/// Diagonal of the prior precision of a splat's parameters.
fn prior(splat: &Splat) -> [f64; N] {
    let prior = PhotometricRule::DEFAULT.prior;
    let extent = f64::from(splat.scale.iter().fold(0.0f32, |a, &s| a.max(s)));
    let per = |deviation: f64| deviation.powi(-2);
    std::array::from_fn(|parameter| match parameter {
        0..3 => per(prior.mean * extent),
        3..6 => per(prior.scale),
        6..9 => per(prior.turn),
        9 => per(prior.opacity),
        _ => match (parameter - N_FORM) % N_COLOR {
            0 => per(prior.color),
            1..4 => per(prior.directional),
            _ => per(prior.gradient / extent),
        },
    })
}

fn solved(n: usize, matrix: &[f64], right: &[f64]) -> Vec<f64> {
    Cholesky::new(n, matrix).unwrap().solve(right)
}

/// Squared error after every splat takes its step.
fn after(splats: &[SplatF64], wrongness: &Wrongness, steps: &[f64], full: f64) -> f64 {
    let step = |(i, splat): (usize, &SplatF64)| {
        (0..N).fold(*splat, |splat, parameter| changed(splat, parameter, steps[i * N + parameter]))
    };
    let stepped: Vec<SplatF64> = splats.iter().enumerate().map(step).collect();
    residual(&stepped, wrongness, full).iter().map(|r| r * r).sum()
}

/// The blocks neglect cross terms between splats of a pixel, and damping compensates for it. Compares
/// their step with the dense Gauss-Newton step under the same prior and noise.
#[test]
fn blocks_come_near_the_dense_step() {
    let (splats, appearance) = scene(true);
    let (full, wide) = (0.6, wide(&splats, &appearance));
    let wrongness = Wrongness::of(&wide);
    let residual = residual(&wide, &wrongness, full);
    let before: f64 = residual.iter().map(|r| r * r).sum();
    let columns: Vec<Vec<f64>> =
        (0..splats.len() * N).map(|k| derivatives(&wide, &wrongness, k / N, k % N, full)).collect();
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let n = columns.len();
    let priors: Vec<f64> = splats.iter().flat_map(prior).collect();
    // Training assumes noise of several times the actual residual.
    let rule = PhotometricRule::DEFAULT;
    let variance = rule.noise.powi(2) * before / residual.len() as f64;
    let mut dense = vec![0.0; n * n];
    for i in 0..n {
        for j in 0..=i {
            let entry = dot(&columns[i], &columns[j]) / variance;
            (dense[i * n + j], dense[j * n + i]) = (entry, entry);
        }
        dense[i * n + i] += priors[i];
    }
    let right: Vec<f64> = columns.iter().map(|column| dot(column, &residual) / variance).collect();
    let dense_step = solved(n, &dense, &right);
    let mut block_step = vec![0.0; n];
    for (id, said) in found(&splats, &appearance, full) {
        let first = id as usize * N;
        let triangle = |i: usize, j: usize| i.max(j) * (i.max(j) + 1) / 2 + i.min(j);
        let mut block = |from: usize, size: usize, curvature: &[f64]| {
            let at = first + from;
            let entry = |k: usize| {
                let (i, j) = (k / size, k % size);
                let own = if i == j { priors[at + i] } else { 0.0 };
                own + rule.damping * curvature[triangle(i, j)] / variance
            };
            let matrix: Vec<f64> = (0..size * size).map(entry).collect();
            let pull = |i: usize| said.gradient[from + i] / variance;
            let step = solved(size, &matrix, &(0..size).map(pull).collect::<Vec<_>>());
            block_step[at..at + size].copy_from_slice(&step);
        };
        block(0, N_FORM, &said.form);
        (0..3).for_each(|k| block(N_FORM + k * N_COLOR, N_COLOR, &said.color));
    }
    let gained = |step: &[f64]| 1.0 - after(&wide, &wrongness, step, full) / before;
    let (dense, block) = (gained(&dense_step), gained(&block_step));
    let cosine = dot(&dense_step, &block_step)
        / (dot(&dense_step, &dense_step) * dot(&block_step, &block_step)).sqrt();
    println!(
        "squared error removed: dense {:.1} %, blocks {:.1} %; cosine of the steps {cosine:.3}",
        100.0 * dense,
        100.0 * block
    );
    assert!(block > 0.0 && block > 0.5 * dense && cosine > 0.5);
}
