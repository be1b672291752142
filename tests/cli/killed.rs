//! Runs that are killed while they save: whatever the moment, a file that goes on is left.
#![cfg(unix)]

use super::runner::Scratch;
use std::process::Stdio;
use std::time::{Duration, Instant};
use vbgs_studio::pipeline::checkpoint::SavedRun;

/// Longest wait for the first save.
const PATIENCE: Duration = Duration::from_secs(120);
/// Between the moments of two kills. A save takes several times as long, and no whole number of them.
const STEP: Duration = Duration::from_micros(4_700);
/// Saves of some megabytes one after the other, for some seconds.
const TRAIN: &str = "train room --preset paper --set components=60000 --set autosave=1";

fn room() -> Scratch {
    let scratch = Scratch::empty();
    scratch.run("synth room --size 64x48 --frames 400 --eval-frames 1").succeeds();
    scratch
}

/// Trains into `out` and kills the process so long after its first save. SIGKILL: nothing of the
/// program runs any more.
fn killed(scratch: &Scratch, out: &str, after: Duration) {
    let arguments = format!("{TRAIN} --out {out}");
    let arguments: Vec<&str> = arguments.split_whitespace().collect();
    let mut command = scratch.command(&arguments);
    let mut child = command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
    let started = Instant::now();
    while !scratch.path(out).join("checkpoint.vbgs").exists() {
        assert!(started.elapsed() < PATIENCE, "nothing was saved");
        std::thread::sleep(Duration::from_millis(1));
    }
    std::thread::sleep(after);
    assert!(child.try_wait().unwrap().is_none(), "it ended before it was killed");
    child.kill().unwrap();
    child.wait().unwrap();
}

/// Frames in the newest file, after it and the one before were read.
fn frames(scratch: &Scratch, out: &str) -> u64 {
    let read = |name: &str| {
        let run = SavedRun::read(&scratch.path(out).join(name));
        run.unwrap_or_else(|e| panic!("{out}: {e}")).content.cursor.frames
    };
    let newest = read("checkpoint.vbgs");
    if scratch.path(out).join("checkpoint.vbgs.bak").exists() {
        // Equal where it was killed between the second name and the new file.
        assert!(read("checkpoint.vbgs.bak") <= newest);
    }
    newest
}

/// Kills so many runs, each a little later; what the last one left goes on to the same scene.
fn kill(n: u32) {
    let scratch = room();
    let mut seen = Vec::new();
    for i in 0..n {
        let out = format!("out{i}");
        killed(&scratch, &out, i * STEP);
        seen.push(frames(&scratch, &out));
    }
    // A busy machine may kill one only after it was done.
    let n_cut_short = seen.iter().filter(|frames| (1..400).contains(*frames)).count();
    assert!(seen.iter().all(|frames| *frames >= 1) && 2 * n_cut_short > seen.len(), "{seen:?}");

    let last = format!("out{}", n - 1);
    let resume = format!("train room --out {last} --resume {last}/checkpoint.vbgs");
    scratch.run(&format!("{resume} --set autosave=0.1s")).succeeds();
    scratch.run(&format!("{TRAIN} --out whole")).succeeds();
    let (went_on, whole) = (format!("{last}/scene.ply"), "whole/scene.ply");
    assert!(scratch.bytes(&went_on) == scratch.bytes(whole), "another scene");
    let left = std::fs::read_dir(scratch.path(&last)).unwrap();
    let left = left.filter(|f| f.as_ref().unwrap().path().extension().is_some_and(|e| e == "tmp"));
    assert_eq!(left.count(), 0, "the run that went on has removed what the killed one left");
}

#[test]
fn a_killed_run_leaves_a_file_that_loads() {
    kill(6);
}

#[test]
#[ignore = "kills 50 runs: about a minute"]
fn fifty_killed_runs_leave_files_that_load() {
    kill(50);
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
