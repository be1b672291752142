//! Reads the golden vectors of `tests/golden` and compares within a tolerance.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Mutex;

/// Path of an uncompressed file of `tests/golden`.
pub fn golden_file(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden").join(name)
}

/// Decompressed content of a zstd file of `tests/golden`.
pub fn golden_unpacked(name: &str) -> Vec<u8> {
    zstd::decode_all(fs::File::open(golden_file(name)).unwrap()).unwrap()
}

/// Folder of a case's arrays, unpacked once per build.
pub fn golden_folder(case: &str) -> PathBuf {
    static ONE_AT_A_TIME: Mutex<()> = Mutex::new(());
    let _one = ONE_AT_A_TIME.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
    let archive = golden_unpacked(&format!("{case}.tar.zst"));
    // The hash gives a changed archive a new folder.
    let name = format!("golden-{:08x}", crc32fast::hash(&archive));
    let target = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    if !target.is_dir() {
        // Renamed only when complete, since test programs may run in parallel.
        let part = tempfile::tempdir_in(env!("CARGO_TARGET_TMPDIR")).unwrap();
        tar::Archive::new(archive.as_slice()).unpack(part.path()).unwrap();
        let renamed = fs::rename(part.path(), &target);
        assert!(renamed.is_ok() || target.is_dir(), "{renamed:?}");
    }
    target.join(case)
}

/// One folder of golden arrays.
pub struct Case {
    folder: PathBuf,
    index: BTreeMap<String, (String, String, Vec<usize>)>,
}

/// Largest error allowed for an expected value.
pub enum Tolerance {
    /// `|a − b| ≤ t`.
    Abs(f64),
    /// `|a − b| ≤ t · max(|b|, floor)`.
    Rel(f64, f64),
}

impl Case {
    pub fn open(name: &str) -> Self {
        let folder = golden_folder(name);
        let text = fs::read_to_string(folder.join("index.tsv")).unwrap();
        let index = text.lines().map(|line| {
            let field: Vec<&str> = line.split('\t').collect();
            let shape = field[3].split('x').map(|n| n.parse().unwrap()).collect();
            (field[0].to_owned(), (field[1].to_owned(), field[2].to_owned(), shape))
        });
        Self { index: index.collect(), folder }
    }

    pub fn has(&self, name: &str) -> bool {
        self.index.contains_key(name)
    }

    fn bytes(&self, name: &str, dtype: &str) -> Vec<u8> {
        let (file, found, shape) =
            self.index.get(name).unwrap_or_else(|| panic!("no golden array {name}"));
        assert_eq!(found, dtype, "{name}");
        let bytes = fs::read(self.folder.join(file)).unwrap();
        let size = if dtype == "f64" { 8 } else { 4 };
        assert_eq!(bytes.len(), size * shape.iter().product::<usize>(), "{name}");
        bytes
    }

    /// Values of an f64 or f32 array in row-major order.
    pub fn f64(&self, name: &str) -> Vec<f64> {
        if self.index[name].1 == "f32" {
            let bytes = self.bytes(name, "f32");
            return bytes
                .as_chunks::<4>()
                .0
                .iter()
                .map(|&b| f32::from_le_bytes(b) as f64)
                .collect();
        }
        self.bytes(name, "f64").as_chunks::<8>().0.iter().map(|&b| f64::from_le_bytes(b)).collect()
    }

    pub fn u32(&self, name: &str) -> Vec<u32> {
        self.bytes(name, "u32").as_chunks::<4>().0.iter().map(|&b| u32::from_le_bytes(b)).collect()
    }

    /// Rows of fixed width.
    pub fn rows<const N: usize>(&self, name: &str) -> Vec<[f64; N]> {
        self.f64(name).as_chunks::<N>().0.to_vec()
    }

    /// Returns a value of `hyper.tsv` by name.
    pub fn hyper(&self, name: &str) -> f64 {
        let text = fs::read_to_string(self.folder.join("hyper.tsv")).unwrap();
        let line = text.lines().find(|l| l.split('\t').next() == Some(name));
        line.and_then(|l| l.split('\t').nth(1))
            .unwrap_or_else(|| panic!("no {name}"))
            .parse()
            .unwrap()
    }

    /// Compares all values of an array; the tolerance may depend on the index.
    pub fn check_each(&self, name: &str, found: &[f64], tolerance: impl Fn(usize, f64) -> f64) {
        let expected = self.f64(name);
        assert_eq!(found.len(), expected.len(), "{name}: number of values");
        for (i, (&a, &b)) in found.iter().zip(&expected).enumerate() {
            let allowed = tolerance(i, b);
            assert!(
                (a - b).abs() <= allowed,
                "{name}[{i}]: found {a:e}, expected {b:e} ± {allowed:e}"
            );
        }
    }

    pub fn check(&self, name: &str, found: &[f64], tolerance: Tolerance) {
        self.check_each(name, found, |_, b| match tolerance {
            Tolerance::Abs(t) => t,
            Tolerance::Rel(t, floor) => t * b.abs().max(floor),
        });
    }

    pub fn check_exact(&self, name: &str, found: &[u32]) {
        assert_eq!(found, self.u32(name), "{name}");
    }
}
