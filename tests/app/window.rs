//! Measurements of the window on a display: start-up time and slowdown of training. They start the program
//! several times, so they are run by name or with `--ignored`.

use crate::common::skip::skip;
use std::ffi::OsString;
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
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
    open_demo_with(folder, "info")
}

fn open_demo_with(folder: &Path, log: &str) -> (Running, impl Iterator<Item = String> + use<>) {
    let mut child = Command::new(env!("CARGO_BIN_EXE_vbgs-studio"))
        .current_dir(folder)
        .env("HOME", folder)
        .env("VBGS_LOG", log)
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

/// Measurements of one demo run in a window.
#[derive(Clone, Copy, Debug)]
struct DemoRun {
    trained_s: f64,
    train_ms_median: f64,
    /// Pictures of the scene per second of training.
    pictures_per_s: f64,
    /// 99th percentile of a pass on the window's thread, milliseconds.
    pass_p99_ms: f64,
}

/// Runs the demo in a window, with the camera dragged all the time if `orbits`.
fn demo_with_a_hand(folder: &Path, orbits: bool) -> Option<DemoRun> {
    let (_running, lines) = open_demo_with(folder, "debug");
    xdotool(&["version"])?;
    let (done, is_seen) = (AtomicBool::new(false), AtomicBool::new(false));
    std::thread::scope(|scope| {
        scope.spawn(|| {
            let at = |x: usize| (300 + x).to_string();
            // A press before the scene is drawn would not start a drag.
            while !is_seen.load(Ordering::Relaxed) && !done.load(Ordering::Relaxed) {
                std::thread::sleep(Duration::from_millis(20));
            }
            xdotool(&["mousemove", "300", "400"]);
            if orbits {
                xdotool(&["mousedown", "1"]);
            }
            // About as often as a mouse reports its position.
            for step in 0.. {
                if done.load(Ordering::Relaxed) {
                    break;
                }
                if orbits {
                    let swing = (step % 200_usize).abs_diff(100);
                    xdotool(&["mousemove", &at(2 * swing), "400"]);
                }
                std::thread::sleep(Duration::from_millis(16));
            }
            xdotool(&["mouseup", "1"]);
        });
        let (mut first, mut n_pictures) = (None, 0);
        let started = Instant::now();
        let mut run = None;
        for line in lines {
            if line.contains("picture: ") {
                first.get_or_insert_with(Instant::now);
                is_seen.store(true, Ordering::Relaxed);
                n_pictures += 1;
            }
            if let Some(trained_s) = number_after(&line, "trained_s ") {
                let train_ms_median = number_after(&line, "train_ms_median ").unwrap();
                let span_s = first.map_or(f64::INFINITY, |first| first.elapsed().as_secs_f64());
                let pictures_per_s = f64::from(n_pictures) / span_s;
                let pass_p99_ms = f64::NAN;
                run = Some(DemoRun { trained_s, train_ms_median, pictures_per_s, pass_p99_ms });
            }
            // Logged by the window once it shows the end.
            if let (Some(p99_ms), Some(run)) = (number_after(&line, "p99_ms "), &mut run) {
                run.pass_p99_ms = p99_ms;
                break;
            }
            if started.elapsed() > PATIENCE {
                break;
            }
        }
        done.store(true, Ordering::Relaxed);
        Some(run.expect("the demo finishes"))
    })
}

/// Measures how much moving the camera slows training if the CPU draws the window:
/// `xvfb-run -a -s "-screen 0 1600x1000x24" cargo test --release --test app -- --ignored --nocapture
/// orbiting`.
#[test]
#[ignore = "trains the demo six times: about a minute"]
fn figures_of_orbiting() {
    let Some(_) = display() else { return };
    let Some(_) = xdotool(&["version"]) else { return };
    // Without a client the display server resets and refuses connections meanwhile.
    let _client = Running(Command::new("xdotool").args(["sleep", "3600"]).spawn().unwrap());
    let folder = tempfile::tempdir().unwrap();
    let mut ratios = Vec::new();
    for _ in 0..RUNS {
        // Runs alternate, so that other load on the machine affects both.
        let Some(still) = demo_with_a_hand(folder.path(), false) else { return };
        let Some(moved) = demo_with_a_hand(folder.path(), true) else { return };
        for (hand, run) in [("hands off", still), ("orbiting", moved)] {
            let DemoRun { trained_s, train_ms_median, pictures_per_s, pass_p99_ms } = run;
            println!(
                "{hand}: trained in {trained_s:.1} s, {train_ms_median:.0} ms a frame, {pictures_per_s:.1} pictures a second, 99 % of passes below {pass_p99_ms:.1} ms"
            );
        }
        ratios.push(moved.trained_s / still.trained_s);
    }
    println!("training time while orbiting / hands off: {ratios:.3?} (target 1.25)");
    let ratio = median(ratios);
    println!("median {ratio:.3}");
    // A busy machine can far exceed the target.
    assert!(ratio < 2.0, "orbiting costs training {ratio:.2} times the time");
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

/// Measures the CPU share of an idle window, visible and hidden, over `VBGS_REST_SECONDS`:
/// `VBGS_REST_SECONDS=60 xvfb-run -a -s "-screen 0 1600x1000x24" cargo test --release --test app -- --ignored
/// --nocapture minutes_at_rest`.
#[cfg(target_os = "linux")]
#[test]
#[ignore = "watches a window for a minute or more"]
fn figures_of_minutes_at_rest() {
    let asked = std::env::var("VBGS_REST_SECONDS").ok();
    let seconds = asked.and_then(|text| text.parse().ok()).unwrap_or(6);
    let folder = tempfile::tempdir().unwrap();
    let Some(running) = open_small(folder.path()) else { return };
    let id = running.0.id().to_string();
    for action in ["windowraise", "windowunmap"] {
        xdotool(&["search", "--onlyvisible", "--pid", &id, action]);
        // Excludes loading, the first pictures, and notices, which disappear after 20 s.
        std::thread::sleep(Duration::from_secs(25));
        let (share, wakes) = at_rest(&running, seconds);
        println!("{action}: {:.3} % of a core at rest, {wakes:.2} wakes per second", 100.0 * share);
        assert!(share < 0.01, "{action}: {share:.3} of a core");
    }
}
