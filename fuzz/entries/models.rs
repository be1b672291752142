//! Reading of model files, and writing of the result.

use vbgs_studio::export::{ModelFormat, WriteOptions, read, read_up_to, write};

/// Maximum number of rows.
// More are not worth the time of one input.
const MAX_ROWS: usize = 2000;

/// Reads a PLY: splats, points, or the compressed form of PlayCanvas.
pub fn ply(data: &[u8]) {
    if data.starts_with(b"ply") {
        model(data);
    }
}

/// Reads an SPZ, usually without gzip, whose checksum would reject mutations.
pub fn spz(data: &[u8]) {
    if data.starts_with(b"NGSP") || data.starts_with(&[0x1F, 0x8B]) {
        model(data);
    }
}

/// Reads a SOG.
pub fn sog(data: &[u8]) {
    if data.starts_with(b"PK\x03\x04") {
        model(data);
    }
}

/// Reads a `.splat`, which has no magic bytes.
pub fn splat(data: &[u8]) {
    model(&data[..data.len() / 32 * 32]);
}

/// Reads a GLB with corrected length, or a glTF.
pub fn glb(data: &[u8]) {
    let mut data = data.to_vec();
    if data.starts_with(b"glTF") && data.len() >= 12 {
        let length = data.len() as u32;
        data[8..12].copy_from_slice(&length.to_le_bytes());
    }
    model(&data);
}

/// Checks that a model that is read is valid, and can be written in every format and read again.
fn model(data: &[u8]) {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("model");
    std::fs::write(&path, data).expect("a file");
    let model = match read_up_to(&path, MAX_ROWS) {
        Ok(model) => model,
        Err(error) => {
            let message = error.to_string();
            assert!(message.len() < 1000 && !message.contains('\n'), "{message}");
            return;
        }
    };
    assert!(!model.splats.is_empty());
    for splat in model.splats.iter() {
        let fields: [f32; 14] = bytemuck::cast(*splat);
        assert!(fields.iter().all(|v| v.is_finite()), "{splat:?}");
    }
    assert!(model.splats.view().appearance().iter().all(|a| a.is_valid()));
    for format in ModelFormat::ALL {
        let path = folder.path().join("again");
        let Ok(summary) = write(&path, &model.splats, &WriteOptions::new(format)) else { continue };
        if !format.is_read() {
            continue;
        }
        let again = read(&path).unwrap_or_else(|error| panic!("written as {format}: {error}"));
        assert_eq!(again.splats.len() + again.skipped, summary.n_written, "{format}");
    }
}
