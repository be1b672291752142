//! Writes the synthetic scene as ScanNet's exporter does: separate colour and depth cameras of different
//! resolutions.

use super::files::{WriteError, create_folder, write_gray16, write_jpeg, write_text};
use super::sequence::frames;
use crate::dataset::matrix;
use crate::dataset::synthetic::plan::ViewPlan;
use crate::dataset::synthetic::scene::quantise;
use crate::dataset::synthetic::view::SyntheticView;
use crate::math::camera::Intrinsics;
use glam::{DMat4, DVec4};
use std::path::Path;

/// Metres per depth code.
const DEPTH_UNIT: f64 = 0.001;
/// Ratio of depth to colour resolution.
const DEPTH_SIZE: f64 = 0.5;
/// Ratio of the depth camera's focal length to that of a resampled photograph: a wider view.
const DEPTH_FOCAL_RATIO: f64 = 0.95;

pub(super) fn write(
    plan: &ViewPlan,
    out: &Path,
    on_frame: &mut dyn FnMut(),
) -> Result<(), WriteError> {
    let folders = ["color", "depth", "pose", "intrinsic"];
    folders.into_iter().try_for_each(|name| create_folder(&out.join(name)))?;
    let k = plan.scene.intrinsics();
    let half = k.scaled(DEPTH_SIZE);
    let of_depth =
        Intrinsics { fx: half.fx * DEPTH_FOCAL_RATIO, fy: half.fy * DEPTH_FOCAL_RATIO, ..half };
    for frame in frames(plan) {
        let SyntheticView { color, depth_z } = frame.view_by(of_depth);
        let i = frame.index;
        write_jpeg(&out.join(format!("color/{i}.jpg")), &color)?;
        write_gray16(&out.join(format!("depth/{i}.png")), &quantise(&depth_z, DEPTH_UNIT))?;
        let pose = matrix::to_text(&frame.pose.to_opencv());
        write_text(&out.join(format!("pose/{i}.txt")), &pose)?;
        on_frame();
    }
    for (name, k) in [("color", &k), ("depth", &of_depth)] {
        let file = out.join(format!("intrinsic/intrinsic_{name}.txt"));
        write_text(&file, &matrix::to_text(&four_by_four(k)))?;
    }
    Ok(())
}

fn four_by_four(k: &Intrinsics) -> DMat4 {
    let principal = DVec4::new(k.cx, k.cy, 1.0, 0.0);
    DMat4::from_cols(DVec4::X * k.fx, DVec4::Y * k.fy, principal, DVec4::W)
}
