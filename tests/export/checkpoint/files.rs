//! Reading and writing checkpoints as files.

use super::{fixed64, fixed128, means_f32, mixture, sample, samples};
use std::path::Path;
use vbgs_studio::export::checkpoint::{
    Checkpoint, CheckpointError, is_checkpoint, read, to_bytes, write, write_keeping_old,
};

type Writer = fn(&Path, &Checkpoint) -> Result<u64, CheckpointError>;

fn message(path: &Path) -> String {
    read(path).unwrap_err().to_string()
}

#[test]
fn files_are_recognised_by_content() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.ply");
    let bytes = to_bytes(&samples()[0]);
    for (content, is_one) in [
        (&bytes[..], true),
        (&bytes[..8], true),
        (&b"\x89VBGS\n\x1a and more"[..], true),
        (&b"ply\n"[..], false),
        (&b""[..], false),
    ] {
        std::fs::write(&path, content).unwrap();
        assert_eq!(is_checkpoint(&path), is_one);
    }
    assert!(!is_checkpoint(folder.path()) && !is_checkpoint(&folder.path().join("none")));
}

#[test]
fn every_message_names_the_file() {
    let folder = tempfile::tempdir().unwrap();
    let missing = folder.path().join("none.vbgs");
    assert!(
        message(&missing).contains("none.vbgs: expected a checkpoint"),
        "{}",
        message(&missing)
    );
    assert!(message(folder.path()).contains("expected a file, found a folder"));
    let path = folder.path().join("x.vbgs");
    std::fs::write(&path, &to_bytes(&samples()[0])[..100]).unwrap();
    assert!(message(&path).contains("x.vbgs: expected"), "{}", message(&path));
    assert!(matches!(read(&path), Err(CheckpointError::Content { .. })));
    let error = write(&folder.path().join("no/x.vbgs"), &samples()[0]).unwrap_err().to_string();
    assert!(error.contains("x.vbgs: the folder"), "{error}");
}

#[test]
fn the_older_file_stays_as_bak() {
    let folder = tempfile::tempdir().unwrap();
    let (path, old) = (folder.path().join("c.vbgs"), folder.path().join("c.vbgs.bak"));
    let (first, second) = (sample(means_f32(), fixed64()), sample(means_f32(), fixed128()));
    write_keeping_old(&path, &first).unwrap();
    assert!(!old.exists(), "there was no file to back up");
    write_keeping_old(&path, &second).unwrap();
    assert_eq!(read(&old).unwrap().checkpoint, first);
    assert_eq!(read(&path).unwrap().checkpoint, second);
    write_keeping_old(&path, &first).unwrap();
    assert_eq!(read(&old).unwrap().checkpoint, second);
    assert_eq!(read(&path).unwrap().checkpoint, first);
    let names = std::fs::read_dir(folder.path()).unwrap().count();
    assert_eq!(names, 2, "a temporary file is left");
}

/// An unreadable file must not replace a valid one.
#[test]
fn what_no_reader_takes_is_not_written() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("c.vbgs");
    let sound = sample(means_f32(), fixed64());
    write(&path, &sound).unwrap();
    let mut unsound = sound.clone();
    mixture(&mut unsound).2.alpha_init[1] = f64::NAN;
    let keeping_old: Writer = |path, checkpoint| write_keeping_old(path, checkpoint);
    for write in [write, keeping_old] {
        let error = write(&path, &unsound).unwrap_err();
        assert!(matches!(error, CheckpointError::Unreadable { .. }), "{error}");
        let said = error.to_string();
        for part in ["c.vbgs: not written", "component 1, alpha", "found NaN", "export the splats"]
        {
            assert!(said.contains(part), "{part:?} is missing in: {said}");
        }
        assert_eq!(read(&path).unwrap().checkpoint, sound);
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    }
    let mut unsound = sound.clone();
    unsound.cursor.frames = unsound.cursor.visited.len() as u64 + 1;
    let error = write(&path, &unsound).unwrap_err().to_string();
    assert!(error.contains("trained frames, found"), "{error}");
    assert_eq!(read(&path).unwrap().checkpoint, sound);
}
