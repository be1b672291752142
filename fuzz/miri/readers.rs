//! Reading of files that fuzzing found. Models and checkpoints are not written, since Miri has no owners of files.

use std::fs;
use std::path::{Path, PathBuf};
use vbgs_studio::dataset::{LoadOptions, open};
use vbgs_studio::export::{checkpoint, read_outline, read_up_to};

/// Returns the inputs of a target: what is in `found/` and, if `corpus.tar.gz` is unpacked, every `step`-th input of
/// its corpus. Leaves out Zstandard, whose decoder is written in C.
fn inputs(target: &str, step: usize) -> Vec<PathBuf> {
    let fuzz = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let mut files = Vec::new();
    for (folder, step) in [("found", 1), ("corpus", step)] {
        let list = fs::read_dir(fuzz.join(folder).join(target)).into_iter().flatten();
        let mut list: Vec<PathBuf> = list.map(|file| file.unwrap().path()).collect();
        list.sort();
        files.extend(list.into_iter().step_by(step));
    }
    let is_rust = |path: &PathBuf| {
        let bytes = fs::read(path).unwrap();
        let has = |part: &[u8]| bytes.windows(part.len()).any(|window| window == part);
        !has(b"zstd") && !bytes.starts_with(b"NGSP\x04")
    };
    files.retain(is_rust);
    println!("{target}: {} inputs", files.len());
    files
}

#[test]
fn models_that_fuzzing_found_are_read_or_refused() {
    let mut n_files = 0;
    for (target, step) in
        [("ply", 50), ("compressed_ply", 50), ("splat", 50), ("spz", 6), ("glb", 12)]
    {
        for file in inputs(target, step) {
            n_files += 1;
            let outline = read_outline(&file).map(|model| model.outline);
            match read_up_to(&file, 2000) {
                Ok(model) => assert_eq!(outline.ok(), Some(model.outline)),
                Err(error) => assert!(error.to_string().len() < 1000),
            }
        }
    }
    assert!(n_files > 0, "nothing was found");
}

#[test]
fn checkpoints_are_read_or_refused() {
    for file in inputs("checkpoint", 25) {
        match checkpoint::parse(&fs::read(file).unwrap()) {
            Ok(read) => assert!(read.bytes > 0),
            Err(defect) => assert!(defect.to_string().len() < 1000),
        }
    }
}

/// Opens a folder of the named file alone.
fn open_each(target: &str, step: usize, name: &str) {
    for file in inputs(target, step) {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join(name), fs::read(file).unwrap()).unwrap();
        match open(folder.path(), &LoadOptions::default()) {
            Ok(dataset) => {
                for split in 0..dataset.splits.len() {
                    for frame in 0..dataset.splits[split].frames.len().min(2) {
                        drop(dataset.load(split, frame));
                    }
                }
            }
            Err(error) => assert!(error.to_string().len() < 2000),
        }
    }
}

#[test]
fn bags_and_archives_are_opened_or_refused() {
    open_each("mcap", 3, "recording.mcap");
    open_each("r3d", 3, "recording.r3d");
}

/// An array of 8×6 numbers of this type, in this order, and of this stated shape.
fn npy(kind: &str, order: &str, shape: &str, bytes: usize) -> Vec<u8> {
    let header = format!("{{'descr': '{kind}', 'fortran_order': {order}, 'shape': ({shape}), }}\n");
    let length = (header.len() as u32).to_le_bytes();
    let values: Vec<u8> = (0..bytes).map(|i| (37 * i % 251) as u8).collect();
    [&b"\x93NUMPY\x02\0"[..], &length, header.as_bytes(), &values].concat()
}

#[test]
fn arrays_of_depth_are_read_or_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    image::RgbImage::new(8, 6).save(path("a.png")).unwrap();
    let list = r#"{"fl_x": 8, "frames": [{"file_path": "a.png", "depth_file_path": "a.npy",
        "transform_matrix": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]}]}"#;
    fs::write(path("transforms.json"), list).unwrap();
    let (mut n_read, mut n_refused) = (0, 0);
    for (kind, size) in [
        ("<f4", 4),
        (">f4", 4),
        ("<f8", 8),
        ("<f2", 2),
        ("<u2", 2),
        (">u2", 2),
        ("<i4", 4),
        ("|u1", 1),
    ] {
        for order in ["False", "True"] {
            let shapes = [
                "6, 8",
                "6, 8, 1",
                "48",
                "8, 6",
                "0, 8",
                "4294967296, 4294967296",
                "9223372036854775807, 3",
            ];
            for (i, shape) in shapes.into_iter().enumerate() {
                // Whole, and cut within a number.
                for n in [48 * size, 48 * size - 1] {
                    if i > 0 && n % 2 == 1 {
                        continue;
                    }
                    fs::write(path("a.npy"), npy(kind, order, shape, n)).unwrap();
                    let dataset = open(folder.path(), &LoadOptions::default());
                    match dataset.and_then(|dataset| Ok(dataset.load(0, 0))) {
                        Ok(Ok(_)) => n_read += 1,
                        Ok(Err(error)) => n_refused += usize::from(error.to_string().len() < 1000),
                        Err(error) => n_refused += usize::from(error.to_string().len() < 1000),
                    }
                }
            }
        }
    }
    assert!(n_read > 0 && n_refused > 0, "{n_read} {n_refused}");
}
