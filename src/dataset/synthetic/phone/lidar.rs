//! Model of a phone's lidar: depth smoothed across edges, with correlated noise and holes, and a confidence
//! code from 0 to 2.

use crate::dataset::synthetic::room::FurnishedRoom;
use crate::dataset::synthetic::view::cast_rays;
use crate::math::camera::Camera;
use crate::math::image::Image;
use crate::math::rng::Rng;

/// Number of rays along each axis of a pixel.
const RAYS: usize = 3;
/// Binomial low-pass filter over five pixels.
const LOW_PASS: [f32; 5] = [0.0625, 0.25, 0.375, 0.25, 0.0625];
/// Maximum range, metres. Surfaces beyond it yield no return.
const RANGE: f32 = 5.0;
/// Minimum cosine of the incidence angle for a return, and for the highest confidence.
const GRAZING: [f32; 2] = [0.1, 0.3];
/// Maximum relative depth span around a pixel for a confidence above 0, and for confidence 2.
const EDGES: [f32; 2] = [0.1, 0.05];

#[derive(Clone, Copy)]
struct RayReturn {
    z: f32,
    cosine: f32,
    is_poor: bool,
}

/// Simulates the lidar. Returns depth along the optical axis (metres, 0 in holes) and the confidence
/// codes.
pub(super) fn measure(
    room: &FurnishedRoom,
    camera: &Camera,
    rng: &mut Rng,
) -> (Image<f64>, Image<u8>) {
    let (width, height) = (camera.intrinsics.width as usize, camera.intrinsics.height as usize);
    let pixels = pixel_returns(&echoes(room, camera), width, height);
    // At edges, foreground objects grow in some places and shrink in others.
    let swelling = correlated_noise(width, height, 6.0, rng);
    let lowest = neighbourhood_range(&pixels, 1, |pixel| pixel.least);
    let spans = neighbourhood_range(&pixels, 2, |pixel| pixel.mean)
        .map(|[low, high]| (high - low) / low.max(0.1));
    // Depth inside surfaces stays: only edges swell.
    let mixed = (0..width * height).map(|i| {
        let is_edge = spans.data[i] > EDGES[1];
        let swell = if is_edge { swelling.data[i].clamp(0.0, 1.0) } else { 0.0 };
        pixels.data[i].mean + swell * (lowest.data[i][0] - pixels.data[i].mean)
    });
    let smooth = separable_filter(&Image::from_vec(width, height, mixed.collect()), &LOW_PASS);
    let [fine, coarse] = [1.5, 8.0].map(|sigma| correlated_noise(width, height, sigma, rng));
    let dropout = correlated_noise(width, height, 5.0, rng);
    let mut depth_z = Image::filled(width, height, 0.0);
    let mut confidences = Image::filled(width, height, 0);
    for (i, pixel) in pixels.data.iter().enumerate() {
        let z = smooth.data[i];
        // 3 to 5 mm within the range.
        let deviation = 0.0028 + 0.0005 * z;
        // The squares of both factors add up to 1, so the variance stays.
        let noise = deviation * (0.8 * fine.data[i] + 0.6 * coarse.data[i]);
        let is_lost = pixel.is_poor && dropout.data[i] > 0.3;
        if is_lost || pixel.cosine < GRAZING[0] || !(0.1..RANGE).contains(&(z + noise)) {
            continue;
        }
        depth_z.data[i] = f64::from(z + noise);
        confidences.data[i] = confidence(pixel, z, spans.data[i]);
    }
    (depth_z, confidences)
}

fn confidence(pixel: &LidarPixel, z: f32, span: f32) -> u8 {
    let is_far = z > 0.8 * RANGE;
    let is_grazing = pixel.cosine < GRAZING[1];
    if span > EDGES[0] || (is_far && is_grazing) {
        return 0;
    }
    if span > EDGES[1] || is_far || is_grazing || pixel.is_poor { 1 } else { 2 }
}

fn echoes(room: &FurnishedRoom, camera: &Camera) -> Image<RayReturn> {
    let fine = Camera { intrinsics: camera.intrinsics.scaled(RAYS as f64), ..*camera };
    // Beyond the range, so that pixels without a return are holes.
    let silence = RayReturn { z: 2.0 * RANGE, cosine: 0.0, is_poor: true };
    cast_rays(room, &fine, silence, |ray, index, hit| {
        let solid = &room.solids[index];
        let normal = solid.shape.normal(ray.at(hit.t), hit.face);
        let cosine = -normal.dot(ray.direction.normalize());
        RayReturn {
            z: hit.t as f32,
            cosine: cosine as f32,
            is_poor: solid.texture.is_poor_target(),
        }
    })
}

#[derive(Clone, Copy)]
struct LidarPixel {
    mean: f32,
    least: f32,
    cosine: f32,
    /// True if most rays of the pixel hit glossy, glass or black surfaces.
    is_poor: bool,
}

fn pixel_returns(echoes: &Image<RayReturn>, width: usize, height: usize) -> Image<LidarPixel> {
    let pixel = |i: usize| {
        let (x, y) = (i % width * RAYS, i / width * RAYS);
        let all = (0..RAYS * RAYS).map(|ray| echoes.at(x + ray % RAYS, y + ray / RAYS));
        let sum = |value: fn(&RayReturn) -> f32| all.clone().map(value).sum::<f32>();
        let n = (RAYS * RAYS) as f32;
        LidarPixel {
            mean: sum(|echo| echo.z) / n,
            least: all.clone().fold(f32::INFINITY, |least, echo| least.min(echo.z)),
            cosine: sum(|echo| echo.cosine) / n,
            is_poor: 2.0 * sum(|echo| f32::from(u8::from(echo.is_poor))) > n,
        }
    };
    Image::from_vec(width, height, (0..width * height).map(pixel).collect())
}

fn neighbourhood_range(
    pixels: &Image<LidarPixel>,
    reach: usize,
    value: fn(&LidarPixel) -> f32,
) -> Image<[f32; 2]> {
    let (width, height) = (pixels.width, pixels.height);
    let span = |i: usize| {
        let near = |at: usize, n: usize| at.saturating_sub(reach)..(at + reach + 1).min(n);
        let rows = near(i / width, height);
        let values = rows.flat_map(|y| near(i % width, width).map(move |x| (x, y)));
        values.fold([f32::INFINITY, 0.0f32], |[low, high], (x, y)| {
            let value = value(pixels.at(x, y));
            [low.min(value), high.max(value)]
        })
    };
    Image::from_vec(width, height, (0..width * height).map(span).collect())
}

/// Generates Gaussian noise of unit variance with a correlation length of about `sigma` pixels.
pub(super) fn correlated_noise(
    width: usize,
    height: usize,
    sigma: f64,
    rng: &mut Rng,
) -> Image<f32> {
    let white = (0..width * height).map(|_| rng.normal() as f32).collect();
    let white = Image::from_vec(width, height, white);
    let reach = (2.5 * sigma).ceil() as i64;
    let weight = |i: i64| (-0.5 * (i as f64 / sigma).powi(2)).exp() as f32;
    let weights: Vec<f32> = (-reach..=reach).map(weight).collect();
    // The variance of a weighted sum of independent unit normals is the sum of squared weights.
    let norm = weights.iter().map(|w| w * w).sum::<f32>().sqrt();
    let weights: Vec<f32> = weights.iter().map(|w| w / norm).collect();
    separable_filter(&white, &weights)
}

/// Filters an image along its rows and then along its columns, with mirrored borders.
pub(super) fn separable_filter(image: &Image<f32>, weights: &[f32]) -> Image<f32> {
    let (width, height) = (image.width, image.height);
    let reach = weights.len() as i64 / 2;
    let mirrored = |at: i64, n: usize| {
        let period = 2 * n as i64;
        let at = at.rem_euclid(period);
        at.min(period - 1 - at) as usize
    };
    let mut rows = image.clone();
    let mut line = Vec::new();
    for (from, to) in image.data.chunks(width).zip(rows.data.chunks_mut(width)) {
        line.clear();
        line.extend((-reach..width as i64 + reach).map(|x| from[mirrored(x, width)]));
        for (window, value) in line.windows(weights.len()).zip(to) {
            *value = window.iter().zip(weights).map(|(v, w)| v * w).sum();
        }
    }
    let mut out = Image::filled(width, height, 0.0f32);
    for (y, to) in out.data.chunks_mut(width).enumerate() {
        for (i, weight) in weights.iter().enumerate() {
            let row = mirrored(y as i64 + i as i64 - reach, height) * width;
            for (value, from) in to.iter_mut().zip(&rows.data[row..row + width]) {
                *value += weight * from;
            }
        }
    }
    out
}
