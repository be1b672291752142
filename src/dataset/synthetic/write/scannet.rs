//! Writes the synthetic scene as ScanNet's exporter does: separate colour and depth cameras of different
//! resolutions.

use super::files::{
    WriteError, create_folder, frames, write_gray16, write_jpeg, write_rgba, write_text,
};
use crate::dataset::matrix;
use crate::dataset::synthetic::plan::ViewPlan;
use crate::dataset::synthetic::scene::quantise;
use crate::dataset::synthetic::view::SyntheticView;
use crate::math::camera::Intrinsics;
use glam::{DMat4, DVec4};
use serde_json::json;
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

/// Depth codes per metre.
const CODES_PER_METRE: f64 = 6553.5;

pub(super) fn write_replica(
    plan: &ViewPlan,
    out: &Path,
    on_frame: &mut dyn FnMut(),
) -> Result<(), WriteError> {
    create_folder(&out.join("results"))?;
    let mut traj = String::new();
    for frame in frames(plan) {
        let SyntheticView { color, depth_z } = frame.view();
        let file = |name: &str| out.join(format!("results/{name}{:06}", frame.index));
        write_jpeg(&file("frame").with_extension("jpg"), &color)?;
        let codes = quantise(&depth_z, 1.0 / CODES_PER_METRE);
        write_gray16(&file("depth").with_extension("png"), &codes)?;
        let m = frame.pose.to_opencv();
        let row = |r: DVec4| r.to_array().map(|v| format!("{v:e}")).join(" ");
        traj += &format!("{}\n", [0, 1, 2, 3].map(|i| row(m.row(i))).join(" "));
        on_frame();
    }
    let k = plan.scene.intrinsics();
    let camera = json!({ "camera": {
        "w": k.width, "h": k.height, "fx": k.fx, "fy": k.fy, "cx": k.cx, "cy": k.cy,
        "scale": CODES_PER_METRE,
    }});
    write_text(&out.join("cam_params.json"), &format!("{camera:#}\n"))?;
    write_text(&out.join("traj.txt"), &traj)
}

/// Metres per depth code: the layout's millimetres.
const SEVEN_SCENES_UNIT: f64 = 0.001;

pub(super) fn write_seven_scenes(
    plan: &ViewPlan,
    out: &Path,
    on_frame: &mut dyn FnMut(),
) -> Result<(), WriteError> {
    let k = plan.scene.intrinsics();
    let intrinsics = format!("{} 0 {}\n0 {} {}\n0 0 1\n", k.fx, k.cx, k.fy, k.cy);
    write_text(&out.join("camera-intrinsics.txt"), &intrinsics)?;
    for split in &plan.splits {
        let folder = out.join(split.name);
        create_folder(&folder)?;
        for (i, pose) in split.poses.iter().enumerate() {
            let SyntheticView { color, depth_z } = plan.render_view(split, i);
            let file = |suffix: &str| folder.join(format!("frame-{i:06}.{suffix}"));
            write_rgba(&file("color.png"), &color)?;
            write_gray16(&file("depth.png"), &quantise(&depth_z, SEVEN_SCENES_UNIT))?;
            write_text(&file("pose.txt"), &matrix::to_text(&pose.to_opencv()))?;
            on_frame();
        }
    }
    Ok(())
}
