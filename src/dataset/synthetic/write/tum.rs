//! Writes the synthetic scene in the TUM RGB-D layout.

use super::files::{WriteError, create_folder, write_gray16, write_rgba, write_text};
use super::sequence::frames;
use crate::dataset::synthetic::plan::ViewPlan;
use crate::dataset::synthetic::scene::quantise;
use crate::dataset::synthetic::view::SyntheticView;
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
