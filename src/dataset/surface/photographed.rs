//! What a frame's photograph shows, and how far the depth camera saw its surfaces, as splats learn from it.

use super::planes::{NOTHING, Planes};
use super::projection::Projection;
use super::sensor::Profile;
use crate::dataset::calibration::{Calibration, ColorCamera};
use crate::dataset::frame::Frame;
use crate::math::image::Image;
use crate::math::measured_pixel::MeasuredPixel;
use crate::observation::photograph::Photograph;
use glam::{DQuat, DVec3, Vec2, Vec3};

/// Pixels that a pixel of the depth image covers at most, however much finer photographs are and however
/// much nearer their camera stands.
const MOST_COVERED: f32 = 16.0;

/// The frame's colours over black with the gain of its calibration, from where they were taken, and the
/// depth of the planes there.
pub(super) fn photograph(
    frame: &Frame,
    planes: &Planes,
    calibration: &Calibration,
    profile: &Profile,
    ranges: &Image<f32>,
) -> Photograph {
    let gain = calibration.gain(&frame.name).map(|gain| gain as f32);
    let color_camera = frame.photographed_by(calibration.color_camera.as_ref());
    // Depth of another camera says nothing of what covers a pixel here.
    let is_registered = color_camera.is_none();
    let pixel = |(i, &[red, green, blue, alpha]): (usize, &[u8; 4])| {
        let opaque = f32::from(alpha) / 255.0;
        let covered = match is_registered {
            true if alpha < u8::MAX => opaque,
            true if ranges.data[i].is_finite() => 1.0,
            _ => f32::NAN,
        };
        let [r, g, b] = [red, green, blue].map(|channel| f32::from(channel) / 255.0 * opaque);
        MeasuredPixel::flat([r * gain[0], g * gain[1], b * gain[2], covered])
    };
    let Image { width, height, data } = &frame.color;
    let pixels = data.iter().enumerate().map(pixel).collect();
    let mut pixels = Image::from_vec(*width, *height, pixels);
    let margin = profile.tolerance.margin;
    let depth = frame.camera.intrinsics;
    let (intrinsics, offset, turn) = match &color_camera {
        None => {
            add_registered(&mut pixels, planes, margin);
            (depth, DVec3::ZERO, DQuat::IDENTITY)
        }
        Some(camera) => {
            let footprint = (camera.focal[0] / depth.fx).max(camera.focal[1] / depth.fy);
            add_seen(&mut pixels, planes, margin, camera, footprint as f32);
            (camera.intrinsics(depth), DVec3::from_array(camera.offset), camera.turn())
        }
    };
    Photograph { intrinsics, offset, turn, pixels }
}

/// Depth of the very pixels.
fn add_registered(pixels: &mut Image<MeasuredPixel>, planes: &Planes, margin: [f32; 2]) {
    let width = pixels.width.max(1);
    for (row, pixels) in pixels.data.chunks_mut(width).enumerate() {
        let depths = &planes.z[planes.at(0, row)..];
        for (pixel, &z) in pixels.iter_mut().zip(depths).filter(|(_, z)| **z < NOTHING) {
            *pixel = pixel.at_depth(z, margin);
        }
    }
}

/// Depth as another camera sees it: what a pixel of the depth image covers there, `footprint` pixels of this
/// one at equal distance, becomes a square; the nearest wins.
fn add_seen(
    pixels: &mut Image<MeasuredPixel>,
    planes: &Planes,
    margin: [f32; 2],
    camera: &ColorCamera,
    footprint: f32,
) {
    let camera = Projection::new(camera);
    let size = Vec2::new(pixels.width as f32, pixels.height as f32);
    for (row, &y) in planes.slope_y.iter().enumerate() {
        let depths = &planes.z[planes.at(0, row)..];
        for (&x, &z) in planes.slope_x.iter().zip(depths).filter(|(_, z)| **z < NOTHING) {
            let point = camera.turned(Vec3::new(x, y, 1.0) * z);
            let Some(at) = camera.project(point) else { continue };
            // Squares of neighbours meet; smaller ones than a pixel fall into one.
            let half = 0.5 * (footprint * z / point.z).clamp(1.0, MOST_COVERED);
            let low = (at - half + 0.5).floor().max(Vec2::ZERO);
            let high = (at + half + 0.5).floor().min(size);
            for row in low.y as usize..high.y.max(0.0) as usize {
                let line = row * pixels.width;
                for column in low.x as usize..high.x.max(0.0) as usize {
                    let pixel = &mut pixels.data[line + column];
                    if pixel.per_tolerance == 0.0 || point.z < pixel.depth {
                        *pixel = pixel.at_depth(point.z, margin);
                    }
                }
            }
        }
    }
}
