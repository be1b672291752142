//! ROS 2 bags, written here by the specifications of MCAP and CDR and the definitions of the messages.

use crate::common::layouts::TestLayout;
use crate::common::mutation::mutate;
use crate::common::scratch::{self, assert_says, edit_json, open_plain, tiny};
use glam::{DMat3, DMat4, DQuat, DVec3};
use serde_json::json;
use std::collections::HashMap;
use std::fs;
use std::io::{Cursor, Write};
use std::path::Path;
use std::time::Instant;
use tempfile::TempDir;
use vbgs_studio::dataset::{Dataset, FrameEntry, Layout, LoadOptions, open};
use vbgs_studio::math::camera::Intrinsics;
use vbgs_studio::math::rng::{Purpose, Rng};

const START: u64 = 1_700_000_000_000_000_000;
/// Time between frames, nanoseconds.
const STEP: u64 = 100_000_000;
const OPTICAL: &str = "camera_optical_frame";

const MAGIC: &[u8] = b"\x89MCAP0\r\n";
/// Opcodes of records.
const HEADER: u8 = 1;
const FOOTER: u8 = 2;
const SCHEMA: u8 = 3;
const CHANNEL: u8 = 4;
const MESSAGE: u8 = 5;
const CHUNK: u8 = 6;
const MESSAGE_INDEX: u8 = 7;
const DATA_END: u8 = 15;

fn record(opcode: u8, parts: &[Vec<u8>]) -> Vec<u8> {
    let content = parts.concat();
    [&[opcode][..], &(content.len() as u64).to_le_bytes(), &content].concat()
}

fn text(text: &str) -> Vec<u8> {
    [&(text.len() as u32).to_le_bytes()[..], text.as_bytes()].concat()
}

#[derive(Clone, Copy, Debug, Default, PartialEq)]
enum Packing {
    #[default]
    Plain,
    Zstd,
    Lz4,
}

/// Message in CDR, aligned from the end of its four bytes of encoding.
struct Cdr {
    bytes: Vec<u8>,
    is_big: bool,
}

impl Cdr {
    fn value<const N: usize>(mut self, mut little: [u8; N]) -> Self {
        while !(self.bytes.len() - 4).is_multiple_of(N) {
            self.bytes.push(0);
        }
        if self.is_big {
            little.reverse();
        }
        self.bytes.extend(little);
        self
    }

    fn u32(self, value: u32) -> Self {
        self.value(value.to_le_bytes())
    }

    fn reals(self, values: &[f64]) -> Self {
        values.iter().fold(self, |cdr, value| cdr.value(value.to_le_bytes()))
    }

    fn blob(self, bytes: &[u8]) -> Self {
        let mut cdr = self.u32(bytes.len() as u32);
        cdr.bytes.extend(bytes);
        cdr
    }

    fn text(self, text: &str) -> Self {
        self.blob(&[text.as_bytes(), &[0]].concat())
    }

    fn header(self, time: u64, frame: &str) -> Self {
        let [seconds, rest] = [time / 1_000_000_000, time % 1_000_000_000];
        self.u32(seconds as u32).u32(rest as u32).text(frame)
    }

    fn pose(self, pose: DMat4) -> Self {
        let (_, q, p) = pose.to_scale_rotation_translation();
        self.reals(&p.to_array()).reals(&q.to_array())
    }
}

#[derive(Default)]
struct Bag {
    is_big: bool,
    packing: Packing,
    has_chunks: bool,
    encoding: Option<&'static str>,
    /// Topic, schema, time and content.
    messages: Vec<(String, &'static str, u64, Vec<u8>)>,
}

impl Bag {
    fn cdr(&self) -> Cdr {
        Cdr { bytes: vec![0, u8::from(!self.is_big), 0, 0], is_big: self.is_big }
    }

    fn add(&mut self, topic: &str, schema: &'static str, time: u64, cdr: Cdr) {
        self.messages.push((topic.to_owned(), schema, time, cdr.bytes));
    }

    fn compressed(&mut self, topic: &str, time: u64, frame: &str, format: &str, data: &[u8]) {
        let cdr = self.cdr().header(time, frame).text(format).blob(data);
        self.add(topic, "sensor_msgs/msg/CompressedImage", time, cdr);
    }

    fn raw(&mut self, topic: &str, time: u64, encoding: &str, size: [u32; 2], data: &[u8]) {
        let row = data.len() / size[1] as usize;
        // Rows end in padding.
        let padded: Vec<u8> = data.chunks(row).flat_map(|row| [row, &[0xEE; 8]].concat()).collect();
        let cdr = self.cdr().header(time, OPTICAL).u32(size[1]).u32(size[0]).text(encoding);
        let cdr = cdr.value([u8::from(self.is_big)]).u32(row as u32 + 8).blob(&padded);
        self.add(topic, "sensor_msgs/msg/Image", time, cdr);
    }

    fn camera(&mut self, topic: &str, frame: &str, k: &Intrinsics, model: &str, terms: &[f64]) {
        let cdr = self.cdr().header(START, frame).u32(k.height).u32(k.width).text(model);
        let cdr = cdr.u32(terms.len() as u32).reals(terms);
        let cdr = cdr.reals(&[k.fx, 0.0, k.cx, 0.0, k.fy, k.cy, 0.0, 0.0, 1.0]);
        let cdr = cdr.reals(&[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]);
        let p = [k.fx, 0.0, k.cx, 0.0, 0.0, k.fy, k.cy, 0.0, 0.0, 0.0, 1.0, 0.0];
        let cdr = cdr.reals(&p).u32(0).u32(0).u32(0).u32(0).u32(0).u32(0).value([0]);
        self.add(topic, "sensor_msgs/msg/CameraInfo", START, cdr);
    }

    fn transform(&mut self, topic: &str, time: u64, [parent, child]: [&str; 2], pose: DMat4) {
        let cdr = self.cdr().u32(1).header(time, parent).text(child).pose(pose);
        self.add(topic, "tf2_msgs/msg/TFMessage", time, cdr);
    }

    fn odometry(&mut self, time: u64, [parent, child]: [&str; 2], pose: DMat4) {
        let cdr = self.cdr().header(time, parent).text(child).pose(pose).reals(&[0.0; 78]);
        self.add("/odom", "nav_msgs/msg/Odometry", time, cdr);
    }

    /// Writes the file by the specification of MCAP.
    fn bytes(&self) -> Vec<u8> {
        let mut file = [MAGIC, &record(HEADER, &[text("ros2"), text("a test")])].concat();
        let mut channels: HashMap<&str, u16> = HashMap::new();
        let mut records = Vec::new();
        for (topic, schema, time, content) in &self.messages {
            let next = channels.len() as u16 + 1;
            let id = *channels.entry(topic).or_insert(next);
            if id == next {
                let number = id.to_le_bytes().to_vec();
                let parts = [number.clone(), text(schema), text("ros2msg"), text("definition")];
                records.push(record(SCHEMA, &parts));
                let encoding = text(self.encoding.unwrap_or("cdr"));
                let parts = [number.clone(), number, text(topic), encoding, text("")];
                records.push(record(CHANNEL, &parts));
            }
            let times = [time.to_le_bytes(), time.to_le_bytes()].concat();
            let head = [&id.to_le_bytes()[..], &7u32.to_le_bytes(), &times].concat();
            records.push(record(MESSAGE, &[head, content.clone()]));
        }
        let size = if self.has_chunks { 12 } else { records.len().max(1) };
        for records in records.chunks(size) {
            let records = records.concat();
            if !self.has_chunks {
                file.extend(records);
                continue;
            }
            let (name, packed) = match self.packing {
                Packing::Plain => ("", records.clone()),
                Packing::Zstd => ("zstd", zstd::encode_all(&records[..], 3).unwrap()),
                Packing::Lz4 => {
                    let mut encoder = lz4_flex::frame::FrameEncoder::new(Vec::new());
                    encoder.write_all(&records).unwrap();
                    ("lz4", encoder.finish().unwrap())
                }
            };
            let times = [START.to_le_bytes(), u64::MAX.to_le_bytes()].concat();
            let [unpacked, length] =
                [records.len(), packed.len()].map(|n| (n as u64).to_le_bytes());
            let head = [&times[..], &unpacked, &[0; 4]].concat();
            file.extend(record(CHUNK, &[head, text(name), length.to_vec(), packed]));
            file.extend(record(MESSAGE_INDEX, &[vec![1, 0], text("")]));
        }
        file.extend(record(DATA_END, &[vec![0; 4]]));
        file.extend(record(FOOTER, &[vec![0; 20]]));
        [&file[..], MAGIC].concat()
    }

    fn write(&self) -> TempDir {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("room_0.mcap"), self.bytes()).unwrap();
        folder
    }
}

/// The tiny recording: PNGs of colour and depth, camera and poses.
struct Room {
    images: Vec<[Vec<u8>; 2]>,
    k: Intrinsics,
    poses: Vec<DMat4>,
    dataset: Dataset,
    _folder: TempDir,
}

impl Room {
    fn new() -> Self {
        let folder = tiny(TestLayout::Open3d);
        let dataset = open_plain(folder.path()).unwrap();
        let frames = all(&dataset);
        let files = |frame: &FrameEntry| {
            [frame.color_path(), frame.depth_path()].map(|path| fs::read(path.unwrap()).unwrap())
        };
        Self {
            images: frames.iter().map(files).collect(),
            k: frames[0].camera.intrinsics,
            poses: frames.iter().map(|frame| frame.camera.pose.to_opencv()).collect(),
            dataset,
            _folder: folder,
        }
    }

    /// A bag of compressed images and cameras, without poses.
    fn bag(&self) -> Bag {
        let mut bag = Bag { has_chunks: true, ..Bag::default() };
        self.fill(&mut bag);
        bag
    }

    fn fill(&self, bag: &mut Bag) {
        for topic in ["/camera/color/camera_info", "/camera/depth/camera_info"] {
            bag.camera(topic, OPTICAL, &self.k, "plumb_bob", &[0.0; 5]);
        }
        for (i, [color, depth]) in self.images.iter().enumerate() {
            let time = START + i as u64 * STEP;
            let topic = "/camera/color/image_raw/compressed";
            bag.compressed(topic, time, OPTICAL, "rgb8; png compressed bgr8", color);
            let depth = [&[7; 12], &depth[..]].concat();
            let topic = "/camera/depth/image_raw/compressedDepth";
            bag.compressed(topic, time, OPTICAL, "16UC1; compressedDepth png", &depth);
        }
    }

    /// Adds transforms from the map over the robot's base to the camera.
    fn transforms(&self, bag: &mut Bag) {
        bag.transform("/tf_static", START, ["base_link", OPTICAL], mount());
        bag.transform("/tf", START, ["map", "odom"], DMat4::IDENTITY);
        for (i, pose) in self.poses.iter().enumerate() {
            let time = START + i as u64 * STEP;
            bag.transform("/tf", time, ["odom", "base_link"], *pose * mount().inverse());
        }
    }

    #[track_caller]
    fn check(&self, path: &Path) -> Dataset {
        let dataset = open_plain(path).unwrap();
        assert_eq!(dataset.layout, Layout::Ros2Bag);
        assert!(dataset.warnings.is_empty(), "{:?}", dataset.warnings);
        assert!(dataset.unused.is_empty() && dataset.is_metric(), "{:?}", dataset.unused);
        assert_eq!(all(&dataset).len(), 4);
        for (i, (found, expected)) in all(&dataset).iter().zip(all(&self.dataset)).enumerate() {
            let pose = found.camera.pose.to_opencv();
            assert!(pose.abs_diff_eq(self.poses[i], 1e-9), "{pose} for {}", self.poses[i]);
            assert_eq!(found.camera.intrinsics, self.k);
            assert!((found.time.unwrap() - 1.7e9 - 0.1 * i as f64).abs() < 1e-6);
            let [found, expected] = [found, expected].map(|frame| frame.load().unwrap());
            assert!(found.color == expected.color, "colours of frame {i}");
            let [found, expected] = [found, expected].map(|frame| frame.depth_z().unwrap());
            let near = |(a, b): (&f32, &f32)| (a - b).abs() < 1e-6;
            assert!(found.data.iter().zip(&expected.data).all(near), "depth of frame {i}");
        }
        dataset
    }
}

/// Camera on the robot, looking ahead.
fn mount() -> DMat4 {
    DMat4::from_translation(DVec3::new(0.1, -0.05, 0.8)) * ahead()
}

fn ahead() -> DMat4 {
    DMat4::from_mat3(DMat3::from_cols(-DVec3::Y, -DVec3::Z, DVec3::X))
}

fn all(dataset: &Dataset) -> &[FrameEntry] {
    &dataset.splits[dataset.split_named("all").unwrap()].frames
}

#[track_caller]
fn refuses(bag: &Bag, parts: &[&str]) {
    scratch::refuses(bag.write().path(), parts);
}

#[test]
fn bags_open_whatever_packs_them() {
    let room = Room::new();
    for (packing, has_chunks) in [
        (Packing::Plain, false),
        (Packing::Plain, true),
        (Packing::Zstd, true),
        (Packing::Lz4, true),
    ] {
        for is_big in [false, true] {
            let mut bag = Bag { is_big, packing, has_chunks, ..Bag::default() };
            room.fill(&mut bag);
            room.transforms(&mut bag);
            let folder = bag.write();
            let dataset = room.check(folder.path());
            assert!(dataset.is_folder && dataset.recognised_by.contains("room_0.mcap"));
            let dataset = room.check(&folder.path().join("room_0.mcap"));
            assert!(!dataset.is_folder && dataset.name == "room_0.mcap");
        }
    }
    // A recording that was split into files.
    let mut first = room.bag();
    let mut second = Bag::default();
    room.transforms(&mut second);
    second.messages.append(&mut first.messages.split_off(6));
    let folder = first.write();
    fs::write(folder.path().join("room_1.mcap"), second.bytes()).unwrap();
    let error = open_plain(folder.path()).unwrap_err().to_string();
    assert_says(&error, &["expected one bag, found 2 without a metadata.yaml", "open one"]);
    fs::write(folder.path().join("metadata.yaml"), "rosbag2_bagfile_information:\n").unwrap();
    room.check(folder.path());
}

#[test]
fn raw_images_of_every_encoding() {
    let room = Room::new();
    let size = [room.k.width, room.k.height];
    for is_big in [false, true] {
        for (color, depth) in
            [("rgb8", "16UC1"), ("bgr8", "32FC1"), ("rgba8", "mono16"), ("bgra8", "16UC1")]
        {
            let mut bag = Bag { is_big, has_chunks: true, ..Bag::default() };
            bag.camera("/camera/camera_info", OPTICAL, &room.k, "", &[]);
            for (i, [photo, codes]) in room.images.iter().enumerate() {
                let time = START + i as u64 * STEP;
                let rgb = image::load_from_memory(photo).unwrap().into_rgb8();
                let pixel = |p: &image::Rgb<u8>| match color {
                    "rgb8" => p.0.to_vec(),
                    "bgr8" => vec![p[2], p[1], p[0]],
                    "rgba8" => vec![p[0], p[1], p[2], 9],
                    _ => vec![p[2], p[1], p[0], 9],
                };
                let data: Vec<u8> = rgb.pixels().flat_map(pixel).collect();
                bag.raw("/camera/image", time, color, size, &data);
                let codes = image::load_from_memory(codes).unwrap().into_luma16();
                let order = |mut bytes: Vec<u8>| {
                    if is_big {
                        bytes.reverse();
                    }
                    bytes
                };
                let data: Vec<u8> = codes
                    .iter()
                    .flat_map(|code| match depth {
                        "32FC1" if *code == 0 => order(f32::NAN.to_le_bytes().to_vec()),
                        "32FC1" => order((f32::from(*code) / 1000.0).to_le_bytes().to_vec()),
                        _ => order(code.to_le_bytes().to_vec()),
                    })
                    .collect();
                bag.raw("/camera/depth", time, depth, size, &data);
            }
            room.transforms(&mut bag);
            room.check(bag.write().path());
        }
    }
}

#[test]
fn poses_of_topics_and_what_they_assume() {
    let room = Room::new();
    let time = |i: usize| START + i as u64 * STEP;
    let noted = |bag: &Bag, parts: &[&str]| {
        let dataset = room.check(bag.write().path());
        assert_says(&dataset.notes.join("\n"), parts);
    };
    // Odometry of a body to which static transforms lead.
    let mut bag = room.bag();
    bag.transform("/tf_static", START, ["base_footprint", "base_link"], DMat4::IDENTITY);
    bag.transform("/tf_static", START, ["base_link", OPTICAL], mount());
    for (i, pose) in room.poses.iter().enumerate() {
        bag.odometry(time(i), ["odom", "base_link"], *pose * mount().inverse());
    }
    noted(&bag, &["poses are those of /odom"]);
    // Of a body on which a camera turns by transforms.
    let mut bag = room.bag();
    for (i, pose) in room.poses.iter().enumerate() {
        let turn = DMat4::from_rotation_z(0.2 * i as f64);
        bag.transform("/tf", time(i), ["base_link", "pan"], turn);
        bag.transform("/tf_static", START, ["pan", OPTICAL], mount());
        bag.odometry(time(i), ["odom", "base_link"], *pose * (turn * mount()).inverse());
    }
    noted(&bag, &["poses are those of /odom"]);
    // Of a body without any transform to the camera.
    for (body, turn, axes) in
        [("base_link", ahead(), "looking ahead"), ("tracking_optical", DMat4::IDENTITY, "its axes")]
    {
        let mut bag = room.bag();
        for (i, pose) in room.poses.iter().enumerate() {
            bag.odometry(time(i), ["odom", body], *pose * turn.inverse());
        }
        noted(&bag, &["no transform from `", body, OPTICAL, axes]);
    }
    // Poses that name no body.
    for (schema, rest) in
        [("geometry_msgs/msg/PoseStamped", 0), ("geometry_msgs/msg/PoseWithCovarianceStamped", 36)]
    {
        let mut bag = room.bag();
        bag.transform("/tf_static", START, ["camera_link", OPTICAL], ahead());
        for (i, pose) in room.poses.iter().enumerate() {
            let cdr = bag.cdr().header(time(i), "map").pose(*pose * ahead().inverse());
            bag.add("/slam/pose", schema, time(i), cdr.reals(&vec![0.0; rest]));
        }
        noted(&bag, &["poses are those of /slam/pose", "assumed to be those of `camera_link`"]);
    }
}

#[test]
fn poses_are_interpolated_in_time() {
    let room = Room::new();
    let mut bag = room.bag();
    let turn = |angle: f64| DMat4::from_quat(DQuat::from_rotation_y(angle));
    for i in 0..10u64 {
        // Between the times of images.
        let time = START - STEP / 4 + i * STEP / 2;
        let t = (i as f64 - 0.5) / 2.0;
        let pose = DMat4::from_translation(DVec3::X * t) * turn(0.1 * t);
        bag.transform("/tf", time, ["map", OPTICAL], pose);
    }
    let dataset = open_plain(bag.write().path()).unwrap();
    for (i, frame) in all(&dataset).iter().enumerate() {
        let expected = DMat4::from_translation(DVec3::X * i as f64) * turn(0.1 * i as f64);
        assert!(frame.camera.pose.to_opencv().abs_diff_eq(expected, 1e-5), "{:?}", frame.camera);
    }
    assert_eq!(all(&dataset).len(), 4);
}

#[test]
fn photographs_have_their_own_camera_place_and_time() {
    let room = Room::new();
    let half = room.k.scaled(0.5);
    let mut bag = Bag { has_chunks: true, ..Bag::default() };
    bag.camera("/color/camera_info", "color_optical", &room.k, "plumb_bob", &[0.0; 5]);
    bag.camera("/depth/camera_info", "depth_optical", &half, "plumb_bob", &[0.0; 5]);
    let beside = DMat4::from_translation(DVec3::new(0.05, 0.0, 0.01));
    bag.transform("/tf_static", START, ["depth_optical", "color_optical"], beside);
    for (i, [color, depth]) in room.images.iter().enumerate() {
        let time = START + i as u64 * STEP;
        bag.transform("/tf", time, ["map", "depth_optical"], room.poses[i]);
        // One photograph is lost.
        if i != 3 {
            bag.compressed("/color/image", time + 1000, "color_optical", "png", color);
        }
        let codes = image::load_from_memory(depth).unwrap();
        let codes = codes.resize_exact(16, 12, image::imageops::FilterType::Nearest);
        let mut small = Cursor::new(Vec::new());
        codes.write_to(&mut small, image::ImageFormat::Png).unwrap();
        bag.compressed(
            "/depth/image",
            time,
            "depth_optical",
            "16UC1; png compressed",
            small.get_ref(),
        );
    }
    let folder = bag.write();
    let dataset = open_plain(folder.path()).unwrap();
    assert_eq!(all(&dataset).len(), 3);
    let said = dataset.warnings[0].to_string();
    assert_says(
        &said,
        &["1700000000.300000", "expected a colour image within 50 ms", "100 ms away"],
    );
    let frame = &all(&dataset)[0];
    assert_eq!((frame.camera.intrinsics, frame.photo_camera(None).intrinsics), (half, room.k));
    let between =
        frame.camera.pose.to_opencv().inverse() * frame.photo_camera(None).pose.to_opencv();
    assert!(between.abs_diff_eq(beside, 1e-4), "{between}");
    frame.load().unwrap();
    // Tracking knows the cameras' places on the rig alone.
    let track = LoadOptions { track: true, ..LoadOptions::default() };
    let tracked = open(folder.path(), &track).unwrap();
    let camera = all(&tracked)[0].color_camera.unwrap();
    assert!((DVec3::from(camera.offset) - DVec3::new(0.05, 0.0, 0.01)).length() < 1e-9);
}

#[test]
fn lenses_are_those_of_camera_info() {
    let room = Room::new();
    let with = |model: &str, terms: &[f64], topic: &str| {
        let mut bag = Bag { has_chunks: true, ..Bag::default() };
        bag.camera("/camera/camera_info", OPTICAL, &room.k, model, terms);
        for (i, [color, depth]) in room.images.iter().enumerate() {
            let time = START + i as u64 * STEP;
            bag.compressed(&format!("/camera/{topic}"), time, OPTICAL, "png", color);
            bag.compressed(&format!("/camera/depth/{topic}"), time, OPTICAL, "16UC1; png", depth);
        }
        room.transforms(&mut bag);
        bag
    };
    let other = tiny(TestLayout::Nerfstudio);
    edit_json(&other.path().join("transforms.json"), |json| {
        for (key, value) in [("k1", -0.1), ("k2", 0.02), ("p1", 0.01), ("p2", -0.02), ("k3", 0.03)]
        {
            json[key] = json!(value);
        }
    });
    let expected = open_plain(other.path()).unwrap().load(0, 1).unwrap();
    let terms = [-0.1, 0.02, 0.01, -0.02, 0.03, 0.0, 0.0, 0.0];
    for (model, n) in [("plumb_bob", 5), ("rational_polynomial", 8)] {
        let folder = with(model, &terms[..n], "image_raw").write();
        let frame = open_plain(folder.path()).unwrap().load(0, 1).unwrap();
        assert_eq!(
            (&frame.color, frame.depth_z()),
            (&expected.color, expected.depth_z()),
            "{model}"
        );
    }
    room.check(with("plumb_bob", &terms[..5], "image_rect").write().path());
    room.check(with("equidistant", &[0.0; 4], "image_raw").write().path());
    refuses(&with("equidistant", &terms[..4], "image_raw"), &["equidistant", "rectified images"]);
    refuses(&with("plumb_bob", &[5.0, 0.0, 0.0, 0.0], "image_raw"), &["fold or tear"]);
}

#[test]
fn what_a_bag_lacks_is_told_with_its_topics() {
    let room = Room::new();
    let folder = room.bag().write();
    let error = open_plain(folder.path()).unwrap_err().to_string();
    assert_says(
        &error,
        &["room_0.mcap", "odometry or poses", "/camera/color/camera_info (CameraInfo)"],
    );
    assert_says(&error, &["--poses track"]);
    let track = LoadOptions { track: true, ..LoadOptions::default() };
    assert_eq!(all(&open(folder.path(), &track).unwrap()).len(), 4);
    // Without cameras.
    let mut bag = room.bag();
    room.transforms(&mut bag);
    bag.messages.retain(|(_, schema, ..)| !schema.ends_with("CameraInfo"));
    refuses(&bag, &["expected CameraInfo for /camera/depth", "--intrinsics"]);
    let k = room.k;
    let given =
        LoadOptions { intrinsics: Some([k.fx, k.fy, k.cx, k.cy]), ..LoadOptions::default() };
    let dataset = open(bag.write().path(), &given).unwrap();
    assert_eq!(all(&dataset)[1].camera.intrinsics, k);
    // Without depth, with depth in a form that is not read, and with messages of other systems.
    let mut bag = room.bag();
    bag.messages.retain(|(topic, ..)| !topic.contains("depth/image"));
    refuses(&bag, &["topics of photographs and of depth", "/camera/color/image_raw/compressed"]);
    bag.compressed("/depth", START, OPTICAL, "16UC1; compressedDepth rvl", &[0; 99]);
    bag.add("/points", "foxglove.PointCloud", START, Cdr { bytes: vec![1; 8], is_big: false });
    refuses(&bag, &["/depth (CompressedImage)", "/points (foxglove.PointCloud)"]);
    refuses(&Bag { encoding: Some("ros1"), ..room.bag() }, &["topics of photographs and of depth"]);
    refuses(&Bag::default(), &["found no message"]);
}

#[test]
fn transforms_that_lead_nowhere() {
    let room = Room::new();
    let mut bag = room.bag();
    for i in 0..4 {
        bag.transform("/tf", START + i * STEP, ["b", OPTICAL], DMat4::IDENTITY);
        bag.transform("/tf", START + i * STEP, [OPTICAL, "b"], DMat4::IDENTITY);
    }
    refuses(&bag, &["expected transforms that lead to a root", "a cycle above"]);
    // Poses of NaN cost their messages, and frames far from a pose themselves.
    let mut bag = room.bag();
    for (i, pose) in room.poses.iter().enumerate().take(3) {
        bag.transform("/tf", START + i as u64 * STEP / 10, ["map", OPTICAL], *pose);
    }
    bag.transform("/tf", START + 3 * STEP, ["map", OPTICAL], DMat4::from_scale(DVec3::NAN));
    let dataset = open_plain(bag.write().path()).unwrap();
    assert_says(&dataset.unused.join("\n"), &["1 messages of /tf", "cannot be read"]);
    assert_eq!(all(&dataset).len(), 1);
    assert_says(&dataset.warnings[0].to_string(), &["expected a pose within 20 ms", "80 ms away"]);
}

#[test]
fn damaged_bags_never_panic() {
    let room = Room::new();
    for packing in [Packing::Plain, Packing::Zstd, Packing::Lz4] {
        let mut bag = Bag { has_chunks: true, packing, ..Bag::default() };
        room.transforms(&mut bag);
        room.fill(&mut bag);
        let whole = bag.bytes();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.mcap");
        let mut n_opened = 0;
        let mut exercise = |bytes: &[u8]| {
            fs::write(&path, bytes).unwrap();
            let dataset = match open_plain(folder.path()) {
                Ok(dataset) => dataset,
                Err(error) => return assert_says(&error.to_string(), &["expected"]),
            };
            n_opened += 1;
            for i in 0..all(&dataset).len() {
                if let Err(error) = dataset.load(0, i) {
                    assert_says(&error.to_string(), &["expected"]);
                }
            }
        };
        exercise(&whole);
        (1..40).for_each(|part| exercise(&whole[..whole.len() * part / 40]));
        for round in 0..200 {
            exercise(&mutate(&whole, &mut Rng::new(17, Purpose::Synthetic, round)));
        }
        assert!(n_opened > 2, "{n_opened}");
    }
    // What is cut off is told, and frames before are used.
    let mut bag = Bag::default();
    room.transforms(&mut bag);
    room.fill(&mut bag);
    let folder = bag.write();
    let path = folder.path().join("room_0.mcap");
    let bytes = fs::read(&path).unwrap();
    let depth = &room.images[3][1];
    let at = bytes.windows(depth.len()).position(|window| window == &depth[..]).unwrap();
    fs::write(&path, &bytes[..at + 9]).unwrap();
    let dataset = open_plain(folder.path()).unwrap();
    assert_eq!(all(&dataset).len(), 3);
    assert_says(
        &dataset.unused.join("\n"),
        &["a record that is cut off: what follows is not read"],
    );
    // A length of almost 2^64 bytes.
    let mut lying = bytes.clone();
    lying[at - 200..at - 150].fill(0xFF);
    fs::write(&path, lying).unwrap();
    if let Err(error) = open_plain(folder.path()) {
        assert_says(&error.to_string(), &["expected"]);
    }
}

#[test]
fn long_bags_open_at_once() {
    const N: u64 = 20_000;
    let room = Room::new();
    for packing in [Packing::Plain, Packing::Zstd] {
        let mut bag = Bag { has_chunks: true, packing, ..room.bag() };
        bag.messages.retain(|(_, schema, ..)| schema.ends_with("CameraInfo"));
        let [color, depth] = &room.images[0];
        for i in 0..N {
            let time = START + i * STEP / 10;
            bag.compressed("/camera/color/image", time, OPTICAL, "png", color);
            bag.compressed("/camera/depth/image", time, OPTICAL, "16UC1; png", depth);
            bag.transform("/tf", time, ["map", OPTICAL], room.poses[i as usize % 2]);
        }
        let folder = bag.write();
        let start = Instant::now();
        let dataset = open_plain(folder.path()).unwrap();
        let seconds = start.elapsed().as_secs_f64();
        eprintln!("{N} frames opened in {seconds:.2} s, {packing:?}");
        assert_eq!(all(&dataset).len() as u64, N);
        dataset.load(0, N as usize - 1).unwrap();
        assert!(seconds < 10.0, "{seconds} s, also on a busy machine");
    }
}
