//! Small datasets that tests may damage, with a fresh copy for each test.

use super::layouts::{TestLayout, write};
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use tempfile::TempDir;
use vbgs_studio::dataset::error::DatasetError;
use vbgs_studio::dataset::synthetic::SyntheticParams;
use vbgs_studio::dataset::synthetic::write::DepthBits;
use vbgs_studio::dataset::{Dataset, LoadOptions, open};

/// Opens a dataset with default options.
pub fn open_plain(path: &Path) -> Result<Dataset, DatasetError> {
    open(path, &LoadOptions::default())
}

/// Asserts that a message contains all parts.
#[track_caller]
pub fn assert_says(message: &str, parts: &[&str]) {
    for part in parts {
        assert!(message.contains(part), "`{part}` is missing from: {message}");
    }
}

/// Asserts that the dataset does not open, with an error that contains all parts.
#[track_caller]
pub fn refuses(path: &Path, parts: &[&str]) {
    match open_plain(path) {
        Ok(dataset) => panic!("opened with {:?}, {:?}", dataset.notes, dataset.warnings),
        Err(error) => assert_says(&error.to_string(), parts),
    }
}

/// Three training frames and one evaluation frame of 32×24 pixels.
pub const TINY: SyntheticParams = SyntheticParams {
    width: 32,
    height: 24,
    n_train: 3,
    n_eval: 1,
    seed: 4,
    depth_noise: 0.0,
    ..SyntheticParams::demo()
};

/// Files of a folder in memory, from which each test writes a fresh copy.
pub struct Files(Vec<(PathBuf, Vec<u8>)>);

impl Files {
    /// Reads a folder recursively.
    pub fn read(folder: &Path) -> Self {
        let mut files = Vec::new();
        collect(folder, Path::new(""), &mut files);
        Self(files)
    }

    /// Iterates over the files: path relative to the folder, and bytes.
    pub fn iter(&self) -> impl Iterator<Item = (&Path, &[u8])> {
        self.0.iter().map(|(path, bytes)| (path.as_path(), bytes.as_slice()))
    }

    /// Writes the files into a folder; its other files stay.
    pub fn write(&self, folder: &Path) {
        for (relative, bytes) in &self.0 {
            let path = folder.join(relative);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, bytes).unwrap();
        }
    }
}

fn collect(root: &Path, relative: &Path, files: &mut Vec<(PathBuf, Vec<u8>)>) {
    for entry in std::fs::read_dir(root.join(relative)).unwrap() {
        let entry = entry.unwrap();
        let relative = relative.join(entry.file_name());
        match entry.file_type().unwrap().is_dir() {
            true => collect(root, &relative, files),
            false => files.push((relative.clone(), std::fs::read(entry.path()).unwrap())),
        }
    }
}

/// Writes a fresh copy of [`TINY`] in a layout; frames are rendered once per test program.
pub fn tiny(layout: TestLayout) -> TempDir {
    static KEPT: [OnceLock<Files>; TestLayout::ALL.len()] =
        [const { OnceLock::new() }; TestLayout::ALL.len()];
    let slot = TestLayout::ALL.iter().position(|other| *other == layout).unwrap();
    let files = KEPT[slot].get_or_init(|| {
        let folder = tempfile::tempdir().unwrap();
        write(&TINY, folder.path(), layout, &mut |_, _| ()).unwrap();
        Files::read(folder.path())
    });
    let folder = tempfile::tempdir().unwrap();
    files.write(folder.path());
    folder
}

/// [`TINY`] in the Blender layout with 8-bit depth.
pub fn tiny_blender() -> TempDir {
    tiny(TestLayout::Blender(DepthBits::Eight))
}

/// [`TINY`] in the 7-Scenes layout, with one folder per split.
pub fn tiny_seven_scenes() -> TempDir {
    tiny(TestLayout::SevenScenes)
}

/// Rewrites a JSON file of a scratch dataset.
pub fn edit_json(path: &Path, edit: impl FnOnce(&mut serde_json::Value)) {
    let mut json = serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap();
    edit(&mut json);
    std::fs::write(path, json.to_string()).unwrap();
}

/// Changes the 16 numbers of the second training pose of a 7-Scenes folder.
pub fn edit_pose(root: &Path, edit: impl FnOnce(&mut Vec<f64>)) {
    let path = root.join("train/frame-000001.pose.txt");
    let text = std::fs::read_to_string(&path).unwrap();
    let mut values: Vec<f64> = text.split_whitespace().map(|t| t.parse().unwrap()).collect();
    edit(&mut values);
    let text: Vec<String> = values.iter().map(f64::to_string).collect();
    std::fs::write(&path, text.join(" ")).unwrap();
}
