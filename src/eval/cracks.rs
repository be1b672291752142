//! Cracks: background visible between splats inside a measured surface (`evaluation.md`, Cracks), at the
//! training distance and at half of it.
//!
//! At half the distance, the camera is moved along its optical axis by half the median depth z of the
//! view's interior pixels. The view's depth is projected into the moved camera; interior pixels are interior
//! in both images.
//!
//! Half the distance reveals splats that just touch at the training distance and leave gaps when the camera
//! approaches. Only pixels inside a surface count, because the background is visible next to a silhouette.

use super::metrics::mean;
use super::scale::visit_views;
use super::surfaces::Surfaces;
use crate::dataset::Dataset;
use crate::dataset::error::FrameError;
use crate::dataset::frame::Frame;
use crate::math::camera::Camera;
use crate::math::image::Image;
use crate::model::splat::appearance::SplatView;
use crate::render::RenderOptions;
use crate::render::cpu::CpuRenderer;
use glam::{DQuat, DVec3};
use serde::{Deserialize, Serialize};

/// Stride of the measured training views, used if the evaluated split has no depth.
const TRAINING_VIEWS_EVERY: usize = 10;

/// Surfaces nearer than this multiple of the near plane are ignored, because the renderer drops some of
/// their splats.
const NEAR_PLANES: f64 = 2.0;

/// Cracks as shares of the pixels in one image, or means of these shares over images.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Cracks {
    /// Share of all pixels that are interior: inside a measured surface, away from its edges and holes.
    pub interior: f64,
    /// Share of interior pixels with transmittance > 0.1.
    pub over_01: f64,
    /// Share of interior pixels with transmittance > 0.3.
    pub over_03: f64,
}

/// Cracks in one view.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ViewCracks {
    /// Name of the view within its split.
    pub frame: String,
    /// Cracks seen by the recorded camera.
    pub training_distance: Cracks,
    /// Cracks seen from half the distance; `None` if no interior pixel remains in view.
    pub half_distance: Option<Cracks>,
}

/// Cracks over the views of a split.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CrackReport {
    /// Split whose depth defines the surfaces.
    pub split: String,
    /// Number of views with interior pixels.
    pub views: usize,
    /// Mean cracks over the views, seen by the recorded cameras.
    pub training_distance: Cracks,
    /// Mean cracks over the views with interior pixels at half the distance; `None` if there are no such
    /// views.
    pub half_distance: Option<Cracks>,
    /// Results per view.
    pub frames: Vec<ViewCracks>,
}

/// Selects the views for crack measurement when `frames` of `split` are evaluated. Returns the evaluated
/// views if they have depth, otherwise every tenth view of the training split. Returns `None` if no
/// split has depth.
pub fn views(dataset: &Dataset, split: usize, frames: &[usize]) -> Option<(usize, Vec<usize>)> {
    if dataset.splits[split].has_depth {
        return Some((split, frames.to_vec()));
    }
    let training = dataset.training_split().ok()?;
    let n_frames = dataset.splits[training].frames.len();
    Some((training, (0..n_frames).step_by(TRAINING_VIEWS_EVERY).collect()))
}

/// Measures cracks in the given views of a split. `progress` receives the number of views done. Views
/// that cannot be loaded or have no interior pixels are skipped. Returns `None` if no view remains.
pub fn measure<'a>(
    splats: impl Into<SplatView<'a>>,
    dataset: &Dataset,
    (split, frames): (usize, &[usize]),
    render: &RenderOptions,
    progress: impl FnMut(usize),
) -> Option<CrackReport> {
    let splats = splats.into();
    let sensor = dataset.sensor();
    let visit = |renderer: &mut CpuRenderer, _, loaded: Result<Frame, FrameError>| {
        // Unusable files are reported when views are scored.
        let frame = loaded.ok()?;
        let surfaces = Surfaces::of(&frame, sensor)?;
        in_view(frame.name, &surfaces, splats, render, renderer)
    };
    let found = visit_views(dataset, split, frames, visit, progress);
    // Views without interior pixels must not count as free of cracks.
    let found: Vec<ViewCracks> = found.into_iter().flatten().collect();
    let far: Vec<Cracks> = found.iter().map(|view| view.training_distance).collect();
    let near: Vec<Cracks> = found.iter().filter_map(|view| view.half_distance).collect();
    Some(CrackReport {
        split: dataset.splits[split].name.clone(),
        views: found.len(),
        training_distance: Cracks::mean(&far)?,
        half_distance: Cracks::mean(&near),
        frames: found,
    })
}

/// Measures cracks in one view at the training distance and at half of it. Returns `None` if there are
/// no interior pixels.
fn in_view(
    frame: String,
    surfaces: &Surfaces,
    splats: SplatView,
    render: &RenderOptions,
    renderer: &mut CpuRenderer,
) -> Option<ViewCracks> {
    let mut shares = |surfaces: &Surfaces| {
        let coverage = renderer.render(splats, &surfaces.camera, render).coverage;
        Cracks::of(&coverage, &surfaces.interior)
    };
    let nearer = half_distance(surfaces)?;
    // Splats are dropped by their centre, so a surface just beyond the near plane would lack some.
    let near = (NEAR_PLANES * render.near) as f32;
    Some(ViewCracks {
        frame,
        training_distance: shares(surfaces)?,
        half_distance: shares(&surfaces.project_into(&nearer, near)),
    })
}

/// Returns the camera moved along its optical axis by half the median depth of the interior pixels.
fn half_distance(surfaces: &Surfaces) -> Option<Camera> {
    // Median rather than mean: a distant background must not move the camera through near objects.
    let step = 0.5 * f64::from(surfaces.median_interior_z()?);
    let Camera { intrinsics, pose } = surfaces.camera;
    Some(Camera { intrinsics, pose: pose.attached_camera(step * DVec3::Z, DQuat::IDENTITY) })
}

impl Cracks {
    /// Computes the shares in one image. Returns `None` if there are no interior pixels.
    fn of(coverage: &Image<f32>, interior: &Image<bool>) -> Option<Self> {
        let (mut n_interior, mut n_over) = (0usize, [0usize; 2]);
        for (&coverage, _) in coverage.data.iter().zip(&interior.data).filter(|(_, i)| **i) {
            n_interior += 1;
            let transmittance = 1.0 - coverage;
            n_over[0] += usize::from(transmittance > 0.1);
            n_over[1] += usize::from(transmittance > 0.3);
        }
        // NaN without interior pixels, discarded below.
        let [over_01, over_03] = n_over.map(|n| n as f64 / n_interior as f64);
        let interior = n_interior as f64 / interior.data.len() as f64;
        (n_interior > 0).then_some(Self { interior, over_01, over_03 })
    }

    fn mean(views: &[Self]) -> Option<Self> {
        Some(Self {
            interior: mean(views.iter().map(|v| v.interior))?,
            over_01: mean(views.iter().map(|v| v.over_01))?,
            over_03: mean(views.iter().map(|v| v.over_03))?,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::surface::Sensor;
    use crate::eval::surfaces;
    use crate::model::splat::splats::Splat;
    use crate::render::RenderMethod;
    use std::ops::Range;

    const WIDTH: usize = 96;
    const HEIGHT: usize = 64;

    fn frame() -> Frame {
        surfaces::tests::wall(surfaces::tests::camera(WIDTH as u32, HEIGHT as u32), |_, _| 2000)
    }

    /// Returns a flat-topped splat per pixel of the frame and its surroundings, except in the columns
    /// `gap`.
    fn wall(camera: &Camera, gap: Range<i32>) -> Vec<Splat> {
        let k = &camera.intrinsics;
        let pixels =
            (-10..HEIGHT as i32 + 10).flat_map(|y| (-10..WIDTH as i32 + 10).map(move |x| (x, y)));
        let splat = |(x, y): (i32, i32)| {
            let at = [f64::from(x) + 0.5 - k.cx, f64::from(y) + 0.5 - k.cy];
            Splat {
                mean: [(2.0 * at[0] / k.fx) as f32, (2.0 * at[1] / k.fy) as f32, 2.0],
                opacity: 3.0,
                scale: [(0.7 * 2.0 / k.fx) as f32; 3],
                ..Splat::default()
            }
        };
        pixels.filter(|(x, _)| !gap.contains(x)).map(splat).collect()
    }

    fn cracks(splats: &[Splat]) -> ViewCracks {
        let frame = frame();
        let surfaces = Surfaces::of(&frame, Sensor::Kinect).unwrap();
        let render = RenderOptions::evaluation(RenderMethod::PROJECTED, [0.0; 3]);
        let renderer = &mut CpuRenderer::new();
        in_view(frame.name, &surfaces, splats.into(), &render, renderer).unwrap()
    }

    #[test]
    fn a_closed_wall_has_none() {
        let found = cracks(&wall(&frame().camera, 0..0));
        let closed = Cracks { interior: 1.0, over_01: 0.0, over_03: 0.0 };
        assert_eq!((found.training_distance, found.half_distance), (closed, Some(closed)));
    }

    /// Ten columns lack splats. One pixel beyond the last splats, alpha is at its cap, because three
    /// splats overlap there. Two pixels beyond, 0.42 of the light is transmitted (3·exp(−d²/2σ²) with σ²
    /// = 0.7² + 0.3). So the outermost column on each side is closed and the other eight are open.
    #[test]
    fn a_gap_counts_by_its_pixels() {
        let found = cracks(&wall(&frame().camera, 40..50));
        let share = 8.0 / WIDTH as f64;
        assert_eq!(
            found.training_distance,
            Cracks { interior: 1.0, over_01: share, over_03: share }
        );
        // Twenty columns in the moved camera; a splat's blur covers two on each side.
        let half = found.half_distance.unwrap();
        let columns = half.over_03 * WIDTH as f64;
        assert_eq!((half.interior, columns), (1.0, 16.0));
    }

    #[test]
    fn an_empty_scene_is_all_crack() {
        let open = Cracks { interior: 1.0, over_01: 1.0, over_03: 1.0 };
        assert_eq!(cracks(&[]).training_distance, open);
    }

    #[test]
    fn the_moved_camera_stands_half_way() {
        let surfaces = Surfaces::of(&frame(), Sensor::Kinect).unwrap();
        assert_eq!(half_distance(&surfaces).unwrap().pose.centre(), DVec3::Z);
    }
}
