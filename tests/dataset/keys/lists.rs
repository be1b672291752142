//! Lists of frames in JSON, and sets whose cameras are in texts.

use super::*;
use crate::cases_camera::INFO;
use crate::common::layouts::TestLayout::*;
use vbgs_studio::dataset::synthetic::write::DepthBits;

pub fn tables() -> Vec<Table> {
    let table = |heading, base, feeds| Table { heading, base, feeds };
    vec![
        table("blender", || tiny(Blender(DepthBits::Sixteen)), blender()),
        table("blender", || tiny(Blender(DepthBits::Eight)), blender_of_8_bits()),
        table("nerfstudio", || tiny(Nerfstudio), nerfstudio()),
        table("replica", || tiny(Replica), replica()),
        table("open3d", || tiny(Open3d), open3d()),
        table("color-depth", images_and_poses, color_depth()),
        table("seven-scenes", || tiny(SevenScenes), seven_scenes()),
        table("scannet", || tiny(Scannet), scannet()),
        table("tum", || tiny(Tum), tum()),
    ]
}

/// Focal length in pixels of a side and its angle.
fn focal(side: f64, angle: f64) -> f64 {
    0.5 * side / (0.5 * angle).tan()
}

/// Keys of frame lists that no perspective camera has.
const OTHER_LENSES: [(&str, &str); 8] = [
    ("k4", "`k4` 0.1"),
    ("k5", "`k5` 0.1"),
    ("k6", "`k6` 0.1"),
    ("skew", "`skew` 0.1"),
    ("sk_x", "`sk_x` 0.1"),
    ("sk_y", "`sk_y` 0.1"),
    ("is_fisheye", "`is_fisheye` true"),
    ("fisheye", "`fisheye` true"),
];
const TERMS: [(&str, f64, &[f64]); 5] = [
    ("/k1", -0.15, &[-0.15]),
    ("/k2", 0.1, &[0.0, 0.1]),
    ("/k3", 0.1, &[0.0, 0.0, 0.0, 0.0, 0.1]),
    ("/p1", 0.03, &[0.0, 0.0, 0.03]),
    ("/p2", 0.03, &[0.0, 0.0, 0.0, 0.03]),
];

/// What lists of both layouts have in common.
fn list(file: &'static str) -> Vec<Feed> {
    let set = |values: &[(&'static str, Value)]| super::set(file, values);
    let mut feeds: Vec<Feed> = vec![
        ("fl_x", set(&[("/fl_x", json!(40.0)), ("/fl_y", json!(42.0))]), Focal([40.0, 42.0])),
        ("fl_y", set(&[("/fl_y", json!(41.0))]), Focal([SAME, 41.0])),
        ("cx", set(&[("/cx", json!(15.0))]), Principal([15.0, SAME])),
        ("cy", set(&[("/cy", json!(11.0))]), Principal([SAME, 11.0])),
        ("w", set(&[("/w", json!(33))]), Checked("stated size 33x24")),
        ("h", set(&[("/h", json!(25))]), Checked("stated size 32x25")),
        ("camera_model", set(&[("/camera_model", json!("FOV"))]), Refused("`camera_model` FOV")),
        ("scale", set(&[("/scale", json!(0.3))]), Unused),
        ("x_fov", set(&[("/x_fov", json!(60.0))]), Unused),
        ("fisheye_crop_radius", set(&[("/fisheye_crop_radius", json!(900))]), Unused),
        ("rolling_shutter", set(&[("/rolling_shutter", json!([0.0, 0.1, 0.0]))]), Unused),
        ("time", set(&[("/frames/0/time", json!(0.5))]), Unused),
    ];
    feeds.extend(OTHER_LENSES.map(|(key, words)| {
        let value = if key.ends_with("fisheye") { json!(true) } else { json!(0.1) };
        let change =
            move |root: &Path| edit_json(&root.join(file), |json| json[key] = value.clone());
        (key, edit(change), Refused(words))
    }));
    feeds.extend(TERMS.map(|(pointer, value, terms)| {
        (&pointer[1..], set(&[(pointer, json!(value))]), Lens(terms))
    }));
    feeds
}

fn blender() -> Vec<Feed> {
    const FILE: &str = "transforms_train.json";
    let set = |values: &[(&'static str, Value)]| super::set(FILE, values);
    let (wide, tall) = (focal(32.0, 1.0), focal(24.0, 0.8));
    let step = json!(0.0005);
    let mut feeds = list(FILE);
    feeds.extend([
        ("camera_angle_x", set(&[("/camera_angle_x", json!(1.0))]), Focal([wide, wide])),
        ("camera_angle_y", set(&[("/camera_angle_y", json!(0.8))]), Focal([SAME, tall])),
        ("integer_depth_scale", set(&[("/integer_depth_scale", step.clone())]), Depth(2.0)),
        (
            "depth_scale",
            set(&[("/integer_depth_scale", Value::Null), ("/depth_scale", step)]),
            Depth(2.0),
        ),
        ("applied_scale", set(&[("/applied_scale", json!(2.0))]), Unused),
        ("depth_unit_scale_factor", set(&[("/depth_unit_scale_factor", json!(2.0))]), Unused),
        ("distortion_params", set(&[("/distortion_params", json!([0.1, 0.0, 0.0]))]), Unused),
        ("timestamp", set(&[("/frames/0/timestamp", json!(3.5))]), Unused),
        ("cx", set(&[("/frames/1/cx", json!(15.0))]), Unused),
        ("cy", set(&[("/frames/1/cy", json!(11.0))]), Unused),
        ("fl_y", set(&[("/frames/1/fl_y", json!(40.0))]), Unused),
        ("h", set(&[("/frames/1/h", json!(24))]), Unused),
    ]);
    feeds
}

fn blender_of_8_bits() -> Vec<Feed> {
    let set = |key| super::set("transforms_train.json", &[(key, json!(0.001))]);
    vec![
        ("integer_depth_scale", set("/integer_depth_scale"), Unused),
        ("depth_scale", set("/depth_scale"), Unused),
    ]
}

fn nerfstudio() -> Vec<Feed> {
    const FILE: &str = "transforms.json";
    let set = |values: &[(&'static str, Value)]| super::set(FILE, values);
    let angles = [
        ("/fl_x", Value::Null),
        ("/fl_y", Value::Null),
        ("/camera_angle_x", json!(1.0)),
        ("/camera_angle_y", json!(0.8)),
    ];
    let (wide, tall) = (focal(32.0, 1.0), focal(24.0, 0.8));
    let terms = ("/distortion_params", json!([-0.15, 0.0, 0.0, 0.0, 0.0, 0.0]));
    let other = json!([0.1, 0.0, 0.0, 0.1, 0.0, 0.0]);
    let (unit, other_unit) = ("/depth_unit_scale_factor", "/integer_depth_scale");
    let times = [("/frames/0/timestamp", json!(3.5)), ("/frames/1/timestamp", json!(5.0))];
    let of_frame = |values: &[(&'static str, Value)]| set(values);
    let mut feeds = list(FILE);
    feeds.extend([
        ("camera_angle_x", set(&angles[..3]), Focal([wide, wide])),
        ("camera_angle_y", set(&angles), Focal([wide, tall])),
        ("fl_x", of_frame(&[("/frames/0/fl_x", json!(44.0))]), Focal([44.0, SAME])),
        ("fl_y", of_frame(&[("/frames/0/fl_y", json!(44.0))]), Focal([SAME, 44.0])),
        ("cx", of_frame(&[("/frames/0/cx", json!(14.0))]), Principal([14.0, SAME])),
        ("k1", of_frame(&[("/frames/0/k1", json!(-0.15))]), Lens(&[-0.15])),
        ("distortion_params", set(std::slice::from_ref(&terms)), Lens(&[-0.15])),
        ("distortion_params", set(&[(terms.0, other)]), Refused("`distortion_params` of k1")),
        ("k1", set(&[terms, ("/k1", json!(0.1))]), Unused),
        ("depth_unit_scale_factor", set(&[(unit, json!(0.002))]), Depth(2.0)),
        (
            "integer_depth_scale",
            set(&[(unit, Value::Null), (other_unit, json!(0.002))]),
            Depth(2.0),
        ),
        ("integer_depth_scale", set(&[(other_unit, json!(0.002))]), Unused),
        ("applied_scale", set(&[("/applied_scale", json!(2.0))]), Depth(2.0)),
        ("timestamp", set(&times), Step(1.5)),
        ("timestamp", set(&[("/timestamp", json!(1.5))]), Unused),
        ("lensPosition", set(&[("/frames/2/lensPosition", json!(0.7))]), Unused),
    ]);
    feeds
}

fn replica() -> Vec<Feed> {
    let set = |pointer, value| super::set("cam_params.json", &[(pointer, value)]);
    vec![
        ("fx", set("/camera/fx", json!(40.0)), Focal([40.0, SAME])),
        ("fy", set("/camera/fy", json!(41.0)), Focal([SAME, 41.0])),
        ("cx", set("/camera/cx", json!(15.0)), Principal([15.0, SAME])),
        ("cy", set("/camera/cy", json!(11.0)), Principal([SAME, 11.0])),
        ("w", set("/camera/w", json!(33)), Checked("stated size 33x24")),
        ("h", set("/camera/h", json!(25)), Checked("stated size 32x25")),
        ("scale", set("/camera/scale", json!(2.0 * 6553.5)), Depth(0.5)),
        ("k1", set("/camera/k1", json!(0.1)), Unused),
        ("crop_edge", set("/camera/crop_edge", json!(8)), Unused),
        ("png_depth_scale", set("/png_depth_scale", json!(1000.0)), Unused),
    ]
}

/// Keys of the camera's file of Open3D.
fn camera_json() -> Vec<Feed> {
    let columns = json!([40.0, 0.0, 0.0, 0.0, 41.0, 0.0, 15.0, 11.0, 1.0]);
    let skewed = json!([40.0, 0.0, 0.0, 0.5, 41.0, 0.0, 15.0, 11.0, 1.0]);
    let set = |pointer, value| super::set("camera.json", &[(pointer, value)]);
    vec![
        ("intrinsic_matrix", set("/intrinsic_matrix", columns), Focal([40.0, 41.0])),
        ("intrinsic_matrix", set("/intrinsic_matrix", matrix()), Principal([15.0, 11.0])),
        ("intrinsic_matrix", set("/intrinsic_matrix", skewed), Refused("of nine numbers")),
        ("width", set("/width", json!(33)), Checked("stated size 33x24")),
        ("height", set("/height", json!(25)), Checked("stated size 32x25")),
        ("depth_scale", set("/depth_scale", json!(1000.0)), Unused),
        ("color_fps", set("/color_fps", json!(30)), Unused),
        ("lensPosition", set("/lensPosition", json!(0.7)), Unused),
        ("rolling_shutter_time", set("/rolling_shutter_time", json!(0.02)), Unused),
        ("color_extrinsics", set("/color_extrinsics", json!([[1.0, 0.0], [0.0, 1.0]])), Unused),
    ]
}

fn open3d() -> Vec<Feed> {
    let mut feeds = camera_json();
    let text = put_text("camera-intrinsics.txt", MATRIX);
    feeds.push(("camera-intrinsics.txt", text, UnusedAs("camera-intrinsics.txt: its camera")));
    feeds.push((
        "camera-intrinsics.txt",
        edit(|root| {
            fs::remove_file(root.join("camera.json")).unwrap();
            fs::write(root.join("camera-intrinsics.txt"), MATRIX).unwrap();
        }),
        Focal([40.0, 41.0]),
    ));
    feeds
}

const POSES: &str = "poses.csv";

/// Images with a table of poses.
fn images_and_poses() -> TempDir {
    let folder = tiny(Open3d);
    let mut table = "timestamp,x,y,z,qx,qy,qz,qw\n".to_owned();
    for (i, frame) in frames(&open_plain(folder.path()).unwrap()).iter().enumerate() {
        let (_, q, t) = frame.camera.pose.to_opencv().to_scale_rotation_translation();
        table += &format!(
            "{:e},{},{},{},{},{},{},{}\n",
            0.5 + i as f64,
            t.x,
            t.y,
            t.z,
            q.x,
            q.y,
            q.z,
            q.w
        );
    }
    fs::remove_file(folder.path().join("trajectory.log")).unwrap();
    fs::write(folder.path().join(POSES), table).unwrap();
    folder
}

/// Replaces the table of poses by JSON whose objects have further keys.
fn poses_in_json(further: fn(usize) -> Value) -> Edit {
    edit(move |root| {
        let dataset = open_plain(root).unwrap();
        let pose = |(i, frame): (usize, &FrameEntry)| {
            let mut pose = further(i);
            pose["matrix"] = json!(frame.camera.pose.to_opencv().transpose().to_cols_array_2d());
            pose
        };
        let list: Vec<Value> = frames(&dataset).iter().enumerate().map(pose).collect();
        fs::remove_file(root.join(POSES)).unwrap();
        fs::write(root.join("poses.json"), json!(list).to_string()).unwrap();
    })
}

fn color_depth() -> Vec<Feed> {
    let column = |name: &'static str| {
        edit(move |root| {
            let text = fs::read_to_string(root.join(POSES)).unwrap();
            let lines = text.lines().enumerate().map(|(i, line)| match i {
                0 => format!("{line},{name}\n"),
                _ => format!("{line},41\n"),
            });
            fs::write(root.join(POSES), lines.collect::<String>()).unwrap();
        })
    };
    let mut feeds = camera_json();
    feeds.extend([
        ("timestamp", replace(POSES, "1.5e0,", "2.25e0,"), Step(1.75)),
        ("timestamp", poses_in_json(|i| json!({ "timestamp": 0.25 * i as f64 + 0.1 })), Step(0.25)),
        ("fx", column("fx"), Unused),
        ("fy", column("fy"), Unused),
        ("cx", column("cx"), Unused),
        ("cy", column("cy"), Unused),
        ("lens_position", column("lens_position"), Unused),
        ("intrinsics", poses_in_json(|_| json!({ "intrinsics": [40, 41, 15, 11] })), Unused),
        ("fx", poses_in_json(|_| json!({ "fx": 40.0 })), Unused),
        ("width", poses_in_json(|_| json!({ "width": 32 })), Unused),
        ("height", poses_in_json(|_| json!({ "height": 24 })), Unused),
    ]);
    feeds
}

/// Replaces the camera by `info.txt`, with a change.
fn info(from: &'static str, to: &'static str) -> Edit {
    edit(move |root| {
        let text = INFO.replace(" 16.5", " 33").replace(" 12.5", " 25");
        assert!(text.contains(from), "{from}");
        fs::remove_file(root.join("camera-intrinsics.txt")).unwrap();
        fs::write(root.join("info.txt"), text.replacen(from, to, 1)).unwrap();
    })
}

fn seven_scenes() -> Vec<Feed> {
    const CAMERA: &str = "camera-intrinsics.txt";
    vec![
        (CAMERA, put_text(CAMERA, MATRIX), Focal([40.0, 41.0])),
        (CAMERA, put_text(CAMERA, MATRIX), Principal([15.0, 11.0])),
        (CAMERA, put_text(CAMERA, "40 41 15 11\n"), Focal([40.0, 41.0])),
        (CAMERA, put_text(CAMERA, SKEWED), Refused("without skew")),
        (CAMERA, put_text(CAMERA, OFFSET), Refused("a matrix with a translation")),
        ("m_colorWidth", info("colorWidth = 64", "colorWidth = 40"), Checked("one shape")),
        ("m_colorHeight", info("colorHeight = 48", "colorHeight = 40"), Checked("one shape")),
        ("m_depthWidth", info("depthWidth = 32", "depthWidth = 40"), Checked("one shape")),
        ("m_depthHeight", info("depthHeight = 24", "depthHeight = 40"), Checked("one shape")),
        ("m_depthShift", info("", ""), Depth(2.0)),
        ("m_calibrationColorIntrinsic", info("", ""), Focal([25.0, 25.5])),
        ("m_calibrationDepthIntrinsic", info("", ""), DepthFocal([40.0, 41.0])),
        (
            "m_calibrationColorExtrinsic",
            info("ColorExtrinsic = 1 0 0 0", "ColorExtrinsic = 1 0 0 1"),
            UnusedAs("the transform between colour and depth camera"),
        ),
        (
            "m_calibrationDepthExtrinsic",
            info("DepthExtrinsic = 1 0 0 0", "DepthExtrinsic = 1 0 0 1"),
            UnusedAs("the transform between colour and depth camera"),
        ),
        (
            "m_depthDistortion",
            info("m_sensorName", "m_depthDistortion = 0.1\nm_sensorName"),
            Unused,
        ),
        ("m_colorFps", info("m_sensorName", "m_colorFps = 30\nm_sensorName"), Unused),
    ]
}

fn scannet() -> Vec<Feed> {
    vec![
        (
            "intrinsic_color.txt",
            put_text("intrinsic/intrinsic_color.txt", MATRIX),
            Focal([40.0, 41.0]),
        ),
        (
            "intrinsic_depth.txt",
            put_text("intrinsic/intrinsic_depth.txt", "20 0 8\n0 21 6\n0 0 1\n"),
            DepthFocal([20.0, 21.0]),
        ),
        (
            "intrinsic_color.txt",
            put_text("intrinsic/intrinsic_color.txt", SKEWED),
            Refused("without skew"),
        ),
        (
            "extrinsic_color.txt",
            put_text("intrinsic/extrinsic_color.txt", OFFSET),
            UnusedAs("extrinsic_color.txt: the transform is not used"),
        ),
        (
            "extrinsic_depth.txt",
            put_text("intrinsic/extrinsic_depth.txt", OFFSET),
            UnusedAs("extrinsic_depth.txt: the transform is not used"),
        ),
    ]
}

fn tum() -> Vec<Feed> {
    const CAMERA: &str = "camera-intrinsics.txt";
    let json = |root: &Path| {
        let camera = json!({ "width": 32, "height": 24, "intrinsic_matrix": matrix() });
        fs::write(root.join("camera.json"), camera.to_string()).unwrap();
    };
    let only_json = move |root: &Path| {
        fs::remove_file(root.join(CAMERA)).unwrap();
        json(root);
    };
    let second = |i: usize, cells: &mut Vec<String>| {
        if i == 1 {
            delay(&mut cells[0], 0.01);
        }
    };
    vec![
        (CAMERA, put_text(CAMERA, "40 41 15 11\n"), Focal([40.0, 41.0])),
        (CAMERA, put_text(CAMERA, MATRIX), Principal([15.0, 11.0])),
        (CAMERA, put_text(CAMERA, SKEWED), Refused("without skew")),
        (CAMERA, edit(json), UnusedAs("camera-intrinsics.txt: its camera is not used")),
        ("intrinsic_matrix", edit(only_json), Focal([40.0, 41.0])),
        ("depth.txt", columns("depth.txt", second), Step(FRAME + 0.01)),
        (
            "rgb.txt",
            columns("rgb.txt", |_, cells| delay(&mut cells[0], 0.01)),
            PhotographBetween(0.3),
        ),
        (
            "groundtruth.txt",
            columns("groundtruth.txt", |_, cells| delay(&mut cells[0], FRAME)),
            LatePose,
        ),
    ]
}
