//! Writes the synthetic scene as Record3D's exported folder or shared archive: photographs with depth of
//! lower resolution.

use super::files::{
    FRAMES_PER_SECOND, SequenceFrame, WriteError, column_major_matrix, create_folder, frames, jpeg,
    write_bytes, write_gray8, write_gray16, write_jpeg, write_rgba, write_text,
};
use crate::dataset::synthetic::phone::camera::Capture;
use crate::dataset::synthetic::plan::ViewPlan;
use crate::dataset::synthetic::scene::quantise;
use crate::math::image::Image;
use exr::prelude::{
    AnyChannel, AnyChannels, Encoding, FlatSamples, Layer, LayerAttributes, SmallVec,
    WritableImage, f16,
};
use serde_json::{Value, json};
use std::io::{Cursor, Write};
use std::path::Path;
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipWriter};

const CONFIDENCE: &str = "confidence";

/// Writes the exported folder: `metadata.json`, JPEG, half-float EXR and the phone's confidence.
pub(super) fn write_folder(
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
    for frame in frames(plan) {
        let Capture { color, depth_z, confidence } = frame.capture();
        let file = |folder: &str| out.join(format!("{folder}/{}", frame.index));
        write_jpeg(&file("rgb").with_extension("jpg"), &color)?;
        write_exr(&file("depth").with_extension("exr"), &depth_z)?;
        if plan.has_phone_camera() {
            write_gray8(&file(CONFIDENCE).with_extension("png"), &confidence)?;
        }
        on_frame();
    }
    write_text(&out.join("metadata.json"), &metadata(plan).to_string())
}

/// Writes the shared archive: `metadata`, JPEG and LZFSE-compressed floats.
pub(super) fn write_archive(
    plan: &ViewPlan,
    out: &Path,
    on_frame: &mut dyn FnMut(),
) -> Result<(), WriteError> {
    let path = out.join("recording.r3d");
    let failed = |source| WriteError::Io { path: path.clone(), source };
    let mut zip = ZipWriter::new(Cursor::new(Vec::new()));
    let mut add = |name: &str, bytes: &[u8]| {
        let options = SimpleFileOptions::default().compression_method(CompressionMethod::Stored);
        zip.start_file(name, options).map_err(std::io::Error::other)?;
        zip.write_all(bytes)
    };
    add("metadata", metadata(plan).to_string().as_bytes()).map_err(failed)?;
    for frame in frames(plan) {
        let Capture { color, depth_z, confidence } = frame.capture();
        let i = frame.index;
        let lengths: Vec<u8> =
            depth_z.data.iter().flat_map(|z| (*z as f32).to_le_bytes()).collect();
        add(&format!("rgbd/{i}.jpg"), &jpeg(&path, &color)?).map_err(failed)?;
        add(&format!("rgbd/{i}.depth"), &compress_lzfse(&lengths).map_err(failed)?)
            .map_err(failed)?;
        add(&format!("rgbd/{i}.conf"), &compress_lzfse(&confidence.data).map_err(failed)?)
            .map_err(failed)?;
        on_frame();
    }
    let bytes = zip.finish().map_err(|e| failed(std::io::Error::other(e)))?.into_inner();
    write_bytes(&path, &bytes)
}

fn compress_lzfse(bytes: &[u8]) -> std::io::Result<Vec<u8>> {
    let mut out = Vec::new();
    lzfse_rust::LzfseEncoder::default().encode_bytes(bytes, &mut out)?;
    Ok(out)
}

fn metadata(plan: &ViewPlan) -> Value {
    let (k, of_depth) = (plan.scene.intrinsics(), plan.depth_camera());
    let pose = |frame: SequenceFrame| {
        let (p, q) = (frame.pose.centre(), frame.rotation_quaternion(true));
        [q.x, q.y, q.z, q.w, p.x, p.y, p.z]
    };
    json!({
        "w": k.width, "h": k.height, "dw": of_depth.width, "dh": of_depth.height,
        "fps": FRAMES_PER_SECOND,
        "K": column_major_matrix(&k),
        "poses": frames(plan).map(pose).collect::<Vec<_>>(),
    })
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
    write_bytes(path, bytes.get_ref())
}

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

/// Metres per depth code.
const DEPTH_UNIT: f64 = 0.001;

pub(super) fn write_stray(
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
