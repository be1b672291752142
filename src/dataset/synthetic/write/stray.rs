//! Writes the synthetic scene in the Stray Scanner layout, with the video extracted to images.

use super::files::{WriteError, create_folder, write_gray8, write_gray16, write_rgba, write_text};
use super::sequence::frames;
use crate::dataset::synthetic::phone::camera::Capture;
use crate::dataset::synthetic::plan::ViewPlan;
use crate::dataset::synthetic::scene::quantise;
use std::path::Path;

/// Metres per depth code.
const DEPTH_UNIT: f64 = 0.001;

pub(super) fn write(
    plan: &ViewPlan,
    out: &Path,
    on_frame: &mut dyn FnMut(),
) -> Result<(), WriteError> {
    let folders = ["rgb", "depth", "confidence"];
    folders.into_iter().try_for_each(|name| create_folder(&out.join(name)))?;
    let k = plan.scene.intrinsics();
    let mut odometry = "timestamp, frame, x, y, z, qx, qy, qz, qw\n".to_owned();
    for frame in frames(plan) {
        let Capture { color, depth_z, confidence } = frame.capture();
        let file = |folder: &str| out.join(format!("{folder}/{:06}.png", frame.index));
        write_rgba(&file("rgb"), &color)?;
        write_gray16(&file("depth"), &quantise(&depth_z, DEPTH_UNIT))?;
        write_gray8(&file("confidence"), &confidence)?;
        let (p, q) = (frame.pose.centre(), frame.rotation_quaternion(false));
        let numbers = [p.x, p.y, p.z, q.x, q.y, q.z, q.w].map(|v| format!("{v:e}")).join(", ");
        odometry += &format!("{:.6}, {:06}, {numbers}\n", frame.time, frame.index);
        on_frame();
    }
    let matrix = format!("{:e},0,{:e}\n0,{:e},{:e}\n0,0,1\n", k.fx, k.cx, k.fy, k.cy);
    write_text(&out.join("camera_matrix.csv"), &matrix)?;
    write_text(&out.join("odometry.csv"), &odometry)
}
