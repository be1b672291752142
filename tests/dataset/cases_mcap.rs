//! ROS 2 bags.

use crate::common::bag::{self, Bag, Cdr, DepthForm, OPTICAL, Packing, QUANTISATION, START, STEP};
use crate::common::layouts::{TestLayout, gray16};
use crate::common::mutation::mutate;
use crate::common::scratch::{self, TINY, assert_says, edit_json, open_plain, tiny};
use glam::{DMat3, DMat4, DQuat, DVec3};
use serde_json::json;
use std::fs;
use std::io::Cursor;
use std::path::Path;
use std::time::Instant;
use tempfile::TempDir;
use vbgs_studio::dataset::{Dataset, FrameEntry, Layout, LoadOptions, open};
use vbgs_studio::math::camera::Intrinsics;
use vbgs_studio::math::image::Image;
use vbgs_studio::math::rng::{Purpose, Rng};

/// The tiny recording: PNGs of colour and depth, camera and poses.
pub struct Room {
    pub images: Vec<[Vec<u8>; 2]>,
    pub k: Intrinsics,
    pub poses: Vec<DMat4>,
    dataset: Dataset,
    _folder: TempDir,
}

impl Room {
    pub fn new() -> Self {
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
    pub fn bag(&self) -> Bag {
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
    pub fn transforms(&self, bag: &mut Bag) {
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

/// Fuzzing starts from these bags.
#[test]
fn bags_of_all_forms_open() {
    for bytes in bag::of_all_forms(&TINY) {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join(bag::FILE), bytes).unwrap();
        let dataset = open_plain(folder.path()).unwrap();
        assert!(dataset.warnings.is_empty() && dataset.unused.is_empty(), "{:?}", dataset.unused);
        assert_eq!(all(&dataset).len(), 4);
        (0..4).for_each(|i| drop(dataset.load(0, i).unwrap()));
    }
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
fn each_camera_has_its_lens() {
    let room = Room::new();
    let terms = [-0.1, 0.02, 0.01, -0.02, 0.03];
    let with = |lenses: [&[f64]; 2]| {
        let mut bag = room.bag();
        bag.messages.retain(|(_, schema, ..)| !schema.ends_with("CameraInfo"));
        for (camera, terms) in ["color", "depth"].into_iter().zip(lenses) {
            let topic = format!("/camera/{camera}/camera_info");
            bag.camera(&topic, OPTICAL, &room.k, "plumb_bob", terms);
        }
        room.transforms(&mut bag);
        bag
    };
    let load = |lenses| open_plain(with(lenses).write().path()).unwrap().load(0, 1).unwrap();
    let [straight, bent] = [&[0.0; 5], &terms].map(|terms| load([&terms[..], &terms[..]]));
    assert!(straight.color != bent.color && straight.depth != bent.depth);
    let of_color = load([&terms, &[0.0; 5]]);
    assert!(of_color.color == bent.color && of_color.depth == straight.depth);
    let of_depth = load([&[0.0; 5], &terms]);
    assert!(of_depth.color == straight.color && of_depth.depth == bent.depth);
    for lenses in [[&[5.0; 1][..], &[0.0]], [&[0.0], &[5.0]]] {
        refuses(&with(lenses), &["fold or tear"]);
    }
}

/// Lengths of a PNG in millimetres.
pub fn lengths(png: &[u8]) -> Image<f64> {
    let codes = image::load_from_memory(png).unwrap().into_luma16();
    let (width, height) = (codes.width() as usize, codes.height() as usize);
    Image::from_vec(width, height, codes.iter().map(|code| f64::from(*code) / 1000.0).collect())
}

#[test]
fn depth_of_every_form_is_unpacked() {
    let room = Room::new();
    for form in [DepthForm::Rvl, DepthForm::InversePng, DepthForm::InverseRvl] {
        let mut bag = room.bag();
        bag.messages.retain(|(topic, ..)| !topic.contains("depth/image"));
        room.transforms(&mut bag);
        for (i, [_, depth]) in room.images.iter().enumerate() {
            let mut depth = lengths(depth);
            depth.data[40 + i] = 0.0;
            bag.depth("/camera/depth/image", START + i as u64 * STEP, form, &depth);
        }
        let folder = bag.write();
        let dataset = open_plain(folder.path()).unwrap();
        assert_eq!((all(&dataset).len(), &dataset.unused[..]), (4, &[][..]));
        for (i, [_, depth]) in room.images.iter().enumerate() {
            let found = dataset.load(0, i).unwrap().depth.unwrap();
            let expected = lengths(depth);
            for (at, z) in expected.data.iter().enumerate() {
                let found = found.value_at(at % expected.width, at / expected.width);
                if at == 40 + i {
                    assert_eq!(found, None, "{form:?}");
                    continue;
                }
                // The publisher rounds codes down, so lengths up, by less than the length of a step.
                let most = if form == DepthForm::Rvl { 0.0 } else { 1.01 * z * z / 10_100.0 };
                let error = found.unwrap() - z;
                assert!((-1e-6..=most + 1e-6).contains(&error), "{form:?}: {found:?} for {z}");
            }
        }
    }
}

#[test]
fn run_lengths_of_the_published_encoder() {
    // Of codes 0 0 1000 1002 999 0 65534 1 0 0 0 2500, by the listing in the paper.
    const PACKED: [u8; 16] = [
        0x45, 0xf3, 0x8a, 0x23, 0xf3, 0x8c, 0xed, 0x12, 0x31, 0xf3, 0xff, 0x9f, 0x00, 0x10, 0xe9,
        0xe8,
    ];
    let room = Room::new();
    let image =
        |size: [u32; 2], words: &[u8]| [&size.map(u32::to_le_bytes).concat(), words].concat();
    let whole = image([4, 3], &PACKED);
    let png = gray16(&Image::filled(4, 3, 1500.0), 1.0);
    let open = |form, [settings, other]: [[f32; 2]; 2], packed: &[u8]| {
        let mut bag = Bag { has_chunks: true, ..Bag::default() };
        bag.camera("/color/camera_info", OPTICAL, &room.k, "plumb_bob", &[]);
        bag.camera("/depth/camera_info", OPTICAL, &room.k.scaled(0.125), "plumb_bob", &[]);
        room.transforms(&mut bag);
        for (i, [color, _]) in room.images.iter().enumerate() {
            let time = START + i as u64 * STEP;
            bag.compressed("/color/image", time, OPTICAL, "png", color);
            let (settings, packed) = match i {
                1 => (other, packed),
                _ if form == DepthForm::InversePng => (settings, &png[..]),
                _ => (settings, &whole[..]),
            };
            bag.packed_depth("/depth/image", time, form, settings, packed);
        }
        let folder = bag.write();
        open_plain(folder.path()).unwrap().load(0, 1)
    };
    let inverse = [2000.0, -1000.0];
    for (form, settings, expected) in [
        (DepthForm::Rvl, [0.0; 2], [1.0, 1.002, 0.999, 65.534, 0.001, 2.5]),
        (
            DepthForm::InverseRvl,
            inverse,
            [1.0, 0.999_001, 1.000_500, 0.030_059_5, 1.998_002, 0.571_429],
        ),
    ] {
        let frame = open(form, [settings; 2], &whole).unwrap();
        let depth = frame.depth.unwrap();
        let found: Vec<f64> =
            (0..12).map(|at| depth.value_at(at % 4, at / 4).unwrap_or_default()).collect();
        let [a, b, c, d, e, f] = expected;
        let expected = [0.0, 0.0, a, b, c, 0.0, d, e, 0.0, 0.0, 0.0, f];
        let far = found.iter().zip(expected).any(|(found, z)| (found - z).abs() > 1e-6);
        assert!(!far, "{form:?}: {found:?}");
    }
    let fails = |form, settings, packed: &[u8], parts: &[&str]| {
        let error = open(form, [inverse, settings], packed).unwrap_err().to_string();
        assert_says(&error, parts);
        assert!(error.len() < 300, "{error}");
    };
    let no_fill = &["expected a whole image message", "run lengths that do not fill it"];
    for packed in [
        image([4, 3], &PACKED[..12]),
        image([5, 3], &PACKED),
        image([2, 3], &PACKED),
        image([4, 3], &[0xFF; 64]),
    ] {
        fails(DepthForm::Rvl, inverse, &packed, no_fill);
    }
    fails(DepthForm::Rvl, inverse, &whole[..7], &["a whole image message", "no size"]);
    for size in [[u32::MAX; 2], [1 << 16, 1 << 10], [0, 3]] {
        fails(DepthForm::Rvl, inverse, &image(size, &PACKED), &["that the file's bytes can hold"]);
    }
    for settings in [[f32::NAN, 0.0], [0.0, 1.0], [-1.0, 1.0], [1.0, f32::INFINITY]] {
        fails(
            DepthForm::InverseRvl,
            settings,
            &whole,
            &["settings of inverse depth", "a positive"],
        );
    }
    let colors = &room.images[0][0];
    fails(DepthForm::InversePng, QUANTISATION, colors, &["16-bit gray"]);
    fails(DepthForm::InversePng, QUANTISATION, &colors[..60], &["PNG"]);
}

#[test]
fn cameras_without_a_transform_are_assumed_in_one_place() {
    let room = Room::new();
    let mut bag = room.bag();
    bag.messages.retain(|(topic, ..)| !topic.contains("color/image"));
    room.transforms(&mut bag);
    for (i, [color, _]) in room.images.iter().enumerate() {
        bag.compressed("/camera/color/image", START + i as u64 * STEP, "lost_frame", "png", color);
    }
    let dataset = room.check(bag.write().path());
    let said = format!("no transform between `{OPTICAL}` and `lost_frame`");
    assert_says(&dataset.notes.join("\n"), &[&said, "one place"]);
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
    bag.raw("/depth", START, "64FC1", [2, 2], &[0; 32]);
    bag.add("/points", "foxglove.PointCloud", START, Cdr { bytes: vec![1; 8], is_big: false });
    refuses(&bag, &["/depth (Image)", "/points (foxglove.PointCloud)"]);
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

/// Chunks of a few bytes that unpack to gigabytes end the reading of a bag.
#[test]
fn chunks_that_unpack_implausibly_are_refused() {
    const UNPACKED: usize = 200 << 20;
    let room = Room::new();
    let mut bag = room.bag();
    room.transforms(&mut bag);
    let mut bytes = bag.bytes();
    // A record of another kind, of zeros.
    let mut record = vec![0; UNPACKED];
    record[0] = 0x80;
    record[1..9].copy_from_slice(&(UNPACKED as u64 - 9).to_le_bytes());
    let packed = zstd::encode_all(&record[..], 3).unwrap();
    let content = [
        &[0; 16][..],
        &(UNPACKED as u64).to_le_bytes(),
        &[0, 0, 0, 0, 4, 0, 0, 0],
        b"zstd",
        &(packed.len() as u64).to_le_bytes(),
        &packed,
    ]
    .concat();
    let chunk = [&[6][..], &(content.len() as u64).to_le_bytes(), &content].concat();
    // Before the mark of the end.
    let end = bytes.windows(9).rposition(|window| window == [15, 4, 0, 0, 0, 0, 0, 0, 0]).unwrap();
    bytes.splice(end..end, chunk.repeat(200));
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join(bag::FILE), bytes).unwrap();
    let start = Instant::now();
    let dataset = open_plain(folder.path()).unwrap();
    let seconds = start.elapsed().as_secs_f64();
    assert_says(&dataset.unused.join("\n"), &["a chunk that unpacks implausibly"]);
    assert!(all(&dataset).len() == 4 && seconds < 10.0, "{seconds} s, also on a busy machine");
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
