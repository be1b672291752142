//! Measurements of the window on a display: start-up time and slowdown of training. They start the program
//! several times, so they are run by name or with `--ignored`.

use crate::common::skip::skip;
use std::ffi::OsString;
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

/// Longest time for a demo run, generous for a loaded machine.
const PATIENCE: Duration = Duration::from_secs(120);
/// Runs per reported median.
const RUNS: usize = 3;

/// Returns the display; `None` without one outside strict mode.
pub fn display() -> Option<OsString> {
    let found = std::env::var_os("DISPLAY").filter(|display| !display.is_empty());
    found.or_else(|| skip("no DISPLAY", "use xvfb-run"))
}

/// Kills the program at the end of the test.
pub struct Running(pub Child);

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

#[cfg(unix)]
impl Running {
    /// Sends SIGTERM, as at a system shutdown; returns the exit status.
    pub fn ask_to_end(&mut self) -> ExitStatus {
        let kill = format!("kill -TERM {}", self.0.id());
        assert!(Command::new("sh").args(["-c", &kill]).status().unwrap().success());
        let asked = Instant::now();
        loop {
            if let Some(status) = self.0.try_wait().unwrap() {
                return status;
            }
            assert!(asked.elapsed() < PATIENCE, "the program does not exit");
            std::thread::sleep(Duration::from_millis(10));
        }
    }
}

/// Starts the program on the demo; returns it with the lines of its log.
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

/// Runs the demo once. Returns milliseconds to the first pass of the window, milliseconds to the first
/// visible splats, and median training milliseconds per frame.
fn demo_in_a_window(folder: &Path) -> (f64, f64, f64) {
    let (_running, lines) = open_demo(folder);
    let started = Instant::now();
    let (mut shown, mut first) = (None, None);
    for line in lines {
        if let Some(ms) = number_after(&line, "window after ") {
            shown = Some(ms);
        }
        if let Some(ms) = number_after(&line, "first splats visible after ") {
            first = Some(ms);
        }
        if let Some(ms) = number_after(&line, "train_ms_median ") {
            let shown = shown.expect("the log has no line about the window's start");
            return (shown, first.expect("the log has no line about the first splats"), ms);
        }
        assert!(started.elapsed() < PATIENCE, "the demo does not finish");
    }
    panic!("the window closed before the demo finished");
}

pub fn number_after(line: &str, words: &str) -> Option<f64> {
    let rest = line.split_once(words)?.1;
    rest.split_whitespace().next()?.parse().ok()
}

/// Median training milliseconds per frame of the demo without a display.
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
fn figures_of_start_up_and_cost() {
    let Some(_) = display() else { return };
    let folder = tempfile::tempdir().unwrap();
    let (mut shows, mut starts, mut windowed, mut headless) = (vec![], vec![], vec![], vec![]);
    for _ in 0..RUNS {
        headless.push(demo_headless(folder.path()));
        let (shown, start, train) = demo_in_a_window(folder.path());
        shows.push(shown);
        starts.push(start);
        windowed.push(train);
    }
    let ratios: Vec<f64> = windowed.iter().zip(&headless).map(|(w, h)| w / h).collect();
    println!("start to the window: {shows:?} ms (target 300)");
    println!("start to first visible splats: {starts:?} ms (target 800)");
    println!(
        "ms.train median: window {windowed:.1?}, headless {headless:.1?}, ratios {ratios:.3?}"
    );
    println!(
        "medians: start {:.0} ms, ratio {:.3}",
        median(starts.clone()),
        median(ratios.clone())
    );
    assert!(median(starts) <= 2000.0, "first splats later than 2 s");
    // A ratio of 2 would mean that the window takes a whole core from the trainer; noise stays below.
    assert!(median(ratios) < 2.0, "the window slows the trainer");
}

/// Runs `xdotool`; true if it succeeds, `None` if it is not installed outside strict mode.
pub fn xdotool(arguments: &[&str]) -> Option<bool> {
    match Command::new("xdotool").args(arguments).stdout(Stdio::null()).status() {
        Ok(status) => Some(status.success()),
        Err(_) => skip("no xdotool", "install the package xdotool"),
    }
}

/// SIGTERM, as at logout or shutdown, closes the window in order.
#[cfg(unix)]
#[test]
fn a_window_that_is_asked_to_end_closes_in_order() {
    let Some(_) = display() else { return };
    let folder = tempfile::tempdir().unwrap();
    let (mut running, mut lines) = open_demo(folder.path());
    lines.find(|line| line.contains("first splats visible")).expect("a window that shows splats");
    let status = running.ask_to_end();
    assert!(status.success(), "{status}: {:?}", lines.collect::<Vec<_>>());
}

/// CPU time of a process so far, seconds.
#[cfg(target_os = "linux")]
fn cpu_s(process: u32) -> f64 {
    let text = std::fs::read_to_string(format!("/proc/{process}/stat")).unwrap();
    // The name may contain spaces; the times after it are in hundredths of a second.
    let fields: Vec<&str> = text.rsplit_once(')').unwrap().1.split_whitespace().collect();
    fields[11..13].iter().map(|ticks| ticks.parse::<f64>().unwrap()).sum::<f64>() / 100.0
}

/// Number of times the threads of a process were woken so far.
#[cfg(target_os = "linux")]
fn n_wakes(process: u32) -> usize {
    let tasks = std::fs::read_dir(format!("/proc/{process}/task")).unwrap();
    let of = |task: std::fs::DirEntry| {
        // The thread may have ended since the listing.
        let text = std::fs::read_to_string(task.path().join("status")).unwrap_or_default();
        let line = text.lines().find_map(|line| line.strip_prefix("voluntary_ctxt_switches:"));
        line.map_or(0, |n| n.trim().parse::<usize>().unwrap())
    };
    tasks.map(|task| of(task.unwrap())).sum()
}

/// Opens a visible window on a small dataset.
#[cfg(target_os = "linux")]
fn open_small(folder: &Path) -> Option<Running> {
    display()?;
    xdotool(&["version"])?;
    let path = super::harness::dataset(folder, 2);
    let child = Command::new(env!("CARGO_BIN_EXE_vbgs-studio"))
        .arg(&path)
        .env("HOME", folder)
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let running = Running(child);
    let id = running.0.id().to_string();
    assert!(xdotool(&["search", "--sync", "--pid", &id]).unwrap(), "no window");
    Some(running)
}

/// Measures a window for some seconds; returns the share of a core and wakes per second.
#[cfg(target_os = "linux")]
fn at_rest(running: &Running, seconds: u32) -> (f64, f64) {
    let id = running.0.id();
    let before = (cpu_s(id), n_wakes(id));
    std::thread::sleep(Duration::from_secs(seconds.into()));
    let seconds = f64::from(seconds);
    ((cpu_s(id) - before.0) / seconds, n_wakes(id).saturating_sub(before.1) as f64 / seconds)
}

/// An idle window uses no CPU, visible or hidden, since nothing in it polls.
#[cfg(target_os = "linux")]
#[test]
fn a_window_at_rest_costs_nothing_shown_or_hidden() {
    let folder = tempfile::tempdir().unwrap();
    let Some(running) = open_small(folder.path()) else { return };
    let id = running.0.id().to_string();
    for action in ["windowraise", "windowunmap"] {
        xdotool(&["search", "--onlyvisible", "--pid", &id, action]);
        // Thumbnails and the first pictures take CPU time at first.
        let started = Instant::now();
        let (mut share, mut wakes) = (f64::INFINITY, f64::INFINITY);
        while share > 0.005 || wakes > 5.0 {
            assert!(
                started.elapsed() < PATIENCE,
                "{action}: {share:.3} of a core at rest, {wakes} wakes per second"
            );
            (share, wakes) = at_rest(&running, 2);
        }
        println!("{action}: {:.1} % of a core at rest, {wakes} wakes per second", 100.0 * share);
    }
}
