//! Photographs for photometric training, with the depth measured at their pixels.

use super::planes::{NOTHING, Planes};
use super::seen::ReprojectedDepths;
use crate::dataset::calibration::ColorCamera;
use crate::dataset::frame::Frame;
use crate::math::image::Image;
use crate::observation::photograph::Photograph;
use glam::{DQuat, DVec3};

/// Photograph registered to the depth image; reuses the memory of an earlier one.
pub(super) fn registered(
    frame: &Frame,
    planes: &Planes,
    gain: [f64; 3],
    earlier: Option<Photograph>,
) -> Photograph {
    let Image { width, height, .. } = *frame.color;
    let rows = (0..height).map(|row| &planes.z[planes.at(0, row)..][..width]);
    Photograph {
        intrinsics: frame.camera.intrinsics,
        offset: DVec3::ZERO,
        rotation: DQuat::IDENTITY,
        colors: frame.color.clone(),
        gain: gain.map(|gain| gain as f32),
        depths: depths(frame, rows, earlier),
        has_coverage: true,
    }
}

/// Photograph of a separate colour camera; reuses the memory of an earlier one.
pub(super) fn seen_beside(
    frame: &Frame,
    seen: &ReprojectedDepths,
    camera: &ColorCamera,
    gain: [f64; 3],
    earlier: Option<Photograph>,
) -> Photograph {
    Photograph {
        intrinsics: camera.intrinsics(frame.camera.intrinsics),
        offset: DVec3::from_array(camera.offset),
        rotation: camera.rotation_quat(),
        colors: frame.color.clone(),
        gain: gain.map(|gain| gain as f32),
        depths: depths(frame, [&seen.nearest.data[..]], earlier),
        // Depth of another camera does not show what covers a pixel of this one.
        has_coverage: false,
    }
}

/// Depth image of a photograph, from consecutive runs of pixels. Reuses an earlier one's memory, since
/// allocating a million pixels takes longer than filling them.
fn depths<'a>(
    frame: &Frame,
    runs: impl IntoIterator<Item = &'a [f32]>,
    earlier: Option<Photograph>,
) -> Image<f32> {
    let mut depths = earlier.map(|earlier| earlier.depths.data).unwrap_or_default();
    depths.clear();
    runs.into_iter().for_each(|run| depths.extend(run.iter().map(|z| known(*z))));
    Image::from_vec(frame.color.width, frame.color.height, depths)
}

/// Depth, or 0 if none was measured.
fn known(z: f32) -> f32 {
    if z < NOTHING { z } else { 0.0 }
}
