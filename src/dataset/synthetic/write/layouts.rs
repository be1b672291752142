//! Writes the synthetic scene as NeRF-synthetic (Blender), 7-Scenes, TUM RGB-D and Record3D's exported folder.

use super::{WriteError, create_folder, write_file, write_jpeg, write_png};
use crate::dataset::depth::INVERSE8_RANGE;
use crate::dataset::matrix;
use crate::dataset::synthetic::phone::camera::Capture;
use crate::dataset::synthetic::plan::{FRAMES_PER_SECOND, PlannedSplit, RecordedFrame, ViewPlan};
use crate::dataset::synthetic::scene::{DEPTH_UNIT, SyntheticScene, quantise};
use crate::dataset::synthetic::view::SyntheticView;
use crate::math::camera::Intrinsics;
use crate::math::image::Image;
use crate::math::pose::Pose;
use exr::prelude::{
    AnyChannel, AnyChannels, Encoding, FlatSamples, Layer, LayerAttributes, SmallVec,
    WritableImage, f16,
};
use glam::DQuat;
use image::ExtendedColorType;
use image::ExtendedColorType::{L8, L16, Rgba8};
use serde_json::json;
use std::fmt::Write;
use std::io::Cursor;
use std::path::Path;
use strum::{EnumString, VariantNames};

/// Depth encoding of the Blender layout.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, EnumString, VariantNames)]
pub enum DepthBits {
    #[strum(serialize = "8")]
    /// 8-bit depth `8·(1 − d/255)` m in RGBA images, as in the original dataset. A step is 31 mm.
    Eight,
    #[default]
    #[strum(serialize = "16")]
    /// 16-bit grey images with `integer_depth_scale`; a step is 0.25 mm.
    Sixteen,
}

pub(super) fn write_blender(
    plan: &ViewPlan,
    is_wanted: fn(&PlannedSplit) -> bool,
    out: &Path,
    bits: DepthBits,
    on_frame: &mut dyn FnMut(),
) -> Result<(), WriteError> {
    let k = plan.scene.intrinsics();
    for split in plan.splits.iter().filter(|split| is_wanted(split)) {
        create_folder(&out.join(split.name))?;
        for i in 0..split.poses.len() {
            let SyntheticView { color, depth_z } = plan.render_view(split, i);
            let stem = out.join(split.name).join(format!("r_{i}"));
            write_png(&stem.with_extension("png"), &color, ExtendedColorType::Rgba8)?;
            // NeRF-synthetic naming; readers accept any number.
            let depth_file = stem.with_file_name(format!("r_{i}_depth_0001.png"));
            let along_ray = ray_lengths(&depth_z, &k);
            match bits {
                DepthBits::Eight => {
                    write_png(&depth_file, &inverse8(&along_ray), ExtendedColorType::Rgba8)?;
                }
                DepthBits::Sixteen => {
                    let codes = quantise(&along_ray, DEPTH_UNIT);
                    write_png(&depth_file, &codes, ExtendedColorType::L16)?;
                }
            }
            on_frame();
        }
        // Written last: after an interruption no list names missing images.
        let list = out.join(format!("transforms_{}.json", split.name));
        write_file(&list, frame_list(&plan.scene, split, bits))?;
    }
    Ok(())
}

fn ray_lengths(depth_z: &Image<f64>, k: &Intrinsics) -> Image<f64> {
    let mut lengths = depth_z.clone();
    for (i, length) in lengths.data.iter_mut().enumerate() {
        *length *= k.ray(i % depth_z.width, i / depth_z.width).length();
    }
    lengths
}

fn inverse8(lengths: &Image<f64>) -> Image<[u8; 4]> {
    lengths.map(|length| {
        let code = (255.0 * (1.0 - length / INVERSE8_RANGE)).round();
        // 0 and 255 are decoded as holes.
        let d = if (1.0..255.0).contains(&code) { code as u8 } else { 0 };
        [d, d, d, 255]
    })
}

fn frame_list(scene: &SyntheticScene, split: &PlannedSplit, bits: DepthBits) -> String {
    let (lo, hi) = scene.room().bounds();
    let entry = |(i, pose): (usize, &Pose)| {
        let rows = pose.to_opengl().transpose().to_cols_array_2d();
        // Without the extension, as in the published lists.
        json!({ "file_path": format!("./{}/r_{i}", split.name), "transform_matrix": rows })
    };
    let frames: Vec<_> = split.poses.iter().enumerate().map(entry).collect();
    let mut list = json!({
        "camera_angle_x": scene.field_of_view(),
        // The room exceeds the cube that the layout implies without a range.
        "position_range": [lo.to_array(), hi.to_array()],
        "frames": frames,
    });
    if bits == DepthBits::Sixteen {
        list["integer_depth_scale"] = json!(DEPTH_UNIT);
    }
    format!("{list:#}\n")
}

/// Length of a step of the depth codes in the 7-Scenes layout, metres.
const SEVEN_SCENES_UNIT: f64 = 0.001;
const TUM_UNIT: f64 = 1.0 / 5000.0;
const CONFIDENCE: &str = "confidence";

pub(super) fn write_seven_scenes(
    plan: &ViewPlan,
    out: &Path,
    on_frame: &mut dyn FnMut(),
) -> Result<(), WriteError> {
    let k = plan.scene.intrinsics();
    let intrinsics = format!("{} 0 {}\n0 {} {}\n0 0 1\n", k.fx, k.cx, k.fy, k.cy);
    write_file(&out.join("camera-intrinsics.txt"), &intrinsics)?;
    for split in &plan.splits {
        let folder = out.join(split.name);
        create_folder(&folder)?;
        for (i, pose) in split.poses.iter().enumerate() {
            let SyntheticView { color, depth_z } = plan.render_view(split, i);
            let file = |suffix: &str| folder.join(format!("frame-{i:06}.{suffix}"));
            write_png(&file("color.png"), &color, Rgba8)?;
            write_png(&file("depth.png"), &quantise(&depth_z, SEVEN_SCENES_UNIT), L16)?;
            write_file(&file("pose.txt"), matrix::to_text(&pose.to_opencv()))?;
            on_frame();
        }
    }
    Ok(())
}

pub(super) fn write_tum(
    plan: &ViewPlan,
    out: &Path,
    on_frame: &mut dyn FnMut(),
) -> Result<(), WriteError> {
    ["rgb", "depth"].into_iter().try_for_each(|name| create_folder(&out.join(name)))?;
    let mut lists = ["# colour images", "# depth maps"].map(|head| format!("{head}\n"));
    let mut poses = "# timestamp tx ty tz qx qy qz qw\n".to_owned();
    for frame in plan.recorded_frames() {
        let SyntheticView { color, depth_z } = frame.view();
        // Microseconds, as in the published recordings.
        let time = format!("{:.6}", frame.time);
        write_png(&out.join(format!("rgb/{time}.png")), &color, Rgba8)?;
        write_png(&out.join(format!("depth/{time}.png")), &quantise(&depth_z, TUM_UNIT), L16)?;
        for (list, folder) in lists.iter_mut().zip(["rgb", "depth"]) {
            // Writing to a string cannot fail.
            let _ = writeln!(list, "{time} {folder}/{time}.png");
        }
        let (p, q) = (frame.pose.centre(), DQuat::from_mat4(&frame.pose.to_opencv()));
        // `{:e}` writes the fewest digits that parse to the same number.
        let numbers = [p.x, p.y, p.z, q.x, q.y, q.z, q.w].map(|v| format!("{v:e}")).join(" ");
        let _ = writeln!(poses, "{time} {numbers}");
        on_frame();
    }
    let k = plan.scene.intrinsics();
    let camera = format!("{:e} {:e} {:e} {:e}\n", k.fx, k.fy, k.cx, k.cy);
    write_file(&out.join("camera-intrinsics.txt"), &camera)?;
    write_file(&out.join("groundtruth.txt"), &poses)?;
    // Written last: after an interruption no list names missing images.
    write_file(&out.join("rgb.txt"), &lists[0])?;
    write_file(&out.join("depth.txt"), &lists[1])
}

pub(super) fn write_record3d(
    plan: &ViewPlan,
    out: &Path,
    on_frame: &mut dyn FnMut(),
) -> Result<(), WriteError> {
    // Exact depth needs no confidence.
    let folders: &[&str] = match plan.has_phone_camera() {
        true => &["rgb", "depth", CONFIDENCE],
        false => &["rgb", "depth"],
    };
    folders.iter().try_for_each(|name| create_folder(&out.join(name)))?;
    for frame in plan.recorded_frames() {
        let Capture { color, depth_z, confidence } = frame.capture();
        let file = |folder: &str| out.join(format!("{folder}/{}", frame.index));
        write_jpeg(&file("rgb").with_extension("jpg"), &color)?;
        write_exr(&file("depth").with_extension("exr"), &depth_z)?;
        if plan.has_phone_camera() {
            write_png(&file(CONFIDENCE).with_extension("png"), &confidence, L8)?;
        }
        on_frame();
    }
    let (k, of_depth) = (plan.scene.intrinsics(), plan.depth_camera());
    let pose = |frame: RecordedFrame| {
        let (p, q) = (frame.pose.centre(), DQuat::from_mat4(&frame.pose.to_opengl()));
        [q.x, q.y, q.z, q.w, p.x, p.y, p.z]
    };
    let metadata = json!({
        "w": k.width, "h": k.height, "dw": of_depth.width, "dh": of_depth.height,
        "fps": FRAMES_PER_SECOND,
        // Column by column.
        "K": [k.fx, 0.0, 0.0, 0.0, k.fy, 0.0, k.cx, k.cy, 1.0],
        "poses": plan.recorded_frames().map(pose).collect::<Vec<_>>(),
    });
    write_file(&out.join("metadata.json"), metadata.to_string())
}

fn write_exr(path: &Path, depth_z: &Image<f64>) -> Result<(), WriteError> {
    let halves = depth_z.data.iter().map(|z| f16::from_f64(*z)).collect();
    let channel = AnyChannel::new("R", FlatSamples::F16(halves));
    let channels = AnyChannels::sort(SmallVec::from_iter([channel]));
    let layer = Layer::new(
        (depth_z.width, depth_z.height),
        LayerAttributes::named(""),
        Encoding::FAST_LOSSLESS,
        channels,
    );
    let mut bytes = Cursor::new(Vec::new());
    let image = exr::prelude::Image::from_layer(layer);
    let written = image.write().non_parallel().to_buffered(&mut bytes);
    let failed = |e| WriteError::Io { path: path.to_owned(), source: std::io::Error::other(e) };
    written.map_err(failed)?;
    write_file(path, bytes.get_ref())
}
