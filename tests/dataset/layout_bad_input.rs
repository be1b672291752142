//! Damaged recordings of every layout. One message states the file, what was expected, what was
//! found and what to do; the other frames stay usable.

use crate::common::layouts::TestLayout::{self, *};
use crate::common::scratch::{assert_says, edit_json, open_plain, refuses, tiny};
use serde_json::{Value, json};
use std::fs;
use std::io::Write;
use std::path::Path;
use vbgs_studio::dataset::Dataset;

/// Layouts of single files, with colour and depth file of their second frame.
const FILES: [(TestLayout, &str, &str); 12] = [
    (Tum, "rgb/1000.033333.png", "depth/1000.033333.png"),
    (Open3d, "color/00001.png", "depth/00001.png"),
    (Replica, "results/frame000001.jpg", "results/depth000001.png"),
    (Scannet, "color/1.jpg", "depth/1.png"),
    (Nerfstudio, "images/frame_00002.png", "depths/frame_00002.png"),
    (Record3d, "rgb/1.jpg", "depth/1.exr"),
    (StrayScanner, "rgb/000001.png", "depth/000001.png"),
    (Arkit, "images/000001.png", "depth/000001.bin"),
    (RtabMap, "rgb/2.png", "depth/2.png"),
    (Colmap, "images/frame_00002.png", "depth/frame_00002.png"),
    (ArkitScenes, "lowres_wide/41048190_6845.100.png", "lowres_depth/41048190_6845.100.png"),
    (ScannetPp, "iphone/rgb/frame_000010.jpg", "iphone/depth/frame_000010.png"),
];

/// Number of usable frames of the whole recording.
fn n_frames(dataset: &Dataset) -> usize {
    dataset.splits[dataset.split_named("all").unwrap()].frames.len()
}

/// Asserts that one of the four frames is skipped, with one warning that contains all parts.
#[track_caller]
fn skips(path: &Path, left: usize, parts: &[&str]) {
    let dataset = open_plain(path).unwrap();
    assert_eq!(n_frames(&dataset), left, "{:?}", dataset.warnings);
    let said: Vec<String> = dataset.warnings.iter().map(ToString::to_string).collect();
    let is_said = said.iter().any(|text| parts.iter().all(|part| text.contains(part)));
    assert!(is_said, "{parts:?} are missing from {said:?}");
    assert!((0..left).all(|i| dataset.load(0, i).is_ok()));
}

#[track_caller]
fn fails_to_load(path: &Path, index: usize, parts: &[&str]) {
    let dataset = open_plain(path).unwrap();
    match dataset.load(0, index) {
        Ok(_) => panic!("the damaged frame loaded"),
        Err(error) => assert_says(&error.to_string(), parts),
    }
    let n = n_frames(&dataset);
    assert!((0..n).filter(|i| *i != index).all(|i| dataset.load(0, i).is_ok()));
}

fn truncate(path: &Path, keep: f64) {
    let bytes = fs::read(path).unwrap();
    fs::write(path, &bytes[..(bytes.len() as f64 * keep) as usize]).unwrap();
}

/// Edits one line of a text file, counted from 0.
fn edit_line(path: &Path, line: usize, edit: impl Fn(&str) -> String) {
    let text = fs::read_to_string(path).unwrap();
    let lines: Vec<String> = text
        .lines()
        .enumerate()
        .map(|(i, old)| if i == line { edit(old) } else { old.to_owned() })
        .collect();
    fs::write(path, lines.join("\n") + "\n").unwrap();
}

#[test]
fn missing_images_of_every_layout() {
    for (layout, color, depth) in FILES {
        let folder = tiny(layout);
        fs::remove_file(folder.path().join(color)).unwrap();
        skips(folder.path(), 3, &["expected a colour image", "found none", "restore"]);
        let folder = tiny(layout);
        fs::remove_file(folder.path().join(depth)).unwrap();
        skips(folder.path(), 3, &["expected a depth image", "found none", "restore"]);
    }
}

#[test]
fn truncated_images_of_every_layout() {
    for (layout, color, depth) in FILES {
        for file in [color, depth] {
            let folder = tiny(layout);
            truncate(&folder.path().join(file), 0.6);
            fails_to_load(folder.path(), 1, &[file, "expected", "found", "again"]);
        }
    }
}

#[test]
fn all_images_damaged() {
    for (layout, color, _) in FILES {
        let folder = tiny(layout);
        let images = Path::new(color).parent().unwrap();
        for entry in fs::read_dir(folder.path().join(images)).unwrap() {
            fs::write(entry.unwrap().path(), "no image").unwrap();
        }
        refuses(folder.path(), &["expected at least one usable", "expected a whole", "again"]);
    }
}

#[test]
fn poses_that_are_none() {
    let nan = |line: &str, place: usize| {
        let mut words: Vec<&str> = line.split(' ').collect();
        words[place] = if line.contains(',') { "nan," } else { "nan" };
        words.join(" ")
    };
    let folder = tiny(Tum);
    edit_line(&folder.path().join("groundtruth.txt"), 2, |line| nan(line, 2));
    skips(folder.path(), 3, &["groundtruth.txt", "line 3", "expected finite", "correct the line"]);
    skips(folder.path(), 3, &["expected a pose within 20 ms of 1000.033", "33 ms away"]);
    let folder = tiny(Open3d);
    edit_line(&folder.path().join("trajectory.log"), 6, |line| nan(line, 0));
    skips(folder.path(), 3, &["trajectory.log", "expected 16 finite", "found NaN", "export"]);
    let folder = tiny(Replica);
    edit_line(&folder.path().join("traj.txt"), 1, |line| nan(line, 3));
    skips(folder.path(), 3, &["traj.txt", "expected 16 finite", "found NaN", "export"]);
    let folder = tiny(Scannet);
    let inf = "-inf -inf -inf -inf\n".repeat(4);
    fs::write(folder.path().join("pose/1.txt"), inf).unwrap();
    skips(folder.path(), 3, &["pose/1.txt", "expected 16 finite", "found -inf", "export"]);
    let folder = tiny(StrayScanner);
    edit_line(&folder.path().join("odometry.csv"), 2, |line| nan(line, 5));
    skips(folder.path(), 3, &["odometry.csv", "line 3", "expected a frame number", "correct"]);
    let folder = tiny(RtabMap);
    edit_line(&folder.path().join("poses.txt"), 2, |line| nan(line, 5));
    skips(folder.path(), 3, &["poses.txt", "line 3", "pose:", "export"]);
    let folder = tiny(Nerfstudio);
    edit_json(&folder.path().join("transforms.json"), |json| {
        json["frames"][1]["transform_matrix"][0][0] = json!(null);
    });
    skips(folder.path(), 3, &["transforms.json", "expected 4 rows", "null at row 0", "export"]);
    let folder = tiny(Record3d);
    edit_json(&folder.path().join("metadata.json"), |json| json["poses"][1][0] = json!("NaN"));
    skips(folder.path(), 3, &["metadata.json", "expected a pose qx", "an array of 7", "export"]);
    let folder = tiny(Arkit);
    edit_line(&folder.path().join("frames.jsonl"), 1, |line| {
        line.replacen("\"camera_to_world\":[[", "\"camera_to_world\":[[NaN,", 1)
    });
    skips(folder.path(), 3, &["frames.jsonl", "expected 4 rows of 4 finite", "export"]);
    edit_line(&folder.path().join("frames.jsonl"), 1, |line| {
        line.replacen("[[NaN,", "[[1e300,", 1)
    });
    skips(folder.path(), 3, &["frames.jsonl", "found 17 numbers", "export"]);
}

#[test]
fn doubled_frames() {
    for (layout, file, twin) in [
        (Open3d, "color/00001.png", "color/1.png"),
        (Replica, "results/depth000001.png", "results/depth1.png"),
        (Scannet, "pose/1.txt", "pose/01.txt"),
        (Record3d, "rgb/1.jpg", "rgb/01.jpg"),
        (StrayScanner, "depth/000001.png", "depth/1.png"),
    ] {
        let folder = tiny(layout);
        fs::copy(folder.path().join(file), folder.path().join(twin)).unwrap();
        skips(folder.path(), 4, &["expected one of each frame", "found `", "remove the other"]);
    }
    for (layout, file, line) in [
        (Tum, "depth.txt", 2),
        (StrayScanner, "odometry.csv", 2),
        (Arkit, "frames.jsonl", 1),
        (RtabMap, "poses.txt", 2),
    ] {
        let folder = tiny(layout);
        edit_line(&folder.path().join(file), line, |line| format!("{line}\n{line}"));
        skips(folder.path(), 4, &[file, "expected one of each frame", "remove the other"]);
    }
    let folder = tiny(Nerfstudio);
    edit_json(&folder.path().join("transforms.json"), |json| {
        let twin = json["frames"][1].clone();
        json["frames"].as_array_mut().unwrap().push(twin);
    });
    skips(folder.path(), 4, &["transforms.json", "expected one of each frame", "remove"]);
    let folder = tiny(Open3d);
    let log = folder.path().join("trajectory.log");
    let text = fs::read_to_string(&log).unwrap();
    let first: Vec<&str> = text.lines().take(5).collect();
    fs::write(&log, format!("{text}{}\n", first.join("\n"))).unwrap();
    skips(folder.path(), 4, &["trajectory.log", "expected one of each frame", "another block 0"]);
}

#[test]
fn times_out_of_order_and_out_of_reach() {
    for (layout, file, first, name) in
        [(Tum, "depth.txt", 1, "depth.txt"), (StrayScanner, "odometry.csv", 1, "odometry.csv")]
    {
        let folder = tiny(layout);
        let path = folder.path().join(file);
        let text = fs::read_to_string(&path).unwrap();
        let mut lines: Vec<&str> = text.lines().collect();
        lines.swap(first, first + 2);
        fs::write(&path, lines.join("\n")).unwrap();
        let dataset = open_plain(folder.path()).unwrap();
        assert!(dataset.warnings.is_empty() && n_frames(&dataset) == 4);
        let times: Vec<_> = dataset.splits[0].frames.iter().map(|f| f.time.unwrap()).collect();
        assert!(times.is_sorted(), "{times:?}");
        assert!(dataset.notes.iter().any(|n| n.contains(name) && n.contains("sorted")));
    }
    let folder = tiny(Tum);
    edit_line(&folder.path().join("groundtruth.txt"), 2, |_| "# lost".to_owned());
    skips(folder.path(), 3, &["depth/1000.033333.png", "within 20 ms", "record a pose"]);
    let folder = tiny(Tum);
    edit_line(&folder.path().join("rgb.txt"), 2, |_| String::new());
    skips(folder.path(), 3, &["expected a colour image within 20 ms", "33 ms away"]);
    fs::remove_file(folder.path().join("groundtruth.txt")).unwrap();
    refuses(folder.path(), &["groundtruth.txt", "expected poses", "no such file", "add the"]);
}

#[test]
fn lying_sizes() {
    let lie = |layout, file: &str, edit: fn(&mut Value), parts: &[&str]| {
        let folder = tiny(layout);
        edit_json(&folder.path().join(file), edit);
        refuses(folder.path(), &[&[file, "expected images of the stated size"], parts].concat());
    };
    let parts = ["found 32x24", "correct the size"];
    lie(Replica, "cam_params.json", |json| json["camera"]["w"] = json!(1200), &parts);
    lie(Nerfstudio, "transforms.json", |json| json["w"] = json!(4_000_000_000u32), &parts);
    lie(Record3d, "metadata.json", |json| json["h"] = json!(1440), &parts);
    lie(Open3d, "camera.json", |json| json["width"] = json!(640), &parts);
    let folder = tiny(RtabMap);
    let path = folder.path().join("calib/1.yaml");
    fs::write(&path, fs::read_to_string(&path).unwrap().replace("width: 32", "width: 64")).unwrap();
    refuses(folder.path(), &["calib/1.yaml", "stated size 64x24", "found 32x24"]);
    let folder = tiny(Arkit);
    edit_line(&folder.path().join("frames.jsonl"), 1, |line| {
        line.replace("\"depth_width\":10", "\"depth_width\":4000000000")
    });
    skips(folder.path(), 3, &["frames.jsonl", "one shape", "4000000000x8", "correct the camera"]);
    for layout in [Tum, Scannet, StrayScanner] {
        let (_, color, depth) = FILES.into_iter().find(|(other, ..)| *other == layout).unwrap();
        let folder = tiny(layout);
        image::RgbImage::new(16, 12).save(folder.path().join(color)).unwrap();
        fails_to_load(folder.path(), 1, &[color, "camera's size 32x24", "found 16x12"]);
        let folder = tiny(layout);
        let small = image::ImageBuffer::from_pixel(4, 4, image::Luma([900u16]));
        small.save(folder.path().join(depth)).unwrap();
        fails_to_load(folder.path(), 1, &[depth, "of the camera's size", "found 4x4", "export"]);
    }
}

#[test]
fn intrinsics_that_are_missing_or_none() {
    let folder = tiny(Tum);
    fs::remove_file(folder.path().join("camera-intrinsics.txt")).unwrap();
    refuses(folder.path(), &["camera-intrinsics.txt", "for images of 32x24", "set the intrinsics"]);
    let folder = tiny(Scannet);
    fs::write(folder.path().join("intrinsic/intrinsic_depth.txt"), "1 2 3").unwrap();
    refuses(folder.path(), &["intrinsic_depth.txt", "expected 4 numbers", "found 3", "export"]);
    let folder = tiny(Open3d);
    fs::remove_file(folder.path().join("camera.json")).unwrap();
    refuses(folder.path(), &["camera.json", "for images of 32x24", "create it"]);
    let folder = tiny(StrayScanner);
    fs::write(folder.path().join("camera_matrix.csv"), "0,0,1,0,0,1,0,0,1").unwrap();
    refuses(folder.path(), &["camera_matrix.csv", "field of view", "correct the focal length"]);
    let folder = tiny(Record3d);
    edit_json(&folder.path().join("metadata.json"), |json| json["K"] = json!([1, 2]));
    refuses(folder.path(), &["metadata.json", "`K`, nine numbers", "an array of 2", "export"]);
    let folder = tiny(Arkit);
    edit_line(&folder.path().join("frames.jsonl"), 1, |line| line.replace("intrinsics", "lens"));
    skips(folder.path(), 3, &["frames.jsonl", "expected `intrinsics`", "an object", "export"]);
    let folder = tiny(Nerfstudio);
    edit_json(&folder.path().join("transforms.json"), |json| {
        json["depth_unit_scale_factor"] = json!(-1);
    });
    refuses(folder.path(), &["transforms.json", "positive `depth_unit_scale_factor`", "found -1"]);
}

#[test]
fn names_that_lead_outside() {
    let folder = tiny(Tum);
    edit_line(&folder.path().join("rgb.txt"), 2, |_| "1000.033333 ../secret.png".to_owned());
    skips(folder.path(), 3, &["rgb.txt", "expected a path inside", "../secret.png", "relative"]);
    let folder = tiny(Nerfstudio);
    edit_json(&folder.path().join("transforms.json"), |json| {
        json["frames"][1]["depth_file_path"] = json!("/etc/hostname");
    });
    skips(folder.path(), 3, &["transforms.json", "expected a path inside", "/etc/hostname"]);
    let folder = tiny(Arkit);
    edit_line(&folder.path().join("frames.jsonl"), 1, |line| {
        line.replace("images/000001", "images/../../000001")
    });
    skips(folder.path(), 3, &["frames.jsonl", "expected a path inside", "../../000001.png"]);
}

#[test]
fn two_layouts_at_once() {
    let folder = tiny(Tum);
    let other = tiny(StrayScanner);
    for name in ["odometry.csv", "camera_matrix.csv"] {
        fs::copy(other.path().join(name), folder.path().join(name)).unwrap();
    }
    let parts =
        ["expected one recording", "two layouts", "tum by", "stray-scanner by", "give each"];
    refuses(folder.path(), &parts);
}

/// Returns the new bytes of an archive member by its name; `None` removes it.
type MemberEdit<'a> = &'a dyn Fn(&str, Vec<u8>) -> Option<Vec<u8>>;

/// Rewrites an archive, editing every member.
fn rewrite(path: &Path, mut edit: impl FnMut(&str, Vec<u8>) -> Option<Vec<u8>>) {
    let mut old = zip::ZipArchive::new(fs::File::open(path).unwrap()).unwrap();
    let mut new = zip::ZipWriter::new(std::io::Cursor::new(Vec::new()));
    for i in 0..old.len() {
        let mut member = old.by_index(i).unwrap();
        let name = member.name().unwrap().into_owned();
        let mut bytes = Vec::new();
        std::io::Read::read_to_end(&mut member, &mut bytes).unwrap();
        let Some(bytes) = edit(&name, bytes) else { continue };
        new.start_file(name, options()).unwrap();
        new.write_all(&bytes).unwrap();
    }
    fs::write(path, new.finish().unwrap().into_inner()).unwrap();
}

fn options() -> zip::write::SimpleFileOptions {
    zip::write::SimpleFileOptions::default().compression_method(zip::CompressionMethod::Deflated)
}

#[test]
fn archives_that_lie() {
    let changed = |edit: MemberEdit| {
        let folder = tiny(Record3dArchive);
        rewrite(&folder.path().join("recording.r3d"), edit);
        folder
    };
    let only = |wanted: &'static str, new: Vec<u8>| {
        move |name: &str, bytes| Some(if name == wanted { new.clone() } else { bytes })
    };
    let folder = changed(&|name, bytes| (name != "rgbd/1.jpg").then_some(bytes));
    skips(
        folder.path(),
        3,
        &["recording.r3d", "expected a colour image", "rgbd/1.jpg", "found none"],
    );
    let folder = changed(&|name, bytes| (name != "rgbd/1.depth").then_some(bytes));
    skips(folder.path(), 3, &["rgbd/1.jpg", "expected a depth image", "found none"]);
    let folder = changed(&only("rgbd/1.depth", vec![7; 100]));
    fails_to_load(folder.path(), 1, &["rgbd/1.depth", "100 bytes for 10x8", "again"]);
    let mut long = Vec::new();
    lzfse_rust::LzfseEncoder::default().encode_bytes(&vec![0; 1 << 26], &mut long).unwrap();
    let folder = changed(&only("rgbd/1.depth", long));
    fails_to_load(folder.path(), 1, &["rgbd/1.depth", "321 bytes for 10x8", "again"]);
    let folder = changed(&only("rgbd/1.jpg", vec![0; 300 << 20]));
    fails_to_load(folder.path(), 1, &["rgbd/1.jpg", "unpack to 314572800", "do not trust"]);
    // The bytes of so many floats wrap to a small number.
    let huge = |name: &str, bytes: Vec<u8>| {
        if name != "metadata" {
            return Some(bytes);
        }
        let mut json: serde_json::Value = serde_json::from_slice(&bytes).unwrap();
        (json["dw"], json["dh"]) = (4_000_000_000u64.into(), 3_000_000_000u64.into());
        Some(json.to_string().into_bytes())
    };
    let folder = changed(&huge);
    refuses(folder.path(), &["4000000000x3000000000", "256 megapixels"]);
    let folder = changed(&only("metadata", b"{".to_vec()));
    refuses(&folder.path().join("recording.r3d"), &["recording.r3d/metadata", "expected JSON"]);
    let folder = changed(&|name, bytes| (name != "metadata").then_some(bytes));
    refuses(&folder.path().join("recording.r3d"), &["recording.r3d", "`metadata`", "share"]);
    let folder = tiny(Record3dArchive);
    truncate(&folder.path().join("recording.r3d"), 0.7);
    refuses(&folder.path().join("recording.r3d"), &["recording.r3d", "whole zip archive", "again"]);
}

#[test]
fn a_part_of_a_recording_names_the_folder_that_holds_all_of_it() {
    for (layout, part) in [(Tum, "rgb"), (Nerfstudio, "images"), (ScannetPp, "iphone/rgb")] {
        let folder = tiny(layout);
        let above = format!("open the folder above, {}", folder.path().display());
        refuses(&folder.path().join(part), &["found a part of a recording", &above]);
    }
}

/// Archive of a recording's folder, with the members that `extra` adds.
fn zipped_folder(
    layout: TestLayout,
    extra: impl FnOnce(&mut zip::ZipWriter<fs::File>),
) -> (tempfile::TempDir, std::path::PathBuf) {
    let folder = tiny(layout);
    let archive = folder.path().with_extension("zip");
    let mut zip = zip::ZipWriter::new(fs::File::create(&archive).unwrap());
    let mut folders = vec![folder.path().to_owned()];
    while let Some(next) = folders.pop() {
        for entry in fs::read_dir(next).unwrap().map(|entry| entry.unwrap().path()) {
            if entry.is_dir() {
                folders.push(entry);
                continue;
            }
            let name = entry.strip_prefix(folder.path()).unwrap().to_str().unwrap();
            zip.start_file(format!("room/{}", name.replace('\\', "/")), options()).unwrap();
            zip.write_all(&fs::read(&entry).unwrap()).unwrap();
        }
    }
    extra(&mut zip);
    zip.finish().unwrap();
    (folder, archive)
}

#[test]
fn a_zipped_folder_opens_like_it_whatever_else_the_archive_holds() {
    for layout in [Tum, Nerfstudio, StrayScanner] {
        let (folder, archive) = zipped_folder(layout, |zip| {
            for name in ["../beside.png", "/root.png", "__MACOSX/room/._1.png"] {
                zip.start_file(name, options()).unwrap();
                zip.write_all(b"no image").unwrap();
            }
            zip.add_symlink("room/link.png", "/etc/passwd", options()).unwrap();
        });
        let [plain, packed] = [folder.path(), &archive].map(|path| open_plain(path).unwrap());
        assert_eq!((packed.layout, n_frames(&packed)), (plain.layout, n_frames(&plain)));
        assert_eq!((packed.path.as_deref(), packed.is_folder), (Some(&*archive), false));
        let [a, b] = [&plain, &packed].map(|dataset| dataset.load(0, 1).unwrap());
        assert_eq!(a.color, b.color);
        let unpacked = packed.splits[0].frames[0].color_path().unwrap().to_owned();
        let kept = packed.clone();
        drop(packed);
        assert!(unpacked.exists() && !unpacked.starts_with(folder.path()));
        drop(kept);
        assert!(!unpacked.exists(), "the files vanish with the dataset");
        assert!(!folder.path().with_file_name("beside.png").exists());
        fs::remove_file(archive).unwrap();
    }
}

#[test]
fn an_archive_that_unpacks_implausibly_is_refused() {
    let (_folder, archive) = zipped_folder(Tum, |zip| {
        zip.start_file("room/rgb/zeros.png", options()).unwrap();
        zip.write_all(&vec![0; 64 << 20]).unwrap();
    });
    // The directory states fewer bytes than the member unpacks to.
    let mut bytes = fs::read(&archive).unwrap();
    let stated = (64u32 << 20).to_le_bytes();
    let at = bytes.array_windows().rposition(|window: &[u8; 4]| *window == stated).unwrap();
    bytes[at..at + 4].copy_from_slice(&100u32.to_le_bytes());
    fs::write(&archive, bytes).unwrap();
    refuses(&archive, &["unpacking to", "larger than its declared", "export"]);
    fs::remove_file(archive).unwrap();
}

#[test]
fn members_that_lead_outside_are_reported_and_never_written() {
    let folder = tiny(Record3dArchive);
    let path = folder.path().join("recording.r3d");
    let mut zip = zip::ZipWriter::new_append(
        fs::OpenOptions::new().read(true).write(true).open(&path).unwrap(),
    )
    .unwrap();
    zip.start_file("rgbd/../../evil.jpg", options()).unwrap();
    zip.write_all(b"x").unwrap();
    zip.finish().unwrap();
    skips(folder.path(), 4, &["recording.r3d", "expected a path inside", "../../evil.jpg"]);
}

/// Sizes that a file of that length cannot hold are refused before any allocation.
#[test]
fn absurd_counts() {
    let folder = tiny(Nerfstudio);
    let depth = |name: &str, bytes: &[u8]| {
        fs::write(folder.path().join(name), bytes).unwrap();
        edit_json(&folder.path().join("transforms.json"), |json| {
            json["frames"][1]["depth_file_path"] = json!(name);
        });
    };
    let header = "{'descr': '<f4', 'fortran_order': False, 'shape': (4000000000, 4000000000), }\n";
    let mut npy = b"\x93NUMPY\x01\x00".to_vec();
    npy.extend((header.len() as u16).to_le_bytes());
    npy.extend(header.bytes());
    depth("a.npy", &npy);
    fails_to_load(folder.path(), 1, &["a.npy", "expected", "0 bytes of data for", "4000000000"]);
    // Little-endian, four entries: 65,535×65,535 pixels of 16 bits.
    let mut tiff = b"II*\0\x08\0\0\0\x04\0".to_vec();
    for (tag, value) in [(256u16, 65_535u32), (257, 65_535), (258, 16), (259, 1)] {
        tiff.extend(tag.to_le_bytes());
        tiff.extend([3, 0, 1, 0, 0, 0]);
        tiff.extend(value.to_le_bytes());
    }
    tiff.extend([0; 4]);
    depth("a.tiff", &tiff);
    fails_to_load(folder.path(), 1, &["a.tiff", "expected", "found", "again"]);
    let folder = tiny(Record3d);
    let path = folder.path().join("depth/1.exr");
    let mut exr = fs::read(&path).unwrap();
    let window = exr.windows(10).position(|w| w == b"dataWindow").unwrap();
    let corner = window + "dataWindow\0box2i\0".len() + 4 + 8;
    exr[corner..corner + 8].copy_from_slice(&[0xff, 0xff, 0xff, 0, 0xff, 0xff, 0xff, 0]);
    fs::write(&path, exr).unwrap();
    fails_to_load(folder.path(), 1, &["depth/1.exr", "expected", "found", "again"]);
}

/// Without images and without a decoder the error names the command to run; geometry alone opens.
#[test]
fn a_video_without_a_decoder() {
    use vbgs_studio::dataset::{LoadOptions, open};
    let folder = tiny(StrayScanner);
    fs::remove_dir_all(folder.path().join("rgb")).unwrap();
    refuses(folder.path(), &["rgb.mp4", "expected the recording's video", "geometry only"]);
    fs::write(folder.path().join("rgb.mp4"), "no video").unwrap();
    let error = match open_plain(folder.path()) {
        Ok(dataset) => panic!("opened with {:?}", dataset.warnings),
        Err(error) => error.to_string(),
    };
    assert_says(&error, &["rgb.mp4", "ffmpeg -noautorotate -i rgb.mp4"]);
    let options = LoadOptions { geometry_only: true, ..LoadOptions::default() };
    let dataset = open(folder.path(), &options).unwrap();
    let frame = dataset.load(0, 2).unwrap();
    assert_eq!((frame.color.width, frame.color.data[0]), (10, [128, 128, 128, 255]));
    assert!(frame.depth.is_some() && dataset.notes.iter().any(|n| n.contains("geometry only")));
}
