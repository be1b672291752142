//! What a frame's photograph shows, and how far the depth camera saw its surfaces, as splats learn from it.

use super::planes::{NOTHING, Planes};
use super::seen::SeenDepths;
use crate::dataset::calibration::ColorCamera;
use crate::dataset::frame::Frame;
use crate::math::image::Image;
use crate::observation::photograph::Photograph;
use glam::{DQuat, DVec3};

/// The photograph whose pixels are those of the depth image.
pub(super) fn registered(frame: &Frame, planes: &Planes, gain: [f64; 3]) -> Photograph {
    let Image { width, height, .. } = frame.color;
    let rows = (0..height).flat_map(|row| &planes.z[planes.at(0, row)..][..width]);
    Photograph {
        intrinsics: frame.camera.intrinsics,
        offset: DVec3::ZERO,
        turn: DQuat::IDENTITY,
        colors: frame.color.clone(),
        gain: gain.map(|gain| gain as f32),
        depths: Image::from_vec(width, height, rows.map(|z| known(*z)).collect()),
        shows_coverage: true,
    }
}

/// The photograph of a camera that stands beside the depth camera.
pub(super) fn seen_beside(
    frame: &Frame,
    seen: &SeenDepths,
    camera: &ColorCamera,
    gain: [f64; 3],
) -> Photograph {
    Photograph {
        intrinsics: camera.intrinsics(frame.camera.intrinsics),
        offset: DVec3::from_array(camera.offset),
        turn: camera.turn(),
        colors: frame.color.clone(),
        gain: gain.map(|gain| gain as f32),
        depths: seen.nearest.map(|z| known(*z)),
        // Depth of another camera says nothing of what covers a pixel here.
        shows_coverage: false,
    }
}

/// A depth, 0 where nothing was measured.
fn known(z: f32) -> f32 {
    if z < NOTHING { z } else { 0.0 }
}
