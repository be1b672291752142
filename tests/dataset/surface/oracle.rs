//! A slow, plain implementation in f64 of the text (`dataset.md`, Plane fit), pixel by pixel. It is
//! the reference of the fast path and shares no arithmetic with it.

use glam::{DMat3, DVec2, DVec3, Vec3};
use std::collections::HashMap;
use std::ops::RangeInclusive;
use vbgs_studio::dataset::calibration::{Calibration, ColorCamera};
use vbgs_studio::dataset::frame::{DepthKind, Frame};
use vbgs_studio::dataset::surface::sensor::{Profile, Thresholds};
use vbgs_studio::dataset::surface::{PixelStatus, SurfaceSettings};
use vbgs_studio::dataset::unproject::MAX_COORDINATE;
use vbgs_studio::math::camera::Intrinsics;
use vbgs_studio::math::image::Image;
use vbgs_studio::observation::surface::{Observation, SurfacePoint};

/// Pixels from the centre of the window to its side (step 3).
const RADIUS: usize = 2;
/// Least-squares rounds; from the second on only inliers take part (step 3).
const ROUNDS: usize = 3;
/// Fewest neighbours of a round, the pixel itself included.
const MIN_INLIERS: usize = 5;
/// Fewest inliers after the last round, as a share of the window (step 4).
const MIN_SHARE: f64 = 0.3;
/// Side of the tiles that order the points, in pixels.
const TILE: usize = 8;
/// Lengths whose squares and inverses fit in f32, the range of the fast path.
const LENGTHS: RangeInclusive<f64> = 1e-9..=1e9;
/// Side of a cell of the depth test, in pixels of the colour image.
const CELL: f64 = 2.0;
/// Pixels of the window.
const WINDOW: f64 = ((2 * RADIUS + 1) * (2 * RADIUS + 1)) as f64;

/// Prepares one frame; also returns the status of every pixel.
///
/// # Panics
/// Panics on a frame without depth.
pub fn prepare(frame: &Frame, settings: &SurfaceSettings) -> (Observation, Image<PixelStatus>) {
    let depth = frame.depth.as_ref().expect("a frame with depth");
    let camera = frame.camera;
    let mut profile = settings.sensor.profile(depth, &camera.intrinsics);
    profile.thresholds = settings.thresholds.unwrap_or(profile.thresholds);
    let none = Calibration::NONE;
    let calibration = settings.calibration.as_ref().unwrap_or(&none);
    let (width, height) = depth.size();
    let mut statuses = Image::filled(width, height, PixelStatus::Hole);
    let mut ranges = Image::filled(width, height, f32::NAN);
    let mut z = Image::filled(width, height, f64::NAN);
    for row in 0..height {
        for column in 0..width {
            let i = row * width + column;
            let alpha = frame.color.data[i][3];
            let Some(value) = depth.value_at(column, row) else {
                ranges.data[i] = if alpha == 0 { f32::INFINITY } else { f32::NAN };
                continue;
            };
            let length =
                value * calibration.depth_scale + profile.offset + calibration.depth_offset;
            if alpha != 255 {
                statuses.data[i] = PixelStatus::Alpha;
            } else if !depth.is_trusted(value) || length <= 0.0 {
                statuses.data[i] = PixelStatus::Range;
            } else if !LENGTHS.contains(&length) {
                statuses.data[i] = PixelStatus::Far;
            } else {
                let per_z = camera.intrinsics.ray(column, row).length();
                z.data[i] = match depth.kind {
                    DepthKind::RayDistance => length / per_z,
                    DepthKind::Z => length,
                };
                ranges.data[i] = (z.data[i] * per_z) as f32;
            }
        }
    }
    let painter = Painter::new(frame, &z, calibration, &profile);
    let mut points = Vec::new();
    for [column, row] in pixels_in_tile_order(width, height) {
        if !z.at(column, row).is_nan() {
            let surface = Surface::at(&z, &camera.intrinsics, &profile, [column, row]);
            let point = point(frame, settings, &profile, &painter, surface);
            statuses.data[row * width + column] = match point {
                Ok(point) => {
                    points.push(point);
                    PixelStatus::Kept
                }
                Err(status) => status,
            };
        }
    }
    let tolerance = profile.tolerance;
    let origin = settings.origin;
    let observation = Observation {
        origin,
        camera,
        points,
        point_weight: 1,
        ranges,
        tolerance,
        photograph: None,
    };
    (observation, statuses)
}

/// All pixels in the order of an observation.
fn pixels_in_tile_order(width: usize, height: usize) -> Vec<[usize; 2]> {
    let mut pixels: Vec<[usize; 2]> = Vec::with_capacity(width * height);
    for top in (0..height).step_by(TILE) {
        for left in (0..width).step_by(TILE) {
            for row in top..height.min(top + TILE) {
                pixels.extend((left..width.min(left + TILE)).map(|column| [column, row]));
            }
        }
    }
    pixels
}

/// A measured pixel and the plane around it.
struct Surface {
    pixel: [usize; 2],
    /// Depth along the axis, as measured.
    z: f64,
    /// Noise half-width at `z`.
    noise: f64,
    /// `w = A + B·a + C·b` at pixel offsets `(a, b)`, if a plane explains the pixel.
    plane: Option<[f64; 3]>,
}

impl Surface {
    fn at(z: &Image<f64>, k: &Intrinsics, profile: &Profile, [column, row]: [usize; 2]) -> Self {
        let measured = *z.at(column, row);
        let noise = profile.noise.at(measured, k.ray(column, row).length());
        let neighbours = neighbours(z, [column, row], measured, noise, profile.steepness);
        let plane = fit(&neighbours, measured, noise, &profile.thresholds);
        Self { pixel: [column, row], z: measured, noise, plane }
    }

    /// Unit normal in the camera frame, towards the camera (step 5).
    fn normal(&self, k: &Intrinsics, [a, b, c]: [f64; 3]) -> DVec3 {
        let ray = k.ray(self.pixel[0], self.pixel[1]);
        let (du, dv) = (ray.x * k.fx, ray.y * k.fy);
        let n = DVec3::new(b * k.fx, c * k.fy, a - b * du - c * dv).normalize();
        if n.dot(ray) < 0.0 { n } else { -n }
    }
}

/// A valid neighbour: offsets and inverse depth.
struct Neighbour {
    a: f64,
    b: f64,
    w: f64,
}

/// Neighbours that pass the gate (step 3). The text has no steepness term; 0 matches it.
fn neighbours(
    z: &Image<f64>,
    [column, row]: [usize; 2],
    measured: f64,
    noise: f64,
    steepness: f64,
) -> Vec<Neighbour> {
    let radius = RADIUS as isize;
    let mut found = Vec::new();
    for b in -radius..=radius {
        for a in -radius..=radius {
            let (Some(x), Some(y)) = (column.checked_add_signed(a), row.checked_add_signed(b))
            else {
                continue;
            };
            if x >= z.width || y >= z.height {
                continue;
            }
            let neighbour = *z.at(x, y);
            let distance = a.abs().max(b.abs()) as f64;
            let gate = noise * (1.5 + 0.6 * distance) + steepness * distance * measured;
            if (neighbour - measured).abs() <= gate {
                found.push(Neighbour { a: a as f64, b: b as f64, w: 1.0 / neighbour });
            }
        }
    }
    found
}

/// Plane of a pixel, if one explains it (steps 3 and 4).
fn fit(neighbours: &[Neighbour], z: f64, noise: f64, thresholds: &Thresholds) -> Option<[f64; 3]> {
    let unit = noise / (z * z);
    let mut inliers: Vec<&Neighbour> = neighbours.iter().collect();
    let mut plane = least_squares(&inliers)?;
    for _ in 1..ROUNDS {
        let is_near = |n: &&Neighbour| residual(plane, n).abs() <= thresholds.inlier * unit;
        inliers = neighbours.iter().filter(is_near).collect();
        plane = least_squares(&inliers)?;
    }
    let n = inliers.len() as f64;
    let squares: f64 = inliers.iter().map(|i| residual(plane, i).powi(2)).sum();
    let is_smooth = (squares / n).sqrt() < thresholds.residual * unit;
    let is_near = plane[0] > 0.0 && (1.0 / plane[0] - z).abs() < thresholds.deviation * noise;
    (n / WINDOW > MIN_SHARE && is_smooth && is_near).then_some(plane)
}

fn residual([a, b, c]: [f64; 3], n: &Neighbour) -> f64 {
    n.w - (a + b * n.a + c * n.b)
}

/// Ordinary least squares; `None` for too few or collinear inliers.
fn least_squares(inliers: &[&Neighbour]) -> Option<[f64; 3]> {
    if inliers.len() < MIN_INLIERS {
        return None;
    }
    let (mut normal, mut right) = (DMat3::ZERO, DVec3::ZERO);
    for n in inliers {
        let row = DVec3::new(1.0, n.a, n.b);
        normal += DMat3::from_cols(row, n.a * row, n.b * row);
        right += n.w * row;
    }
    // Sums of small integers are exact, so a determinant of 0 means collinear inliers.
    (normal.determinant() > 0.5).then(|| (normal.inverse() * right).to_array())
}

/// Steps 4 to 7 for a pixel whose plane is known.
fn point(
    frame: &Frame,
    settings: &SurfaceSettings,
    profile: &Profile,
    painter: &Painter<'_>,
    surface: Surface,
) -> Result<SurfacePoint, PixelStatus> {
    let k = &frame.camera.intrinsics;
    let [column, row] = surface.pixel;
    let ray = k.ray(column, row);
    let per_z = ray.length();
    let direction = ray / per_z;
    let (z, normal) = match surface.plane {
        Some(plane) if settings.plane_fit => (1.0 / plane[0], surface.normal(k, plane)),
        Some(plane) => (surface.z, surface.normal(k, plane)),
        None if settings.flying_pixels => return Err(PixelStatus::Flying),
        None => (surface.z, -direction),
    };
    if settings.cosine && -normal.dot(direction) <= profile.thresholds.cosine {
        return Err(PixelStatus::Slant);
    }
    let pose = &frame.camera.pose;
    let position = (pose.transform_point(ray * z) - settings.origin).as_vec3();
    if !position.abs().cmple(Vec3::splat(MAX_COORDINATE)).all() {
        return Err(PixelStatus::Far);
    }
    let color = painter.color(surface.pixel, ray * z).ok_or(PixelStatus::NoColor)?;
    Ok(SurfacePoint {
        position: position.to_array(),
        range: (z * per_z) as f32,
        color,
        noise: (surface.noise * per_z) as f32,
        normal: (pose.rotation() * normal).as_vec3().to_array(),
        footprint: (z * per_z / k.fx) as f32,
        direction: (pose.rotation() * direction).as_vec3().to_array(),
        pixel: (row * frame.color.width + column) as u32,
    })
}

struct Painter<'a> {
    image: &'a Image<[u8; 4]>,
    camera: Option<ColorCamera>,
    margin: [f64; 2],
    /// Depth of the nearest surface in cells of the colour image.
    nearest: HashMap<[i64; 2], f64>,
    gain: DVec3,
}

impl<'a> Painter<'a> {
    fn new(frame: &'a Frame, z: &Image<f64>, calibration: &Calibration, profile: &Profile) -> Self {
        let mut nearest = HashMap::new();
        if let Some(camera) = &calibration.color_camera {
            for (i, z) in z.data.iter().enumerate().filter(|(_, z)| !z.is_nan()) {
                let (column, row) = (i % frame.color.width, i / frame.color.width);
                let point = frame.camera.intrinsics.ray(column, row) * *z;
                if let Some(at) = camera.project(point) {
                    let depth = camera.to_color_frame(point).z;
                    let nearest = nearest.entry(cell(at)).or_insert(depth);
                    *nearest = nearest.min(depth);
                }
            }
        }
        let gain = DVec3::from_array(calibration.gain(&frame.name));
        let margin = profile.tolerance.margin.map(f64::from);
        let camera = calibration.color_camera;
        Self { image: &frame.color, camera, margin, nearest, gain }
    }

    /// Colour of a depth pixel whose point is in the depth camera's frame; `None` if the colour
    /// camera does not see it.
    fn color(&self, [column, row]: [usize; 2], point: DVec3) -> Option<[f32; 3]> {
        let color = match &self.camera {
            None => self.texel(column, row),
            Some(camera) => {
                let at = camera.project(point)?;
                let depth = camera.to_color_frame(point).z;
                let margin = self.margin[0] + self.margin[1] * depth;
                if self.nearest.get(&cell(at)).is_some_and(|nearest| depth > nearest + margin) {
                    return None;
                }
                self.bilinear(at)?
            }
        };
        Some((color * self.gain).min(DVec3::ONE).as_vec3().to_array())
    }

    fn texel(&self, column: usize, row: usize) -> DVec3 {
        let [r, g, b, _] = self.image.at(column, row).map(|byte| f64::from(byte) / 255.0);
        DVec3::new(r, g, b)
    }

    fn bilinear(&self, at: DVec2) -> Option<DVec3> {
        let Image { width, height, .. } = *self.image;
        let corner = at - 0.5;
        let last = DVec2::new(width as f64 - 1.0, height as f64 - 1.0);
        if !(corner.cmpge(DVec2::ZERO).all() && corner.cmple(last).all()) {
            return None;
        }
        let (x, y) = (corner.x as usize, corner.y as usize);
        let (right, below) = ((x + 1).min(width - 1), (y + 1).min(height - 1));
        let t = corner.fract();
        let above = self.texel(x, y).lerp(self.texel(right, y), t.x);
        let under = self.texel(x, below).lerp(self.texel(right, below), t.x);
        Some(above.lerp(under, t.y))
    }
}

fn cell(at: DVec2) -> [i64; 2] {
    (at / CELL).floor().as_i64vec2().to_array()
}
