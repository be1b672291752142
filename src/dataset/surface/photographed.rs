//! What a frame's photograph shows, and how far the depth camera saw its surfaces, as splats learn from it.

use super::planes::{NOTHING, Planes};
use super::seen::SeenDepths;
use crate::dataset::calibration::ColorCamera;
use crate::dataset::frame::Frame;
use crate::math::image::Image;
use crate::observation::photograph::Photograph;
use glam::{DQuat, DVec3};

/// The photograph whose pixels are those of the depth image, in the memory of an earlier one.
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
        turn: DQuat::IDENTITY,
        colors: frame.color.clone(),
        gain: gain.map(|gain| gain as f32),
        depths: depths(frame, rows, earlier),
        shows_coverage: true,
    }
}

/// The photograph of a camera that stands beside the depth camera, in the memory of an earlier one.
pub(super) fn seen_beside(
    frame: &Frame,
    seen: &SeenDepths,
    camera: &ColorCamera,
    gain: [f64; 3],
    earlier: Option<Photograph>,
) -> Photograph {
    Photograph {
        intrinsics: camera.intrinsics(frame.camera.intrinsics),
        offset: DVec3::from_array(camera.offset),
        turn: camera.turn(),
        colors: frame.color.clone(),
        gain: gain.map(|gain| gain as f32),
        depths: depths(frame, [&seen.nearest.data[..]], earlier),
        // Depth of another camera says nothing of what covers a pixel here.
        shows_coverage: false,
    }
}

/// Depths of a photograph's pixels, which come in runs. Fresh memory for a million pixels takes longer than
/// filling it, so that of an earlier photograph is used again.
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

/// A depth, 0 where nothing was measured.
fn known(z: f32) -> f32 {
    if z < NOTHING { z } else { 0.0 }
}
