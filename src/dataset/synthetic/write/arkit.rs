//! Writes the synthetic scene as an ARKit package: one JSON object per line, raw floats and bytes.

use super::files::{WriteError, create_folder, write_bytes, write_rgba, write_text};
use super::sequence::frames;
use crate::dataset::synthetic::phone::camera::Capture;
use crate::dataset::synthetic::plan::ViewPlan;
use serde_json::json;
use std::path::Path;

pub(super) fn write(
    plan: &ViewPlan,
    out: &Path,
    on_frame: &mut dyn FnMut(),
) -> Result<(), WriteError> {
    let folders = ["images", "depth", "confidence"];
    folders.into_iter().try_for_each(|name| create_folder(&out.join(name)))?;
    let k = plan.scene.intrinsics();
    let of_depth = plan.depth_camera();
    let mut lines = String::new();
    for frame in frames(plan) {
        let Capture { color, depth_z, confidence: sure } = frame.capture();
        let file = |folder: &str, end: &str| format!("{folder}/{:06}.{end}", frame.index);
        let [image, depth, confidence] =
            [file("images", "png"), file("depth", "bin"), file("confidence", "bin")];
        write_rgba(&out.join(&image), &color)?;
        let lengths: Vec<u8> =
            depth_z.data.iter().flat_map(|z| (*z as f32).to_le_bytes()).collect();
        write_bytes(&out.join(&depth), &lengths)?;
        write_bytes(&out.join(&confidence), &sure.data)?;
        let line = json!({
            "timestamp": frame.time,
            "camera_to_world": frame.pose.to_opengl().transpose().to_cols_array_2d(),
            "intrinsics": [[k.fx, 0.0, k.cx], [0.0, k.fy, k.cy], [0.0, 0.0, 1.0]],
            "image": image, "width": k.width, "height": k.height,
            "depth": depth, "depth_width": of_depth.width, "depth_height": of_depth.height,
            "confidence": confidence,
        });
        lines += &format!("{line}\n");
        on_frame();
    }
    write_text(&out.join("frames.jsonl"), &lines)
}
