//! Settings files.

use serde::Serialize;
use serde::de::DeserializeOwned;
use std::path::Path;
use std::sync::{Arc, OnceLock};
use vbgs_studio::dataset::Dataset;
use vbgs_studio::dataset::calibration::Calibration;
use vbgs_studio::dataset::synthetic::{SyntheticParams, dataset};
use vbgs_studio::pipeline::plan::Selection;
use vbgs_studio::pipeline::session::Session;
use vbgs_studio::pipeline::settings::GivenSettings;
use vbgs_studio::pipeline::settings::scene::SceneOverrides;
use vbgs_studio::train::paper::config::PaperOverrides;
use vbgs_studio::train::setting::Preset;

/// Reads a text as settings of either preset and as a calibration, and trains a scene with them on a frame.
pub fn ron(data: &[u8]) {
    if let Ok(text) = std::str::from_utf8(data) {
        if let Some(paper) = layer::<PaperOverrides>(text) {
            let _ = GivenSettings::from(paper).request(Preset::Paper);
        }
        if let Some(scene) = layer::<SceneOverrides>(text) {
            learn(scene);
        }
    }
    let folder = tempfile::tempdir().expect("a folder");
    calibration(&folder.path().join("calibration.ron"), data);
}

/// Checks that settings survive writing and reading.
fn layer<L: DeserializeOwned + Serialize>(text: &str) -> Option<L> {
    let options =
        ron::Options::default().with_default_extension(ron::extensions::Extensions::IMPLICIT_SOME);
    let layer: L = options.from_str(text).ok()?;
    let written = ron::to_string(&layer).expect("settings can be written");
    let again: L = ron::from_str(&written).unwrap_or_else(|error| panic!("{written}: {error}"));
    assert_eq!(ron::to_string(&again).ok(), Some(written));
    Some(layer)
}

fn learn(scene: SceneOverrides) {
    static ROOM: OnceLock<Arc<Dataset>> = OnceLock::new();
    let room = ROOM.get_or_init(|| {
        let params = SyntheticParams {
            width: 16,
            height: 12,
            n_train: 1,
            n_eval: 0,
            ..SyntheticParams::demo()
        };
        Arc::new(dataset(&params).expect("a room"))
    });
    let Ok(mut session) = Session::new(room.clone(), scene, Selection::all_frames()) else {
        return;
    };
    let _ = session.step();
    let splats = session.splats();
    let drawn = splats.iter().filter(|splat| splat.opacity > 0.0);
    drawn.for_each(|splat| assert!(splat.is_valid(), "{splat:?}"));
}

fn calibration(path: &Path, data: &[u8]) {
    std::fs::write(path, data).expect("a file");
    let Ok(calibration) = Calibration::read(path) else { return };
    std::fs::write(path, calibration.to_text().expect("what was read can be written"))
        .expect("a file");
    assert_eq!(Calibration::read(path).expect("what was written can be read"), calibration);
}
