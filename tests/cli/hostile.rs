//! Files and folders made to harm whoever opens them or writes to them.
#![cfg(target_os = "linux")]

use super::runner::{Run, Scratch};
use std::fs;
use std::os::unix::fs::symlink;
use std::process::Command;

/// Runs the program within limits of a shell's `ulimit`.
fn run_limited(scratch: &Scratch, limits: &str, arguments: &str) -> Run {
    let program = env!("CARGO_BIN_EXE_vbgs-studio");
    let mut shell = Command::new("sh");
    // The signal of a file that grows too large would end the program; ignored, it is an error.
    let script = format!("trap '' XFSZ; ulimit {limits}; exec {program} {arguments} --threads 1");
    shell.args(["-c", &script]).current_dir(scratch.path("")).stdin(std::process::Stdio::null());
    shell.env("XDG_STATE_HOME", scratch.path("state")).env("TMPDIR", scratch.path(""));
    Run::from(shell.output().unwrap())
}

#[test]
fn a_list_of_empty_objects_is_refused_before_it_is_parsed() {
    let scratch = Scratch::empty();
    fs::create_dir(scratch.path("list")).unwrap();
    let objects = "{},".repeat(8 << 20);
    let text = format!(r#"{{"camera_angle_x": 1.0, "frames": [{objects}{{}}]}}"#);
    fs::write(scratch.path("list/transforms.json"), text).unwrap();
    // Parsed, these 25 MB would take 5 GB.
    let run = run_limited(&scratch, "-v 900000", "info list");
    assert_eq!(run.code, 1, "{}{}", run.stdout, run.stderr);
    assert!(run.stderr.contains("transforms.json") && run.stderr.contains("MiB"), "{}", run.stderr);
}

#[test]
fn names_and_texts_of_files_do_not_control_the_terminal() {
    let scratch = Scratch::with_scene();
    let name = "a\u{1b}]0;owned\u{7}.ply";
    fs::rename(scratch.path("out/scene.ply"), scratch.path(name)).unwrap();
    let run = scratch.run_args(&["info", name]).succeeds();
    assert!(run.stdout.contains("\\u{1b}]0;owned\\u{7}.ply"), "{}", run.stdout);
    let missing = scratch.run_args(&["info", "no\u{9b}2J.ply"]);
    assert_eq!(missing.code, 1);
    let other = "b\u{9b}2J\u{202e}.ply";
    fs::rename(scratch.path(name), scratch.path(other)).unwrap();
    let json = scratch.run_args(&["info", other, "--json"]).succeeds();
    // Escaped as JSON escapes, so that the name comes back.
    assert!(json.json().to_string().contains(other), "{}", json.stdout);
    for text in [&run.stdout, &run.stderr, &missing.stderr, &json.stdout] {
        assert!(!text.contains(|c: char| c.is_control() && !"\n\t".contains(c)), "{text:?}");
    }
}

#[test]
fn a_camera_path_that_never_ends_is_refused() {
    let scratch = Scratch::with_scene();
    assert!(Command::new("mkfifo").arg(scratch.path("fifo")).status().unwrap().success());
    for path in ["fifo", "/dev/zero", "out"] {
        let run = scratch.run(&format!("render out/scene.ply --path {path} -o film"));
        run.fails(1, &[path, "a file of at most 16 MiB", "FIFO or device"]);
    }
}

#[test]
fn links_planted_in_the_output_folder_are_not_followed() {
    for name in ["scene.ply", "checkpoint.vbgs", "report.json", "checkpoint.vbgs.bak"] {
        let scratch = Scratch::with_room();
        fs::create_dir(scratch.path("new")).unwrap();
        fs::write(scratch.path("precious"), "kept").unwrap();
        symlink(scratch.path("precious"), scratch.path(&format!("new/{name}"))).unwrap();
        let run = scratch.run("train room --out new --max-frames 1");
        run.fails(1, &[name, "a link or device", "another folder"]);
        assert_eq!(scratch.bytes("precious"), b"kept");
    }
}

/// A recording of one frame is learned: holding it out would leave nothing.
#[test]
fn a_single_frame_is_not_held_out() {
    let scratch = Scratch::empty();
    scratch.run("synth one --layout tum --size 64x48 --frames 1 --eval-frames 0").succeeds();
    let run = scratch.run("train one --out out").succeeds();
    assert!(run.stdout.contains("1 frames, 0 skipped"), "{}", run.stdout);
}

/// The limit is between the sizes of the scene and of its checkpoint.
#[test]
fn a_checkpoint_that_does_not_fit_costs_no_other_file() {
    let scratch = Scratch::with_room();
    let whole = "train room --max-frames 2 --set textures=0";
    scratch.run(&format!("{whole} --out whole")).succeeds();
    let [model, checkpoint] =
        ["scene.ply", "checkpoint.vbgs"].map(|name| scratch.bytes(&format!("whole/{name}")).len());
    assert!(model + 4096 < checkpoint, "{model} {checkpoint}");
    let blocks = (model + checkpoint) / 2 / 512;
    let run = run_limited(&scratch, &format!("-f {blocks}"), &format!("{whole} --out new"));
    assert_eq!(run.code, 1, "{}{}", run.stdout, run.stderr);
    assert!(run.stdout.contains("wrote scene.ply and report.json"), "{}", run.stdout);
    // Tried in both folders for unsaved runs.
    assert_eq!(run.stderr.matches("unsaved-").count(), 2, "{}", run.stderr);
    assert!(run.stderr.contains("new/checkpoint.vbgs"), "{}", run.stderr);
    assert!(
        scratch.path("new/report.json").exists() && !scratch.path("new/checkpoint.vbgs").exists()
    );
    assert_eq!(scratch.bytes("new/scene.ply").len(), model);
}

#[test]
fn a_default_budget_follows_from_scarce_memory() {
    let scratch = Scratch::empty();
    scratch.run("synth one --size 800x600 --frames 1 --eval-frames 0").succeeds();
    let run = run_limited(&scratch, "-v 700000", "train one --out out --set textures=0").succeeds();
    let text = &run.stderr;
    let (_, rest) = text.split_once("note: memory holds ").unwrap_or_else(|| panic!("{text}"));
    let n: usize = rest.split_once(' ').unwrap().0.parse().unwrap();
    assert!((10_000..300_000).contains(&n), "{text}");
    let report: serde_json::Value =
        serde_json::from_slice(&scratch.bytes("out/report.json")).unwrap();
    assert_eq!(report["config"]["most"], n, "the report states it");
    // With ample memory the default stays.
    let run = scratch.run("train one --out ample --set textures=0").succeeds();
    assert!(!run.stderr.contains("memory holds"), "{}", run.stderr);
}

#[test]
fn frames_too_large_for_the_memory_are_refused_before_any_is_read() {
    let scratch = Scratch::empty();
    scratch.run("synth one --size 1600x1200 --frames 1 --eval-frames 0").succeeds();
    for limit in ["-v 150000", "-v 250000", "-v 400000"] {
        let run = run_limited(&scratch, limit, "train one --out out");
        run.fails(1, &["memory: found", "for this program", "textures"]);
    }
    let run = run_limited(&scratch, "-v 250000", "calibrate one -o camera.ron");
    run.fails(1, &["frames (`--max-frames`): found 1 of this size", "expected at most 0"]);
    assert!(!scratch.path("out").exists() && !scratch.path("camera.ron").exists());
}

/// Also without ffmpeg, which is an error too.
#[test]
fn a_video_that_does_not_fit_is_an_error() {
    let scratch = Scratch::with_scene();
    let path = r#"{"version": 1, "fps": 4, "keyframes": [
        {"time": 0, "eye": [3, 3, 1], "target": [0, 0, 0.5], "fov_y": 60},
        {"time": 2, "eye": [-3, 3, 1], "target": [0, 0, 0.5]}]}"#;
    fs::write(scratch.path("way.json"), path).unwrap();
    for film in ["film.mp4", "film.webm", "film.webp"] {
        let render = format!("render out/scene.ply -o {film} --path way.json --size 160x120");
        let run = run_limited(&scratch, "-f 2", &render);
        run.fails(1, &[film, "free disk space"]);
        assert!(!scratch.path(film).exists());
    }
    let gif = run_limited(&scratch, "-f 2", "render out/scene.ply -o film.gif --path way.json");
    gif.fails(1, &["film.gif"]);
    assert!(!scratch.path("film.gif").exists());
    let run = run_limited(&scratch, "-f 2", "render out/scene.ply -o film --path way.json");
    run.fails(1, &["film/00000.png"]);
}
