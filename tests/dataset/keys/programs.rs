//! Programs that reconstruct or record: RTAB-Map, COLMAP and ROS 2.

use super::*;
use crate::cases_camera::with_lens;
use crate::cases_colmap::Model;
use crate::cases_mcap::{Room, lengths};
use crate::common::bag::{self, Bag, DepthForm, OPTICAL, START, STEP};
use crate::common::layouts::TestLayout::*;
use std::iter::repeat_n;
use vbgs_studio::math::image::Image;

pub fn tables() -> Vec<Table> {
    let table = |heading, base, feeds| Table { heading, base, feeds };
    vec![
        table("rtab-map", || tiny(RtabMap), rtab_map()),
        table("colmap", || tiny(Colmap), colmap()),
        table("ros2-bag", || robot().write(), ros2_bag()),
    ]
}

/// The recording of a layout with OpenCV's terms `k1 k2 p1 p2 k3 k4 k5 k6` for its photographs.
pub fn bent(layout: TestLayout, terms: &[f64]) -> TempDir {
    let model = "rational_polynomial";
    let terms: Vec<f64> = terms.iter().copied().chain(repeat_n(0.0, 8 - terms.len())).collect();
    match layout {
        RtabMap => with_lens(model, &terms.iter().map(|v| format!("{v:e}, ")).collect::<String>()),
        Ros2Bag => {
            let mut bag = robot();
            let k = Room::new().k;
            with_cameras(&mut bag, &k, model, &terms);
            bag.write()
        }
        other => panic!("{other:?} states no lens of eight terms"),
    }
}

fn rtab_map() -> Vec<Feed> {
    const FILE: &str = "calib/1.yaml";
    let added = |text: &'static str| {
        edit(move |root| {
            let yaml = fs::read_to_string(root.join(FILE)).unwrap();
            fs::write(root.join(FILE), yaml + text).unwrap();
        })
    };
    let lens = |text: &'static str, model: &'static str| {
        edit(move |root| {
            let yaml = fs::read_to_string(root.join(FILE)).unwrap();
            let lens = format!(
                "distortion_model: {model}\ndistortion_coefficients:\n   rows: 1\n   data: [ {text} ]\n"
            );
            fs::write(root.join(FILE), yaml + &lens).unwrap();
        })
    };
    let camera = |data: &'static str, rest: &'static str| {
        edit(move |root| {
            let yaml = fs::read_to_string(root.join(FILE)).unwrap();
            let (head, _) = yaml.split_once("data:").unwrap();
            fs::write(root.join(FILE), format!("{head}data: [ {data} ]\n{rest}")).unwrap();
        })
    };
    const PROJECTION: &str =
        "projection_matrix:\n   data: [ 40., 0., 15., 0., 0., 41., 11., 0., 0., 0., 1., 0. ]\n";
    const TURN: &str = "rectification_matrix:\n   data: [ 0., 1., 0., 1., 0., 0., 0., 0., 1. ]\n";
    const MOUNT: &str =
        "local_transform:\n   data: [ 1., 0., 0., 0.1, 0., 1., 0., 0., 0., 0., 1., 0.2 ]\n";
    let whole = "40., 0., 15., 0., 41., 11., 0., 0., 1.";
    let eight = "0.3, 0.1, 0.01, 0., 0.02, 0.5, 0.05, 0.";
    vec![
        ("image_width", replace(FILE, "width: 32", "width: 33"), Checked("stated size 33x24")),
        ("image_height", replace(FILE, "height: 24", "height: 25"), Checked("stated size 32x25")),
        ("camera_matrix", camera(whole, ""), Focal([40.0, 41.0])),
        ("camera_matrix", camera(whole, ""), Principal([15.0, 11.0])),
        ("projection_matrix", added(PROJECTION), Unused),
        (
            "projection_matrix",
            camera("0., 40., 0., 15., 0., 41., 11., 0., 0.", PROJECTION),
            Focal([40.0, 41.0]),
        ),
        ("rectification_matrix", added(TURN), Unused),
        ("distortion_model", lens("0.1, 0., 0., 0.", "equidistant"), Refused("equidistant")),
        ("distortion_coefficients", lens("-0.15, 0., 0., 0.", "plumb_bob"), Lens(&[-0.15])),
        (
            "distortion_coefficients",
            lens(eight, "rational_polynomial"),
            Lens(&[0.3, 0.1, 0.01, 0.0, 0.02, 0.5, 0.05, 0.0]),
        ),
        ("local_transform", added(MOUNT), Shift([0.1, 0.0, 0.2])),
        (
            "timestamp",
            columns("poses.txt", |i, cells| {
                if i == 1 {
                    delay(&mut cells[0], 0.01);
                }
            }),
            Step(FRAME + 0.01),
        ),
        ("baseline", added("baseline: 0.05\n"), Unused),
        ("exposure_time", added("exposure_time: 0.01\n"), Unused),
    ]
}

/// Writes another model over the recording's.
fn model(extension: &'static str, change: impl Fn(&mut Model) + 'static) -> Edit {
    edit(move |root| {
        let mut model = Model::of_tiny();
        change(&mut model);
        fs::remove_dir_all(root.join("sparse")).unwrap();
        model.write(&root.join("sparse/0"), extension);
    })
}

fn colmap() -> Vec<Feed> {
    static EIGHT: [f64; 8] = [0.3, 0.1, 0.01, 0.0, 0.02, 0.5, 0.05, 0.0];
    // With one focal length or two, and lens terms.
    let lenses: [(&str, u32, bool, &'static [f64]); 4] = [
        ("SIMPLE_RADIAL", 2, true, &EIGHT[..1]),
        ("RADIAL", 3, true, &EIGHT[..2]),
        ("OPENCV", 4, false, &EIGHT[..4]),
        ("FULL_OPENCV", 6, false, &EIGHT),
    ];
    let fisheyes = [
        ("OPENCV_FISHEYE", 5, 8),
        ("FOV", 7, 5),
        ("SIMPLE_RADIAL_FISHEYE", 8, 4),
        ("RADIAL_FISHEYE", 9, 5),
        ("THIN_PRISM_FISHEYE", 10, 12),
        ("RAD_TAN_THIN_PRISM_FISHEYE", 11, 16),
    ];
    let mut feeds: Vec<Feed> = Vec::new();
    for extension in ["bin", "txt"] {
        let camera = |name, number, parameters: &'static [f64]| {
            model(extension, move |model| {
                (model.cameras[0].1, model.cameras[0].3) = ((name, number), parameters.to_vec());
            })
        };
        let twice = || {
            model(extension, |model| {
                (model.cameras[0].2, model.cameras[0].3) = ([64, 48], vec![80.0, 82.0, 30.0, 22.0]);
            })
        };
        let own = model(extension, |model| {
            let other = (2, model.cameras[0].1, [32, 24], vec![44.0, 45.0, 16.0, 12.0]);
            model.cameras.push(other);
            model.images[0].camera = 2;
        });
        feeds.extend([
            ("WIDTH", twice(), Focal([40.0, 41.0])),
            ("HEIGHT", twice(), Principal([15.0, 11.0])),
            ("CAMERA_ID", own, Focal([44.0, 45.0])),
            ("SIMPLE_PINHOLE", camera("SIMPLE_PINHOLE", 0, &[40.0, 15.0, 11.0]), Focal([40.0; 2])),
            ("PINHOLE", camera("PINHOLE", 1, &[40.0, 41.0, 15.0, 11.0]), Focal([40.0, 41.0])),
            ("PINHOLE", camera("PINHOLE", 1, &[40.0, 41.0, 15.0, 11.0]), Principal([15.0, 11.0])),
        ]);
        feeds.extend(lenses.map(|(name, number, is_square, terms)| {
            let change = model(extension, move |model| {
                let camera = &mut model.cameras[0];
                camera.1 = (name, number);
                if is_square {
                    camera.3.remove(1);
                }
                camera.3.extend(terms);
            });
            (name, change, Lens(terms))
        }));
        feeds.extend(fisheyes.map(|(name, number, n)| {
            let change = model(extension, move |model| {
                let camera = &mut model.cameras[0];
                camera.1 = (name, number);
                camera.3.resize(n, 0.01);
            });
            // Messages shorten foreign names.
            (name, change, Refused(&name[..name.len().min(24)]))
        }));
    }
    let estimates = put_text("sparse/0/depth_params.json", "{}");
    feeds.push(("depth_params.json", estimates, Refused("that a network estimated")));
    feeds
}

/// The bag to which changes are made.
fn robot() -> Bag {
    let room = Room::new();
    let mut bag = room.bag();
    room.transforms(&mut bag);
    bag
}

/// Writes the bag with a change.
fn recorded(change: impl Fn(&mut Bag) + 'static) -> Edit {
    edit(move |root| {
        let mut bag = robot();
        change(&mut bag);
        fs::write(root.join(bag::FILE), bag.bytes()).unwrap();
    })
}

const CAMERAS: [&str; 2] = ["/camera/color/camera_info", "/camera/depth/camera_info"];

fn with_cameras(bag: &mut Bag, k: &Intrinsics, model: &str, terms: &[f64]) {
    bag.messages.retain(|(_, schema, ..)| !schema.ends_with("CameraInfo"));
    CAMERAS.into_iter().for_each(|topic| bag.camera(topic, OPTICAL, k, model, terms));
}

/// Writes values into the messages of cameras, before this number of bytes from the end.
fn at_end<const N: usize>(bag: &mut Bag, before: usize, values: &[[u8; N]]) {
    let cameras = bag.messages.iter_mut().filter(|(_, schema, ..)| schema.ends_with("CameraInfo"));
    for (.., content) in cameras {
        let start = content.len() - before;
        content[start..start + values.as_flattened().len()].copy_from_slice(values.as_flattened());
    }
}

/// Bytes from fields of a camera's message to its end: region of interest, binning, `p`, `r` and `k`.
const ROI: usize = 17;
const BINNING: usize = ROI + 8;
const P: usize = BINNING + 96;
const R: usize = P + 72;
const K: usize = R + 72;

/// Replaces the depth images; `add` gets twice their lengths.
fn with_depth(bag: &mut Bag, add: impl Fn(&mut Bag, u64, &Image<f64>)) {
    let room = Room::new();
    bag.messages.retain(|(topic, ..)| !topic.contains("depth/image"));
    for (i, [_, depth]) in room.images.iter().enumerate() {
        let mut depth = lengths(depth);
        depth.data.iter_mut().for_each(|z| *z *= 2.0);
        add(bag, START + i as u64 * STEP, &depth);
    }
}

fn ros2_bag() -> Vec<Feed> {
    let reals = |numbers: [f64; 9]| numbers.map(f64::to_le_bytes);
    let k = move |numbers| recorded(move |bag| at_end(bag, K, &reals(numbers)));
    let whole = [40.0, 0.0, 15.0, 0.0, 41.0, 11.0, 0.0, 0.0, 1.0];
    let skewed = [40.0, 0.5, 15.0, 0.0, 41.0, 11.0, 0.0, 0.0, 1.0];
    let turned = [0.0, 1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0];
    let field = |before: usize| recorded(move |bag| at_end(bag, before, &[2u32.to_le_bytes()]));
    let lens = |model: &'static str| {
        recorded(move |bag| {
            with_cameras(bag, &Room::new().k, model, &[-0.15, 0.02, 0.01, -0.01, 0.0]);
        })
    };
    let twice = || {
        let k = Intrinsics { width: 64, height: 48, fx: 80.0, fy: 82.0, cx: 30.0, cy: 22.0 };
        recorded(move |bag| with_cameras(bag, &k, "plumb_bob", &[0.0; 5]))
    };
    let rectified = recorded(|bag| {
        bag.messages
            .iter_mut()
            .for_each(|(topic, ..)| *topic = topic.replace("image_raw", "image_rect"));
        let rows = [44.0f64, 0.0, 16.0, 0.0, 0.0, 45.0].map(f64::to_le_bytes);
        at_end(bag, P, &rows);
    });
    let changed = recorded(|bag| {
        bag.camera(CAMERAS[0], OPTICAL, &Room::new().k.scaled(2.0), "plumb_bob", &[0.0; 5]);
    });
    let later = recorded(|bag| {
        let second = |schema: &str, time: u64| schema.ends_with("Image") && time == START + STEP;
        let moved = bag.messages.iter_mut().filter(|(_, schema, time, _)| second(schema, *time));
        // Nanoseconds are behind the encoding and the seconds.
        moved.for_each(|(.., content)| {
            content[8..12].copy_from_slice(&120_000_000u32.to_le_bytes())
        });
    });
    let late = recorded(|bag| {
        bag.messages.retain(|(topic, ..)| !topic.starts_with("/tf"));
        for (i, pose) in Room::new().poses.iter().enumerate() {
            bag.transform("/tf", START + (i as u64 + 1) * STEP, ["map", OPTICAL], *pose);
        }
    });
    let extrinsics = recorded(|bag| {
        let cdr = bag.cdr().reals(&[0.0; 12]);
        let schema = "realsense2_camera_msgs/msg/Extrinsics";
        bag.add("/camera/extrinsics/depth_to_color", schema, START, cdr);
    });
    let floats = |size: [u32; 2]| {
        recorded(move |bag| {
            with_depth(bag, |bag, time, depth| {
                let bytes = depth.data.iter().flat_map(|z| (*z as f32).to_le_bytes());
                let bytes: Vec<u8> = bytes.collect();
                bag.raw("/camera/depth/image_raw", time, "32FC1", size, &bytes);
            });
        })
    };
    let inverse = || {
        recorded(|bag| {
            with_depth(bag, |bag, time, depth| {
                bag.depth("/camera/depth/image_raw", time, DepthForm::InversePng, depth);
            });
        })
    };
    vec![
        ("k", k(whole), Focal([40.0, 41.0])),
        ("k", k(whole), Principal([15.0, 11.0])),
        ("k", k(skewed), UnusedAs("k (skew) of camera_info")),
        ("d", lens("plumb_bob"), Lens(&[-0.15, 0.02, 0.01, -0.01])),
        ("distortion_model", lens("equidistant"), Refused("equidistant")),
        ("r", recorded(move |bag| at_end(bag, R, &reals(turned))), UnusedAs("r of camera_info")),
        ("p", rectified, Focal([44.0, 45.0])),
        (
            "p",
            recorded(|bag| at_end(bag, P - 24, &[(-2.0f64).to_le_bytes()])),
            UnusedAs("p (baseline) of camera_info"),
        ),
        ("binning_x", field(BINNING), Unused),
        ("binning_y", field(BINNING - 4), Unused),
        ("roi", field(ROI), Unused),
        ("width", twice(), Focal([40.0, 41.0])),
        ("height", twice(), Principal([15.0, 11.0])),
        ("width", floats([24, 32]), Checked("one shape")),
        ("height", floats([24, 32]), Checked("one shape")),
        ("camera_info", changed, UnusedAs("later cameras of /camera/color/camera_info")),
        ("header.stamp", later, Step(0.12)),
        ("header.stamp", late, LatePose),
        ("encoding", floats([32, 24]), Depth(2.0)),
        ("format", inverse(), Depth(2.0)),
        ("depth_param", inverse(), Depth(2.0)),
        ("Extrinsics", extrinsics, Unused),
    ]
}
