//! No data loss and no silent errors: signals, full disks, unusual file types and changed folders.
#![cfg(unix)]

use super::runner::{PATIENCE, Run, Scratch, end, signal};
use crate::common::layouts::TestLayout;
use serde_json::json;
use std::ffi::OsStr;
use std::fs;
use std::os::unix::ffi::OsStrExt;
use std::os::unix::fs::{FileTypeExt, PermissionsExt};
use std::process::Command;
use std::time::Instant;

const PAPER: &str = "--preset paper --set components=300";

/// Runs with stdout on `/dev/full`, a device without free space.
fn to_full(scratch: &Scratch, arguments: &str) -> Run {
    let arguments: Vec<&str> = arguments.split_whitespace().collect();
    let full = fs::OpenOptions::new().write(true).open("/dev/full").unwrap();
    Run::from(scratch.command(&arguments).stdout(full).output().unwrap())
}

#[test]
fn output_that_does_not_arrive_is_a_failure() {
    let scratch = Scratch::with_scene();
    for arguments in ["info room", "info room --json", "eval out/scene.ply room", "--help", "-V"] {
        assert_eq!(to_full(&scratch, arguments).code, 1, "{arguments}");
    }
    let run = to_full(&scratch, &format!("train room --out new {PAPER}"));
    run.fails(1, &["stdout", "expected", "No space left", "redirect it elsewhere"]);
    assert!(scratch.path("new/report.json").exists(), "outputs are written anyway");
    // A usage error keeps status 2, and a closed pipe is not an error.
    assert_eq!(to_full(&scratch, "info").code, 2);
    let shell = format!("{} info room | true", env!("CARGO_BIN_EXE_vbgs-studio"));
    let closed = Command::new("bash")
        .args(["-o", "pipefail", "-c", &shell])
        .current_dir(scratch.path(""))
        .output();
    assert_eq!(Run::from(closed.unwrap()).code, 0);
}

#[test]
fn exports_go_through_devices_and_fifos_and_keep_modes() {
    let scratch = Scratch::with_scene();
    scratch.run("export out/scene.ply -o copy.ply").succeeds();
    fs::set_permissions(scratch.path("copy.ply"), fs::Permissions::from_mode(0o640)).unwrap();
    scratch.run("export out/scene.ply -o copy.ply --axes viewer").succeeds();
    let mode = fs::metadata(scratch.path("copy.ply")).unwrap().permissions().mode();
    assert_eq!(mode & 0o777, 0o640);
    scratch.run("export out/scene.ply --format ply -o /dev/null").succeeds();
    assert!(fs::metadata("/dev/null").unwrap().file_type().is_char_device());
    scratch.run("export out/scene.ply --format ply -o /dev/full").fails(1, &["disk is full"]);
}

/// FIFOs without a writer, and devices without an end.
#[test]
fn what_never_ends_is_no_model_and_no_settings() {
    let scratch = Scratch::with_room();
    let made = Command::new("mkfifo").arg(scratch.path("fifo")).status().unwrap();
    assert!(made.success());
    for path in ["fifo", "/dev/zero"] {
        for arguments in [
            format!("eval {path} room"),
            format!("render {path} -o a.png"),
            format!("export {path} -o a.ply"),
            format!("info {path}"),
            format!("merge {path} {path} -o a.vbgs"),
            format!("train room --out out --resume {path}"),
            format!("train room --out out --config {path}"),
        ] {
            scratch.run(&arguments).fails(1, &[path, "expected", "found"]);
        }
        let run = scratch.run(&format!("train room --out out --calibration {path}"));
        assert!(run.code > 0 && run.stderr.contains(path), "{}", run.stderr);
    }
    // The same for a frame list and an image of a dataset.
    fs::rename(scratch.path("fifo"), scratch.path("room/transforms_more.json")).unwrap();
    scratch.run("info room").succeeds();
    fs::remove_file(scratch.path("room/train/r_1.png")).unwrap();
    fs::rename(scratch.path("room/transforms_more.json"), scratch.path("room/train/r_1.png"))
        .unwrap();
    let run = scratch.run(&format!("train room --out out {PAPER} --json")).succeeds();
    assert_eq!(run.json()["skipped"].as_array().unwrap().len(), 1);
}

/// A small file whose header declares four hundred million pixels is refused before decoding.
#[test]
fn an_enormous_image_is_not_decoded() {
    let scratch = Scratch::with_room();
    let mut png = fs::read(scratch.path("room/train/r_1.png")).unwrap();
    png[16..24].copy_from_slice(&[0, 0, 0x4E, 0x20, 0, 0, 0x4E, 0x20]);
    let checksum = crc32(&png[12..29]);
    png[29..33].copy_from_slice(&checksum.to_be_bytes());
    fs::write(scratch.path("room/train/r_1.png"), png).unwrap();
    let run = scratch.run(&format!("train room --out out {PAPER} --json")).succeeds();
    let message = run.json()["skipped"][0]["message"].as_str().unwrap().to_owned();
    assert!(message.contains("64x48") && message.contains("20000x20000"), "{message}");
}

fn crc32(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(!0u32, |crc, byte| {
        (0..8).fold(crc ^ u32::from(*byte), |crc, _| {
            (crc >> 1) ^ (0xEDB8_8320 & (crc & 1).wrapping_neg())
        })
    })
}

#[test]
fn a_path_that_is_no_utf8_is_trained_on() {
    let scratch = Scratch::with_room();
    let odd = OsStr::from_bytes(b"r\xFFm");
    fs::rename(scratch.path("room"), scratch.path("").join(odd)).unwrap();
    let train = |more: &[&str]| {
        let mut command = scratch.command(&["train"]);
        command.arg(odd).args(PAPER.split_whitespace()).args(more);
        Run::from(command.output().unwrap()).succeeds()
    };
    train(&["--out", "out", "--max-frames", "4"]);
    train(&["--out", "on", "--resume", "out/checkpoint.vbgs", "--max-frames", "8"]);
    assert_eq!(scratch.json("on/report.json")["frames"].as_array().unwrap().len(), 8);
}

#[test]
fn folders_in_the_place_of_files_are_found_before_training() {
    for name in ["scene.ply", "checkpoint.vbgs", "report.json", "checkpoint.vbgs.bak"] {
        let scratch = Scratch::with_room();
        fs::create_dir_all(scratch.path("out").join(name)).unwrap();
        let run = scratch.run(&format!("train room --out out {PAPER} --set autosave=100"));
        run.fails(1, &[name, "expected a file", "found a folder", "remove it"]);
        assert_eq!(fs::read_dir(scratch.path("out")).unwrap().count(), 1, "nothing was trained");
    }
}

#[test]
fn sigterm_and_sighup_are_as_ctrl_c() {
    let scratch = Scratch::empty();
    scratch.run("synth room --size 64x48 --frames 60 --eval-frames 1").succeeds();
    let train =
        "train room --preset paper --set components=8000 --set candidates=dense --set autosave=1";
    // Whoever runs the tests by `nohup` asked for runs that outlive their terminal.
    let is_hangup_ignored = signals("self", "SigIgn:") & 1 == 1;
    for name in ["TERM", "HUP"].into_iter().filter(|s| *s == "TERM" || !is_hangup_ignored) {
        let child = scratch.start(&format!("{train} --out {name}"));
        scratch.wait_for(&format!("{name}/checkpoint.vbgs"));
        signal(name, &child);
        let run = end(child);
        assert_eq!(run.code, 130, "{name}: {}", run.stderr);
        let report = scratch.json(&format!("{name}/report.json"));
        assert!(!report["frames"].as_array().unwrap().is_empty());
        scratch.run(&format!("info {name}/checkpoint.vbgs")).succeeds();
    }
}

/// Signal mask of a process, the first signal in the lowest bit, from a line of `/proc/PID/status`.
fn signals(process: &str, line: &str) -> u64 {
    let status = fs::read_to_string(format!("/proc/{process}/status")).unwrap_or_default();
    let mask = status.lines().find_map(|text| text.strip_prefix(line));
    mask.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok()).unwrap_or(0)
}

/// A run stopped before its first frame leaves the files of an earlier run unchanged. The next run
/// removes the temporary files of killed runs.
#[cfg(target_os = "linux")]
#[test]
fn files_of_an_earlier_run_stay_until_there_are_newer_ones() {
    let scratch = Scratch::with_scene();
    let names = ["scene.ply", "checkpoint.vbgs", "report.json"];
    let before = names.map(|name| scratch.bytes(&format!("out/{name}")));
    for left in [".report.json.1.aa.tmp", ".scene.ply.1.aa.tmp", ".checkpoint.vbgs.1.aa.tmp"] {
        fs::write(scratch.path("out").join(left), "half").unwrap();
    }
    let train = "train room --out out --preset paper --set components=20000 --set candidates=dense";
    let child = scratch.start(train);
    // The signal handler is installed before any file is opened; 14 is the bit of SIGTERM.
    let (started, process) = (Instant::now(), child.id().to_string());
    while signals(&process, "SigCgt:") >> 14 & 1 == 0 {
        assert!(started.elapsed() < PATIENCE, "the signal handler was not installed");
        std::thread::yield_now();
    }
    signal("TERM", &child);
    assert_eq!(end(child).code, 130);
    assert!(names.map(|name| scratch.bytes(&format!("out/{name}"))) == before);
    scratch.run(&format!("train room --out out {PAPER}")).succeeds();
    assert_eq!(fs::read_dir(scratch.path("out")).unwrap().count(), 3, "leftovers are gone");
}

#[test]
fn a_run_does_not_go_on_with_edited_frames_unless_it_is_told_to() {
    let scratch = Scratch::with_room();
    scratch.run(&format!("train room --out out {PAPER} --max-frames 4")).succeeds();
    let resume = "train room --out on --resume out/checkpoint.vbgs";
    let file = scratch.path("room/train/r_3.png");
    let image = image::open(&file).unwrap();
    let mut edited = image.to_rgba8();
    edited.pixels_mut().for_each(|pixel| pixel.0[0] ^= 0x15);
    edited.save(&file).unwrap();
    scratch.run(resume).fails(1, &["checkpoint.vbgs", "image files", "--force"]);
    scratch.run(&format!("{resume} --force")).succeeds();
    let info = scratch.run("info out/checkpoint.vbgs --json").succeeds().json();
    assert!(info["defects"][0].as_str().unwrap().contains("has changed"), "{info}");
}

#[test]
fn views_that_were_trained_on_are_counted() {
    let scratch = Scratch::with_room();
    let train = format!("train room --out out {PAPER} --max-frames 6 --eval train --json");
    let report = scratch.run(&train).succeeds().json();
    assert_eq!(report["eval"][0]["learnt_views"], 6);
    let counted = |arguments: &str| {
        let run = scratch.run(&format!("eval out/checkpoint.vbgs room {arguments}")).succeeds();
        let json = scratch.run(&format!("eval out/checkpoint.vbgs room {arguments} --json"));
        let said = run.stdout.contains("of these views: their scores measure reproduction");
        (json.json()["eval"][0]["learnt_views"].clone(), said)
    };
    assert_eq!(counted("--split train"), (json!(6), true));
    assert_eq!(counted("--split train --max-frames 2"), (json!(2), true));
    assert_eq!(counted(""), (json!(0), false));
    // A splat file does not record which views were trained.
    let run = scratch.run("eval out/scene.ply room").succeeds();
    assert!(run.stderr.contains("does not state which of these views"), "{}", run.stderr);

    // A split chosen by name is trained whole; without it every eighth frame is held out.
    scratch.record("one", TestLayout::Open3d, 9, 1);
    scratch.run(&format!("train one --out whole {PAPER} --split all")).succeeds();
    let run = scratch.run("eval whole/checkpoint.vbgs one").succeeds();
    assert!(!format!("{}{}", run.stdout, run.stderr).contains("held out"), "{}", run.stderr);
    assert!(run.stdout.contains("trained on 2 of these views"), "{}", run.stdout);
}

#[test]
fn a_training_split_without_a_usable_frame_is_named() {
    let scratch = Scratch::with_room();
    let list = scratch.path("room/transforms_train.json");
    crate::common::scratch::edit_json(&list, |json| {
        for frame in json["frames"].as_array_mut().unwrap() {
            frame["transform_matrix"][0][0] = json!(7.0);
        }
    });
    let parts = ["room", "the split `train`", "none in 8 listed", "r_0", "choose another split"];
    scratch.run(&format!("train room --out out {PAPER}")).fails(1, &parts);
    assert!(!scratch.path("out").exists());
    scratch.run(&format!("train room --out out {PAPER} --split eval")).succeeds();
}

#[test]
fn absurd_and_contradicting_options_are_wrong_usage() {
    let scratch = Scratch::with_scene();
    fs::write(scratch.path("custom.ron"), "(precision: custom)").unwrap();
    for (arguments, parts) in [
        ("train room --out o --scale 1e30", &["--scale", "at most the depth", "found 1e30"][..]),
        ("train room --out o --scale 1e30px", &["--scale", "at most the depth", "px"]),
        ("train room --out o --preset paper --config custom.ron", &["precision", "custom alone"]),
        (
            "train room --out o --intrinsics 1e30 1e30 0 0",
            &["intrinsics", "expected", "at most 1e9"],
        ),
        ("train room --out o --confidence 2", &["confidence", "with confidence maps, found none"]),
        ("export out/scene.ply -o a.glb --axes viewer", &["--axes", "glb", "leave"]),
        ("export out/scene.ply -o a.sog --axes y-up", &["--axes", "expected viewer", "sog"]),
        ("export out/scene.ply -o a.spz --sh3-padding", &["--sh3-padding", "spz", "leave it out"]),
        (
            "export out/scene.ply -o a.glb --spz-version 3",
            &["--spz-version", "glb", "leave it out"],
        ),
        ("export out/scene.ply -o a.spz --spz-version 1", &["--spz-version", "invalid value '1'"]),
        (
            "export out/scene.ply -o a.ply --unit-scale 1e300",
            &["--unit-scale", "a factor from 1e-9"],
        ),
    ] {
        scratch.run(arguments).fails(2, parts);
    }
    // The message names the real cause only: such depths are not millimetres.
    let run = scratch.run("train room --out o --depth-scale 1e30");
    assert!(run.code > 0 && !run.stderr.contains("millimetres"), "{}", run.stderr);
    fs::write(scratch.path("bad.ron"), "(").unwrap();
    let parts = ["bad.ron", "expected settings such as", "found: 1:", "correct this place"];
    scratch.run("train room --out o --config bad.ron").fails(1, &parts);
}

/// The setting sizes an allocation, so a huge value would abort the process.
#[test]
fn a_checkpoint_that_asks_for_all_memory_is_refused() {
    use vbgs_studio::export::checkpoint;
    let scratch = Scratch::with_scene();
    let path = scratch.path("out/checkpoint.vbgs");
    let plain = checkpoint::read(&path).unwrap().checkpoint;
    for floor in ["18446744073709551615", "0"] {
        let mut asking = plain.clone();
        let stated = "\"low_elbo_floor\":1024";
        assert!(asking.config.contains(stated));
        asking.config = asking.config.replace(stated, &format!("\"low_elbo_floor\":{floor}"));
        checkpoint::write(&path, &asking).unwrap();
        let parts = ["checkpoint.vbgs", "low_elbo_floor", "expected 1 to 65536", floor];
        scratch.run("train room --out on --resume out/checkpoint.vbgs").fails(1, &parts);
        scratch.run("eval out/checkpoint.vbgs room").fails(1, &parts);
    }
}
