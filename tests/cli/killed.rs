//! Runs killed while they save: a checkpoint that resumes is left at any moment.
#![cfg(unix)]

use super::runner::Scratch;
use std::time::Duration;
use vbgs_studio::pipeline::checkpoint::SavedRun;

/// Step between the times of successive kills. A save takes several steps, and not a whole number of them.
const STEP: Duration = Duration::from_micros(4_700);
/// Saves of some megabytes one after the other, for some seconds.
const TRAIN: &str = "train room --preset paper --set components=60000 --set autosave=1";

fn room() -> Scratch {
    let scratch = Scratch::empty();
    scratch.run("synth room --size 64x48 --frames 400 --eval-frames 1").succeeds();
    scratch
}

/// Trains into `out` and sends SIGKILL this long after the first save, so no cleanup code runs.
fn killed(scratch: &Scratch, out: &str, after: Duration) {
    let mut child = scratch.start(&format!("{TRAIN} --out {out}"));
    scratch.wait_for(&format!("{out}/checkpoint.vbgs"));
    std::thread::sleep(after);
    assert!(child.try_wait().unwrap().is_none(), "it ended before it was killed");
    child.kill().unwrap();
    child.wait().unwrap();
}

/// Frames of the newest checkpoint; also reads the backup.
fn frames(scratch: &Scratch, out: &str) -> u64 {
    let read = |name: &str| {
        let run = SavedRun::read(&scratch.path(out).join(name));
        run.unwrap_or_else(|e| panic!("{out}: {e}")).content.cursor.frames
    };
    let newest = read("checkpoint.vbgs");
    if scratch.path(out).join("checkpoint.vbgs.bak").exists() {
        // Equal if the kill came between linking the backup and renaming the new file.
        assert!(read("checkpoint.vbgs.bak") <= newest);
    }
    newest
}

/// Kills `n` runs, each a little later, then resumes the last one and compares its scene.
fn kill(n: u32) {
    let scratch = room();
    let mut seen = Vec::new();
    for i in 0..n {
        let out = format!("out{i}");
        killed(&scratch, &out, i * STEP);
        seen.push(frames(&scratch, &out));
    }
    // On a busy machine a run may finish before it is killed.
    let n_cut_short = seen.iter().filter(|frames| (1..400).contains(*frames)).count();
    assert!(seen.iter().all(|frames| *frames >= 1) && 2 * n_cut_short > seen.len(), "{seen:?}");

    let last = format!("out{}", n - 1);
    let resume = format!("train room --out {last} --resume {last}/checkpoint.vbgs");
    scratch.run(&format!("{resume} --set autosave=0.1s")).succeeds();
    scratch.run(&format!("{TRAIN} --out whole")).succeeds();
    let (went_on, whole) = (format!("{last}/scene.ply"), "whole/scene.ply");
    assert!(scratch.bytes(&went_on) == scratch.bytes(whole), "the resumed scene differs");
    let left = std::fs::read_dir(scratch.path(&last)).unwrap();
    let left = left.filter(|f| f.as_ref().unwrap().path().extension().is_some_and(|e| e == "tmp"));
    assert_eq!(left.count(), 0, "the resumed run removes temporary files of the killed one");
}

#[test]
fn a_killed_run_leaves_a_file_that_loads() {
    kill(4);
}

#[test]
#[ignore = "kills 25 runs: half a minute"]
fn killed_runs_leave_files_that_load() {
    kill(25);
}

#[test]
fn seconds_between_saves_are_positive() {
    let scratch = Scratch::empty();
    for seconds in ["0", "-1", "inf", "nan", "1e300", "soon"] {
        let run = scratch.run(&format!("train room --out out --set autosave={seconds}s"));
        assert_eq!(run.code, 2, "{seconds}");
        assert!(run.stderr.contains("a number of seconds above 0"), "{}", run.stderr);
    }
}
