//! Fault injection into saves: every disk operation fails with every error, and the process is killed
//! before each. Afterwards the newest or the previous file must load.

use crate::checkpoint::samples;
use std::cell::Cell;
use std::io;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use vbgs_studio::export::atomic::{SaveStep, remove_leftovers, write_checked, write_with_backup};
use vbgs_studio::export::checkpoint::{self, Checkpoint};

/// Disk on which one operation fails.
struct FaultyDisk {
    /// Index of the operation, from 0.
    at: usize,
    fault: Fault,
    has_links: bool,
    done: Cell<usize>,
}

#[derive(Clone, Copy, Debug)]
enum Fault {
    /// Only this operation fails; the clean-up works.
    Once(i32),
    /// This operation and all later ones fail, including the clean-up.
    Always(i32),
    /// The process is killed before this operation.
    Kill,
}

/// ENOSPC, EFBIG, EIO, EDQUOT, EACCES.
const ERRORS: [i32; 5] = [28, 27, 5, 122, 13];

impl FaultyDisk {
    fn check(&self, step: SaveStep) -> io::Result<()> {
        let now = self.done.replace(self.done.get() + 1);
        match self.fault {
            Fault::Once(error) if now == self.at => Err(io::Error::from_raw_os_error(error)),
            Fault::Always(error) if now >= self.at => Err(io::Error::from_raw_os_error(error)),
            Fault::Kill if now >= self.at => Err(io::Error::other("killed")),
            _ if step == SaveStep::Link && !self.has_links => {
                Err(io::ErrorKind::Unsupported.into())
            }
            _ => Ok(()),
        }
    }
}

/// Writes in pieces, each of which reaches the disk by itself.
fn write_in_pieces(out: &mut dyn Write, bytes: &[u8]) -> io::Result<()> {
    bytes.chunks(700).try_for_each(|piece| out.write_all(piece).and_then(|()| out.flush()))
}

/// Checkpoint identified by its number of frames.
fn saved(frames: u64) -> Vec<u8> {
    let [plain, ..] = samples();
    let cursor = checkpoint::Cursor { frames, ..plain.cursor.clone() };
    checkpoint::to_bytes(&Checkpoint { cursor, ..plain })
}

fn frames_in(path: &Path) -> u64 {
    let loaded = checkpoint::read(path).unwrap_or_else(|e| panic!("{e}"));
    loaded.checkpoint.cursor.frames
}

/// Folder with a checkpoint of 2 frames and a `.bak` of 1.
struct Saves {
    folder: tempfile::TempDir,
    bytes: [Vec<u8>; 4],
}

impl Saves {
    fn new() -> Self {
        Self { folder: tempfile::tempdir().unwrap(), bytes: [1, 2, 3, 4].map(saved) }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn reset(&self) {
        for entry in std::fs::read_dir(self.folder.path()).unwrap() {
            std::fs::remove_file(entry.unwrap().path()).unwrap();
        }
        for bytes in &self.bytes[..2] {
            write_with_backup(&self.path("run.vbgs"), |out| out.write_all(bytes)).unwrap();
        }
    }

    /// Numbers of frames in the file and in its backup; both must load.
    fn loaded(&self) -> (u64, u64) {
        (frames_in(&self.path("run.vbgs")), frames_in(&self.path("run.vbgs.bak")))
    }

    /// Saves 3 frames on a faulty disk; returns whether it succeeded and the number of operations.
    fn save(&self, at: usize, fault: Fault, has_links: bool) -> (bool, usize) {
        let disk = FaultyDisk { at, fault, has_links, done: Cell::new(0) };
        let path = self.path("run.vbgs");
        let outcome = write_checked(&|step| disk.check(step), &path, true, |out| {
            write_in_pieces(out, &self.bytes[2])
        });
        (outcome.is_ok(), disk.done.get())
    }
}

#[test]
fn whichever_operation_fails_the_newest_or_the_previous_file_loads() {
    let saves = Saves::new();
    for has_links in [true, false] {
        saves.reset();
        let (succeeded, n) = saves.save(usize::MAX, Fault::Kill, has_links);
        assert!(succeeded && n > 8, "{n} operations");
        assert_eq!(saves.loaded(), (3, 2));
        let errors = ERRORS.iter().flat_map(|&e| [Fault::Once(e), Fault::Always(e)]);
        for fault in errors.chain([Fault::Kill]) {
            for at in 0..n {
                saves.reset();
                let (succeeded, _) = saves.save(at, fault, has_links);
                let found = saves.loaded();
                let told = format!("{fault:?} at {at} of {n}, links {has_links}: {found:?}");
                match succeeded {
                    true => assert_eq!(found, (3, 2), "{told}"),
                    // Between writing the new backup and the new file, both hold the previous frames.
                    false => assert!(matches!(found, (2, 1 | 2) | (3, 2)), "{told}"),
                }
                // The next save works, and starting a run removes all leftovers.
                let path = saves.path("run.vbgs");
                remove_leftovers(&path);
                write_with_backup(&path, |out| out.write_all(&saves.bytes[3])).unwrap();
                assert_eq!(saves.loaded(), (4, found.0), "{told}");
                let names = std::fs::read_dir(saves.folder.path()).unwrap().count();
                assert_eq!(names, 2, "{told}");
            }
        }
    }
}

/// Consecutive failing autosaves, as on a disk that stays full.
#[test]
fn a_disk_that_stays_full_costs_no_file() {
    let saves = Saves::new();
    saves.reset();
    for at in (0..12).cycle().take(60) {
        let (succeeded, _) = saves.save(at.min(6), Fault::Always(28), at % 2 == 0);
        assert!(!succeeded);
        assert_eq!(saves.loaded().0, 2);
    }
}

/// Two writers save to the same path while a third repeatedly starts a run in the folder.
#[test]
fn saves_side_by_side_leave_whole_files() {
    let saves = Saves::new();
    saves.reset();
    let path = saves.path("run.vbgs");
    let is_over = AtomicBool::new(false);
    std::thread::scope(|scope| {
        scope.spawn(|| {
            while !is_over.load(Ordering::SeqCst) {
                remove_leftovers(&path);
                assert!(saves.loaded().0 >= 2);
            }
        });
        let savers = [2, 3].map(|i| {
            let (path, bytes) = (&path, &saves.bytes[i]);
            scope.spawn(move || {
                for _ in 0..40 {
                    write_with_backup(path, |out| out.write_all(bytes)).unwrap();
                }
            })
        });
        let ended = savers.map(|saver| saver.join());
        is_over.store(true, Ordering::SeqCst);
        assert!(ended.iter().all(Result::is_ok), "a save failed");
    });
    assert!(saves.loaded().0 >= 3);
    assert_eq!(std::fs::read_dir(saves.folder.path()).unwrap().count(), 2, "a file is left");
}
