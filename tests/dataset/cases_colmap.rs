//! COLMAP models beside photographs and depth, written from COLMAP's documentation.

use crate::common::layouts::{TestLayout, write};
use crate::common::mutation::mutate;
use crate::common::scratch::{TINY, assert_says, edit_json, open_plain, refuses, tiny};
use glam::{DMat4, DQuat};
use serde_json::json;
use std::fs;
use std::path::Path;
use std::time::Instant;
use tempfile::TempDir;
use vbgs_studio::dataset::synthetic::SyntheticParams;
use vbgs_studio::dataset::{Dataset, FrameEntry, Layout, LoadOptions, open, pose_check};
use vbgs_studio::math::rng::{Purpose, Rng};

/// Identifier, model with its number, size and parameters.
pub type Camera = (u32, (&'static str, u32), [u64; 2], Vec<f64>);
const PINHOLE: (&str, u32) = ("PINHOLE", 1);

pub struct Image {
    name: String,
    pub camera: u32,
    /// Quaternion w x y z and translation, world to camera.
    pose: [f64; 7],
}

pub struct Model {
    pub cameras: Vec<Camera>,
    pub images: Vec<Image>,
}

impl Model {
    /// The camera and poses of the tiny recording in another layout.
    pub fn of_tiny() -> Self {
        Self::of(&open_plain(tiny(TestLayout::Open3d).path()).unwrap())
    }

    fn of(dataset: &Dataset) -> Self {
        let k = all(dataset)[0].camera.intrinsics;
        let image = |(i, frame): (usize, &FrameEntry)| Image {
            name: format!("frame_{:05}.png", i + 1),
            camera: 1,
            pose: world_to_camera(frame.camera.pose.to_opencv()),
        };
        Self {
            cameras: vec![(
                1,
                PINHOLE,
                [k.width, k.height].map(u64::from),
                vec![k.fx, k.fy, k.cx, k.cy],
            )],
            images: all(dataset).iter().enumerate().map(image).collect(),
        }
    }

    fn texts(&self) -> [String; 2] {
        let words =
            |all: &[f64]| all.iter().map(|v| format!("{v:?}")).collect::<Vec<_>>().join(" ");
        let mut cameras = "# CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n".to_owned();
        for (id, (name, _), [width, height], parameters) in &self.cameras {
            cameras += &format!("{id} {name} {width} {height} {}\n", words(parameters));
        }
        let mut images = "# Image list with two lines of data per image:\n".to_owned();
        for (i, image) in self.images.iter().enumerate() {
            // An image without observations has an empty line.
            let points = "12.5 7.25 -1 30.1 2 17 1 2 3 4 5 6".repeat(i % 2);
            let Image { name, camera, pose } = image;
            images += &format!("{} {} {camera} {name}\n{points}\n", i + 1, words(pose));
        }
        [cameras, images]
    }

    fn bytes(&self) -> [Vec<u8>; 2] {
        let mut cameras = (self.cameras.len() as u64).to_le_bytes().to_vec();
        for (id, (_, model), size, parameters) in &self.cameras {
            cameras.extend([id.to_le_bytes(), model.to_le_bytes()].as_flattened());
            cameras.extend(size.iter().flat_map(|side| side.to_le_bytes()));
            cameras.extend(parameters.iter().flat_map(|v| v.to_le_bytes()));
        }
        let mut images = (self.images.len() as u64).to_le_bytes().to_vec();
        for (i, image) in self.images.iter().enumerate() {
            images.extend((i as u32 + 1).to_le_bytes());
            images.extend(image.pose.iter().flat_map(|v| v.to_le_bytes()));
            images.extend(image.camera.to_le_bytes());
            images.extend(image.name.as_bytes());
            images.push(0);
            images.extend((i as u64).to_le_bytes());
            images.extend(vec![0xA5; 24 * i]);
        }
        [cameras, images]
    }

    pub fn write(&self, place: &Path, extension: &str) {
        fs::create_dir_all(place).unwrap();
        let files = match extension {
            "bin" => self.bytes(),
            _ => self.texts().map(String::into_bytes),
        };
        for (stem, bytes) in ["cameras", "images"].iter().zip(files) {
            fs::write(place.join(format!("{stem}.{extension}")), bytes).unwrap();
        }
    }

    /// Writes the model in place of the tiny recording's.
    fn replacing(&self, extension: &str) -> TempDir {
        let folder = without_model();
        self.write(&folder.path().join("sparse/0"), extension);
        folder
    }
}

fn world_to_camera(pose: DMat4) -> [f64; 7] {
    let inverse = pose.inverse();
    let (q, t) = (DQuat::from_mat4(&inverse), inverse.w_axis);
    [q.w, q.x, q.y, q.z, t.x, t.y, t.z]
}

fn without_model() -> TempDir {
    let folder = tiny(TestLayout::Colmap);
    fs::remove_dir_all(folder.path().join("sparse")).unwrap();
    folder
}

fn all(dataset: &Dataset) -> &[FrameEntry] {
    &dataset.splits[dataset.split_named("all").unwrap()].frames
}

/// Asserts that `left` frames open, and that one warning contains all parts.
#[track_caller]
fn skips(path: &Path, left: usize, parts: &[&str]) {
    let dataset = open_plain(path).unwrap();
    assert_eq!(all(&dataset).len(), left, "{:?}", dataset.warnings);
    let said: Vec<String> = dataset.warnings.iter().map(ToString::to_string).collect();
    let is_said = said.iter().any(|text| parts.iter().all(|part| text.contains(part)));
    assert!(is_said, "{parts:?} are missing from {said:?}");
    assert!((0..left).all(|i| dataset.load(0, i).is_ok()));
}

#[test]
fn models_open_in_both_forms_wherever_they_lie() {
    let model = Model::of_tiny();
    let truth = tiny(TestLayout::Open3d);
    let truth = open_plain(truth.path()).unwrap();
    for place in ["", "sparse", "sparse/0", "colmap", "colmap/sparse/0", "sparse/3"] {
        for extension in ["bin", "txt"] {
            let folder = without_model();
            model.write(&folder.path().join(place), extension);
            fs::write(folder.path().join(place).join("rigs.bin"), "more").unwrap();
            let dataset = open_plain(folder.path()).unwrap();
            assert_eq!(dataset.layout, Layout::Colmap, "{place}");
            assert!(dataset.warnings.is_empty() && dataset.unused.is_empty());
            assert!(!dataset.is_metric(), "worlds of COLMAP have any unit");
            assert_eq!(all(&dataset).len(), 4);
            for (found, expected) in all(&dataset).iter().zip(all(&truth)) {
                assert_eq!(found.camera.intrinsics, expected.camera.intrinsics);
                let [a, b] = [found, expected].map(|frame| frame.camera.pose.to_opencv());
                assert!(a.abs_diff_eq(b, 1e-9), "{place}: {a} for {b}");
                let [a, b] = [found, expected].map(|frame| frame.load().unwrap());
                assert_eq!((a.depth_z(), a.color), (b.depth_z(), b.color));
            }
        }
    }
}

/// The lens of each camera model is that of nerfstudio's terms of the same names.
#[test]
fn lenses_bend_as_their_models_state() {
    let k = Model::of_tiny().cameras[0].3.clone();
    let [fx, cx, cy] = [k[0], k[2], k[3]];
    let lenses: [(&str, u32, Vec<f64>, serde_json::Value); 5] = [
        ("SIMPLE_PINHOLE", 0, vec![fx, cx, cy], json!({})),
        ("SIMPLE_RADIAL", 2, vec![fx, cx, cy, -0.1], json!({"k1": -0.1})),
        ("RADIAL", 3, vec![fx, cx, cy, -0.1, 0.02], json!({"k1": -0.1, "k2": 0.02})),
        (
            "OPENCV",
            4,
            vec![fx, fx, cx, cy, -0.1, 0.02, 0.01, -0.02],
            json!({"k1": -0.1, "k2": 0.02, "p1": 0.01, "p2": -0.02}),
        ),
        (
            "FULL_OPENCV",
            6,
            vec![fx, fx, cx, cy, -0.1, 0.02, 0.01, -0.02, 0.03, 0.0, 0.0, 0.0],
            json!({"k1": -0.1, "k2": 0.02, "p1": 0.01, "p2": -0.02, "k3": 0.03}),
        ),
    ];
    for (name, number, parameters, terms) in lenses {
        let other = tiny(TestLayout::Nerfstudio);
        edit_json(&other.path().join("transforms.json"), |json| {
            json["fl_y"] = json["fl_x"].clone();
            terms.as_object().unwrap().iter().for_each(|(k, v)| json[k] = v.clone());
        });
        let expected = open_plain(other.path()).unwrap().load(0, 1).unwrap();
        for extension in ["bin", "txt"] {
            let mut model = Model::of_tiny();
            model.cameras[0] = (1, (name, number), [32, 24], parameters.clone());
            let folder = model.replacing(extension);
            let frame = open_plain(folder.path()).unwrap().load(0, 1).unwrap();
            assert_eq!(frame.color, expected.color, "{name}");
            assert_eq!(frame.depth_z(), expected.depth_z(), "{name}");
        }
    }
    // Denominators of the rational lens come last.
    let mut model = Model::of_tiny();
    let rational = [&k[..], &[0.1, 0.0, 0.0, 0.0, 0.0, 0.1, 0.0, 0.0]].concat();
    model.cameras[0] = (1, ("FULL_OPENCV", 6), [32, 24], rational);
    let bent = open_plain(model.replacing("bin").path()).unwrap().load(0, 1).unwrap();
    let straight =
        open_plain(Model::of_tiny().replacing("bin").path()).unwrap().load(0, 1).unwrap();
    assert_eq!(bent.depth_z(), straight.depth_z(), "numerator and denominator are equal");
}

#[test]
fn lenses_that_are_not_perspective_are_refused() {
    let mut model = Model::of_tiny();
    let k = model.cameras[0].3.clone();
    let fisheye = ("OPENCV_FISHEYE", 5);
    model.cameras.push((2, fisheye, [32, 24], [&k[..], &[0.0; 4]].concat()));
    model.images[2].camera = 2;
    for extension in ["bin", "txt"] {
        let folder = model.replacing(extension);
        skips(folder.path(), 3, &["cameras.", "OPENCV_FISHEYE", "undistort the images"]);
    }
    model.images.iter_mut().for_each(|image| image.camera = 2);
    for extension in ["bin", "txt"] {
        let folder = model.replacing(extension);
        refuses(folder.path(), &["sparse/0/cameras.", "OPENCV_FISHEYE", "undistort the images"]);
    }
    model.cameras[1] = (2, ("OPENCV", 4), [32, 24], [&k[..], &[5.0, 0.0, 0.0, 0.0]].concat());
    refuses(model.replacing("bin").path(), &["cameras.bin", "fold or tear"]);
    model.cameras[1] = (2, ("NEW_MODEL", 99), [32, 24], k.clone());
    refuses(model.replacing("bin").path(), &["cameras.bin", "camera model 99 in record 2 of 2"]);
    refuses(model.replacing("txt").path(), &["cameras.txt", "NEW_MODEL", "undistort"]);
}

/// Photographs of two sizes, and depth of half the size of either.
#[test]
fn every_image_has_the_camera_of_its_size() {
    let mut model = Model::of_tiny();
    let k = model.cameras[0].3.clone();
    let double: Vec<f64> = k.iter().map(|v| 2.0 * v).collect();
    model.cameras.push((9, PINHOLE, [64, 48], double));
    model.images[1].camera = 9;
    let folder = model.replacing("txt");
    let scale = |name: &str, width, height| {
        let path = folder.path().join(name);
        let image = image::open(&path).unwrap();
        let image = image.resize_exact(width, height, image::imageops::FilterType::Nearest);
        image.save(path).unwrap();
    };
    scale("images/frame_00002.png", 64, 48);
    for name in ["frame_00001.png", "frame_00003.png", "frame_00004.png"] {
        scale(&format!("depth/{name}"), 16, 12);
    }
    let dataset = open_plain(folder.path()).unwrap();
    assert!(dataset.warnings.is_empty(), "{:?}", dataset.warnings);
    for (i, (color, depth)) in [(32, 16), (64, 32), (32, 16), (32, 16)].into_iter().enumerate() {
        let entry = &all(&dataset)[i];
        let (of_depth, photo) = (entry.camera.intrinsics, entry.photo_camera(None).intrinsics);
        assert_eq!((of_depth.width, photo.width), (depth, color), "frame {i}");
        for k_of in [of_depth, photo] {
            let scale = f64::from(k_of.width) / 32.0;
            assert!((k_of.fx - scale * k[0]).abs() < 1e-9 && (k_of.cy - scale * k[3]).abs() < 1e-9);
        }
        entry.load().unwrap();
    }
}

#[test]
fn worlds_of_any_unit_are_told() {
    let folder = tempfile::tempdir().unwrap();
    let walk = SyntheticParams { width: 64, height: 48, n_train: 48, n_eval: 0, ..TINY };
    write(&walk, folder.path(), TestLayout::Colmap, &mut |_, _| ()).unwrap();
    let dataset = open_plain(folder.path()).unwrap();
    let check = pose_check::check(&dataset, 0).unwrap();
    assert!(check.opened.agreement > 0.8 && check.warnings().is_empty(), "{check:?}");
    let mut model = Model::of(&dataset);
    for image in &mut model.images {
        image.pose[4..].iter_mut().for_each(|v| *v *= 2.5);
    }
    model.write(&folder.path().join("sparse/0"), "bin");
    let check = pose_check::check(&open_plain(folder.path()).unwrap(), 0).unwrap();
    assert!(!check.warnings().is_empty(), "{check:?}");
    assert!((check.best.unit / 2.5 - 1.0).abs() < 0.05, "{check:?}");
    let options = LoadOptions { depth_scale: Some(0.0025), ..LoadOptions::default() };
    let check = pose_check::check(&open(folder.path(), &options).unwrap(), 0).unwrap();
    assert!(check.opened.agreement > 0.8 && check.warnings().is_empty(), "{check:?}");
}

#[test]
fn names_with_folders_and_depth_in_floats() {
    let mut model = Model::of_tiny();
    let plain = model.replacing("bin");
    let expected = open_plain(plain.path()).unwrap().load(0, 1).unwrap().depth_z().unwrap();
    model.images.iter_mut().for_each(|image| image.name = format!("cam 1/{}", image.name));
    for (photographs, depths) in [("images/cam 1", "depths/cam 1"), ("cam 1", "depth_images")] {
        let folder = model.replacing("txt");
        let at = |name: &str| folder.path().join(name);
        fs::create_dir_all(at(depths)).unwrap();
        for i in 1..=4 {
            let name = format!("frame_{i:05}.png");
            fs::create_dir_all(at(photographs)).unwrap();
            fs::rename(at("images").join(&name), at(photographs).join(&name)).unwrap();
            let depth = image::open(at("depth").join(&name)).unwrap().into_luma16();
            let header = "{'descr': '<f4', 'fortran_order': False, 'shape': (24, 32), }";
            let header = format!("{header:<117}\n");
            let lengths = depth.iter().flat_map(|mm| (f32::from(*mm) / 1000.0).to_le_bytes());
            let magic = b"\x93NUMPY\x01\x00\x76\x00".to_vec();
            let npy: Vec<u8> = magic.into_iter().chain(header.bytes()).chain(lengths).collect();
            fs::write(at(depths).join(format!("frame_{i:05}.npy")), npy).unwrap();
        }
        fs::remove_dir_all(at("depth")).unwrap();
        let dataset = open_plain(folder.path()).unwrap();
        assert_eq!(all(&dataset).len(), 4, "{:?}", dataset.warnings);
        assert_eq!(all(&dataset)[1].name, "cam 1/frame_00002.png");
        let found = dataset.load(0, 1).unwrap().depth_z().unwrap();
        let near = |(a, b): (&f32, &f32)| (a - b).abs() < 1e-6;
        assert!(found.data.iter().zip(&expected.data).all(near), "floats are metres");
    }
    // Depth of one name in no folder belongs to neither of two images of that name.
    model.images[2].name = "cam 2/frame_00002.png".to_owned();
    let folder = model.replacing("bin");
    for cam in ["cam 1", "cam 2"] {
        fs::create_dir_all(folder.path().join(cam)).unwrap();
        for i in 1..=4 {
            let [from, to] = ["images", cam].map(|at| folder.path().join(at));
            let name = format!("frame_{i:05}.png");
            fs::copy(from.join(&name), to.join(&name)).unwrap();
        }
    }
    skips(folder.path(), 2, &["cam 2/frame_00002.png", "expected a depth image"]);
}

#[test]
fn the_model_with_most_images_is_used_and_others_are_named() {
    let model = Model::of_tiny();
    let folder = model.replacing("bin");
    let mut part = Model::of_tiny();
    part.images.truncate(2);
    part.write(&folder.path().join("sparse/1"), "bin");
    part.write(&folder.path().join("colmap"), "txt");
    fs::create_dir_all(folder.path().join("sparse/2")).unwrap();
    for name in ["cameras.bin", "images.bin"] {
        fs::write(folder.path().join("sparse/2").join(name), "short").unwrap();
    }
    let dataset = open_plain(folder.path()).unwrap();
    assert_eq!(all(&dataset).len(), 4);
    let notes = dataset.notes.join("\n");
    assert_says(&notes, &["sparse/0/images.bin (4 images)", "sparse/1/images.bin (2 images)"]);
    assert_says(&notes, &["not used", "colmap/images.txt (2 images)"]);
    assert_says(&dataset.unused.join("\n"), &["sparse/2/cameras.bin", "the end of the file"]);
}

#[test]
fn missing_depth_is_told_with_what_was_found() {
    let folder = Model::of_tiny().replacing("txt");
    fs::remove_dir_all(folder.path().join("depth")).unwrap();
    let parts = ["a COLMAP model of 4 images (sparse/0/images.txt)", "without depth", "depth/NAME"];
    refuses(folder.path(), &parts);
    assert!(open_plain(folder.path()).unwrap_err().to_string().len() < 420);
    // Depth that a network estimated, beside its scales (3DGS).
    let folder = Model::of_tiny().replacing("txt");
    fs::write(folder.path().join("sparse/0/depth_params.json"), "{}").unwrap();
    refuses(folder.path(), &["depth_params.json", "inverse depth that a network estimated"]);
    // Some images have none.
    let folder = Model::of_tiny().replacing("bin");
    fs::remove_file(folder.path().join("depth/frame_00003.png")).unwrap();
    skips(folder.path(), 3, &["frame_00003.png", "expected a depth image", "found none"]);
}

#[test]
fn other_layouts_open_as_themselves_beside_a_model() {
    for (layout, recognised) in [
        (TestLayout::Nerfstudio, Layout::Nerfstudio),
        (TestLayout::StrayScanner, Layout::StrayScanner),
        (TestLayout::Tum, Layout::Tum),
    ] {
        let folder = tiny(layout);
        let expected = open_plain(folder.path()).unwrap();
        for place in ["sparse/0", "colmap"] {
            Model::of_tiny().write(&folder.path().join(place), "bin");
        }
        let dataset = open_plain(folder.path()).unwrap();
        assert_eq!((dataset.layout, all(&dataset).len()), (recognised, 4));
        assert_eq!(all(&dataset)[1].camera, all(&expected)[1].camera);
    }
    // Lists of photographs under the names of a model are none.
    let folder = without_model();
    fs::write(folder.path().join("cameras.txt"), "left 1\nright 2\n").unwrap();
    fs::write(folder.path().join("images.txt"), "a.png\nb.png\n").unwrap();
    refuses(folder.path(), &["expected a known layout"]);
}

#[test]
fn lists_of_names_divide_the_images() {
    let frames = |dataset: &Dataset, split: &str| -> Vec<String> {
        let split = &dataset.splits[dataset.split_named(split).unwrap()];
        split.frames.iter().map(|frame| frame.name.clone()).collect()
    };
    let folder = Model::of_tiny().replacing("bin");
    fs::write(folder.path().join("sparse/0/test.txt"), "frame_00002.png\nframe_00004\n").unwrap();
    let dataset = open_plain(folder.path()).unwrap();
    assert_eq!(frames(&dataset, "test"), ["frame_00002.png", "frame_00004.png"]);
    assert_eq!(frames(&dataset, "train"), ["frame_00001.png", "frame_00003.png"]);
    assert_eq!(dataset.splits[dataset.training_split().unwrap()].name, "train");
    assert_eq!(dataset.splits.len(), 2);
    let lists =
        json!({"train": ["frame_00001.png", "frame_00004.png"], "test": ["frame_00003.png"]});
    fs::write(folder.path().join("train_test_lists.json"), lists.to_string()).unwrap();
    let dataset = open_plain(folder.path()).unwrap();
    assert_eq!(frames(&dataset, "train"), ["frame_00001.png", "frame_00004.png"]);
    assert_eq!(frames(&dataset, "test"), ["frame_00003.png"]);
    assert_says(&dataset.notes.join("\n"), &["1 images are in no list of a split; left out"]);
    // Lists of other images divide nothing.
    fs::write(folder.path().join("train_test_lists.json"), r#"{"test": ["DSC01.JPG"]}"#).unwrap();
    fs::write(folder.path().join("sparse/0/test.txt"), "notes\n").unwrap();
    assert_eq!(all(&open_plain(folder.path()).unwrap()).len(), 4);
}

#[test]
fn masks_leave_pixels_out() {
    let folder = Model::of_tiny().replacing("bin");
    let mut mask = image::GrayImage::from_pixel(32, 24, image::Luma([255]));
    mask.put_pixel(3, 2, image::Luma([0]));
    fs::create_dir_all(folder.path().join("masks")).unwrap();
    mask.save(folder.path().join("masks/frame_00002.png")).unwrap();
    let depth = open_plain(folder.path()).unwrap().load(0, 1).unwrap().depth_z().unwrap();
    assert_eq!((*depth.at(3, 2) == 0.0, *depth.at(4, 2) > 0.0), (true, true));
}

#[test]
fn tracking_reads_no_pose() {
    let mut model = Model::of_tiny();
    model.images.iter_mut().for_each(|image| image.pose = [f64::NAN; 7]);
    let options = LoadOptions { track: true, ..LoadOptions::default() };
    for extension in ["bin", "txt"] {
        let folder = model.replacing(extension);
        let dataset = open(folder.path(), &options).unwrap();
        assert!(dataset.warnings.is_empty(), "{:?}", dataset.warnings);
        assert_eq!(all(&dataset).len(), 4);
        refuses(folder.path(), &["frame_00001.png", "a unit quaternion first", "NaN"]);
    }
}

#[test]
fn a_bad_image_costs_itself() {
    type Edit = fn(&mut Model);
    let edits: [(Edit, &[&str]); 6] = [
        (|m| m.images[1].pose[2] = f64::NAN, &["images.", "frame_00002.png", "NaN"]),
        (|m| m.images[1].pose[..4].fill(0.0), &["images.", "unit quaternion", "0.0"]),
        (|m| m.images[1].camera = 77, &["expected a camera of the model", "camera 77"]),
        (|m| m.images[1].name = "../secret.png".into(), &["inside the dataset", "../secret.png"]),
        (|m| m.images[1].name = "/etc/hostname".into(), &["inside the dataset", "/etc/hostname"]),
        (|m| m.images[1].name = "frame_00001.png".into(), &["expected one of each frame"]),
    ];
    for (edit, parts) in edits {
        for extension in ["bin", "txt"] {
            let mut model = Model::of_tiny();
            edit(&mut model);
            skips(model.replacing(extension).path(), 3, parts);
        }
    }
    let folder = Model::of_tiny().replacing("txt");
    let path = folder.path().join("sparse/0/images.txt");
    let text = fs::read_to_string(&path).unwrap();
    fs::write(&path, text.replace("\n2 ", "\ntwo ")).unwrap();
    skips(folder.path(), 3, &["images.txt", "line 4", "expected IMAGE_ID", "found two"]);
    // Without lines of observations.
    fs::write(
        &path,
        text.lines().filter(|line| line.ends_with(".png")).fold(String::new(), |a, l| a + l + "\n"),
    )
    .unwrap();
    assert_eq!(all(&open_plain(folder.path()).unwrap()).len(), 4);
}

#[test]
fn damaged_models_are_refused_in_one_message() {
    let [cameras, images] = Model::of_tiny().bytes();
    let of = |cameras: &[u8], images: &[u8]| {
        let folder = Model::of_tiny().replacing("bin");
        fs::write(folder.path().join("sparse/0/cameras.bin"), cameras).unwrap();
        fs::write(folder.path().join("sparse/0/images.bin"), images).unwrap();
        folder
    };
    for length in [0, 7, 8, 30, 100, 180] {
        refuses(
            of(&cameras, &images[..length]).path(),
            &["images.bin", "the end of the file", "export"],
        );
    }
    for length in [0, 12, 40] {
        refuses(of(&cameras[..length], &images).path(), &["cameras.bin", "the end of the file"]);
    }
    let lying = |count: u64| [&count.to_le_bytes(), &images[8..]].concat();
    for count in [5, 1 << 63, u64::MAX] {
        let said = format!("the end of the file in record 5 of {count}");
        refuses(of(&cameras, &lying(count)).path(), &["images.bin", &said]);
    }
    refuses(of(&cameras, &0u64.to_le_bytes()).path(), &["expected a model with images"]);
    // Names without end and absurd counts of observations.
    let endless = [&1u64.to_le_bytes()[..], &[7; 64], &[b'a'; 9000]].concat();
    refuses(of(&cameras, &endless).path(), &["images.bin", "a name without end", "record 1"]);
    let first = 8 + 4 + 56 + 4 + "frame_00001.png".len() + 1;
    for count in [u64::MAX, 1 << 62, i64::MAX as u64 / 24] {
        let mut images = images.clone();
        images[first..first + 8].copy_from_slice(&count.to_le_bytes());
        let error = open_plain(of(&cameras, &images).path()).unwrap_err().to_string();
        assert_says(&error, &["images.bin", "record"]);
    }
    let mut huge = cameras.clone();
    huge[16..24].copy_from_slice(&u64::MAX.to_le_bytes());
    refuses(of(&huge, &images).path(), &["cameras.bin", "width and height", "0x24"]);
}

#[test]
fn mutated_texts_and_binaries_never_panic() {
    for extension in ["bin", "txt"] {
        let folder = Model::of_tiny().replacing(extension);
        let mut n_opened = 0;
        for stem in ["cameras", "images"] {
            let path = folder.path().join(format!("sparse/0/{stem}.{extension}"));
            let whole = fs::read(&path).unwrap();
            for round in 0..150 {
                let mut rng = Rng::new(31, Purpose::Synthetic, round);
                fs::write(&path, mutate(&whole, &mut rng)).unwrap();
                match open_plain(folder.path()) {
                    Ok(_) => n_opened += 1,
                    Err(error) => assert_says(&error.to_string(), &["expected"]),
                }
            }
            fs::write(&path, whole).unwrap();
        }
        assert!(n_opened > 0 && open_plain(folder.path()).is_ok());
    }
}

/// Opening takes little longer for observations, which are skipped, and for twenty thousand images.
#[test]
fn long_recordings_open_at_once() {
    const N: usize = 20_000;
    let folder = Model::of_tiny().replacing("bin");
    let mut model = Model::of_tiny();
    let [color, depth] = ["images", "depth"].map(|at| folder.path().join(at));
    for i in 0..N {
        let name = format!("long_{i:05}.png");
        for at in [&color, &depth] {
            fs::hard_link(at.join("frame_00001.png"), at.join(&name)).unwrap();
        }
        let Image { camera, pose, .. } = model.images[i % 4];
        model.images.push(Image { name, camera, pose });
    }
    model.write(&folder.path().join("sparse/0"), "txt");
    let start = Instant::now();
    let dataset = open_plain(folder.path()).unwrap();
    let seconds = start.elapsed().as_secs_f64();
    assert_eq!(all(&dataset).len(), N + 4);
    eprintln!("{N} images opened in {seconds:.2} s");
    assert!(seconds < 10.0, "{seconds} s, also on a busy machine");
}
