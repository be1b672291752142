//! Splats as SOG version 2.
//!
//! Splats are written along a space-filling curve that runs down the columns of the images, because the WebP encoder
//! predicts a pixel from the one above it. Values are rounded no finer than is visible: what remains is noise, which
//! no encoder compresses.

use super::{
    Asset, Codebook, Coded, FIRST_MODE, Images, META, Means, Meta, N_COEFFICIENTS, N_LEVELS,
    Palette, ROW_ENTRIES, VERSION, from_log, to_log,
};
use crate::export::gaussian::{
    Gaussian, color_to_harmonic, directional_to_harmonics, harmonics_to_directional, wxyz,
};
use crate::export::stream::{ProgressCounter, SplatRows, morton_order, small_quantile};
use glam::{DMat3, DVec3};
use image_webp::{ColorType, EncoderParams, WebPEncoder};
use rayon::prelude::*;
use std::f64::consts::SQRT_2;
use std::io;
use std::io::{Cursor, Write};
use wide::f32x8;
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipWriter};

/// Rounding step of coordinates, relative to the middle one of a small splat's three standard deviations.
const STEP_OF_DEVIATION: f64 = 1.0 / 4.0;
/// Number of bits of a coordinate.
const COORDINATE_BITS: u32 = 16;
/// Rounding error of a rotation that does not show, relative to a splat's middle standard deviation over its largest.
const ERROR_OF_ROTATION: f64 = 1.0 / 4.0;
/// Error of rotations in radians, root mean square, after rounding to all levels of a byte.
const ERROR_OF_BYTE: f64 = 0.0055;
/// Largest number of lowest bits of rotations that are zero.
const MAX_ZERO_BITS: u32 = 2;
/// Number of levels of the logarithms of scales.
const SCALE_LEVELS: usize = 32;
/// Number of levels of colours.
const COLOR_LEVELS: usize = 64;
/// Number of splats for each entry of the palette of harmonics.
const SPLATS_PER_ENTRY: usize = 64;
/// Largest number of entries of the palette.
const MAX_ENTRIES: usize = 1024;
/// Number of splats from which the palette is learned.
const N_SAMPLED: usize = 1 << 15;
/// Number of iterations of k-means.
const N_ITERATIONS: usize = 8;
/// Number of bins in which the values of a codebook are counted.
const N_BINS: usize = 4096;
/// Number of values in the three coefficients of degree 1.
const N_VALUES: usize = 9;

pub(in crate::export) struct SogLayout {
    /// Rows in the order of pixels.
    pixels: Vec<u32>,
    width: usize,
    height: usize,
    /// Extremes of the positions in the logarithmic domain.
    bounds: [DVec3; 2],
    /// Number of lowest bits of coordinates that are zero.
    n_zero_bits: u32,
    is_antialiased: bool,
    has_directions: bool,
}

impl SogLayout {
    pub fn new(rows: &impl SplatRows, is_antialiased: bool) -> Self {
        let n = rows.n_rows();
        let none = [DVec3::INFINITY, DVec3::NEG_INFINITY];
        let merge = |[a, b]: [DVec3; 2], [c, d]: [DVec3; 2]| [a.min(c), b.max(d)];
        let logs = (0..n).into_par_iter().map(|i| [log_mean(&rows.row(i)); 2]);
        let bounds = logs.reduce(|| none, merge);
        let n_zero_bits = n_zero_bits(rows, bounds);
        let cell = |i: usize| rounded(&rows.row(i), bounds, n_zero_bits).map(u64::from);
        let order = morton_order(n, cell);
        let width = (n as f64).sqrt().ceil() as usize;
        let height = n.div_ceil(width);
        let pixels = in_columns(&order, width, height);
        let has_directions = rows.has_directions();
        Self { pixels, width, height, bounds, n_zero_bits, is_antialiased, has_directions }
    }

    pub fn n_columns(&self) -> usize {
        if self.has_directions { 6 } else { 5 }
    }

    pub fn write(
        &self,
        out: &mut dyn Write,
        rows: &impl SplatRows,
        steps: &mut ProgressCounter,
    ) -> io::Result<()> {
        let n = rows.n_rows();
        let entries = if self.has_directions { palette(rows, &self.pixels) } else { Vec::new() };
        let rows = &Labelled::new(rows, &entries);
        let mut zip = ZipWriter::new(Cursor::new(Vec::new()));
        let mut add = |name: &str, bytes: &[u8], method: CompressionMethod| {
            let options = SimpleFileOptions::default().compression_method(method);
            zip.start_file(name, options).map_err(io::Error::other)?;
            zip.write_all(bytes)
        };
        let mut stored =
            |name: &str, channels: usize, pixel: &(dyn Fn(usize) -> [u8; 4] + Sync)| {
                let pixels = self.pixels.par_iter().map(|row| pixel(*row as usize));
                let pixels: Vec<[u8; 4]> = pixels.collect();
                add(
                    name,
                    &webp(&pixels, channels, self.width, self.height)?,
                    CompressionMethod::Stored,
                )?;
                steps.advance(n)?;
                Ok::<Images, io::Error>(Images { files: vec![name.to_owned()] })
            };
        let mut image =
            |name: &str, channels: usize, pixel: &(dyn Fn(Gaussian) -> [u8; 4] + Sync)| {
                stored(name, channels, &|row| pixel(rows.row(row)))
            };
        let position =
            |g: &Gaussian| rounded(g, self.bounds, self.n_zero_bits).map(u16::to_le_bytes);
        let low = image("means_l.webp", 3, &|g| {
            let [[a, _], [b, _], [c, _]] = position(&g);
            [a, b, c, 255]
        })?;
        let high = image("means_u.webp", 3, &|g| {
            let [[_, a], [_, b], [_, c]] = position(&g);
            [a, b, c, 255]
        })?;
        let scale = |g: &Gaussian| g.scale.to_array().map(f64::ln);
        let levels = Levels::of(rows, SCALE_LEVELS, scale);
        let files = image("scales.webp", 3, &|g| levels.pixel(scale(&g), 255))?.files;
        let scales = Coded { codebook: levels.codebook(), files };
        let n_zero_bits = rotation_zero_bits(rows);
        let quats = image("quats.webp", 4, &|g| to_quaternion(wxyz(g.rotation), n_zero_bits))?;
        let color = |g: &Gaussian| color_to_harmonic(g.color).to_array();
        let levels = Levels::of(rows, COLOR_LEVELS, color);
        let files =
            image("sh0.webp", 4, &|g| levels.pixel(color(&g), to_byte(255.0 * g.opacity)))?.files;
        let sh0 = Coded { codebook: levels.codebook(), files };
        let harmonics = match self.has_directions {
            false => None,
            true => {
                let labels = stored("shN_labels.webp", 3, &|row| {
                    let [low, high] = rows.labels[row].to_le_bytes();
                    // The encoder stores differences to the second channel: none are left in the third.
                    [low, high, high, 255]
                })?;
                let name = "shN_centroids.webp";
                let (codebook, bytes) = centroids(&entries)?;
                add(name, &bytes, CompressionMethod::Stored)?;
                let files = [vec![name.to_owned()], labels.files].concat();
                Some(Palette { count: entries.len() as u64, bands: 1, codebook, files })
            }
        };
        let [mins, maxs] = self.bounds.map(|corner| corner.to_array());
        let meta = Meta {
            version: VERSION,
            asset: Asset { generator: concat!("vbgs-studio ", env!("CARGO_PKG_VERSION")).into() },
            count: n as u64,
            antialias: self.is_antialiased,
            means: Means { mins, maxs, files: [low.files, high.files].concat() },
            scales,
            quats,
            sh0,
            harmonics,
        };
        add(META, &serde_json::to_vec(&meta)?, CompressionMethod::Deflated)?;
        out.write_all(zip.finish().map_err(io::Error::other)?.get_ref())
    }
}

/// Arranges rows so that they run down the columns of an image. Returns them in the order of its pixels, row by row.
fn in_columns(order: &[u32], width: usize, height: usize) -> Vec<u32> {
    // The last row is incomplete, because the pixels behind the last splat must be the unused ones.
    let n_long = order.len() - width * (height - 1);
    let mut pixels = vec![0; order.len()];
    let mut next = order.iter();
    for x in 0..width {
        let length = if x < n_long { height } else { height - 1 };
        for (y, row) in (0..length).zip(&mut next) {
            pixels[y * width + x] = *row;
        }
    }
    pixels
}

fn log_mean(g: &Gaussian) -> DVec3 {
    DVec3::from_array(g.mean.to_array().map(to_log))
}

/// Returns the coordinates of a position in 16 bits, of which the lowest `n_zero_bits` are zero.
fn rounded(g: &Gaussian, [start, end]: [DVec3; 2], n_zero_bits: u32) -> [u16; 3] {
    let extent = (end - start).max(DVec3::splat(f64::MIN_POSITIVE));
    let share = (log_mean(g) - start) / extent;
    let most = f64::from(u16::MAX >> n_zero_bits);
    let step = f64::from(1u32 << n_zero_bits);
    let coordinate = |v: f64| (v * f64::from(u16::MAX) / step).round().min(most) as u16;
    share.to_array().map(|v| coordinate(v) << n_zero_bits)
}

/// Returns how many of the lowest bits of coordinates are finer than a small splat needs.
fn n_zero_bits(rows: &impl SplatRows, [start, end]: [DVec3; 2]) -> u32 {
    let extent = (end - start).max_element() / f64::from(u16::MAX);
    // Number of steps in a middle deviation at the splat's place.
    let steps = |g: &Gaussian| {
        let log = log_mean(g).abs().max_element();
        let step = from_log(log + extent) - from_log(log);
        g.middle_scale() * STEP_OF_DEVIATION / step.max(f64::MIN_POSITIVE)
    };
    let small = small_quantile(rows, steps);
    (small.log2().floor().max(0.0) as u32).min(COORDINATE_BITS / 2)
}

/// Returns how many of the lowest bits of rotations are finer than shows at a long splat.
fn rotation_zero_bits(rows: &impl SplatRows) -> u32 {
    let steps = |g: &Gaussian| {
        let width = g.middle_scale() / g.scale.max_element();
        ERROR_OF_ROTATION * width / ERROR_OF_BYTE
    };
    (small_quantile(rows, steps).log2().floor().max(0.0) as u32).min(MAX_ZERO_BITS)
}

fn to_byte(v: f64) -> u8 {
    v.round() as u8
}

/// Inverse of [`quaternion`](super::quaternion) for `w x y z`. Half a turn about an axis of a Gaussian does not change
/// it, so the rotation is chosen whose `w` is the largest component: all pixels then have the same mode. The lowest
/// `n_zero_bits` of each byte are zero.
fn to_quaternion([w, x, y, z]: [f64; 4], n_zero_bits: u32) -> [u8; 4] {
    let most = w.abs().max(x.abs()).max(y.abs()).max(z.abs());
    let [w, x, y, z] = match most {
        _ if w.abs() == most => [w, x, y, z],
        _ if x.abs() == most => [x, -w, -z, y],
        _ if y.abs() == most => [y, z, -w, -x],
        _ => [z, -y, x, -w],
    };
    let most = f64::from(u8::MAX >> n_zero_bits);
    let step = f64::from(1u8 << n_zero_bits);
    let byte = |v: f64| {
        let share = v * w.signum() / SQRT_2 + 0.5;
        to_byte((255.0 * share / step).round().min(most)) << n_zero_bits
    };
    [byte(x), byte(y), byte(z), FIRST_MODE]
}

/// Ascending levels to which numbers are rounded.
struct Levels(Vec<f32>);

impl Levels {
    /// Returns at most `most` levels for three numbers of every row.
    fn of<R: SplatRows>(
        rows: &R,
        most: usize,
        values: impl Fn(&Gaussian) -> [f64; 3] + Sync,
    ) -> Self {
        let all = || (0..rows.n_rows()).into_par_iter().map(|i| values(&rows.row(i)));
        let merge = |[a, b]: [f64; 2], [c, d]: [f64; 2]| [a.min(c), b.max(d)];
        let extremes = all().flat_map_iter(|three| three.map(|v| [v; 2]));
        let extremes = extremes.reduce(|| [f64::INFINITY, f64::NEG_INFINITY], merge);
        let count = |mut bins: Bins, three: [f64; 3]| {
            three.into_iter().for_each(|v| bins.add(v));
            bins
        };
        let bins = (0..rows.n_rows()).map(|i| values(&rows.row(i)));
        Self::of_bins(&bins.fold(Bins::new(extremes), count), most)
    }

    fn of_numbers(numbers: &[f32], most: usize) -> Self {
        let numbers = || numbers.iter().map(|v| f64::from(*v));
        let extremes =
            [numbers().fold(f64::INFINITY, f64::min), numbers().fold(f64::NEG_INFINITY, f64::max)];
        let mut bins = Bins::new(extremes);
        numbers().for_each(|v| bins.add(v));
        Self::of_bins(&bins, most)
    }

    /// Places levels by k-means in one dimension, for the least sum of squared errors.
    fn of_bins(bins: &Bins, most: usize) -> Self {
        let filled: Vec<(f64, f64)> = bins.filled().collect();
        // Where values have the density p, the best levels have nearly the density ∛p.
        let total: f64 = filled.iter().map(|(n, _)| n.cbrt()).sum();
        let mut levels: Vec<f64> = Vec::new();
        let mut sum = 0.0;
        for (n, mean) in &filled {
            let next = sum + n.cbrt();
            if (next * most as f64 / total).floor() > (sum * most as f64 / total).floor() {
                levels.push(*mean);
            }
            sum = next;
        }
        if levels.is_empty() {
            levels.extend(filled.first().map(|(_, mean)| *mean));
        }
        for _ in 0..N_ITERATIONS {
            let mut sums = vec![(0.0, 0.0); levels.len()];
            for (n, mean) in &filled {
                let (total, weight) = &mut sums[nearest_level(&levels, *mean)];
                *total += n * mean;
                *weight += n;
            }
            let used = sums.iter().filter(|(_, weight)| *weight > 0.0);
            levels = used.map(|(total, weight)| total / weight).collect();
        }
        Self(levels.into_iter().map(|level| level as f32).collect())
    }

    fn index(&self, value: f64) -> u8 {
        nearest_level(&self.0, value as f32) as u8
    }

    fn pixel(&self, values: [f64; 3], alpha: u8) -> [u8; 4] {
        let [r, g, b] = values.map(|v| self.index(v));
        [r, g, b, alpha]
    }

    fn codebook(&self) -> Codebook {
        let last = self.0.last().copied();
        let level = |i: usize| self.0.get(i).copied().or(last);
        Codebook((0..N_LEVELS).map(level).collect())
    }
}

fn nearest_level<T: Copy + PartialOrd + std::ops::Sub<Output = T>>(
    levels: &[T],
    value: T,
) -> usize {
    let above = levels.partition_point(|level| *level < value);
    match (above.checked_sub(1).map(|i| levels[i]), levels.get(above)) {
        (Some(below), Some(next)) if value - below <= *next - value => above - 1,
        (Some(_), None) => above - 1,
        _ => above,
    }
}

/// Numbers counted in bins of equal width.
struct Bins {
    start: f64,
    width: f64,
    /// Number and sum of the values of each bin.
    sums: Vec<(f64, f64)>,
}

impl Bins {
    fn new([start, end]: [f64; 2]) -> Self {
        let width = ((end - start) / N_BINS as f64).max(f64::MIN_POSITIVE);
        Self { start, width, sums: vec![(0.0, 0.0); N_BINS] }
    }

    fn add(&mut self, v: f64) {
        let (n, sum) = &mut self.sums[(((v - self.start) / self.width) as usize).min(N_BINS - 1)];
        (*n, *sum) = (*n + 1.0, *sum + v);
    }

    /// Returns the number of values and the mean of every bin that has some.
    fn filled(&self) -> impl Iterator<Item = (f64, f64)> {
        self.sums.iter().filter(|(n, _)| *n > 0.0).map(|(n, sum)| (*n, sum / n))
    }
}

fn harmonics(g: &Gaussian) -> [f32; N_VALUES] {
    let [a, b, c] = directional_to_harmonics(g.directional).map(|v| v.as_vec3().to_array());
    let mut values = [0.0; N_VALUES];
    values.iter_mut().zip([a, b, c].as_flattened()).for_each(|(to, v)| *to = *v);
    values
}

/// Learns a palette of harmonics by k-means, from splats at equal distances along the curve.
fn palette(rows: &impl SplatRows, pixels: &[u32]) -> Vec<[f32; N_VALUES]> {
    let step = pixels.len().div_ceil(N_SAMPLED);
    let sampled: Vec<u32> = pixels.iter().step_by(step).copied().collect();
    let samples: Vec<[f32; N_VALUES]> =
        sampled.par_iter().map(|row| harmonics(&rows.row(*row as usize))).collect();
    let n = (pixels.len() / SPLATS_PER_ENTRY).clamp(1, MAX_ENTRIES).min(samples.len());
    let mut entries: Vec<[f32; N_VALUES]> =
        (0..n).map(|i| samples[i * samples.len() / n]).collect();
    for _ in 0..N_ITERATIONS {
        let nearest = Nearest::new(&entries);
        let labels: Vec<usize> = samples.par_iter().map(|sample| nearest.index(sample)).collect();
        let mut sums = vec![([0.0f64; N_VALUES], 0.0f64); n];
        for (sample, label) in samples.iter().zip(labels) {
            let (sum, weight) = &mut sums[label];
            sum.iter_mut().zip(sample).for_each(|(sum, v)| *sum += f64::from(*v));
            *weight += 1.0;
        }
        for (entry, (sum, weight)) in entries.iter_mut().zip(sums).filter(|(_, (_, w))| *w > 0.0) {
            *entry = sum.map(|v| (v / weight) as f32);
        }
    }
    // Neighbouring entries are alike, so that the upper bytes of labels are, too.
    let key = |entry: &[f32; N_VALUES]| entry.iter().sum::<f32>();
    entries.sort_by(|a, b| key(a).total_cmp(&key(b)));
    entries
}

/// Rows whose harmonics are those of a palette.
struct Labelled<'a, R> {
    rows: &'a R,
    /// Entries of the palette as matrices of directional colour.
    entries: Vec<DMat3>,
    /// Index of each row's entry; empty without a palette.
    labels: Vec<u16>,
}

impl<'a, R: SplatRows> Labelled<'a, R> {
    fn new(rows: &'a R, entries: &[[f32; N_VALUES]]) -> Self {
        let nearest = Nearest::new(entries);
        let all = if entries.is_empty() { 0..0 } else { 0..rows.n_rows() };
        let labels = all.into_par_iter().map(|i| nearest.index(&harmonics(&rows.row(i))) as u16);
        let directional = |entry: &[f32; N_VALUES]| {
            let coefficient = |k: usize| DVec3::from_slice(&entry.map(f64::from)[3 * k..]);
            harmonics_to_directional([0, 1, 2].map(coefficient))
        };
        let labels = labels.collect();
        Self { rows, entries: entries.iter().map(directional).collect(), labels }
    }
}

impl<R: SplatRows> SplatRows for Labelled<'_, R> {
    fn n_rows(&self) -> usize {
        self.rows.n_rows()
    }

    fn row(&self, row: usize) -> Gaussian {
        let exact = self.rows.row(row);
        let Some(label) = self.labels.get(row) else { return exact };
        exact.with_slope(self.entries[usize::from(*label)])
    }

    fn has_directions(&self) -> bool {
        self.rows.has_directions()
    }
}

/// Entries of a palette in blocks of eight, for the search of the nearest one.
struct Nearest(Vec<[f32x8; N_VALUES]>);

impl Nearest {
    fn new(entries: &[[f32; N_VALUES]]) -> Self {
        let block = |entries: &[[f32; N_VALUES]]| {
            // Repeating the last entry fills a block without a new candidate.
            let lane = |k: usize, i: usize| entries[i.min(entries.len() - 1)][k];
            std::array::from_fn(|k| f32x8::new(std::array::from_fn(|i| lane(k, i))))
        };
        Self(entries.chunks(8).map(block).collect())
    }

    fn index(&self, values: &[f32; N_VALUES]) -> usize {
        let values = values.map(f32x8::splat);
        let mut best = (f32::INFINITY, 0);
        for (i, block) in self.0.iter().enumerate() {
            let squared = |(entry, value): (&f32x8, &f32x8)| (*entry - *value) * (*entry - *value);
            let distance = block.iter().zip(&values).map(squared).fold(f32x8::ZERO, |a, b| a + b);
            for (lane, distance) in distance.to_array().into_iter().enumerate() {
                if distance < best.0 {
                    best = (distance, 8 * i + lane);
                }
            }
        }
        best.1
    }
}

/// Encodes the image of a palette; returns the codebook of its values as well.
fn centroids(entries: &[[f32; N_VALUES]]) -> io::Result<(Codebook, Vec<u8>)> {
    let levels = Levels::of_numbers(entries.as_flattened(), N_LEVELS);
    let coefficients = entries.as_flattened().as_chunks::<3>().0.iter();
    let pixels: Vec<[u8; 4]> =
        coefficients.map(|rgb| levels.pixel(rgb.map(f64::from), 255)).collect();
    let width = ROW_ENTRIES * N_COEFFICIENTS[0];
    let bytes = webp(&pixels, 3, width, pixels.len().div_ceil(width))?;
    Ok((levels.codebook(), bytes))
}

/// Encodes an image of three or four channels. Pixels beyond those given repeat the one above, or are zero.
fn webp(pixels: &[[u8; 4]], channels: usize, width: usize, height: usize) -> io::Result<Vec<u8>> {
    let pixel = |i: usize| {
        let above = || i.checked_sub(width).and_then(|i| pixels.get(i));
        pixels.get(i).or_else(above).copied().unwrap_or_default()
    };
    let bytes: Vec<u8> =
        (0..width * height).flat_map(|i| pixel(i).into_iter().take(channels)).collect();
    let color = if channels == 4 { ColorType::Rgba8 } else { ColorType::Rgb8 };
    let encode = |use_predictor_transform: bool| {
        let mut file = Vec::new();
        let mut encoder = WebPEncoder::new(&mut file);
        let mut params = EncoderParams::default();
        params.use_predictor_transform = use_predictor_transform;
        encoder.set_params(params);
        encoder.encode(&bytes, width as u32, height as u32, color).map_err(io::Error::other)?;
        Ok::<Vec<u8>, io::Error>(file)
    };
    // Differences of neighbours have fewer bits, unless they are noise.
    let (plain, predicted) = (encode(false)?, encode(true)?);
    Ok(if predicted.len() < plain.len() { predicted } else { plain })
}
