//! Files appear whole or not at all.

use std::io;
use std::path::Path;
use vbgs_studio::export::atomic::write_atomic;
use vbgs_studio::export::{Fault, Format, WriteOptions, write};

fn names(folder: &Path) -> Vec<String> {
    let mut names: Vec<String> = std::fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect();
    names.sort();
    names
}

#[test]
fn a_file_is_replaced_and_nothing_else_is_left() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("report.json");
    for text in ["first", "second and longer"] {
        let written = write_atomic(&path, |out| out.write_all(text.as_bytes())).unwrap();
        assert_eq!(written, text.len() as u64);
        assert_eq!(std::fs::read_to_string(&path).unwrap(), text);
        assert_eq!(names(folder.path()), ["report.json"]);
    }
}

#[test]
fn a_failing_writer_leaves_the_old_file_and_no_temporary() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.ply");
    std::fs::write(&path, "old").unwrap();
    let mut seen = Vec::new();
    let error = write_atomic(&path, |out| {
        out.write_all(&vec![7; 1 << 20])?;
        seen = names(folder.path());
        Err(io::Error::other("the writer broke"))
    })
    .unwrap_err();
    assert!(matches!(error.fault, Fault::Io { action: "write", .. }), "{error}");
    assert!(error.to_string().contains("the writer broke"), "{error}");
    assert_eq!(std::fs::read_to_string(&path).unwrap(), "old");
    assert_eq!(names(folder.path()), ["scene.ply"]);
    let temporary = format!(".scene.ply.{}.", std::process::id());
    assert!(seen[0].starts_with(&temporary) && seen[0].ends_with(".tmp"), "{seen:?}");
}

#[test]
fn a_full_disk_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let error = write_atomic(&folder.path().join("a"), |out| {
        out.write_all(&[0; 1000])?;
        Err(io::ErrorKind::StorageFull.into())
    })
    .unwrap_err();
    assert!(matches!(error.fault, Fault::DiskFull { written: 1000 }), "{error}");
}

#[test]
fn a_missing_folder_and_a_folder_as_target_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let splats = super::random_splats(1, 1);
    let missing = folder.path().join("no/such/scene.ply");
    let options = WriteOptions::new(Format::Ply);
    let error = write(&missing, &splats, &options).unwrap_err();
    assert!(matches!(&error.fault, Fault::NoFolder { folder } if folder.ends_with("no/such")));
    assert!(error.to_string().contains("scene.ply: the folder"), "{error}");
    let error = write(folder.path(), &splats, &options).unwrap_err();
    assert!(matches!(error.fault, Fault::IsFolder), "{error}");
    assert!(names(folder.path()).is_empty());
}

#[cfg(unix)]
#[test]
fn exports_are_as_readable_as_ordinary_files() {
    use std::os::unix::fs::PermissionsExt;
    let folder = tempfile::tempdir().unwrap();
    let (ours, ordinary) = (folder.path().join("ours"), folder.path().join("ordinary"));
    write_atomic(&ours, |out| out.write_all(b"x")).unwrap();
    std::fs::write(&ordinary, "x").unwrap();
    let mode = |path: &Path| std::fs::metadata(path).unwrap().permissions().mode();
    assert_eq!(mode(&ours), mode(&ordinary));
}
