//! Writers of every layout that is read: those of the library, and those that only tests need.

use super::{bag, lidar};
use glam::{DMat4, DQuat, DVec4};
use image::codecs::jpeg::JpegEncoder;
use image::codecs::png::PngEncoder;
use image::{ExtendedColorType, ImageEncoder};
use serde_json::{Value, json};
use std::fs;
use std::io::{Cursor, Write};
use std::path::Path;
use vbgs_studio::dataset::synthetic::write::{
    self, DepthBits, FREE_FOLDER, LiveFiles, SyntheticLayout, WriteError,
};
use vbgs_studio::dataset::synthetic::{
    Capture, RecordedFrame, SyntheticParams, SyntheticView, ViewPlan,
};
use vbgs_studio::math::camera::Intrinsics;
use vbgs_studio::math::image::Image;
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipWriter};

/// Every layout that is read.
#[derive(Clone, Copy, Debug, PartialEq, Eq, strum::EnumString)]
#[strum(serialize_all = "kebab-case")]
pub enum TestLayout {
    Blender(DepthBits),
    SevenScenes,
    Tum,
    /// `trajectory.log`, depth in millimetres.
    Open3d,
    /// As rendered by NICE-SLAM: JPEG, depth in 1/6553.5 m.
    Replica,
    /// JPEG, depth by a camera of its own at half the resolution, in millimetres.
    Scannet,
    /// Depth in millimetres.
    Nerfstudio,
    Record3d,
    /// JPEG, compressed float depth at a quarter of the resolution, metres.
    Record3dArchive,
    /// Images extracted: depth at a quarter of the resolution, millimetres.
    StrayScanner,
    /// Raw float depth at a quarter of the resolution, metres.
    Arkit,
    /// Depth in millimetres.
    RtabMap,
    /// A binary model, depth in millimetres.
    Colmap,
    /// PNG, depth in millimetres, transforms.
    Ros2Bag,
    /// With corrected cameras.
    Polycam,
    Scanner3d,
    ArkitScenes,
    ScannetPp,
}

impl TestLayout {
    /// All layouts, Blender with both depth encodings.
    pub const ALL: [Self; 19] = [
        Self::Blender(DepthBits::Eight),
        Self::Blender(DepthBits::Sixteen),
        Self::SevenScenes,
        Self::Tum,
        Self::Open3d,
        Self::Replica,
        Self::Scannet,
        Self::Nerfstudio,
        Self::Record3d,
        Self::Record3dArchive,
        Self::StrayScanner,
        Self::Arkit,
        Self::RtabMap,
        Self::Colmap,
        Self::Ros2Bag,
        Self::Polycam,
        Self::Scanner3d,
        Self::ArkitScenes,
        Self::ScannetPp,
    ];

    /// The layout with this name in reports; Blender with 16-bit depth.
    pub fn named(name: &str) -> Self {
        name.parse().unwrap_or_else(|_| panic!("no layout {name}"))
    }

    fn of_library(self) -> Option<SyntheticLayout> {
        match self {
            Self::Blender(bits) => Some(SyntheticLayout::Blender(bits)),
            Self::SevenScenes => Some(SyntheticLayout::SevenScenes),
            Self::Tum => Some(SyntheticLayout::Tum),
            Self::Record3d => Some(SyntheticLayout::Record3d),
            _ => None,
        }
    }

    /// The files that grow, of layouts that only tests write.
    fn live_files(self) -> LiveFiles {
        match self {
            Self::Open3d => LiveFiles {
                files: &[(&["color"], ""), (&["depth"], "")],
                lists: &[("trajectory.log", 0, 5)],
            },
            Self::Replica => LiveFiles {
                files: &[(&["results"], "frame"), (&["results"], "depth")],
                lists: &[("traj.txt", 0, 1)],
            },
            Self::Scannet => LiveFiles {
                files: &[(&["color"], ""), (&["depth"], ""), (&["pose"], "")],
                lists: &[],
            },
            Self::StrayScanner => LiveFiles {
                files: &[(&["rgb"], ""), (&["depth"], ""), (&["confidence"], "")],
                lists: &[("odometry.csv", 1, 1)],
            },
            Self::Arkit => LiveFiles {
                files: &[(&["images"], ""), (&["depth"], ""), (&["confidence"], "")],
                lists: &[("frames.jsonl", 0, 1)],
            },
            Self::RtabMap => LiveFiles {
                files: &[(&["rgb"], ""), (&["depth"], ""), (&["calib"], "")],
                lists: &[("poses.txt", 1, 1)],
            },
            other => panic!("{other:?} has no frames that are written one by one"),
        }
    }
}

/// Writes a recording as [`write::write`] does, in any layout.
pub fn write(
    params: &SyntheticParams,
    out: &Path,
    layout: TestLayout,
    on_frame: &mut dyn FnMut(usize, usize),
) -> Result<(), WriteError> {
    if let Some(layout) = layout.of_library() {
        return write::write(params, out, layout, on_frame);
    }
    let plan = ViewPlan::new(params)?;
    fs::create_dir_all(out).unwrap();
    let frames: Vec<RecordedFrame> = plan.recorded_frames().collect();
    match layout {
        TestLayout::Open3d => write_open3d(&plan, &frames, out),
        TestLayout::Replica => write_replica(&plan, &frames, out),
        TestLayout::Scannet => write_scannet(&plan, &frames, out),
        TestLayout::Nerfstudio => write_nerfstudio(&plan, &frames, out),
        TestLayout::Record3dArchive => write_archive(&plan, &frames, out),
        TestLayout::StrayScanner => write_stray(&plan, &frames, out),
        TestLayout::Arkit => write_arkit(&plan, &frames, out),
        TestLayout::RtabMap => write_rtabmap(&plan, &frames, out),
        TestLayout::Colmap => write_colmap(&plan, &frames, out),
        TestLayout::Ros2Bag => bag::write(params, out),
        TestLayout::Polycam => lidar::write_polycam(&plan, &frames, out),
        TestLayout::Scanner3d => lidar::write_scanner_3d(&plan, &frames, out),
        TestLayout::ArkitScenes => lidar::write_arkit_scenes(&plan, &frames, out),
        TestLayout::ScannetPp => lidar::write_scannet_pp(&plan, &frames, out),
        _ => unreachable!("the library writes {layout:?}"),
    }
    on_frame(frames.len(), frames.len());
    if plan.has_unrecorded_splits() {
        // The library writes these splits beside a recording of any layout.
        let beside = tempfile::tempdir().unwrap();
        write::write(params, beside.path(), SyntheticLayout::Record3d, &mut |_, _| ())?;
        super::scratch::Files::read(&beside.path().join(FREE_FOLDER)).write(&out.join(FREE_FOLDER));
    }
    Ok(())
}

/// Writes a growing recording as [`write::write_live`] does, in any layout that can grow.
pub fn write_live(
    params: &SyntheticParams,
    out: &Path,
    layout: TestLayout,
    due: &mut dyn FnMut(usize, usize),
) -> Result<(), WriteError> {
    if let Some(layout) = layout.of_library() {
        return write::write_live(params, out, layout, due);
    }
    fs::create_dir_all(out).unwrap();
    let finished = tempfile::tempdir().unwrap();
    write(params, finished.path(), layout, &mut |_, _| ())?;
    layout.live_files().replay(finished.path(), out, due)
}

fn write_open3d(plan: &ViewPlan, frames: &[RecordedFrame], out: &Path) {
    let mut log = String::new();
    for frame in frames {
        let SyntheticView { color, depth_z } = frame.view();
        let i = frame.index;
        put(out, &format!("color/{i:05}.png"), &rgba(&color));
        put(out, &format!("depth/{i:05}.png"), &gray16(&depth_z, 0.001));
        log += &format!("{i} {i} {}\n{}", i + 1, matrix_text(&frame.pose.to_opencv()));
    }
    let k = plan.photo_camera();
    let camera = json!({
        "width": k.width, "height": k.height, "intrinsic_matrix": column_major_matrix(&k)
    });
    put(out, "camera.json", camera.to_string().as_bytes());
    put(out, "trajectory.log", log.as_bytes());
}

fn write_replica(plan: &ViewPlan, frames: &[RecordedFrame], out: &Path) {
    const CODES_PER_METRE: f64 = 6553.5;
    let mut traj = String::new();
    for frame in frames {
        let SyntheticView { color, depth_z } = frame.view();
        let i = frame.index;
        put(out, &format!("results/frame{i:06}.jpg"), &jpeg(&color));
        put(out, &format!("results/depth{i:06}.png"), &gray16(&depth_z, 1.0 / CODES_PER_METRE));
        traj += &format!("{}\n", matrix_text(&frame.pose.to_opencv()).trim().replace('\n', " "));
    }
    let k = plan.photo_camera();
    let camera = json!({ "camera": {
        "w": k.width, "h": k.height, "fx": k.fx, "fy": k.fy, "cx": k.cx, "cy": k.cy,
        "scale": CODES_PER_METRE,
    }});
    put(out, "cam_params.json", camera.to_string().as_bytes());
    put(out, "traj.txt", traj.as_bytes());
}

fn write_scannet(plan: &ViewPlan, frames: &[RecordedFrame], out: &Path) {
    let k = plan.photo_camera();
    let half = k.scaled(0.5);
    // A wider view than that of the photographs.
    let of_depth = Intrinsics { fx: half.fx * 0.95, fy: half.fy * 0.95, ..half };
    for frame in frames {
        let SyntheticView { color, depth_z } = frame.view_by(of_depth);
        let i = frame.index;
        put(out, &format!("color/{i}.jpg"), &jpeg(&color));
        put(out, &format!("depth/{i}.png"), &gray16(&depth_z, 0.001));
        put(out, &format!("pose/{i}.txt"), matrix_text(&frame.pose.to_opencv()).as_bytes());
    }
    for (name, k) in [("color", &k), ("depth", &of_depth)] {
        let principal = DVec4::new(k.cx, k.cy, 1.0, 0.0);
        let matrix = DMat4::from_cols(DVec4::X * k.fx, DVec4::Y * k.fy, principal, DVec4::W);
        put(out, &format!("intrinsic/intrinsic_{name}.txt"), matrix_text(&matrix).as_bytes());
    }
}

fn write_nerfstudio(plan: &ViewPlan, frames: &[RecordedFrame], out: &Path) {
    let mut list = Vec::new();
    for frame in frames {
        let SyntheticView { color, depth_z } = frame.view();
        let file = |folder: &str| format!("{folder}/frame_{:05}.png", frame.index + 1);
        put(out, &file("images"), &rgba(&color));
        put(out, &file("depths"), &gray16(&depth_z, 0.001));
        list.push(json!({
            "file_path": file("images"),
            "depth_file_path": file("depths"),
            "transform_matrix": frame.pose.to_opengl().transpose().to_cols_array_2d(),
        }));
    }
    let k = plan.photo_camera();
    let json = json!({
        "camera_model": "OPENCV",
        "fl_x": k.fx, "fl_y": k.fy, "cx": k.cx, "cy": k.cy, "w": k.width, "h": k.height,
        "k1": 0.0, "k2": 0.0, "p1": 0.0, "p2": 0.0,
        "depth_unit_scale_factor": 0.001,
        "frames": list,
    });
    put(out, "transforms.json", format!("{json:#}\n").as_bytes());
}

fn write_archive(plan: &ViewPlan, frames: &[RecordedFrame], out: &Path) {
    let mut zip = ZipWriter::new(Cursor::new(Vec::new()));
    let mut add = |name: &str, bytes: &[u8]| {
        let options = SimpleFileOptions::default().compression_method(CompressionMethod::Stored);
        zip.start_file(name, options).unwrap();
        zip.write_all(bytes).unwrap();
    };
    let (k, of_depth) = (plan.photo_camera(), plan.depth_camera());
    let pose = |frame: &RecordedFrame| {
        let (p, q) = (frame.pose.centre(), DQuat::from_mat4(&frame.pose.to_opengl()));
        [q.x, q.y, q.z, q.w, p.x, p.y, p.z]
    };
    let metadata: Value = json!({
        "w": k.width, "h": k.height, "dw": of_depth.width, "dh": of_depth.height,
        "fps": 30.0,
        "K": column_major_matrix(&k),
        "poses": frames.iter().map(pose).collect::<Vec<_>>(),
    });
    add("metadata", metadata.to_string().as_bytes());
    for frame in frames {
        let Capture { color, depth_z, confidence } = frame.capture();
        let i = frame.index;
        add(&format!("rgbd/{i}.jpg"), &jpeg(&color));
        add(&format!("rgbd/{i}.depth"), &compress_lzfse(&floats(&depth_z)));
        add(&format!("rgbd/{i}.conf"), &compress_lzfse(&confidence.data));
    }
    put(out, "recording.r3d", &zip.finish().unwrap().into_inner());
}

fn write_stray(plan: &ViewPlan, frames: &[RecordedFrame], out: &Path) {
    let mut odometry = "timestamp, frame, x, y, z, qx, qy, qz, qw\n".to_owned();
    for frame in frames {
        let Capture { color, depth_z, confidence } = frame.capture();
        let file = |folder: &str| format!("{folder}/{:06}.png", frame.index);
        put(out, &file("rgb"), &rgba(&color));
        put(out, &file("depth"), &gray16(&depth_z, 0.001));
        put(out, &file("confidence"), &png(&confidence.data, &confidence, ExtendedColorType::L8));
        let numbers = position_and_rotation(frame, ", ");
        odometry += &format!("{:.6}, {:06}, {numbers}\n", frame.time, frame.index);
    }
    let k = plan.photo_camera();
    let matrix = format!("{:e},0,{:e}\n0,{:e},{:e}\n0,0,1\n", k.fx, k.cx, k.fy, k.cy);
    put(out, "camera_matrix.csv", matrix.as_bytes());
    put(out, "odometry.csv", odometry.as_bytes());
}

fn write_arkit(plan: &ViewPlan, frames: &[RecordedFrame], out: &Path) {
    let (k, of_depth) = (plan.photo_camera(), plan.depth_camera());
    let mut lines = String::new();
    for frame in frames {
        let capture = frame.capture();
        let file = |folder: &str, end: &str| format!("{folder}/{:06}.{end}", frame.index);
        let [image, depth, confidence] =
            [file("images", "png"), file("depth", "bin"), file("confidence", "bin")];
        put(out, &image, &rgba(&capture.color));
        put(out, &depth, &floats(&capture.depth_z));
        put(out, &confidence, &capture.confidence.data);
        let line = json!({
            "timestamp": frame.time,
            "camera_to_world": frame.pose.to_opengl().transpose().to_cols_array_2d(),
            "intrinsics": [[k.fx, 0.0, k.cx], [0.0, k.fy, k.cy], [0.0, 0.0, 1.0]],
            "image": image, "width": k.width, "height": k.height,
            "depth": depth, "depth_width": of_depth.width, "depth_height": of_depth.height,
            "confidence": confidence,
        });
        lines += &format!("{line}\n");
    }
    put(out, "frames.jsonl", lines.as_bytes());
}

fn write_rtabmap(plan: &ViewPlan, frames: &[RecordedFrame], out: &Path) {
    let Intrinsics { width, height, fx, fy, cx, cy } = plan.photo_camera();
    let calibration = format!(
        "%YAML:1.0\n---\ncamera_name: room\nimage_width: {width}\nimage_height: {height}\n\
         camera_matrix:\n   rows: 3\n   cols: 3\n   \
         data: [ {fx:e}, 0., {cx:e}, 0., {fy:e}, {cy:e}, 0., 0., 1. ]\n"
    );
    let mut poses = "#timestamp x y z qx qy qz qw id\n".to_owned();
    for frame in frames {
        let SyntheticView { color, depth_z } = frame.view();
        let number = frame.index + 1;
        put(out, &format!("rgb/{number}.png"), &rgba(&color));
        put(out, &format!("depth/{number}.png"), &gray16(&depth_z, 0.001));
        put(out, &format!("calib/{number}.yaml"), calibration.as_bytes());
        let numbers = position_and_rotation(frame, " ");
        poses += &format!("{:.6} {numbers} {number}\n", frame.time);
    }
    put(out, "poses.txt", poses.as_bytes());
}

/// Writes the model as COLMAP's documentation describes it, with two observations in each image.
fn write_colmap(plan: &ViewPlan, frames: &[RecordedFrame], out: &Path) {
    const PINHOLE: u32 = 1;
    let k = plan.photo_camera();
    let number = |n: u64| n.to_le_bytes().to_vec();
    let reals = |all: &[f64]| all.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>();
    let head = [7u32.to_le_bytes(), PINHOLE.to_le_bytes()].concat();
    let size = [number(k.width.into()), number(k.height.into())].concat();
    let camera = [number(1), head, size, reals(&[k.fx, k.fy, k.cx, k.cy])].concat();
    put(out, "sparse/0/cameras.bin", &camera);
    let mut images = number(frames.len() as u64);
    // Models list images in any order.
    for frame in frames.iter().rev() {
        let SyntheticView { color, depth_z } = frame.view();
        let name = format!("frame_{:05}.png", frame.index + 1);
        put(out, &format!("images/{name}"), &rgba(&color));
        put(out, &format!("depth/{name}"), &gray16(&depth_z, 0.001));
        let inverse = frame.pose.to_opencv().inverse();
        let (q, t) = (DQuat::from_mat4(&inverse), inverse.w_axis);
        images.extend((frame.index as u32 + 1).to_le_bytes());
        images.extend(reals(&[q.w, q.x, q.y, q.z, t.x, t.y, t.z]));
        images.extend(7u32.to_le_bytes());
        images.extend([name.as_bytes(), &[0]].concat());
        images.extend([number(2), reals(&[1.5, 2.5]), number(9), reals(&[3.5, 4.5])].concat());
        images.extend(number(u64::MAX));
    }
    put(out, "sparse/0/images.bin", &images);
}

pub fn put(root: &Path, name: &str, bytes: &[u8]) {
    let path = root.join(name);
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    fs::write(path, bytes).unwrap();
}

pub fn rgba(image: &Image<[u8; 4]>) -> Vec<u8> {
    png(image.data.as_flattened(), image, ExtendedColorType::Rgba8)
}

/// Depth in 16-bit codes of `unit` metres, 0 out of range.
pub fn gray16(depth: &Image<f64>, unit: f64) -> Vec<u8> {
    let codes = depth.data.iter().map(|z| (z / unit).round());
    let codes = codes.map(|code| if (1.0..65535.0).contains(&code) { code as u16 } else { 0 });
    let bytes: Vec<u8> = codes.flat_map(u16::to_ne_bytes).collect();
    png(&bytes, depth, ExtendedColorType::L16)
}

pub fn png<T>(bytes: &[u8], image: &Image<T>, color: ExtendedColorType) -> Vec<u8> {
    let mut encoded = Vec::new();
    PngEncoder::new(&mut encoded)
        .write_image(bytes, image.width as u32, image.height as u32, color)
        .unwrap();
    encoded
}

pub fn jpeg(image: &Image<[u8; 4]>) -> Vec<u8> {
    let rgb: Vec<u8> = image.data.iter().flat_map(|[r, g, b, _]| [*r, *g, *b]).collect();
    let mut encoded = Vec::new();
    JpegEncoder::new_with_quality(&mut encoded, 95)
        .write_image(&rgb, image.width as u32, image.height as u32, ExtendedColorType::Rgb8)
        .unwrap();
    encoded
}

fn floats(depth: &Image<f64>) -> Vec<u8> {
    depth.data.iter().flat_map(|z| (*z as f32).to_le_bytes()).collect()
}

fn compress_lzfse(bytes: &[u8]) -> Vec<u8> {
    let mut out = Vec::new();
    lzfse_rust::LzfseEncoder::default().encode_bytes(bytes, &mut out).unwrap();
    out
}

fn column_major_matrix(k: &Intrinsics) -> [f64; 9] {
    [k.fx, 0.0, 0.0, 0.0, k.fy, 0.0, k.cx, k.cy, 1.0]
}

/// Rows of numbers that parse to the same bits.
fn matrix_text(matrix: &DMat4) -> String {
    let row = |r: DVec4| format!("{:e} {:e} {:e} {:e}\n", r.x, r.y, r.z, r.w);
    (0..4).map(|i| row(matrix.row(i))).collect()
}

/// Position and quaternion in OpenCV axes.
fn position_and_rotation(frame: &RecordedFrame, separator: &str) -> String {
    let (p, q) = (frame.pose.centre(), DQuat::from_mat4(&frame.pose.to_opencv()));
    [p.x, p.y, p.z, q.x, q.y, q.z, q.w].map(|v| format!("{v:e}")).join(separator)
}
