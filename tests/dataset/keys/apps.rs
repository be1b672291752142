//! Apps on phones, and sets of Apple's lidar.

use super::*;
use crate::common::layouts::TestLayout::*;
use std::io::{Cursor, Read, Write};
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipArchive, ZipWriter};

pub fn tables() -> Vec<Table> {
    let table = |heading, base, feeds| Table { heading, base, feeds };
    vec![
        table("record3d, record3d-archive", || tiny(Record3d), record3d(false)),
        table("record3d, record3d-archive", || tiny(Record3dArchive), record3d(true)),
        table("stray-scanner", || tiny(StrayScanner), stray_scanner()),
        table("arkit", || tiny(Arkit), arkit()),
        table("polycam", || tiny(Polycam), polycam()),
        table("scanner3d", || tiny(Scanner3d), scanner_3d()),
        table("arkit-scenes", || tiny(ArkitScenes), arkit_scenes()),
        table("scannet-pp", || tiny(ScannetPp), scannet_pp()),
    ]
}

/// Changes the metadata of a folder or an archive of Record3D.
fn edit_metadata(root: &Path, change: impl FnOnce(&mut Value)) {
    let path = root.join("recording.r3d");
    if !path.exists() {
        return edit_json(&root.join("metadata.json"), change);
    }
    let mut archive = ZipArchive::new(Cursor::new(fs::read(&path).unwrap())).unwrap();
    let mut zip = ZipWriter::new(Cursor::new(Vec::new()));
    let mut change = Some(change);
    for i in 0..archive.len() {
        let mut member = archive.by_index(i).unwrap();
        let (name, mut bytes) = (member.name().unwrap().into_owned(), Vec::new());
        member.read_to_end(&mut bytes).unwrap();
        if name == "metadata" {
            let mut json = serde_json::from_slice(&bytes).unwrap();
            change.take().unwrap()(&mut json);
            bytes = json.to_string().into_bytes();
        }
        let options = SimpleFileOptions::default().compression_method(CompressionMethod::Stored);
        zip.start_file(name, options).unwrap();
        zip.write_all(&bytes).unwrap();
    }
    fs::write(path, zip.finish().unwrap().into_inner()).unwrap();
}

fn record3d(is_archive: bool) -> Vec<Feed> {
    let set = |key: &'static str, value: Value| {
        edit(move |root| edit_metadata(root, |json| json[key] = value.clone()))
    };
    let double = |key: &'static str| {
        edit(move |root| {
            edit_metadata(root, |json| json[key] = json!(2 * json[key].as_u64().unwrap()));
        })
    };
    let columns = json!([40.0, 0.0, 0.0, 0.0, 41.0, 0.0, 15.0, 11.0, 1.0]);
    let own = json!([[44.0, 45.0, 16.0, 12.0], [40.0, 40.0, 16.0, 12.0]]);
    // Floats without a header have no size of their own.
    let of_size = || if is_archive { Checked("one shape") } else { Unused };
    vec![
        ("K", set("K", columns.clone()), Focal([40.0, 41.0])),
        ("K", set("K", columns), Principal([15.0, 11.0])),
        ("perFrameIntrinsicCoeffs", set("perFrameIntrinsicCoeffs", own), Focal([44.0, 45.0])),
        ("w", set("w", json!(33)), Checked("stated size 33x24")),
        ("h", set("h", json!(25)), Checked("stated size 32x25")),
        ("dw", double("dw"), of_size()),
        ("dh", double("dh"), of_size()),
        ("fps", set("fps", json!(10)), Step(0.1)),
        ("frameTimestamps", set("frameTimestamps", json!([7.0, 7.5, 8.0, 8.5])), Step(0.5)),
        ("cameraType", set("cameraType", json!(1)), Unused),
        ("lensDistortion", set("lensDistortion", json!([0.1, 0.0])), Unused),
        ("exposureTimes", set("exposureTimes", json!([0.01])), Unused),
    ]
}

fn stray_scanner() -> Vec<Feed> {
    const CAMERA: &str = "camera_matrix.csv";
    let added = |names: &'static str, cells: &'static str| {
        edit(move |root| {
            let file = root.join("odometry.csv");
            let text = fs::read_to_string(&file).unwrap();
            let lines = text.lines().enumerate();
            let line = |(i, line)| format!("{line}, {}\n", if i == 0 { names } else { cells });
            fs::write(file, lines.map(line).collect::<String>()).unwrap();
        })
    };
    let camera = || added("fx, fy, cx, cy", "50, 51, 15, 11");
    vec![
        (CAMERA, put_text(CAMERA, MATRIX.replace(' ', ",")), Focal([40.0, 41.0])),
        (CAMERA, put_text(CAMERA, MATRIX.replace(' ', ",")), Principal([15.0, 11.0])),
        (CAMERA, put_text(CAMERA, SKEWED.replace(' ', ",")), Refused("without skew")),
        ("fx", camera(), Focal([50.0, 51.0])),
        ("fy", camera(), Focal([50.0, 51.0])),
        ("cx", camera(), Principal([15.0, 11.0])),
        ("cy", camera(), Principal([15.0, 11.0])),
        ("timestamp", replace("odometry.csv", "1000.033333,", "1000.05,"), Step(0.05)),
        ("k1", added("k1", "0.1"), Unused),
        ("lens_position", added("lens_position", "0.7"), Unused),
        ("exposure_time", added("exposure_time", "0.01"), Unused),
    ]
}

/// Changes the objects of all lines, with their indices.
fn edit_lines(change: impl Fn(usize, &mut Value) + 'static) -> Edit {
    edit(move |root| {
        let file = root.join("frames.jsonl");
        let text = fs::read_to_string(&file).unwrap();
        let lines = text.lines().enumerate().map(|(i, line)| {
            let mut json = serde_json::from_str(line).unwrap();
            change(i, &mut json);
            format!("{json}\n")
        });
        fs::write(file, lines.collect::<String>()).unwrap();
    })
}

/// Sets values of the first object.
fn set_first(values: &[(&'static str, Value)]) -> Edit {
    let values = values.to_vec();
    edit_lines(move |i, json| {
        if i == 0 {
            set_in(json, &values)
        }
    })
}

fn arkit() -> Vec<Feed> {
    let none = ("/intrinsics", Value::Null);
    let named = |names: [&'static str; 4]| {
        let numbers = names.into_iter().zip([40.0, 41.0, 15.0, 11.0].map(|v| json!(v)));
        set_first(&[vec![("/intrinsics", Value::Null)], numbers.collect()].concat())
    };
    let nested = json!({ "fx": 40.0, "fy": 41.0, "cx": 15.0, "cy": 11.0, "k1": 0.1 });
    let mut feeds: Vec<Feed> = vec![
        ("intrinsics", set_first(&[("/intrinsics", matrix())]), Focal([40.0, 41.0])),
        ("intrinsics", set_first(&[("/intrinsics", matrix())]), Principal([15.0, 11.0])),
        ("K", set_first(&[none, ("/K", matrix())]), Focal([40.0, 41.0])),
        ("k1", set_first(&[("/intrinsics", nested)]), Unused),
        ("lensDistortion", set_first(&[("/lensDistortion", json!([0.1]))]), Unused),
        ("zoomFactor", set_first(&[("/zoomFactor", json!(2.0))]), Unused),
        ("depthUnit", set_first(&[("/depthUnit", json!("mm"))]), Unused),
        (
            "exposureDuration",
            edit_lines(|i, json| json["exposureDuration"] = json!(0.01 * i as f64)),
            Unused,
        ),
    ];
    for names in [["/fx", "/fy", "/cx", "/cy"], ["/fl_x", "/fl_y", "/ox", "/oy"]] {
        for (i, name) in names.iter().enumerate() {
            let effect = if i < 2 { Focal([40.0, 41.0]) } else { Principal([15.0, 11.0]) };
            feeds.push((&name[1..], named(names), effect));
        }
    }
    for key in ["intrinsics_depth", "depth_intrinsics", "depthIntrinsics"] {
        let change = edit_lines(move |_, json| {
            let [width, height] =
                ["depth_width", "depth_height"].map(|key| json[key].as_f64().unwrap());
            json[key] =
                json!([[30.0, 0.0, 0.5 * width], [0.0, 31.0, 0.5 * height], [0.0, 0.0, 1.0]]);
        });
        feeds.push((key, change, DepthFocal([30.0, 31.0])));
    }
    for (key, old, words) in [
        ("/width", "/width", "stated size 33x24"),
        ("/image_width", "/width", "stated size 33x24"),
        ("/w", "/width", "stated size 33x24"),
        ("/height", "/height", "stated size 32x33"),
        ("/image_height", "/height", "stated size 32x33"),
        ("/h", "/height", "stated size 32x33"),
    ] {
        feeds.push((&key[1..], set_first(&[(old, Value::Null), (key, json!(33))]), Checked(words)));
    }
    for (key, old) in [
        ("/depth_width", "/depth_width"),
        ("/depthWidth", "/depth_width"),
        ("/depth_height", "/depth_height"),
        ("/depthHeight", "/depth_height"),
    ] {
        let change = set_first(&[(old, Value::Null), (key, json!(77))]);
        feeds.push((&key[1..], change, Skipped("one shape")));
    }
    for key in ["/depth_size", "/depth_resolution"] {
        let change = set_first(&[("/depth_width", Value::Null), (key, json!([77, 24]))]);
        feeds.push((&key[1..], change, Skipped("one shape")));
    }
    for key in ["timestamp", "time", "t"] {
        let change = edit_lines(move |i, json| {
            json.as_object_mut().unwrap().remove("timestamp");
            json[key] = json!(7.0 + 0.5 * i as f64);
        });
        feeds.push((key, change, Step(0.5)));
    }
    feeds
}

/// Changes the JSON files of a folder whose names begin so, with their places.
fn edit_files(
    folder: &'static str,
    prefix: &'static str,
    change: impl Fn(usize, &mut Value) + 'static,
) -> Edit {
    edit(move |root| {
        let files = fs::read_dir(root.join(folder)).unwrap().map(|file| file.unwrap().path());
        let is_one = |file: &std::path::PathBuf| {
            let name = file.file_name().unwrap().to_str().unwrap();
            name.starts_with(prefix) && name.ends_with(".json")
        };
        let mut files: Vec<_> = files.filter(is_one).collect();
        files.sort();
        files.iter().enumerate().for_each(|(i, file)| edit_json(file, |json| change(i, json)));
    })
}

fn polycam() -> Vec<Feed> {
    let each =
        |change: fn(usize, &mut Value)| edit_files("keyframes/corrected_cameras", "", change);
    let twice = |_: usize, json: &mut Value| {
        for (key, value) in
            [("fx", 80), ("fy", 82), ("cx", 30), ("cy", 22), ("width", 64), ("height", 48)]
        {
            json[key] = json!(value);
        }
    };
    vec![
        ("fx", each(|_, json| json["fx"] = json!(40.0)), Focal([40.0, SAME])),
        ("fy", each(|_, json| json["fy"] = json!(41.0)), Focal([SAME, 41.0])),
        ("cx", each(|_, json| json["cx"] = json!(15.0)), Principal([15.0, SAME])),
        ("cy", each(|_, json| json["cy"] = json!(11.0)), Principal([SAME, 11.0])),
        ("width", each(twice), Focal([40.0, 41.0])),
        ("height", each(twice), Principal([15.0, 11.0])),
        ("timestamp", each(|i, json| json["timestamp"] = json!(500_000 * i)), Step(0.5)),
        ("k1", each(|_, json| json["k1"] = json!(0.1)), Unused),
        ("exposure_time", each(|_, json| json["exposure_time"] = json!(0.01)), Unused),
        ("depth_unit", each(|_, json| json["depth_unit"] = json!("mm")), Unused),
    ]
}

fn scanner_3d() -> Vec<Feed> {
    let each = |change: fn(usize, &mut Value)| edit_files("", "frame_", change);
    let set_all = |_: usize, json: &mut Value| {
        for (key, value) in [("fx", 40), ("fy", 41), ("cx", 15), ("cy", 11)] {
            json[key] = json!(value);
        }
    };
    let twice = |_: usize, json: &mut Value| {
        json["intrinsics"] = json!([80, 0, 30, 0, 82, 22, 0, 0, 1]);
        (json["width"], json["height"]) = (json!(64), json!(48));
    };
    vec![
        ("intrinsics", each(|_, json| json["intrinsics"] = matrix()), Focal([40.0, 41.0])),
        ("intrinsics", each(|_, json| json["intrinsics"] = matrix()), Principal([15.0, 11.0])),
        ("fx", each(set_all), Focal([40.0, 41.0])),
        ("fy", each(set_all), Focal([40.0, 41.0])),
        ("cx", each(set_all), Principal([15.0, 11.0])),
        ("cy", each(set_all), Principal([15.0, 11.0])),
        ("width", each(twice), Focal([40.0, 41.0])),
        ("height", each(twice), Principal([15.0, 11.0])),
        ("time", each(|i, json| json["time"] = json!(3.0 + 0.5 * i as f64)), Step(0.5)),
        ("exposureDuration", each(|_, json| json["exposureDuration"] = json!(0.01)), Unused),
        ("projectionMatrix", each(|_, json| json["projectionMatrix"] = json!([1.7, 0.0])), Unused),
        ("lensPosition", each(|_, json| json["lensPosition"] = json!(0.7)), Unused),
    ]
}

fn arkit_scenes() -> Vec<Feed> {
    let camera =
        |text: &'static str| put_text("lowres_wide_intrinsics/41048190_6845.000.pincam", text);
    let twice = || camera("64 48 80 82 30 22\n");
    let later = edit(|root| {
        for (folder, end) in [
            ("lowres_wide", "png"),
            ("lowres_depth", "png"),
            ("confidence", "png"),
            ("lowres_wide_intrinsics", "pincam"),
        ] {
            let file = |time: &str| root.join(format!("{folder}/41048190_{time}.{end}"));
            fs::rename(file("6845.100"), file("6845.130")).unwrap();
        }
    });
    vec![
        ("w", twice(), Focal([40.0, 41.0])),
        ("h", twice(), Principal([15.0, 11.0])),
        ("fx", camera("32 24 40 41 15 11\n"), Focal([40.0, 41.0])),
        ("fy", camera("32 24 40 41 15 11\n"), Focal([40.0, 41.0])),
        ("cx", camera("32 24 40 41 15 11\n"), Principal([15.0, 11.0])),
        ("cy", camera("32 24 40 41 15 11\n"), Principal([15.0, 11.0])),
        ("_SECONDS.png", later, Step(0.13)),
        (
            "lowres_wide.traj",
            columns("lowres_wide.traj", |_, cells| delay(&mut cells[0], 0.1)),
            LatePose,
        ),
    ]
}

fn scannet_pp() -> Vec<Feed> {
    let each = |change: fn(usize, &mut Value)| {
        edit(move |root| {
            edit_json(&root.join("iphone/pose_intrinsic_imu.json"), |json| {
                let entries = json.as_object_mut().unwrap().values_mut();
                entries.enumerate().for_each(|(i, entry)| change(i, entry));
            });
        })
    };
    vec![
        ("intrinsic", each(|_, entry| entry["intrinsic"] = matrix()), Focal([40.0, 41.0])),
        ("intrinsic", each(|_, entry| entry["intrinsic"] = matrix()), Principal([15.0, 11.0])),
        ("timestamp", each(|i, entry| entry["timestamp"] = json!(9.0 + 0.5 * i as f64)), Step(0.5)),
        ("width", each(|_, entry| entry["width"] = json!(32)), Unused),
        ("height", each(|_, entry| entry["height"] = json!(24)), Unused),
        ("k1", each(|_, entry| entry["k1"] = json!(0.1)), Unused),
        ("exposure_duration", each(|_, entry| entry["exposure_duration"] = json!(0.01)), Unused),
    ]
}
