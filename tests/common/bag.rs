//! Bags of ROS 2, written by the specifications of MCAP and CDR and the definitions of the messages.

use super::layouts::{gray16, put, rgba};
use glam::DMat4;
use std::collections::HashMap;
use std::io::Write;
use std::path::Path;
use tempfile::TempDir;
use vbgs_studio::dataset::synthetic::{SyntheticParams, SyntheticView, ViewPlan};
use vbgs_studio::math::camera::Intrinsics;
use vbgs_studio::math::image::Image;

pub const START: u64 = 1_700_000_000_000_000_000;
/// Time between frames, nanoseconds.
pub const STEP: u64 = 100_000_000;
pub const OPTICAL: &str = "camera_optical_frame";

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
pub enum Packing {
    #[default]
    Plain,
    Zstd,
    Lz4,
}

/// Message in CDR, aligned from the end of its four bytes of encoding.
pub struct Cdr {
    pub bytes: Vec<u8>,
    pub is_big: bool,
}

impl Cdr {
    pub fn value<const N: usize>(mut self, mut little: [u8; N]) -> Self {
        while !(self.bytes.len() - 4).is_multiple_of(N) {
            self.bytes.push(0);
        }
        if self.is_big {
            little.reverse();
        }
        self.bytes.extend(little);
        self
    }

    pub fn u32(self, value: u32) -> Self {
        self.value(value.to_le_bytes())
    }

    pub fn reals(self, values: &[f64]) -> Self {
        values.iter().fold(self, |cdr, value| cdr.value(value.to_le_bytes()))
    }

    pub fn blob(self, bytes: &[u8]) -> Self {
        let mut cdr = self.u32(bytes.len() as u32);
        cdr.bytes.extend(bytes);
        cdr
    }

    pub fn text(self, text: &str) -> Self {
        self.blob(&[text.as_bytes(), &[0]].concat())
    }

    pub fn header(self, time: u64, frame: &str) -> Self {
        let [seconds, rest] = [time / 1_000_000_000, time % 1_000_000_000];
        self.u32(seconds as u32).u32(rest as u32).text(frame)
    }

    pub fn pose(self, pose: DMat4) -> Self {
        let (_, q, p) = pose.to_scale_rotation_translation();
        self.reals(&p.to_array()).reals(&q.to_array())
    }
}

#[derive(Default)]
pub struct Bag {
    pub is_big: bool,
    pub packing: Packing,
    pub has_chunks: bool,
    pub encoding: Option<&'static str>,
    /// Topic, schema, time and content.
    pub messages: Vec<(String, &'static str, u64, Vec<u8>)>,
}

impl Bag {
    pub fn cdr(&self) -> Cdr {
        Cdr { bytes: vec![0, u8::from(!self.is_big), 0, 0], is_big: self.is_big }
    }

    pub fn add(&mut self, topic: &str, schema: &'static str, time: u64, cdr: Cdr) {
        self.messages.push((topic.to_owned(), schema, time, cdr.bytes));
    }

    pub fn compressed(&mut self, topic: &str, time: u64, frame: &str, format: &str, data: &[u8]) {
        let cdr = self.cdr().header(time, frame).text(format).blob(data);
        self.add(topic, "sensor_msgs/msg/CompressedImage", time, cdr);
    }

    pub fn raw(&mut self, topic: &str, time: u64, encoding: &str, size: [u32; 2], data: &[u8]) {
        let row = data.len() / size[1] as usize;
        // Rows end in padding.
        let padded: Vec<u8> = data.chunks(row).flat_map(|row| [row, &[0xEE; 8]].concat()).collect();
        let cdr = self.cdr().header(time, OPTICAL).u32(size[1]).u32(size[0]).text(encoding);
        let cdr = cdr.value([u8::from(self.is_big)]).u32(row as u32 + 8).blob(&padded);
        self.add(topic, "sensor_msgs/msg/Image", time, cdr);
    }

    pub fn camera(&mut self, topic: &str, frame: &str, k: &Intrinsics, model: &str, terms: &[f64]) {
        let cdr = self.cdr().header(START, frame).u32(k.height).u32(k.width).text(model);
        let cdr = cdr.u32(terms.len() as u32).reals(terms);
        let cdr = cdr.reals(&[k.fx, 0.0, k.cx, 0.0, k.fy, k.cy, 0.0, 0.0, 1.0]);
        let cdr = cdr.reals(&[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]);
        let p = [k.fx, 0.0, k.cx, 0.0, 0.0, k.fy, k.cy, 0.0, 0.0, 0.0, 1.0, 0.0];
        let cdr = cdr.reals(&p).u32(0).u32(0).u32(0).u32(0).u32(0).u32(0).value([0]);
        self.add(topic, "sensor_msgs/msg/CameraInfo", START, cdr);
    }

    pub fn transform(&mut self, topic: &str, time: u64, [parent, child]: [&str; 2], pose: DMat4) {
        let cdr = self.cdr().u32(1).header(time, parent).text(child).pose(pose);
        self.add(topic, "tf2_msgs/msg/TFMessage", time, cdr);
    }

    pub fn odometry(&mut self, time: u64, [parent, child]: [&str; 2], pose: DMat4) {
        let cdr = self.cdr().header(time, parent).text(child).pose(pose).reals(&[0.0; 78]);
        self.add("/odom", "nav_msgs/msg/Odometry", time, cdr);
    }

    /// Writes the file by the specification of MCAP.
    pub fn bytes(&self) -> Vec<u8> {
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

    pub fn write(&self) -> TempDir {
        let folder = tempfile::tempdir().unwrap();
        put(folder.path(), FILE, &self.bytes());
        folder
    }
}

/// Form of the depth images of a bag.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum DepthForm {
    Raw,
    /// Millimetres as PNG.
    Png,
    /// Steps of inverse depth as PNG.
    InversePng,
    /// Millimetres as run lengths.
    Rvl,
    /// Steps of inverse depth as run lengths.
    InverseRvl,
}

/// Settings of the inverse depth that ROS's publisher writes by default: for 10 m and steps of 100.
pub const QUANTISATION: [f32; 2] = [100.0 * 101.0, 1.0 - 100.0 * 101.0 / 10.0];

impl DepthForm {
    fn is_inverse(self) -> bool {
        matches!(self, Self::InversePng | Self::InverseRvl)
    }

    /// Returns the codes of lengths in metres; 0 for holes.
    fn codes(self, depth: &Image<f64>) -> Image<f64> {
        let [a, b] = QUANTISATION.map(f64::from);
        let code = |z: &f64| match self.is_inverse() {
            true => (a / z + b).floor(),
            false => (z * 1000.0).round(),
        };
        let code = |z: &f64| if *z > 0.0 { code(z).clamp(0.0, 65535.0) } else { 0.0 };
        Image::from_vec(depth.width, depth.height, depth.data.iter().map(code).collect())
    }
}

/// Packs codes of depth as the paper on RVL describes it (Wilson 2017), after width and height.
pub fn run_lengths(codes: &[u16], size: [u32; 2]) -> Vec<u8> {
    let mut nibbles = Vec::new();
    let mut put = |mut number: u32| loop {
        let is_last = number < 8;
        nibbles.push((number & 7) | if is_last { 0 } else { 8 });
        number >>= 3;
        if is_last {
            break;
        }
    };
    let (mut rest, mut previous) = (codes, 0);
    while !rest.is_empty() {
        let n_holes = rest.iter().take_while(|code| **code == 0).count();
        let n_codes = rest[n_holes..].iter().take_while(|code| **code != 0).count();
        let (run, behind) = rest.split_at(n_holes + n_codes);
        rest = behind;
        put(n_holes as u32);
        put(n_codes as u32);
        for code in &run[n_holes..] {
            let step = i32::from(*code) - previous;
            put(((step << 1) ^ (step >> 31)) as u32);
            previous = i32::from(*code);
        }
    }
    nibbles.resize(nibbles.len().next_multiple_of(8), 0);
    let words =
        nibbles.chunks(8).map(|word| word.iter().fold(0, |word, nibble| (word << 4) | nibble));
    size.into_iter().chain(words).flat_map(u32::to_le_bytes).collect()
}

impl Bag {
    /// Adds a depth image of lengths in metres, 0 for holes.
    pub fn depth(&mut self, topic: &str, time: u64, form: DepthForm, depth: &Image<f64>) {
        let size = [depth.width as u32, depth.height as u32];
        let image = form.codes(depth);
        let codes: Vec<u16> = image.data.iter().map(|code| *code as u16).collect();
        let packed = match form {
            DepthForm::Raw => {
                let order = if self.is_big { u16::to_be_bytes } else { u16::to_le_bytes };
                let data: Vec<u8> = codes.into_iter().flat_map(order).collect();
                return self.raw(topic, time, "16UC1", size, &data);
            }
            DepthForm::Png | DepthForm::InversePng => gray16(&image, 1.0),
            DepthForm::Rvl | DepthForm::InverseRvl => run_lengths(&codes, size),
        };
        self.packed_depth(topic, time, form, QUANTISATION, &packed);
    }

    /// Adds an image of the transport `compressedDepth`.
    pub fn packed_depth(
        &mut self,
        topic: &str,
        time: u64,
        form: DepthForm,
        settings: [f32; 2],
        packed: &[u8],
    ) {
        let kind = if form.is_inverse() { "32FC1" } else { "16UC1" };
        let is_png = matches!(form, DepthForm::Png | DepthForm::InversePng);
        let format = format!("{kind}; compressedDepth {}", if is_png { "png" } else { "rvl" });
        let settings = settings.map(f32::to_le_bytes).concat();
        self.compressed(topic, time, OPTICAL, &format, &[&[0; 4], &settings[..], packed].concat());
    }
}

/// Where a bag's poses and cameras are.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Rig {
    /// Transforms move one camera.
    Camera,
    /// Odometry moves a body with two cameras, one with a bent lens.
    Robot,
}

/// Adds a recording to a bag.
fn record_views(mut bag: Bag, rig: Rig, form: DepthForm, params: &SyntheticParams) -> Bag {
    let plan = ViewPlan::new(params).unwrap();
    let k = plan.photo_camera();
    let (color_frame, term) = match rig {
        Rig::Camera => (OPTICAL, 0.0),
        Rig::Robot => ("color_optical_frame", 0.01),
    };
    bag.camera("/color/camera_info", color_frame, &k, "plumb_bob", &[term; 5]);
    bag.camera("/depth/camera_info", OPTICAL, &k, "plumb_bob", &[0.0; 5]);
    if rig == Rig::Robot {
        bag.transform("/tf_static", START, ["base", OPTICAL], DMat4::IDENTITY);
        bag.transform("/tf_static", START, ["base", color_frame], DMat4::IDENTITY);
    }
    for frame in plan.recorded_frames() {
        let (time, pose) = ((1e9 * frame.time).round() as u64, frame.pose.to_opencv());
        match rig {
            Rig::Camera => bag.transform("/tf", time, ["map", OPTICAL], pose),
            Rig::Robot => bag.odometry(time, ["odom", "base"], pose),
        }
        let SyntheticView { color, depth_z } = frame.view();
        bag.compressed("/color/image/compressed", time, color_frame, "rgb8; png", &rgba(&color));
        bag.depth("/depth/image", time, form, &depth_z);
    }
    bag
}

/// Writes a bag without packing, so that mutations reach its messages. Its checksums are 0: not computed.
pub fn write(params: &SyntheticParams, out: &Path) {
    let bag = Bag { has_chunks: true, ..Bag::default() };
    put(out, FILE, &record_views(bag, Rig::Camera, DepthForm::Png, params).bytes());
}

/// Name of the file of [`write()`].
pub const FILE: &str = "room_0.mcap";

/// Returns bags that hold every packing, order of bytes, rig and form of depth.
pub fn of_all_forms(params: &SyntheticParams) -> Vec<Vec<u8>> {
    use DepthForm::{InversePng, InverseRvl, Png, Raw, Rvl};
    [
        (false, Packing::Plain, Rig::Camera, Rvl, false),
        (true, Packing::Plain, Rig::Robot, InversePng, false),
        (true, Packing::Plain, Rig::Camera, Raw, true),
        (true, Packing::Plain, Rig::Robot, InverseRvl, true),
        (true, Packing::Zstd, Rig::Camera, Png, false),
        (true, Packing::Lz4, Rig::Robot, Rvl, false),
    ]
    .into_iter()
    .map(|(has_chunks, packing, rig, form, is_big)| {
        let bag = Bag { is_big, packing, has_chunks, ..Bag::default() };
        record_views(bag, rig, form, params).bytes()
    })
    .collect()
}
