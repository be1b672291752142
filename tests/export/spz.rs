//! Reading SPZ: every version, and invalid files.

use super::assert_fails;
use flate2::{Compression, write::GzEncoder};
use std::io::Write;

/// File of version 1 to 3 before gzip; every column byte is 128.
pub fn legacy(version: u32, n: u32, degree: u8) -> Vec<u8> {
    let coefficients = (usize::from(degree) + 1).pow(2) - 1;
    let position = if version == 1 { 6 } else { 9 };
    let rotation = if version < 3 { 3 } else { 4 };
    let row = position + 1 + 3 + 3 + rotation + 3 * coefficients;
    let mut bytes = b"NGSP".to_vec();
    bytes.extend(version.to_le_bytes());
    bytes.extend(n.to_le_bytes());
    bytes.extend([degree, 12, 0, 0]);
    bytes.resize(16 + n as usize * row, 128);
    bytes
}

pub fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::best());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

/// File of version 4 with each column compressed and its true lengths.
pub fn version_4(n: u32, degree: u8, columns: &[Vec<u8>]) -> Vec<u8> {
    let mut bytes = b"NGSP\x04\0\0\0".to_vec();
    bytes.extend(n.to_le_bytes());
    bytes.extend([degree, 12, 0, columns.len() as u8, 32, 0, 0, 0]);
    bytes.resize(32, 0);
    let packed: Vec<Vec<u8>> =
        columns.iter().map(|c| zstd::encode_all(&c[..], 3).unwrap()).collect();
    for (packed, column) in packed.iter().zip(columns) {
        bytes.extend((packed.len() as u64).to_le_bytes());
        bytes.extend((column.len() as u64).to_le_bytes());
    }
    bytes.extend(packed.concat());
    bytes
}

pub fn zeros(n: usize) -> Vec<Vec<u8>> {
    [9, 1, 3, 3, 4].map(|width| vec![0; n * width]).to_vec()
}

#[test]
fn half_precision_positions_of_version_1_are_read() {
    let mut file = legacy(1, 2, 0);
    // 1, −2 and ⅓ in half precision, rotated to z-up.
    file[16..22].copy_from_slice(&[0x00, 0x3C, 0x00, 0xC0, 0x55, 0x35]);
    // The x of the second splat is NaN.
    file[22..24].copy_from_slice(&[0x01, 0x7E]);
    let model = super::read_bytes(&gzip(&file)).unwrap();
    assert_eq!((model.splats.len(), model.skipped), (1, 1));
    assert_eq!(model.splats[0].mean, [1.0, -0.333_251_95, -2.0]);
    assert!((model.splats[0].scale[0] - (-2.0f32).exp()).abs() < 1e-6);
}

#[test]
fn damaged_files_of_old_versions_are_refused() {
    let good = gzip(&legacy(2, 5, 1));
    let with = |at: usize, byte: u8| {
        let mut bytes = legacy(2, 5, 1);
        bytes[at] = byte;
        gzip(&bytes)
    };
    let longer = [legacy(2, 5, 1), vec![0]].concat();
    let shorter = legacy(3, 5, 0);
    let cases: [(&str, Vec<u8>, &str); 10] = [
        ("cut", good[..good.len() - 9].to_vec(), "SPZ"),
        ("checksum", [&good[..good.len() - 8], &[0; 8]].concat(), "SPZ: expected an end after"),
        ("magic", with(0, b'X'), "SPZ header: expected \"NGSP\" at its start"),
        ("version", with(4, 9), "SPZ header: expected version 1 to 4, found 9; save the file as"),
        ("inside", with(4, 4), "SPZ header: expected version 1 to 3 inside gzip, found version 4"),
        ("degree", with(12, 5), "SPZ header: expected harmonics of degree 0 to 4, found 5"),
        ("bits", with(13, 99), "at most 24 fraction bits, found 99"),
        ("extensions", with(14, 2), "unsupported: extensions in SPZ version 2"),
        ("longer", gzip(&longer), "expected an end after the last column, found more bytes"),
        ("short", gzip(&shorter[..60]), "SPZ positions: expected 45 bytes, found 44"),
    ];
    for (name, bytes, message) in cases {
        assert_fails(name, &bytes, &[message]);
    }
    assert_fails(
        "count",
        &with(10, 0xFF),
        &["at most 16 times the file's size, found 16711685 splats"],
    );
    assert_fails("absurd", &with(11, 0xFF), &["at most 20000000 splats, found 4278190085"]);
    assert_fails("empty", &gzip(&legacy(2, 0, 0)), &["at least one finite row"]);
}

#[test]
fn damaged_files_of_version_4_are_refused() {
    let good = version_4(3, 0, &zeros(3));
    let with = |at: usize, bytes: &[u8]| {
        let mut file = good.clone();
        file[at..at + bytes.len()].copy_from_slice(bytes);
        file
    };
    let cases: [(&str, Vec<u8>, &str); 9] = [
        ("header", good[..20].to_vec(), "SPZ header"),
        ("table", good[..50].to_vec(), "expected a table of 80 bytes after byte 32, found byte 32"),
        ("table far", with(16, &[0xFF; 4]), "found byte 4294967295 of"),
        ("table near", with(16, &[3, 0, 0, 0]), "found byte 3 of"),
        ("streams", with(15, &[6]), "expected 5 streams for harmonics of degree 0, found 6"),
        ("packed", with(32, &[0xFF; 8]), "SPZ positions: expected 18446744073709551615 compressed"),
        (
            "unpacked",
            with(40, &[0xFF; 8]),
            "expected 27 bytes for 3 splats, found 18446744073709551",
        ),
        ("stream", with(112, &[0; 4]), "SPZ positions: expected "),
        ("count", with(8, &[4]), "SPZ positions: expected 36 bytes for 4 splats, found 27"),
    ];
    for (name, bytes, message) in cases {
        assert_fails(name, &bytes, &[message]);
    }
}

/// Unpacking stops at the declared number of splats, even if a few kB would unpack to a gigabyte.
#[test]
fn bombs_end_where_the_splats_do() {
    let mut bomb = legacy(2, 2, 0);
    bomb.resize(64 << 20, 0);
    assert_fails(
        "gzip",
        &gzip(&bomb),
        &["expected an end after the last column, found more bytes"],
    );
    let mut columns = zeros(2);
    columns[0].resize(64 << 20, 0);
    let mut file = version_4(2, 0, &columns);
    file[40..48].copy_from_slice(&18u64.to_le_bytes());
    assert_fails("zstd", &file, &["SPZ positions: expected 18 bytes, found more"]);
}
