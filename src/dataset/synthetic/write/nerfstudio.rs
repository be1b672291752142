//! Writes the synthetic scene in the nerfstudio layout.

use super::files::{WriteError, create_folder, frames, write_gray16, write_rgba, write_text};
use crate::dataset::synthetic::plan::ViewPlan;
use crate::dataset::synthetic::scene::quantise;
use crate::dataset::synthetic::view::SyntheticView;
use serde_json::json;
use std::path::Path;

/// Metres per depth code.
const DEPTH_UNIT: f64 = 0.001;

pub(super) fn write(
    plan: &ViewPlan,
    out: &Path,
    on_frame: &mut dyn FnMut(),
) -> Result<(), WriteError> {
    ["images", "depths"].into_iter().try_for_each(|name| create_folder(&out.join(name)))?;
    let mut list = Vec::new();
    for frame in frames(plan) {
        let SyntheticView { color, depth_z } = frame.view();
        let file = |folder: &str| format!("{folder}/frame_{:05}.png", frame.index + 1);
        write_rgba(&out.join(file("images")), &color)?;
        write_gray16(&out.join(file("depths")), &quantise(&depth_z, DEPTH_UNIT))?;
        list.push(json!({
            "file_path": file("images"),
            "depth_file_path": file("depths"),
            "transform_matrix": frame.pose.to_opengl().transpose().to_cols_array_2d(),
        }));
        on_frame();
    }
    let k = plan.scene.intrinsics();
    let json = json!({
        "camera_model": "OPENCV",
        "fl_x": k.fx, "fl_y": k.fy, "cx": k.cx, "cy": k.cy, "w": k.width, "h": k.height,
        "k1": 0.0, "k2": 0.0, "p1": 0.0, "p2": 0.0,
        "depth_unit_scale_factor": DEPTH_UNIT,
        "frames": list,
    });
    write_text(&out.join("transforms.json"), &format!("{json:#}\n"))
}
