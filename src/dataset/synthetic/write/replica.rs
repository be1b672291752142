//! Writes the synthetic scene in the Replica layout of NICE-SLAM.

use super::files::{WriteError, create_folder, write_gray16, write_jpeg, write_text};
use super::sequence::frames;
use crate::dataset::synthetic::plan::ViewPlan;
use crate::dataset::synthetic::scene::quantise;
use crate::dataset::synthetic::view::SyntheticView;
use glam::DVec4;
use serde_json::json;
use std::path::Path;

/// Depth codes per metre.
const CODES_PER_METRE: f64 = 6553.5;

pub(super) fn write(
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
