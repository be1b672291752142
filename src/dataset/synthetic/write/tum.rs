//! Writes the synthetic scene in the TUM RGB-D layout.

use super::files::{
    WriteError, column_major_matrix, create_folder, frames, write_gray16, write_rgba, write_text,
};
use crate::dataset::matrix;
use crate::dataset::synthetic::plan::ViewPlan;
use crate::dataset::synthetic::scene::quantise;
use crate::dataset::synthetic::view::SyntheticView;
use crate::math::camera::Intrinsics;
use serde_json::json;
use std::fmt::Write;
use std::path::Path;

/// Metres per depth code.
const DEPTH_UNIT: f64 = 1.0 / 5000.0;

pub(super) fn write(
    plan: &ViewPlan,
    out: &Path,
    on_frame: &mut dyn FnMut(),
) -> Result<(), WriteError> {
    ["rgb", "depth"].into_iter().try_for_each(|name| create_folder(&out.join(name)))?;
    let mut lists = ["# colour images", "# depth maps"].map(|head| format!("{head}\n"));
    let mut poses = "# timestamp tx ty tz qx qy qz qw\n".to_owned();
    for frame in frames(plan) {
        let SyntheticView { color, depth_z } = frame.view();
        let time = format!("{:.6}", frame.time);
        write_rgba(&out.join(format!("rgb/{time}.png")), &color)?;
        write_gray16(&out.join(format!("depth/{time}.png")), &quantise(&depth_z, DEPTH_UNIT))?;
        for (list, folder) in lists.iter_mut().zip(["rgb", "depth"]) {
            // Writing to a string cannot fail.
            let _ = writeln!(list, "{time} {folder}/{time}.png");
        }
        let (p, q) = (frame.pose.centre(), frame.rotation_quaternion(false));
        let numbers = [p.x, p.y, p.z, q.x, q.y, q.z, q.w].map(|v| format!("{v:e}")).join(" ");
        let _ = writeln!(poses, "{time} {numbers}");
        on_frame();
    }
    let k = plan.scene.intrinsics();
    let camera = format!("{:e} {:e} {:e} {:e}\n", k.fx, k.fy, k.cx, k.cy);
    write_text(&out.join("camera-intrinsics.txt"), &camera)?;
    write_text(&out.join("groundtruth.txt"), &poses)?;
    // Written last: after an interruption no list names missing images.
    write_text(&out.join("rgb.txt"), &lists[0])?;
    write_text(&out.join("depth.txt"), &lists[1])
}

/// Metres per depth code.
const OPEN3D_UNIT: f64 = 0.001;

pub(super) fn write_open3d(
    plan: &ViewPlan,
    out: &Path,
    on_frame: &mut dyn FnMut(),
) -> Result<(), WriteError> {
    ["color", "depth"].into_iter().try_for_each(|name| create_folder(&out.join(name)))?;
    let mut log = String::new();
    for frame in frames(plan) {
        let SyntheticView { color, depth_z } = frame.view();
        let i = frame.index;
        write_rgba(&out.join(format!("color/{i:05}.png")), &color)?;
        write_gray16(&out.join(format!("depth/{i:05}.png")), &quantise(&depth_z, OPEN3D_UNIT))?;
        log += &format!("{i} {i} {}\n{}", i + 1, matrix::to_text(&frame.pose.to_opencv()));
        on_frame();
    }
    let k = plan.scene.intrinsics();
    let camera = json!({ "width": k.width, "height": k.height, "intrinsic_matrix": column_major_matrix(&k) });
    write_text(&out.join("camera.json"), &format!("{camera:#}\n"))?;
    write_text(&out.join("trajectory.log"), &log)
}

/// Metres per depth code.
const RTABMAP_UNIT: f64 = 0.001;

pub(super) fn write_rtabmap(
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
        write_gray16(&out.join(format!("depth/{number}.png")), &quantise(&depth_z, RTABMAP_UNIT))?;
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
