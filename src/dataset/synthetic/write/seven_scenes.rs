//! Writes the synthetic scene in the 7-Scenes layout: one folder per split and the intrinsics.

use super::files::{WriteError, create_folder, write_gray16, write_rgba, write_text};
use crate::dataset::matrix;
use crate::dataset::synthetic::plan::ViewPlan;
use crate::dataset::synthetic::scene::quantise;
use crate::dataset::synthetic::view::SyntheticView;
use std::path::Path;

/// Metres per depth code: the layout's millimetres.
const DEPTH_UNIT: f64 = 0.001;

pub(super) fn write(
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
            write_gray16(&file("depth.png"), &quantise(&depth_z, DEPTH_UNIT))?;
            write_text(&file("pose.txt"), &matrix::to_text(&pose.to_opencv()))?;
            on_frame();
        }
    }
    Ok(())
}
