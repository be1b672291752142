//! Figures of the real window on a display: start-up, and what it costs the trainer. They start the
//! program several times, so they are run by name or with `--ignored`.

use crate::common::skip::skip;
use std::ffi::OsString;
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// Longest a demo may take on a loaded machine.
const PATIENCE: Duration = Duration::from_secs(120);
/// Runs of which the median is quoted.
const RUNS: usize = 3;

/// A display; `None` where there is none and may be none.
fn display() -> Option<OsString> {
    let found = std::env::var_os("DISPLAY").filter(|display| !display.is_empty());
    found.or_else(|| skip("no DISPLAY", "use xvfb-run"))
}

/// Ends the window with the test.
struct Running(Child);

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// The window on the demo, with a log of what it does.
fn open_demo(folder: &Path) -> (Running, impl Iterator<Item = String> + use<>) {
    let mut child = Command::new(env!("CARGO_BIN_EXE_vbgs-studio"))
        .current_dir(folder)
        .env("HOME", folder)
        .env("VBGS_LOG", "info")
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let lines = BufReader::new(child.stderr.take().unwrap()).lines();
    (Running(child), lines.map_while(Result::ok))
}

/// Milliseconds to the first visible splats, and the trainer's median per frame, of one demo run.
fn demo_in_a_window(folder: &Path) -> (f64, f64) {
    let (_running, lines) = open_demo(folder);
    let started = Instant::now();
    let mut first = None;
    for line in lines {
        if let Some(ms) = number_after(&line, "first splats visible after ") {
            first = Some(ms);
        }
        if let Some(ms) = number_after(&line, "train_ms_median ") {
            return (first.expect("splats were seen before the end"), ms);
        }
        assert!(started.elapsed() < PATIENCE, "the demo does not finish");
    }
    panic!("the window closed before the demo finished");
}

fn number_after(line: &str, words: &str) -> Option<f64> {
    let rest = line.split_once(words)?.1;
    rest.split_whitespace().next()?.parse().ok()
}

/// The trainer's median per frame of the same demo without a display.
fn demo_headless(folder: &Path) -> f64 {
    let status = Command::new(env!("CARGO_BIN_EXE_vbgs-studio"))
        .current_dir(folder)
        .env_remove("DISPLAY")
        .env_remove("WAYLAND_DISPLAY")
        .stdout(Stdio::null())
        .status()
        .unwrap();
    assert!(status.success());
    let report = std::fs::read_to_string(folder.join("vbgs-demo/report.json")).unwrap();
    let report: serde_json::Value = serde_json::from_str(&report).unwrap();
    report["summary"]["train_ms_median"].as_f64().unwrap()
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

#[test]
#[ignore = "trains the demo six times: about a minute"]
fn start_up_and_cost_of_the_window() {
    let Some(_) = display() else { return };
    let folder = tempfile::tempdir().unwrap();
    let (mut starts, mut windowed, mut headless) = (vec![], vec![], vec![]);
    for _ in 0..RUNS {
        headless.push(demo_headless(folder.path()));
        let (start, train) = demo_in_a_window(folder.path());
        starts.push(start);
        windowed.push(train);
    }
    let ratios: Vec<f64> = windowed.iter().zip(&headless).map(|(w, h)| w / h).collect();
    println!("cold start to first visible splats: {starts:?} ms (target 2000)");
    println!(
        "ms.train median: window {windowed:.1?}, headless {headless:.1?}, ratios {ratios:.3?}"
    );
    println!(
        "medians: start {:.0} ms, ratio {:.3}",
        median(starts.clone()),
        median(ratios.clone())
    );
    assert!(median(starts) <= 2000.0, "first splats later than 2 s");
    // Twice would mean that the window takes a whole core from the trainer; noise stays below.
    assert!(median(ratios) < 2.0, "the window slows the trainer");
}

/// Whoever logs out or shuts the machine down waits for programs that were asked to end.
#[cfg(unix)]
#[test]
fn a_window_that_is_asked_to_end_closes_in_order() {
    let Some(_) = display() else { return };
    let folder = tempfile::tempdir().unwrap();
    let (mut running, mut lines) = open_demo(folder.path());
    lines.find(|line| line.contains("first splats visible")).expect("a window that shows splats");
    let kill = format!("kill -TERM {}", running.0.id());
    assert!(Command::new("sh").args(["-c", &kill]).status().unwrap().success());
    let asked = Instant::now();
    let status = loop {
        if let Some(status) = running.0.try_wait().unwrap() {
            break status;
        }
        assert!(asked.elapsed() < PATIENCE, "it does not close");
        std::thread::sleep(Duration::from_millis(10));
    };
    assert!(status.success(), "{status}: {:?}", lines.collect::<Vec<_>>());
}
