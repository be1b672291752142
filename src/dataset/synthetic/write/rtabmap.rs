//! Writes the synthetic scene as an RTAB-Map export, with images named by number.

use super::files::{WriteError, create_folder, write_gray16, write_rgba, write_text};
use super::sequence::frames;
use crate::dataset::synthetic::plan::ViewPlan;
use crate::dataset::synthetic::scene::quantise;
use crate::dataset::synthetic::view::SyntheticView;
use crate::math::camera::Intrinsics;
use std::path::Path;

/// Metres per depth code.
const DEPTH_UNIT: f64 = 0.001;

pub(super) fn write(
    plan: &ViewPlan,
    out: &Path,
    on_frame: &mut dyn FnMut(),
) -> Result<(), WriteError> {
    let folders = ["rgb", "depth", "calib"];
    folders.into_iter().try_for_each(|name| create_folder(&out.join(name)))?;
    let calibration = calibration(&plan.scene.intrinsics());
    let mut poses = "#timestamp x y z qx qy qz qw id\n".to_owned();
    for frame in frames(plan) {
        let SyntheticView { color, depth_z } = frame.view();
        let number = frame.index + 1;
        write_rgba(&out.join(format!("rgb/{number}.png")), &color)?;
        write_gray16(&out.join(format!("depth/{number}.png")), &quantise(&depth_z, DEPTH_UNIT))?;
        write_text(&out.join(format!("calib/{number}.yaml")), &calibration)?;
        let (p, q) = (frame.pose.centre(), frame.rotation_quaternion(false));
        let numbers = [p.x, p.y, p.z, q.x, q.y, q.z, q.w].map(|v| format!("{v:e}")).join(" ");
        poses += &format!("{:.6} {numbers} {number}\n", frame.time);
        on_frame();
    }
    write_text(&out.join("poses.txt"), &poses)
}

fn calibration(k: &Intrinsics) -> String {
    let Intrinsics { width, height, fx, fy, cx, cy } = k;
    format!(
        "%YAML:1.0\n---\ncamera_name: room\nimage_width: {width}\nimage_height: {height}\n\
         camera_matrix:\n   rows: 3\n   cols: 3\n   \
         data: [ {fx:e}, 0., {cx:e}, 0., {fy:e}, {cy:e}, 0., 0., 1. ]\n"
    )
}
