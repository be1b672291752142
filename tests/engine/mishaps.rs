//! Dataset files that change or vanish during training: unreadable frames are skipped and reported, and
//! the model trained before is retained.

use crate::common::layouts::{TestLayout, write};
use crate::common::scratch::{Files, open_plain};
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};
use tempfile::TempDir;
use vbgs_studio::dataset::synthetic::SyntheticParams;
use vbgs_studio::pipeline::checkpoint::SavedRun;
use vbgs_studio::pipeline::plan::Selection;
use vbgs_studio::pipeline::session::{Session, Step};
use vbgs_studio::pipeline::settings::scene::SceneOverrides;

/// Frames of the recording, and those trained before the files change.
const FRAMES: usize = 24;
const BEFORE: usize = 4;

type Mishap = fn(&Path) -> std::io::Result<()>;

/// Each mishap is applied to every colour and depth image.
const MISHAPS: [(&str, Mishap); 6] = [
    ("removed", |path| fs::remove_file(path)),
    ("cut short", |path| fs::write(path, &fs::read(path)?[..100])),
    ("emptied", |path| fs::write(path, "")),
    ("no image any more", |path| fs::write(path, "gone")),
    ("of another size", |path| {
        let small = image::open(path).unwrap().crop_imm(0, 0, 8, 8);
        small.save(path).map_err(std::io::Error::other)
    }),
    ("folders instead", |path| fs::remove_file(path).and_then(|()| fs::create_dir(path))),
];

fn recording() -> TempDir {
    static KEPT: OnceLock<Files> = OnceLock::new();
    let files = KEPT.get_or_init(|| {
        let folder = tempfile::tempdir().unwrap();
        let room = SyntheticParams {
            width: 48,
            height: 36,
            n_train: FRAMES,
            n_eval: 0,
            ..SyntheticParams::demo()
        };
        write(&room, folder.path(), TestLayout::Open3d, &mut |_, _| {}).unwrap();
        Files::read(folder.path())
    });
    let folder = tempfile::tempdir().unwrap();
    files.write(folder.path());
    folder
}

fn images(folder: &Path) -> Vec<PathBuf> {
    let of = |name: &str| fs::read_dir(folder.join(name)).unwrap().map(|file| file.unwrap().path());
    of("color").chain(of("depth")).collect()
}

fn begun(folder: &Path) -> Session {
    let dataset = Arc::new(open_plain(folder).unwrap());
    let asked = SceneOverrides::default();
    let mut session = Session::new(dataset, asked, Selection::all_frames()).unwrap();
    for _ in 0..BEFORE {
        assert!(matches!(session.step().unwrap(), Step::Trained(_)));
    }
    session
}

/// Trains to the end; the model can still be saved, read back and drawn.
fn ends_with_what_it_learnt(mut session: Session, what: &str) {
    loop {
        match session.step().unwrap_or_else(|error| panic!("{what}: {error}")) {
            Step::Finished => break,
            Step::Skipped(frame) | Step::Lost(frame) => {
                assert!(!frame.message.is_empty(), "{what}: {frame:?}")
            }
            Step::Trained(_) | Step::Waiting => {}
        }
    }
    let (trained, skipped) = (session.frames().len(), session.skipped().len());
    assert!(trained >= BEFORE && skipped > 0, "{what}: {trained} trained, {skipped} skipped");
    let out = tempfile::tempdir().unwrap();
    let file = out.path().join("checkpoint.vbgs");
    vbgs_studio::export::checkpoint::write(&file, &session.checkpoint().unwrap()).unwrap();
    let saved = SavedRun::read(&file).unwrap();
    assert!(saved.content.model == session.checkpoint().unwrap().model, "{what}");
    assert!(session.splats().view().splats().iter().any(|s| s.opacity > 0.0), "{what}");
}

#[test]
fn files_that_change_while_they_train_cost_their_frames_and_no_more() {
    for (what, happens) in MISHAPS {
        let folder = recording();
        let session = begun(folder.path());
        for path in images(folder.path()) {
            happens(&path).unwrap();
        }
        ends_with_what_it_learnt(session, what);
    }
}

#[test]
fn a_recording_that_goes_while_it_trains_leaves_what_was_learnt() {
    let folder = recording();
    let session = begun(folder.path());
    fs::remove_dir_all(folder.path()).unwrap();
    ends_with_what_it_learnt(session, "the whole folder");
}
