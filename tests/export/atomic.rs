//! Atomic writes: files appear complete or not at all.

use std::io;
use std::path::Path;
use vbgs_studio::export::atomic::{write_atomic, write_with_backup};
use vbgs_studio::export::{Fault, ModelFormat, WriteOptions, write};

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
    let options = WriteOptions::new(ModelFormat::Ply);
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

#[test]
fn saves_that_fail_again_and_again_leave_the_file_and_its_backup() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.vbgs");
    let backup = folder.path().join("run.vbgs.bak");
    let text = |path: &Path| std::fs::read_to_string(path).unwrap();
    write_with_backup(&path, |out| out.write_all(b"first")).unwrap();
    assert!(!backup.exists(), "nothing older");
    write_with_backup(&path, |out| out.write_all(b"second")).unwrap();
    assert_eq!((text(&path), text(&backup)), ("second".into(), "first".into()));
    for save in 0..4 {
        let error = write_with_backup(&path, |out| {
            out.write_all(&[0; 100])?;
            Err(io::ErrorKind::StorageFull.into())
        })
        .unwrap_err();
        assert!(matches!(error.fault, Fault::DiskFull { written: 100 }), "{error}");
        assert_eq!((text(&path), text(&backup)), ("second".into(), "first".into()), "{save}");
        assert_eq!(names(folder.path()), ["run.vbgs", "run.vbgs.bak"]);
    }
    write_with_backup(&path, |out| out.write_all(b"third")).unwrap();
    assert_eq!((text(&path), text(&backup)), ("third".into(), "second".into()));
}

#[cfg(unix)]
#[test]
fn a_link_stays_one_and_its_file_is_replaced() {
    use std::os::unix::fs::symlink;
    let folder = tempfile::tempdir().unwrap();
    let far = folder.path().join("far");
    std::fs::create_dir(&far).unwrap();
    let link = folder.path().join("link.vbgs");
    symlink("next.vbgs", &link).unwrap();
    symlink("far/real.vbgs", folder.path().join("next.vbgs")).unwrap();
    for (text, in_far) in [
        ("first", &["real.vbgs"][..]),
        ("second", &["real.vbgs", "real.vbgs.bak"]),
        ("third", &["real.vbgs", "real.vbgs.bak"]),
    ] {
        write_with_backup(&link, |out| out.write_all(text.as_bytes())).unwrap();
        assert_eq!(std::fs::read_to_string(far.join("real.vbgs")).unwrap(), text);
        assert!(link.is_symlink() && folder.path().join("next.vbgs").is_symlink());
        assert_eq!(names(&far), in_far);
    }
    assert_eq!(std::fs::read_to_string(far.join("real.vbgs.bak")).unwrap(), "second");
    assert_eq!(names(folder.path()), ["far", "link.vbgs", "next.vbgs"]);

    let circle = folder.path().join("circle");
    symlink("circle", &circle).unwrap();
    let error = write_atomic(&circle, |out| out.write_all(b"x")).unwrap_err();
    assert!(matches!(error.fault, Fault::Io { action: "follow this link", .. }), "{error}");
    let nowhere = folder.path().join("nowhere");
    symlink("missing/a", &nowhere).unwrap();
    let error = write_atomic(&nowhere, |out| out.write_all(b"x")).unwrap_err();
    assert!(matches!(&error.fault, Fault::NoFolder { folder } if folder.ends_with("missing")));
}

#[cfg(unix)]
#[test]
fn a_fifo_and_a_device_are_written_to_and_stay() {
    use std::os::unix::fs::FileTypeExt;
    let folder = tempfile::tempdir().unwrap();
    let fifo = folder.path().join("fifo");
    let made = std::process::Command::new("mkfifo").arg(&fifo).status().unwrap();
    assert!(made.success());
    let reader = std::thread::spawn({
        let fifo = fifo.clone();
        move || std::fs::read(fifo).unwrap()
    });
    let content = vec![7; 200_000]; // more than a pipe holds
    assert_eq!(write_with_backup(&fifo, |out| out.write_all(&content)).unwrap(), 200_000);
    assert_eq!(reader.join().unwrap(), content);
    assert!(std::fs::metadata(&fifo).unwrap().file_type().is_fifo());
    assert_eq!(names(folder.path()), ["fifo"]);

    let link = folder.path().join("null");
    std::os::unix::fs::symlink("/dev/null", &link).unwrap();
    assert_eq!(write_atomic(&link, |out| out.write_all(b"gone")).unwrap(), 4);
    assert!(link.is_symlink());
    assert!(std::fs::metadata("/dev/null").unwrap().file_type().is_char_device());
}

#[cfg(unix)]
#[test]
fn a_file_that_is_replaced_keeps_its_permissions() {
    use std::os::unix::fs::PermissionsExt;
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ply");
    let mode = |path: &Path| std::fs::metadata(path).unwrap().permissions().mode() & 0o7777;
    for expected in [0o640, 0o600, 0o444, 0o755] {
        std::fs::write(&path, "old").unwrap();
        std::fs::set_permissions(&path, std::fs::Permissions::from_mode(expected)).unwrap();
        write_with_backup(&path, |out| out.write_all(b"new")).unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"new");
        assert_eq!((mode(&path), mode(&folder.path().join("a.ply.bak"))), (expected, expected));
        std::fs::remove_file(&path).unwrap();
    }
}
