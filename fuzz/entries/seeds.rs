//! Valid inputs from which fuzzing starts. Tests replay them, because an entry that refuses all of them would
//! find nothing.

use super::folders::{IMAGE_FILES, MARK, POSE_FILES, SMALLEST, sound};
use super::training::{FIRST_OF_PAPER, steps_wider};
use crate::common::bag;
use crate::common::layouts::TestLayout;
use std::path::Path;
use vbgs_studio::dataset::synthetic::{SyntheticParams, dataset};
use vbgs_studio::export::checkpoint::to_bytes;
use vbgs_studio::export::{ModelFormat, SpzVersion, WriteOptions, write};
use vbgs_studio::model::splat::splats::Splat;
use vbgs_studio::pipeline::plan::Selection;
use vbgs_studio::pipeline::session::{Session, Step};
use vbgs_studio::pipeline::settings::method::MethodRequest;
use vbgs_studio::pipeline::settings::preset_file;
use vbgs_studio::pipeline::settings::scene::SceneOverrides;
use vbgs_studio::train::paper::config::{PaperConfig, PaperOverrides};
use vbgs_studio::train::setting::Preset;

/// Folders of every layout, each as one text.
pub fn layouts() -> Vec<Vec<u8>> {
    let text = |layout: &TestLayout| {
        let files = sound(*layout).iter();
        files.fold(Vec::new(), |text, (name, bytes)| {
            let name = name.to_str().expect("a plain name").as_bytes();
            [&text[..], MARK, name, b"\n", bytes].concat()
        })
    };
    TestLayout::ALL.iter().map(text).collect()
}

/// Every file of poses after the byte of its number.
pub fn poses() -> Vec<Vec<u8>> {
    numbered(&POSE_FILES)
}

/// Every image after the byte of its number.
pub fn images() -> Vec<Vec<u8>> {
    numbered(&IMAGE_FILES)
}

fn numbered(files: &[(TestLayout, &str)]) -> Vec<Vec<u8>> {
    let numbered = files.iter().zip(0..);
    numbered.map(|((layout, file), i)| [&[i][..], &file_of(*layout, file)].concat()).collect()
}

fn file_of(layout: TestLayout, file: &str) -> Vec<u8> {
    let (_, bytes) = sound(layout)
        .iter()
        .find(|(name, _)| *name == Path::new(file))
        .unwrap_or_else(|| panic!("{layout:?} has no {file}"));
    bytes.to_vec()
}

/// Depth file of Record3D.
pub fn exr() -> Vec<Vec<u8>> {
    vec![file_of(TestLayout::Record3d, "depth/0.exr")]
}

/// Arrays of all readable types, and a TIFF of 16 bits.
pub fn npy() -> Vec<Vec<u8>> {
    let array = |kind: &str, bytes: usize| {
        let header =
            format!("{{'descr': '{kind}', 'fortran_order': False, 'shape': (12, 16), }}\n");
        let magic = b"\x93NUMPY\x01\0";
        let length = (header.len() as u16).to_le_bytes();
        [&magic[..], &length, header.as_bytes(), &vec![60; 12 * 16 * bytes]].concat()
    };
    let mut tiff = b"II*\0\x08\0\0\0\x08\0".to_vec();
    let tags =
        [(256, 16), (257, 12), (258, 16), (259, 1), (262, 1), (273, 110), (278, 12), (279, 384)];
    for (tag, value) in tags {
        tiff.extend([u16::to_le_bytes(tag), 4u16.to_le_bytes()].concat());
        tiff.extend([1u32.to_le_bytes(), u32::to_le_bytes(value)].concat());
    }
    tiff.resize(110 + 384, 1);
    let kinds = [("<u2", 2), ("<f2", 2), ("<f4", 4), ("<f8", 8), ("<u4", 4), ("|u1", 1)];
    kinds.into_iter().map(|(kind, bytes)| array(kind, bytes)).chain([tiff]).collect()
}

/// Archives of a recording.
pub fn r3d() -> Vec<Vec<u8>> {
    vec![file_of(TestLayout::Record3dArchive, "recording.r3d")]
}

/// Bags of every packing, order of bytes and form of depth.
pub fn mcap() -> Vec<Vec<u8>> {
    bag::of_all_forms(&SMALLEST)
}

fn splats() -> [Splat; 2] {
    let first = Splat {
        mean: [0.5, -1.25, 2.0],
        opacity: 0.95,
        color: [1.0, 0.5, 0.0],
        scale: [0.2, 0.1, 0.05],
        rotation: [1.0, 0.0, 0.0, 0.0],
    };
    [first, Splat { mean: [-3.0, 0.0, 1.5], rotation: [0.6, 0.0, 0.8, 0.0], ..first }]
}

fn written(options: &WriteOptions) -> Vec<u8> {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("model");
    write(&path, &splats()[..], options).expect("a model");
    std::fs::read(path).expect("the model")
}

/// Splats with harmonics, points, and points in ASCII.
pub fn ply() -> Vec<Vec<u8>> {
    let padded = WriteOptions { sh3_padding: true, ..WriteOptions::new(ModelFormat::Ply) };
    let text = "ply\nformat ascii 1.0\nelement face 1\nproperty list uchar int i\nelement vertex 2\n\
                property float x\nproperty float y\nproperty float z\nproperty uchar red\n\
                property uchar green\nproperty uchar blue\nend_header\n3 0 1 2\n\
                1 2 3 4 5 6\n-1e-3 2 3 4 5 6\n";
    let points = WriteOptions::new(ModelFormat::PointCloudPly);
    vec![written(&padded), written(&points), text.into()]
}

/// Two splats of one chunk, with zero bits except in sizes.
pub fn compressed_ply() -> Vec<Vec<u8>> {
    let bounds = ["x", "y", "z", "scale_x", "scale_y", "scale_z"];
    let mut text = "ply\nformat binary_little_endian 1.0\nelement chunk 1\n".to_owned();
    for end in ["min", "max"] {
        bounds.iter().for_each(|name| text += &format!("property float {end}_{name}\n"));
    }
    text += "element vertex 2\n";
    for name in ["position", "rotation", "scale", "color"] {
        text += &format!("property uint packed_{name}\n");
    }
    let harmonics = "element sh 2\nproperty uchar f_rest_0\nproperty uchar f_rest_1\n";
    let body = [-1f32, -1.0, -1.0, -4.0, -4.0, -4.0, 1.0, 1.0, 1.0, -2.0, -2.0, -2.0];
    let mut bytes: Vec<u8> = body.iter().flat_map(|v| v.to_le_bytes()).collect();
    bytes.extend([0x55; 32]);
    let plain = [text.as_bytes(), b"end_header\n", &bytes].concat();
    let more = [text.as_bytes(), harmonics.as_bytes(), b"end_header\n", &bytes, &[128; 4]].concat();
    vec![plain, more]
}

/// A written file, plain and with the record of mirrored axes, and files of older versions without their gzip.
pub fn spz() -> Vec<Vec<u8>> {
    let legacy = |version: u8, row: usize| {
        let mut bytes = b"NGSP".to_vec();
        bytes.extend([version, 0, 0, 0, 2, 0, 0, 0, 1, 12, 0, 0]);
        bytes.resize(16 + 2 * row, 128);
        bytes
    };
    let older = [legacy(1, 6 + 10 + 9), legacy(2, 9 + 10 + 9), legacy(3, 9 + 11 + 9)];
    let spz_version = SpzVersion::V4;
    let plain = written(&WriteOptions { spz_version, ..WriteOptions::new(ModelFormat::Spz) });
    let record = [3, 0, 0xBE, 0xAD, 4, 0, 0, 0, 7, 0, 0, 0];
    let mut mirrored = [&plain[..32], &record, &plain[32..]].concat();
    (mirrored[14], mirrored[16]) = (3, 44);
    older.into_iter().chain([plain, mirrored]).collect()
}

/// A written file, whose images are stored as they are in the archive.
pub fn sog() -> Vec<Vec<u8>> {
    vec![written(&WriteOptions::new(ModelFormat::Sog))]
}

/// Two splats.
pub fn splat() -> Vec<Vec<u8>> {
    let mut bytes = Vec::new();
    for splat in splats() {
        let floats = splat.mean.iter().chain(&splat.scale);
        bytes.extend(floats.flat_map(|v| v.to_le_bytes()));
        bytes.extend([200, 100, 50, 255, 255, 128, 128, 128]);
    }
    vec![bytes]
}

/// A written file, and a glTF with an embedded buffer.
pub fn glb() -> Vec<Vec<u8>> {
    let glb = written(&WriteOptions::new(ModelFormat::Glb));
    let json_end = 20 + u32::from_le_bytes([glb[12], glb[13], glb[14], glb[15]]) as usize;
    let mut json: serde_json::Value =
        serde_json::from_slice(&glb[20..json_end]).expect("the JSON of a GLB");
    let length = json["buffers"][0]["byteLength"].as_u64().expect("a length") as usize;
    let base64 = "AAAA".repeat(length.div_ceil(3));
    json["buffers"][0]["uri"] = format!("data:;base64,{base64}").into();
    vec![glb, json.to_string().into()]
}

/// A room with few components, by each preset.
pub fn checkpoint() -> Vec<Vec<u8>> {
    let paper = PaperOverrides { components: Some(4), ..PaperOverrides::default() };
    let paper = PaperConfig::paper().with(&paper).expect("settings");
    let scene = SceneOverrides {
        budget: Some(vbgs_studio::train::scene::units::Budget::Components(8)),
        ..SceneOverrides::default()
    };
    let asked: [MethodRequest; 2] = [paper.into(), scene.into()];
    asked.into_iter().map(trained).collect()
}

fn trained(asked: MethodRequest) -> Vec<u8> {
    let params =
        SyntheticParams { width: 8, height: 8, n_train: 2, n_eval: 0, ..SyntheticParams::demo() };
    let room = dataset(&params).expect("a room");
    let mut session = Session::new(room.into(), asked, Selection::all_frames()).expect("a session");
    while !matches!(session.step().expect("a frame"), Step::Finished) {}
    to_bytes(&session.checkpoint().expect("a checkpoint"))
}

/// Files of both presets, and a calibration.
pub fn ron() -> Vec<Vec<u8>> {
    let calibration = "(color_camera: Some((focal: (522.0, 522.0), principal: (320.0, 238.5), \
                       offset: (0.02, 0.0, 0.0), rotation: (0.0, 0.0, 0.0))), depth_offset: 0.0, \
                       depth_scale: 1.0, exposure: [(frame: \"0\", gain: (1.0, 1.0, 1.0))])";
    let few = "(scale: \"2.5px\", refine: false, budget: \"5MB\", seed: 7)";
    let texts = [preset_file(Preset::Paper), preset_file(Preset::Scene), few, calibration];
    texts.into_iter().map(Into::into).collect()
}

/// Settings and frames of a plane, then every command once: for each kind of scene, and for each policy of
/// reassignment and precision.
pub fn training() -> Vec<Vec<u8>> {
    let commands = [
        0, 15, 11, 0, 1, 0, 0, 0, 0, 24, 1, 24, 3, 0, 90, 1, // a frame
        0, 15, 11, 0, 2, 0, 1, 0, 0, 24, 1, 24, 3, 0, 90, 1, // from the side
        4, 5, 6, 3, 7, 1, 3, 5,
    ];
    let scene = |kind: u8, flags: u8| {
        let config = [kind, 4, flags, 20, kind, 0];
        [&config[..], &commands].concat()
    };
    // Eight components with three candidates, of which an eighth may move, in a room of 12 units.
    let paper = |kind: u8, flags: u8, precision: u8| {
        let config = [FIRST_OF_PAPER + kind, 8, 3, flags, 1, 2, precision, 0, 0, 0, 16];
        [&config[..], &commands].concat()
    };
    let scenes = (0..3).flat_map(|kind| [scene(kind, 0), scene(kind, 0b1001_0111)]);
    // A budget far too small for a fine scale, with each set of features, fused with itself.
    let narrow = (0..3).flat_map(|kind| {
        let config = |flags| [kind, 1, flags, 2, kind, 0];
        [0, 0b1101_0111].map(|flags| [&config(flags)[..], &commands, &[6]].concat())
    });
    let narrow: Vec<Vec<u8>> = narrow.collect();
    assert!(narrow.iter().all(|seed| steps_wider(seed) > 0), "a scale that was fine enough");
    let papers = (0..5).flat_map(|kind| (0..3).map(move |precision| paper(kind, 0, precision)));
    scenes.chain(narrow).chain(papers).chain([paper(0, 2, 3), paper(3, 4, 1)]).collect()
}
