//! Writes the synthetic scene in Open3D's recording layout.

use super::files::{WriteError, create_folder, write_gray16, write_rgba, write_text};
use super::sequence::{column_major_matrix, frames};
use crate::dataset::matrix;
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
    ["color", "depth"].into_iter().try_for_each(|name| create_folder(&out.join(name)))?;
    let mut log = String::new();
    for frame in frames(plan) {
        let SyntheticView { color, depth_z } = frame.view();
        let i = frame.index;
        write_rgba(&out.join(format!("color/{i:05}.png")), &color)?;
        write_gray16(&out.join(format!("depth/{i:05}.png")), &quantise(&depth_z, DEPTH_UNIT))?;
        log += &format!("{i} {i} {}\n{}", i + 1, matrix::to_text(&frame.pose.to_opencv()));
        on_frame();
    }
    let k = plan.scene.intrinsics();
    let camera = json!({ "width": k.width, "height": k.height, "intrinsic_matrix": column_major_matrix(&k) });
    write_text(&out.join("camera.json"), &format!("{camera:#}\n"))?;
    write_text(&out.join("trajectory.log"), &log)
}
