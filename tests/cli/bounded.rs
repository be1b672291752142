//! Peak memory of the program on files made to exhaust it: at most [`MOST`] each, and a message or a count of
//! defects.
//!
//! `cargo test --release --test cli bounded -- --nocapture` prints the table of [the lab](../../docs/lab/files.md).
#![cfg(target_os = "linux")]

use super::runner::Scratch;
use crate::common::layouts::TestLayout;
use flate2::Compression;
use flate2::write::{GzEncoder, ZlibEncoder};
use serde_json::{Value, json};
use std::fs::{self, File};
use std::io::{BufWriter, Cursor, Write};
use std::process::Stdio;
use std::time::{Duration, Instant};
use zip::ZipWriter;
use zip::write::SimpleFileOptions;

/// Largest peak of resident memory, bytes.
const MOST: u64 = 256_000_000;
/// Longest time that the program takes.
const MOST_TIME: Duration = Duration::from_secs(60);
/// Size of what bombs unpack to, bytes: more than [`MOST`].
const BOMB: usize = 300 << 20;

fn packed_zeros<W: Write>(mut encoder: W, n: usize, finish: fn(W) -> Vec<u8>) -> Vec<u8> {
    let block = vec![0; 1 << 20];
    (0..n.div_ceil(block.len())).for_each(|_| encoder.write_all(&block).unwrap());
    finish(encoder)
}

fn zlib(n: usize) -> Vec<u8> {
    let encoder = ZlibEncoder::new(Vec::new(), Compression::default());
    packed_zeros(encoder, n, |encoder| encoder.finish().unwrap())
}

fn zip_of(name: &str, content: &[&[u8]]) -> Vec<u8> {
    let mut zip = ZipWriter::new(Cursor::new(Vec::new()));
    zip.start_file(name, SimpleFileOptions::default()).unwrap();
    content.iter().for_each(|part| zip.write_all(part).unwrap());
    zip.finish().unwrap().into_inner()
}

/// An archive of Record3D with this list of poses.
fn r3d(poses: &[u8]) -> Vec<u8> {
    zip_of("metadata", &[br#"{"K": [1], "poses": ["#, poses, b"0]}"])
}

fn png_chunk(kind: &[u8], content: &[u8]) -> Vec<u8> {
    let named = [kind, content].concat();
    let length = (content.len() as u32).to_be_bytes();
    [&length[..], &named, &crc32fast::hash(&named).to_be_bytes()].concat()
}

/// A grey PNG of 16 bits with this stated side and chunk before its pixels.
fn png(side: u32, chunk: &[u8]) -> Vec<u8> {
    png_of([side; 2], [16, 0], chunk, &zlib(1))
}

/// A black photograph.
fn photograph([width, height]: [u32; 2]) -> Vec<u8> {
    png_of([width, height], [8, 2], &[], &zlib((height * (1 + 3 * width)) as usize))
}

/// A grey JPEG of this size, in colours of half the size if they are subsampled, and turned by its EXIF data if
/// that is wanted. A progressive one has no details.
fn jpeg([width, height]: [u16; 2], is_progressive: bool, is_turned: bool) -> Vec<u8> {
    let segment = |marker: u8, content: &[&[u8]]| {
        let content = content.concat();
        [&[0xFF, marker][..], &(content.len() as u16 + 2).to_be_bytes(), &content].concat()
    };
    // One entry, of kind 274, 16 bits, one value: 6, a turn by a quarter.
    let exif = b"Exif\0\0MM\0\x2a\0\0\0\x08\0\x01\x01\x12\0\x03\0\0\0\x01\0\x06\0\0\0\0\0\0";
    let exif = if is_turned { segment(0xE1, &[exif]) } else { Vec::new() };
    let sides = [height.to_be_bytes(), width.to_be_bytes()].concat();
    let components = [3, 1, 0x22, 0, 2, 0x11, 0, 3, 0x11, 0];
    let frame = if is_progressive { 0xC2 } else { 0xC0 };
    // Each table has one code, of one bit: no difference, and the end of a block.
    let table = |kind: u8| segment(0xC4, &[&[kind, 1], &[0; 15], &[0]]);
    let last = if is_progressive { 0 } else { 63 };
    let scan = [3, 1, 0, 2, 0, 3, 0, 0, last, 0];
    let n_blocks = 6 * usize::from(width.div_ceil(16)) * usize::from(height.div_ceil(16));
    let n_bits = if is_progressive { n_blocks } else { 2 * n_blocks };
    let parts = [
        vec![0xFF, 0xD8],
        exif,
        segment(0xDB, &[&[0], &[1; 64]]),
        segment(frame, &[&[8], &sides, &components]),
        table(0),
        table(0x10),
        segment(0xDA, &[&scan]),
        vec![0; n_bits.div_ceil(8)],
        vec![0xFF, 0xD9],
    ];
    parts.concat()
}

/// A PNG of this size, bits per channel and kind of channels, with a chunk before its packed pixels.
fn png_of(size: [u32; 2], kind: [u8; 2], chunk: &[u8], packed: &[u8]) -> Vec<u8> {
    let header = [&size.map(u32::to_be_bytes).concat()[..], &kind, &[0; 3]].concat();
    let chunks = [png_chunk(b"IHDR", &header), chunk.to_vec(), png_chunk(b"IDAT", packed)];
    [&b"\x89PNG\r\n\x1a\n"[..], &chunks.concat(), &png_chunk(b"IEND", b"")].concat()
}

/// A megabyte that begins like an EXR of one channel and this side.
fn exr(side: i32) -> Vec<u8> {
    let window: Vec<u8> =
        [0, 0, side - 1, side - 1].into_iter().flat_map(i32::to_le_bytes).collect();
    let channel = b"R\0\x02\0\0\0\0\0\0\0\x01\0\0\0\x01\0\0\0\0";
    let attributes: [(&[u8], &[u8]); 8] = [
        (b"channels\0chlist\0", channel),
        (b"compression\0compression\0", &[3]),
        (b"dataWindow\0box2i\0", &window),
        (b"displayWindow\0box2i\0", &window),
        (b"lineOrder\0lineOrder\0", &[0]),
        (b"pixelAspectRatio\0float\0", &1f32.to_le_bytes()),
        (b"screenWindowCenter\0v2f\0", &[0; 8]),
        (b"screenWindowWidth\0float\0", &1f32.to_le_bytes()),
    ];
    let mut file = b"\x76\x2f\x31\x01\x02\0\0\0".to_vec();
    for (name, value) in attributes {
        file.extend([name, &(value.len() as u32).to_le_bytes(), value].concat());
    }
    file.resize(1_300_000, 0);
    file
}

/// A TIFF of 33 million zeros in double precision.
fn tiff() -> Vec<u8> {
    let (side, packed) = (5792u32, zlib(5792 * 5792 * 8));
    let tags = [
        [256, 4, side],
        [257, 4, side],
        [258, 3, 64],
        [259, 3, 8], // deflate
        [262, 3, 1],
        [273, 4, 134], // the pixels follow the tags
        [277, 3, 1],
        [278, 4, side],
        [279, 4, packed.len() as u32],
        [339, 3, 3], // floats
    ];
    let mut file = b"II*\0\x08\0\0\0\x0a\0".to_vec();
    for [tag, kind, value] in tags {
        file.extend([tag as u16, kind as u16].into_iter().flat_map(u16::to_le_bytes));
        file.extend([1, value].into_iter().flat_map(u32::to_le_bytes));
    }
    [&file[..], &[0; 4], &packed].concat()
}

fn npy(shape: &str) -> Vec<u8> {
    let header = format!("{{'descr': '<f4', 'fortran_order': False, 'shape': ({shape}), }}\n");
    let length = (header.len() as u32).to_le_bytes();
    [&b"\x93NUMPY\x02\0"[..], &length, header.as_bytes(), &[0; 4096]].concat()
}

/// A bag with one chunk, compressed by the named method, that unpacks to so many bytes.
fn bag(method: &str, packed: &[u8], unpacked: usize) -> Vec<u8> {
    let sizes = [0, 0, unpacked as u64].map(u64::to_le_bytes).concat();
    let method = [&(method.len() as u32).to_le_bytes()[..], method.as_bytes()].concat();
    let length = (packed.len() as u64).to_le_bytes();
    let chunk = [&sizes[..], &[0; 4], &method, &length, packed].concat();
    let length = (chunk.len() as u64).to_le_bytes();
    [&b"\x89MCAP0\r\n\x06"[..], &length, &chunk].concat()
}

/// Records of a bag with so many compressed images without pixels.
fn messages(n: usize) -> Vec<u8> {
    let text = |text: &str| [&(text.len() as u32).to_le_bytes()[..], text.as_bytes()].concat();
    let record = |opcode: u8, content: &[Vec<u8>]| {
        let content = content.concat();
        [&[opcode][..], &(content.len() as u64).to_le_bytes(), &content].concat()
    };
    let schema = [vec![1, 0], text("sensor_msgs/msg/CompressedImage")];
    let channel = [vec![1, 0, 1, 0], text("/rgb"), text("cdr")];
    // Channel, number and times; CDR with time, frame of reference and format.
    let times = vec![0; 8];
    let image =
        [vec![1, 0], vec![0; 20], vec![0, 1, 0, 0], times, text("w\0"), vec![0; 2], text("jpeg\0")];
    [record(3, &schema), record(4, &channel), record(5, &image).repeat(n)].concat()
}

/// A record of zeros, of a kind that no reader needs.
fn record() -> Vec<u8> {
    let mut record = vec![0; 9 + BOMB];
    record[0] = 0x80;
    record[1..9].copy_from_slice(&(BOMB as u64).to_le_bytes());
    record
}

/// A PLY that states so many splats and holds ten.
fn ply(n: u64) -> Vec<u8> {
    let names =
        "x y z f_dc_0 f_dc_1 f_dc_2 opacity scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3";
    ply_of(n, names.split(' ').map(|name| ("float", name)), 560)
}

/// A PLY of zeros with so many rows of properties, of which it holds so many bytes.
fn ply_of<'a>(
    n: u64,
    properties: impl Iterator<Item = (&'a str, &'a str)>,
    size: usize,
) -> Vec<u8> {
    let list: String = properties.map(|(kind, name)| format!("property {kind} {name}\n")).collect();
    let start = "ply\nformat binary_little_endian 1.0\nelement vertex";
    [format!("{start} {n}\n{list}end_header\n").as_bytes(), &vec![0; size]].concat()
}

/// An archive of so many empty members.
fn members(n: usize) -> Vec<u8> {
    let mut zip = ZipWriter::new(Cursor::new(Vec::new()));
    let stored = SimpleFileOptions::default().compression_method(zip::CompressionMethod::Stored);
    (0..n).for_each(|i| zip.start_file(format!("{i}"), stored).unwrap());
    zip.finish().unwrap().into_inner()
}

/// An archive of 400,000 members behind other bytes. Its end has a record of another length than usual; another end
/// follows, which contradicts itself.
fn members_between_two_ends() -> Vec<u8> {
    let mut archive = members(400_000);
    let end = archive.split_off(archive.len() - 22);
    let locator = archive.split_off(archive.len() - 20);
    // The record grows by a hundred bytes, which its length states.
    let start = archive.len() - 56;
    archive[start + 4..start + 12].copy_from_slice(&144u64.to_le_bytes());
    let junk = [&b"PK\x03\x04"[..], &[7; 996]].concat();
    let other = [&b"PK\x05\x06"[..], &[0; 4], &[1, 0, 2, 0], &[0xFF, 0, 0, 0], &[0; 6]].concat();
    [&junk, &archive, &vec![0; 100], &locator, &end, &other].map(Vec::as_slice).concat()
}

/// A scene of ten points whose buffer, a file beside it, has 8 GB.
fn points_of_8_gb(scratch: &Scratch) -> Vec<u8> {
    let n = 8u64 << 30;
    File::create(scratch.path("much.bin")).unwrap().set_len(n).unwrap();
    let document = json!({
        "asset": {"version": "2.0"},
        "buffers": [{"byteLength": n, "uri": "much.bin"}],
        "bufferViews": [{"buffer": 0, "byteLength": n, "byteStride": n / 16}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 10, "type": "VEC3"}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "mode": 0}]}],
        "nodes": [{"mesh": 0}],
    });
    document.to_string().into_bytes()
}

/// Twenty million splats of zeros, of 20 bytes each.
fn spz() -> Vec<u8> {
    let n = 20_000_000u32;
    let mut encoder = GzEncoder::new(Vec::new(), Compression::default());
    let header = [&b"NGSP\x02\0\0\0"[..], &n.to_le_bytes(), &[0, 12, 0, 0]].concat();
    encoder.write_all(&header).unwrap();
    packed_zeros(encoder, 20 * n as usize, |encoder| encoder.finish().unwrap())
}

/// Six million splats in 13 MB: their first bytes do not compress, and the rest are zeros, whole megabytes.
fn spz_of_noise() -> Vec<u8> {
    let n = 6_000_000u32;
    let mut encoder = GzEncoder::new(Vec::new(), Compression::default());
    let header = [&b"NGSP\x02\0\0\0"[..], &n.to_le_bytes(), &[0, 12, 0, 0]].concat();
    encoder.write_all(&header).unwrap();
    let mut state = 1u64;
    let noise = (0..13_336_704).map(|_| {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (state >> 56) as u8
    });
    let noise: Vec<u8> = noise.collect();
    encoder.write_all(&noise).unwrap();
    packed_zeros(encoder, 19 * n as usize - noise.len(), |encoder| encoder.finish().unwrap())
}

/// An archive that states this many splats, with an image of 268 million pixels.
fn sog(n: usize) -> Vec<u8> {
    let coded = json!({"codebook": vec![0.0; 256], "files": ["a"]});
    let meta = json!({
        "version": 2, "count": n, "scales": coded, "sh0": coded, "quats": {"files": ["a"]},
        "means": {"mins": [0, 0, 0], "maxs": [1, 1, 1], "files": ["a", "a"]},
    });
    // A lossless WebP whose header states 16384 pixels each way; the rest is not reached.
    let image = [&b"RIFF\x64\0\0\0WEBPVP8L\x58\0\0\0\x2f\xff\xff\xff\x0f"[..], &[0; 83]].concat();
    let mut zip = ZipWriter::new(Cursor::new(Vec::new()));
    for (name, content) in [("meta.json", meta.to_string().into_bytes()), ("a", image)] {
        zip.start_file(name, SimpleFileOptions::default()).unwrap();
        zip.write_all(&content).unwrap();
    }
    zip.finish().unwrap().into_inner()
}

/// A scene that shows a mesh of a thousand points twenty thousand times.
fn instances() -> Vec<u8> {
    let n = 20_000;
    let document = json!({
        "asset": {"version": "2.0"},
        "buffers": [{"byteLength": 12_000, "uri": format!("data:;base64,{}", "A".repeat(16_000))}],
        "bufferViews": [{"buffer": 0, "byteLength": 12_000}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 1000, "type": "VEC3"}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "mode": 0}]}],
        "nodes": vec![json!({"mesh": 0}); n],
        "scenes": [{"nodes": (0..n).collect::<Vec<_>>()}],
        "scene": 0,
    });
    document.to_string().into_bytes()
}

/// Runs the program; returns its peak of resident memory in bytes, its time, its exit code and its output.
fn measured(scratch: &Scratch, arguments: &str) -> (u64, Duration, Option<i32>, String) {
    let begun = Instant::now();
    let arguments: Vec<&str> = arguments.split(' ').collect();
    let shown = scratch.path("shown");
    let out = File::create(&shown).unwrap();
    let mut command = scratch.command(&arguments);
    command.stdout(out.try_clone().unwrap()).stderr(out).stdin(Stdio::null());
    let mut child = command.spawn().unwrap();
    let mut peak = 0;
    let status = loop {
        // The system's own record of the largest size so far, so that no short peak is missed but the last.
        let status = fs::read_to_string(format!("/proc/{}/status", child.id())).unwrap_or_default();
        let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
        let kib = line.and_then(|line| line.trim().trim_end_matches(" kB").parse::<u64>().ok());
        peak = peak.max(1024 * kib.unwrap_or(0));
        if let Some(status) = child.try_wait().unwrap() {
            break status;
        }
        std::thread::sleep(Duration::from_millis(1));
    };
    (peak, begun.elapsed(), status.code(), fs::read_to_string(shown).unwrap())
}

/// Runs a command on a hostile file, prints a row of the table, and returns what exceeds the bounds.
fn row(scratch: &Scratch, what: &str, command: &str, code: i32, part: &str) -> Option<String> {
    let (peak, time, found, shown) = measured(scratch, command);
    let (verb, _) = command.split_once(' ').unwrap();
    let seconds = time.as_secs_f64();
    eprintln!("| {what} | `{verb}` | {} MB | {seconds:.1} s | {found:?} |", peak / 1_000_000);
    let is_right = found == Some(code) && shown.contains(part) && !shown.contains("panicked");
    let start: String = shown.chars().take(1000).collect();
    (peak > MOST || time > MOST_TIME || !is_right)
        .then(|| format!("{what}: {command}: {peak} bytes, {seconds:.1} s, {found:?}, {start}"))
}

/// Writes single files and reads each.
fn single_files(scratch: &Scratch) -> Vec<Option<String>> {
    let unpacked = record();
    let spaces = vec![b' '; BOMB];
    let lz4 = {
        let mut encoder = lz4_flex::frame::FrameEncoder::new(Vec::new());
        encoder.write_all(&unpacked).unwrap();
        encoder.finish().unwrap()
    };
    let endless = [&b"\x89MCAP0\r\n\x05"[..], &[0xff; 7], &[0x7f; 100]].concat();
    let zstd = zstd::encode_all(&unpacked[..], 3).unwrap();
    let long = json!({
        "asset": {"version": "2.0"},
        "buffers": [{"byteLength": 1u64 << 63, "uri": "few.bin"}],
    });
    let long = long.to_string().into_bytes();
    fs::write(scratch.path("few.bin"), "few").unwrap();
    let bytes = ["x", "y", "z"].map(|name| ("uchar", name));
    let floats = ["x", "y", "z"].map(|name| ("float", name));
    let colors = ["red", "green", "blue"].map(|name| ("uchar", name));
    let images = messages(3_000_000);
    let packed = zstd::encode_all(&images[..], 3).unwrap();
    let files: [(&str, &str, Vec<u8>, &str); 25] = [
        (
            "JSON of 1.6 million maps",
            "a.r3d",
            r3d(&b"{\"\":{}},".repeat(1_600_000)),
            "MiB of values",
        ),
        ("JSON of 20 million maps", "b.r3d", r3d(&b"{},".repeat(20_000_000)), "MiB of values"),
        ("JSON of 7 million numbers", "c.r3d", r3d(&b"0,".repeat(7_000_000)), "MiB of values"),
        ("JSON of 4 million numbers", "d.r3d", r3d(&b"0,".repeat(4_000_000)), "at least one frame"),
        ("JSON of 7 million NaN", "e.r3d", r3d(&b"NaN,".repeat(7_000_000)), "MiB of values"),
        ("JSON that is not UTF-8", "f.r3d", r3d(&[b'\xff'].repeat(60 << 20)), "not UTF-8"),
        ("JSON of 30 million levels", "g.r3d", r3d(&[b'['].repeat(30 << 20)), "MiB of values"),
        ("archive of 300 MB of spaces", "h.r3d", r3d(&spaces), "at most 256 MiB"),
        (
            "bag that Zstandard unpacks",
            "a.mcap",
            bag("zstd", &zstd, unpacked.len()),
            "expected topics",
        ),
        ("bag that LZ4 unpacks", "b.mcap", bag("lz4", &lz4, unpacked.len()), "expected topics"),
        ("bag of a record of 2⁶³ bytes", "c.mcap", endless, "expected topics"),
        (
            "bag of 3 million images",
            "d.mcap",
            bag("zstd", &packed, images.len()),
            "at most 2097152 images and poses",
        ),
        ("PLY of 2⁶³ splats", "a.ply", ply(1 << 63), "rows of at least 56 bytes"),
        ("PLY of 20 million splats", "b.ply", ply(20_000_000), "rows of at least 56 bytes"),
        (
            "PLY of 20 million points of 3 bytes",
            "c.ply",
            ply_of(20_000_000, bytes.into_iter(), 60_000_000),
            "splats, found 20000000",
        ),
        ("SPZ of 20 million zeros", "a.spz", spz(), "at most 16 times"),
        ("SOG of 700,000 splats", "a.sog", sog(699_000), "a lossless WebP of 699000"),
        ("SOG of 20 million splats", "b.sog", sog(20_000_000), "at most 16 times"),
        ("glTF of 20 million instances", "a.gltf", instances(), "at most 4000000 splats"),
        ("glTF of a buffer of 2⁶³ bytes", "b.gltf", long, "found 3 bytes"),
        (
            "checkpoint of 2³² sections",
            "a.vbgs",
            [&b"\x89VBGS\r\n\x1a"[..], &[1, 0, 0, 0], &[0xff; 900]].concat(),
            "at most 64 sections",
        ),
        ("archive of 400,000 members", "i.r3d", members(400_000), "at most 131072 members"),
        ("archive of 130,000 members", "j.r3d", members(130_000), "none of that name"),
        (
            "archive of 400,000 members and two ends",
            "k.r3d",
            members_between_two_ends(),
            "at most 131072 members",
        ),
        ("levels of glTF", "c.gltf", b"{\"a\":".repeat(1 << 20), "64 nested levels"),
    ];
    let read = |(what, name, bytes, part): (&str, &str, Vec<u8>, &str), code| {
        fs::write(scratch.path(name), bytes).unwrap();
        row(scratch, what, &format!("info {name}"), code, part)
    };
    let sound: [(&str, &str, Vec<u8>, &str); 4] = [
        (
            "PLY of 4 million points with colours",
            "d.ply",
            ply_of(4_000_000, floats.into_iter().chain(colors), 60_000_000),
            "4000000 point-cloud",
        ),
        (
            "PLY of 5 million points without colours",
            "e.ply",
            ply_of(5_000_000, floats.into_iter(), 60_000_000),
            "5000000 point-cloud",
        ),
        ("SPZ of 13 MB, 6 million splats", "b.spz", spz_of_noise(), "6000000 splats"),
        ("glTF of ten points in 8 GB", "d.gltf", points_of_8_gb(scratch), "10 point-cloud"),
    ];
    let damaged = files.into_iter().map(|file| read(file, 1));
    damaged.chain(sound.into_iter().map(|file| read(file, 0))).collect()
}

/// Damages datasets and reads each.
fn datasets(scratch: &Scratch) -> Vec<Option<String>> {
    let profile = [&b"a\0\0"[..], &zlib(BOMB)].concat();
    let depths: [(&str, Vec<u8>, &str); 7] = [
        ("depth of 2³¹×2³¹ pixels", png(i32::MAX as u32, &[]), "skipped"),
        ("PNG with a profile of 300 MB", png(64, &png_chunk(b"iCCP", &profile)), "skipped"),
        ("EXR of 1.3 MB for 2³⁰×2³⁰ pixels", exr(1 << 30), "skipped"),
        ("EXR of 1.3 MB for 33 million pixels", exr(5791), "skipped"),
        ("TIFF of 33 million doubles", tiff(), "skipped"),
        ("NPY of 2³¹×2³¹", npy("2147483648, 2147483648"), "skipped"),
        ("NPZ of 300 MB", zip_of("depth.npy", &[&npy("8, 8"), &vec![0; BOMB]]), "skipped"),
    ];
    let mut found = Vec::new();
    for (i, (what, bytes, part)) in depths.into_iter().enumerate() {
        let name = format!("depth{i}");
        scratch.record(&name, TestLayout::Nerfstudio, 3, 0);
        let folder = fs::read_dir(scratch.path(&name).join("depths")).unwrap();
        let mut files: Vec<_> = folder.map(|file| file.unwrap().path()).collect();
        files.sort();
        fs::write(&files[1], bytes).unwrap();
        found.push(row(scratch, what, &format!("info {name}"), 0, "defect"));
        let train = format!("train {name} --out out{i} --preset paper --set components=200");
        found.push(row(scratch, what, &train, 0, part));
    }
    scratch.record("model", TestLayout::Colmap, 3, 0);
    for (what, file) in [("COLMAP of 2⁶³ cameras", "cameras"), ("COLMAP of 2⁶³ images", "images")]
    {
        let path = scratch.path(&format!("model/sparse/0/{file}.bin"));
        let sound = fs::read(&path).unwrap();
        fs::write(&path, [&(1u64 << 63).to_le_bytes()[..], &sound[8..]].concat()).unwrap();
        found.push(row(scratch, what, "info model", 1, "expected"));
        fs::write(&path, sound).unwrap();
    }
    scratch.record("list", TestLayout::Nerfstudio, 3, 0);
    File::create(scratch.path("list/transforms.json")).unwrap().set_len(1 << 30).unwrap();
    found.push(row(scratch, "list of frames of 1 GB", "info list", 1, "MiB"));
    found
}

/// Appends so many numbered lines to a list.
fn append_lines(scratch: &Scratch, list: &str, n: usize, line: impl Fn(f64) -> String) {
    let file = File::options().append(true).open(scratch.path(list)).unwrap();
    let mut file = BufWriter::new(file);
    for i in 1..=n {
        // Later than the recorded times.
        writeln!(file, "{}", line(2000.0 + i as f64 / 32.0)).unwrap();
    }
    file.flush().unwrap();
}

/// Adds lines to the lists of recordings.
fn lists(scratch: &Scratch) -> Vec<Option<String>> {
    let photograph = |time| format!("{time} rgb/none.png");
    let pose = |time| format!("{time} 0 0 0 0 0 0 1");
    let mut found = Vec::new();
    let mut read = |name: &str, what: &str, code, part: &str| {
        found.push(row(scratch, what, &format!("info {name}"), code, part));
    };
    for name in ["photographs", "missing", "poses", "known"] {
        scratch.record(name, TestLayout::Tum, 3, 0);
    }
    append_lines(scratch, "photographs/rgb.txt", 2_000_000, photograph);
    read("photographs", "list of 2 million photographs", 1, "at most 524288 lines");
    append_lines(scratch, "missing/rgb.txt", 119_000, photograph);
    read("missing", "list of 119,000 missing photographs", 0, "rgb/none.png");
    append_lines(scratch, "poses/groundtruth.txt", 2_600_000, pose);
    read("poses", "list of 2.6 million poses", 1, "at most 524288 lines");
    append_lines(scratch, "known/groundtruth.txt", 524_000, pose);
    read("known", "list of 524,000 poses", 0, "3 frames");
    fs::rename(scratch.path("known/groundtruth.txt"), scratch.path("known/poses.txt")).unwrap();
    read("known", "list of 524,000 poses by another name", 0, "3 frames");
    scratch.record("images", TestLayout::Colmap, 3, 0);
    let record = [&[0; 4][..], &[0; 56], &[0; 4], b"none.png\0", &[0; 8]].concat();
    let n = 750_000u64;
    let images = [&n.to_le_bytes()[..], &record.repeat(n as usize)].concat();
    fs::write(scratch.path("images/sparse/0/images.bin"), images).unwrap();
    read("images", "COLMAP of 750,000 images", 1, "at most 120000 images");
    many_frames(scratch, 78_000);
    read("frames", "list of 78,000 frames", 0, "78000 frames");
    found
}

/// Writes a recording whose list has so many frames, all with files: those of three frames under other names.
fn many_frames(scratch: &Scratch, n: usize) {
    scratch.record("frames", TestLayout::Nerfstudio, 3, 0);
    let path = scratch.path("frames/transforms.json");
    let mut list: Value = serde_json::from_slice(&fs::read(&path).unwrap()).unwrap();
    let frames = list["frames"].as_array().unwrap().clone();
    let many = (0..n).map(|i| {
        let mut frame = frames[i % frames.len()].clone();
        for key in ["file_path", "depth_file_path"] {
            let Some(name) = frame[key].as_str().map(str::to_owned) else { continue };
            let (folder, file) = name.rsplit_once('/').unwrap();
            let other = format!("{folder}/{i}_{file}");
            // A file has at most 65,000 names.
            let is_first = i < 2 * frames.len();
            let from = if is_first { name } else { format!("{folder}/{}_{file}", i % 6) };
            let [from, to] = [&from, &other].map(|name| scratch.path("frames").join(name));
            match is_first {
                true => drop(fs::copy(from, to).unwrap()),
                false => fs::hard_link(from, to).unwrap(),
            }
            frame[key] = other.into();
        }
        frame
    });
    list["frames"] = many.collect();
    fs::write(path, list.to_string()).unwrap();
}

/// Replaces the photographs of recordings with depth of 64×48 pixels by black and grey ones.
fn photographs(scratch: &Scratch) -> Vec<Option<String>> {
    let files: [(&str, Vec<u8>, usize, &str); 7] = [
        ("ten PNG of 121 megapixels", photograph([12704, 9528]), 10, "at most 208 MiB"),
        ("three PNG of 50 megapixels", photograph([8192, 6144]), 3, "photographs: 8192x6144"),
        ("three JPEG of 50 megapixels", jpeg([8192, 6144], false, false), 3, " 8192x6144"),
        ("three JPEG of 108 megapixels", jpeg([12000, 9000], false, false), 3, " 6000x4500"),
        ("three JPEG of 200 megapixels", jpeg([16320, 12240], false, false), 3, " 4080x3060"),
        (
            "three progressive JPEG of 50 megapixels",
            jpeg([8192, 6144], true, false),
            3,
            " 4096x3072",
        ),
        (
            "progressive JPEG of 200 megapixels",
            jpeg([16320, 12240], true, false),
            3,
            "at most 208 MiB",
        ),
    ];
    let mut found = Vec::new();
    for (i, (what, bytes, n, part)) in files.into_iter().enumerate() {
        let name = format!("photographs{i}");
        scratch.record(&name, TestLayout::Open3d, n, 0);
        for file in fs::read_dir(scratch.path(&name).join("color")).unwrap() {
            fs::write(file.unwrap().path(), &bytes).unwrap();
        }
        found.push(row(scratch, what, &format!("info {name}"), 0, part));
    }
    found.push(turned_photographs(scratch));
    found
}

/// Replaces the photographs of a recording by ones that their EXIF data turns to the shape which its list states.
fn turned_photographs(scratch: &Scratch) -> Option<String> {
    scratch.record("turned", TestLayout::Nerfstudio, 3, 0);
    let path = scratch.path("turned/transforms.json");
    let mut list: Value = serde_json::from_slice(&fs::read(&path).unwrap()).unwrap();
    let packed = jpeg([8192, 6144], false, true);
    for frame in list["frames"].as_array().unwrap() {
        let name = frame["file_path"].as_str().unwrap();
        fs::write(scratch.path("turned").join(name), &packed).unwrap();
    }
    let codes = [&[0][..], &[3, 232].repeat(48)].concat();
    let mut encoder = ZlibEncoder::new(Vec::new(), Compression::default());
    encoder.write_all(&codes.repeat(64)).unwrap();
    let depth = png_of([48, 64], [16, 0], &[], &encoder.finish().unwrap());
    for file in fs::read_dir(scratch.path("turned/depths")).unwrap() {
        fs::write(file.unwrap().path(), &depth).unwrap();
    }
    for (key, value) in
        [("w", 6144), ("h", 8192), ("fl_x", 5000), ("fl_y", 5000), ("cx", 3072), ("cy", 4096)]
    {
        list[key] = value.into();
    }
    fs::write(path, list.to_string()).unwrap();
    row(scratch, "three JPEG of 50 megapixels, turned", "info turned", 0, " 3072x4096")
}

/// Settings, calibration and camera path.
fn settings(scratch: &Scratch) -> Vec<Option<String>> {
    scratch.run("synth room --size 64x48 --frames 3 --eval-frames 0").succeeds();
    let deep = b"(".repeat(1 << 20);
    fs::write(scratch.path("deep.ron"), &deep).unwrap();
    fs::write(scratch.path("deep.json"), b"[".repeat(15 << 20)).unwrap();
    File::create(scratch.path("long.ron")).unwrap().set_len(1 << 30).unwrap();
    fs::write(scratch.path("one.ply"), ply(10)).unwrap();
    let train = "train room --out settings";
    vec![
        row(
            scratch,
            "settings of a million levels",
            &format!("{train} --config deep.ron"),
            1,
            "expected settings",
        ),
        row(
            scratch,
            "settings of 1 GB",
            &format!("{train} --config long.ron"),
            1,
            "limit of 64 MiB",
        ),
        row(
            scratch,
            "calibration of a million levels",
            &format!("{train} --calibration deep.ron"),
            1,
            "expected a calibration",
        ),
        row(
            scratch,
            "camera path of 15 million levels",
            "render one.ply --path deep.json -o film",
            1,
            "expected JSON",
        ),
    ]
}

#[test]
fn hostile_files_take_a_bounded_amount_of_memory() {
    let scratch = Scratch::empty();
    let found = [single_files, datasets, lists, photographs, settings].map(|read| read(&scratch));
    let found = found.concat();
    let wrong: Vec<String> = found.into_iter().flatten().collect();
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}
