//! Runs killed at random moments lose at most the time between two autosaves.
//!
//! `VBGS_KILLS=100 cargo test --release --test cli lost -- --nocapture` kills a hundred default runs within
//! two minutes a round, at most six per core at a time.
#![cfg(target_os = "linux")]

use super::runner::Scratch;
use std::io::Read;
use std::process::{ChildStdout, Command, Stdio};
use std::thread;
use std::time::{Duration, Instant};
use vbgs_studio::math::rng::{Purpose, Rng};
use vbgs_studio::pipeline::autosave::DEFAULT_S;
use vbgs_studio::pipeline::checkpoint::SavedRun;

const RUNS_PER_CORE: usize = 6;

/// Frames that the progress bar shows, with the time at which each number appeared first.
fn progress(mut shown: ChildStdout) -> Vec<(Instant, u64)> {
    let (mut text, mut buffer) = (String::new(), [0; 4096]);
    let mut seen: Vec<(Instant, u64)> = Vec::new();
    while let Ok(n @ 1..) = shown.read(&mut buffer) {
        text.push_str(&String::from_utf8_lossy(&buffer[..n]));
        let newest = text.rsplit("frame ").find_map(|rest| rest.split_once('/')?.0.parse().ok());
        if let Some(frames) = newest.filter(|n| seen.last().is_none_or(|(_, last)| last != n)) {
            seen.push((Instant::now(), frames));
        }
        text.drain(..text.rfind("frame ").unwrap_or(0));
    }
    seen
}

/// A killed run.
#[derive(Debug)]
struct Killed {
    /// Seconds of training that its checkpoint lacks.
    lost: f64,
    saved: Option<u64>,
}

/// Trains in a terminal, which shows progress, and sends SIGKILL.
fn kill(scratch: &Scratch, out: &str, options: &str, after: f64) -> Killed {
    let (program, pid) = (env!("CARGO_BIN_EXE_vbgs-studio"), format!("{out}.pid"));
    let train = format!("train room --out {out} --threads 1 {options}");
    let script = format!("echo $$ > {pid}; exec '{program}' {train}");
    let mut terminal = Command::new("script");
    terminal.args(["-qfec", &script, "/dev/null"]).current_dir(scratch.path(""));
    terminal.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::null());
    let started = Instant::now();
    let mut terminal = terminal.spawn().unwrap();
    let shown = terminal.stdout.take().unwrap();
    let watch = thread::spawn(|| progress(shown));
    thread::sleep(Duration::from_secs_f64(after));
    let pid = String::from_utf8(scratch.bytes(&pid)).unwrap();
    let kill = Command::new("sh").args(["-c", &format!("kill -KILL {pid}")]).status().unwrap();
    let killed = Instant::now();
    assert!(kill.success(), "{out} ended before it was killed");
    terminal.wait().unwrap();
    let seen = watch.join().unwrap();
    let file = scratch.path(out).join("checkpoint.vbgs");
    let saved = file.exists().then(|| {
        let run =
            SavedRun::read(&file).unwrap_or_else(|e| panic!("{out}, killed at {after} s: {e}"));
        run.content.cursor.frames
    });
    let held = saved.unwrap_or(0);
    let last = seen.iter().rfind(|(_, frames)| *frames <= held);
    let lost = killed - last.map_or(started, |(time, _)| *time);
    Killed { lost: lost.as_secs_f64(), saved }
}

/// Kills `n` runs after some seconds of a range; returns them, that with the largest loss first.
fn kills(n: usize, synth: &str, options: &str, [from, to]: [f64; 2]) -> Vec<Killed> {
    let scratch = Scratch::empty();
    scratch.run(&format!("synth room --eval-frames 0 {synth}")).succeeds();
    let mut rng = Rng::new(1, Purpose::Synthetic, 0);
    let moments: Vec<f64> = (0..n).map(|_| rng.range(from, to)).collect();
    let at_once = RUNS_PER_CORE * thread::available_parallelism().unwrap().get();
    // Rounds of equal size, because the runs of a small one would be fast and end before they are killed.
    let n_rounds = n.div_ceil(at_once);
    let mut killed = Vec::new();
    for moments in moments.chunks(n.div_ceil(n_rounds)) {
        let first = killed.len();
        thread::scope(|scope| {
            let run = |(i, after): (usize, &f64)| {
                let (scratch, out, after) = (&scratch, format!("out{}", first + i), *after);
                scope.spawn(move || kill(scratch, &out, options, after))
            };
            let runs: Vec<_> = moments.iter().enumerate().map(run).collect();
            killed.extend(runs.into_iter().map(|run| run.join().unwrap()));
        });
    }
    killed.sort_by(|a, b| b.lost.total_cmp(&a.lost));
    killed
}

#[test]
fn a_killed_run_loses_at_most_the_time_between_saves() {
    let asked = std::env::var("VBGS_KILLS").ok().and_then(|n| n.parse().ok());
    let (killed, most) = match asked {
        Some(n) => {
            let killed = kills(n, "--size 320x240 --frames 4800", "", [3.0, 115.0]);
            (killed, f64::from(DEFAULT_S))
        }
        // Twice the interval: a busy disk may take longer than so short a one.
        None => {
            let often = "--set autosave=2s";
            (kills(3, "--size 64x48 --frames 3000", often, [4.0, 7.0]), 4.0)
        }
    };
    let n_saved = killed.iter().filter(|run| run.saved.is_some()).count();
    eprintln!(
        "{} killed, {n_saved} after a save; most was lost by {:.2?}",
        killed.len(),
        killed[0]
    );
    assert!(killed[0].lost <= most, "at most {most} s: {killed:?}");
    assert!(2 * n_saved > killed.len(), "most were killed before a save: {killed:?}");
}
