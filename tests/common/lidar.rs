//! Writers of layouts of Apple's lidar, after the documentation of the apps and sets.

use super::layouts::{gray16, jpeg, png, put};
use glam::DQuat;
use image::ExtendedColorType::{L8, Rgba8};
use serde_json::{Map, json};
use std::path::Path;
use vbgs_studio::dataset::synthetic::{Capture, RecordedFrame, ViewPlan};
use vbgs_studio::math::camera::Intrinsics;
use vbgs_studio::math::image::Image;

/// Confidence as a grey image; levels are multiplied by `step`, up to white.
pub fn confidence(map: &Image<u8>, step: u8) -> Vec<u8> {
    let levels: Vec<u8> = map.data.iter().map(|level| level.saturating_mul(step)).collect();
    png(&levels, map, L8)
}

/// Name of a frame of Polycam: its time in microseconds.
pub fn polycam_name(frame: &RecordedFrame) -> String {
    (108_085_000_000 + (1e6 * frame.time) as u64).to_string()
}

pub fn write_polycam(plan: &ViewPlan, frames: &[RecordedFrame], out: &Path) {
    let Intrinsics { width, height, fx, fy, cx, cy } = plan.photo_camera();
    for frame in frames {
        let Capture { color, depth_z, confidence: map } = frame.capture();
        let name = polycam_name(frame);
        let rows = frame.pose.to_opengl().transpose().to_cols_array_2d();
        let mut camera = json!({
            "fx": fx, "fy": fy, "cx": cx, "cy": cy, "width": width, "height": height,
            "timestamp": name.parse::<u64>().unwrap(), "blur_score": 150.0, "neighbors": [],
        });
        for (i, j) in (0..3).flat_map(|i| (0..4).map(move |j| (i, j))) {
            camera[format!("t_{i}{j}")] = json!(rows[i][j]);
        }
        let file = |folder: &str, end: &str| format!("keyframes/{folder}/{name}.{end}");
        for kind in ["", "corrected_"] {
            put(out, &file(&format!("{kind}images"), "jpg"), &jpeg(&color));
            put(out, &file(&format!("{kind}cameras"), "json"), camera.to_string().as_bytes());
            // Corrected cameras state no size.
            camera.as_object_mut().unwrap().retain(|key, _| !["width", "height"].contains(&&**key));
        }
        put(out, &file("depth", "png"), &gray16(&depth_z, 0.001));
        put(out, &file("confidence", "png"), &confidence(&map, 128));
    }
    put(out, "mesh_info.json", b"{}");
}

pub fn write_scanner_3d(plan: &ViewPlan, frames: &[RecordedFrame], out: &Path) {
    let k = plan.photo_camera();
    for frame in frames {
        let Capture { color, depth_z, confidence: map } = frame.capture();
        let file = |kind: &str, end: &str| format!("{kind}_{:05}.{end}", frame.index);
        let camera = json!({
            "intrinsics": [k.fx, 0.0, k.cx, 0.0, k.fy, k.cy, 0.0, 0.0, 1.0],
            "cameraPoseARFrame": frame.pose.to_opengl().transpose().to_cols_array(),
            "time": frame.time, "frame_index": frame.index, "motionQuality": 0.9,
        });
        put(out, &file("frame", "jpg"), &jpeg(&color));
        put(out, &file("frame", "json"), camera.to_string().as_bytes());
        put(out, &file("depth", "png"), &gray16(&depth_z, 0.001));
        put(out, &file("conf", "png"), &confidence(&map, 1));
    }
    put(out, "info.json", b"{\"device\": \"synthetic\"}");
}

pub fn write_arkit_scenes(plan: &ViewPlan, frames: &[RecordedFrame], out: &Path) {
    let Intrinsics { width, height, fx, fy, cx, cy } = plan.photo_camera();
    let mut poses = String::new();
    for frame in frames {
        let Capture { color, depth_z, confidence: map } = frame.capture();
        let file = |folder: &str, end: &str| {
            format!("{folder}/41048190_{:.3}.{end}", 6845.0 + 0.1 * frame.index as f64)
        };
        let world_to_camera = frame.pose.to_opencv().inverse();
        let turn = DQuat::from_mat4(&world_to_camera).to_scaled_axis();
        let [a, t] = [turn, world_to_camera.w_axis.truncate()];
        let time = 6845.0 + 0.1 * frame.index as f64;
        let numbers = [time, a.x, a.y, a.z, t.x, t.y, t.z].map(|v| format!("{v:e}")).join(" ");
        poses += &format!("{numbers}\n");
        let rgba = png(color.data.as_flattened(), &color, Rgba8);
        put(out, &file("lowres_wide", "png"), &rgba);
        put(out, &file("lowres_depth", "png"), &gray16(&depth_z, 0.001));
        put(out, &file("confidence", "png"), &confidence(&map, 1));
        let camera = format!("{width} {height} {fx:e} {fy:e} {cx:e} {cy:e}\n");
        put(out, &file("lowres_wide_intrinsics", "pincam"), camera.as_bytes());
    }
    put(out, "lowres_wide.traj", poses.as_bytes());
}

pub fn write_scannet_pp(plan: &ViewPlan, frames: &[RecordedFrame], out: &Path) {
    let k = plan.photo_camera();
    let mut list = Map::new();
    for frame in frames {
        let Capture { color, depth_z, .. } = frame.capture();
        // The toolkit unpacks every tenth frame.
        let name = format!("frame_{:06}", 10 * frame.index);
        put(out, &format!("iphone/rgb/{name}.jpg"), &jpeg(&color));
        put(out, &format!("iphone/depth/{name}.png"), &gray16(&depth_z, 0.001));
        let entry = json!({
            "timestamp": 100.0 + frame.time,
            "pose": frame.pose.to_opengl().transpose().to_cols_array_2d(),
            "aligned_pose": frame.pose.to_opencv().transpose().to_cols_array_2d(),
            "intrinsic": [[k.fx, 0.0, k.cx], [0.0, k.fy, k.cy], [0.0, 0.0, 1.0]],
        });
        list.insert(name, entry);
    }
    put(out, "iphone/pose_intrinsic_imu.json", json!(list).to_string().as_bytes());
}
