//! Every command on a small room, in both layouts.

use super::runner::Scratch;
use vbgs_studio::export::ModelKind;

#[test]
fn train_writes_a_scene_and_a_report() {
    let scratch = Scratch::empty();
    for layout in ["blender", "seven-scenes"] {
        let synth =
            format!("synth {layout} --layout {layout} --size 64x48 --frames 6 --eval-frames 2");
        let said = scratch.run(&synth).succeeds().stdout;
        assert!(said.contains("wrote 8 frames"), "{said}");
        let train = format!(
            "train {layout} --out {layout}-out --preset paper --set components=2000 --eval eval"
        );
        let run = scratch.run(&train).succeeds();
        assert!(
            run.stdout.contains("wrote scene.ply, checkpoint.vbgs and report.json"),
            "{}",
            run.stdout
        );
        assert!(run.stdout.contains("PSNR"), "{}", run.stdout);
        let notes = run.stderr.lines().all(|line| line.starts_with("note: "));
        assert!(notes, "no warning, and no progress bar without a terminal: {}", run.stderr);
        let report = scratch.json(&format!("{layout}-out/report.json"));
        assert_eq!(report["dataset"]["layout"], layout);
        assert_eq!(report["frames"].as_array().unwrap().len(), 6);
        assert_eq!(report["eval"][0]["views"], 2);
        let model = scratch.model(&format!("{layout}-out/scene.ply"));
        assert_eq!((model.kind, model.skipped), (ModelKind::Splats, 0));
        assert_eq!(model.splats.len() as u64, report["summary"]["used"].as_u64().unwrap());
    }
}

#[test]
fn a_second_run_replaces_the_first() {
    let scratch = Scratch::with_scene();
    let first = scratch.bytes("out/scene.ply");
    scratch
        .run("train room --out out --preset paper --set components=2000 --set seed=5")
        .succeeds();
    assert_ne!(scratch.bytes("out/scene.ply"), first);
    scratch.run("train room --out out --preset paper --set components=2000").succeeds();
    assert_eq!(scratch.bytes("out/scene.ply"), first);
    let mut names: Vec<_> = std::fs::read_dir(scratch.path("out"))
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect();
    names.sort();
    assert_eq!(names, ["checkpoint.vbgs", "report.json", "scene.ply"], "no temporary file is left");
}

#[test]
fn without_an_evaluation_split_every_eighth_frame_is_held_out() {
    let scratch = Scratch::empty();
    scratch.run("synth room --size 64x48 --frames 16 --eval-frames 0").succeeds();
    let run = scratch.run("train room --out out --preset paper --set components=500").succeeds();
    assert!(run.stderr.contains("note: held out for evaluation: every 8th"), "{}", run.stderr);
    assert_eq!(scratch.json("out/report.json")["frames"].as_array().unwrap().len(), 14);
    let run = scratch.run("eval out/scene.ply room --json").succeeds();
    assert!(run.stderr.contains("every 8th"), "{}", run.stderr);
    assert_eq!(run.json()["eval"][0]["views"], 2);
}

#[test]
fn frames_are_chosen_as_asked() {
    let scratch = Scratch::with_room();
    for (options, names) in [
        ("--max-frames 2", &["train/r_0", "train/r_1"][..]),
        ("--set stride=3", &["train/r_0", "train/r_3", "train/r_6"]),
        ("--set stride=3 --max-frames 2", &["train/r_0", "train/r_3"]),
        ("--split eval", &["eval/r_0", "eval/r_1", "eval/r_2"]),
    ] {
        scratch
            .run(&format!("train room --out out --preset paper --set components=100 {options}"))
            .succeeds();
        let report = scratch.json("out/report.json");
        let found: Vec<_> = report["frames"].as_array().unwrap().iter().collect();
        let found: Vec<_> = found.iter().map(|f| f["frame"].as_str().unwrap()).collect();
        assert_eq!(found, names, "{options}");
        assert_eq!(report["dataset"]["frames"], names.len());
    }
}

#[test]
fn eval_measures_every_view() {
    let scratch = Scratch::with_scene();
    let run = scratch.run("eval out/scene.ply room").succeeds();
    assert_eq!(run.stdout.lines().count(), 7, "{}", run.stdout);
    for part in ["colours aligned", "where their depth was measured", "cracks, interior pixels"] {
        assert!(run.stdout.lines().skip(4).any(|line| line.contains(part)), "{}", run.stdout);
    }
    assert!(run.stderr.contains("note: evaluating on all frames of the split `eval`"));
    let run = scratch.run("eval out/scene.ply room --renderer both").succeeds();
    let with = |name: &str| run.stdout.lines().filter(|line| line.contains(name)).count();
    assert_eq!((with("projected"), with("exact")), (4, 4), "{}", run.stdout);
    assert!(run.stdout.contains("exact (antialias footprint, ray) on 3 views"), "{}", run.stdout);
    assert_eq!(run.stderr.matches("note: evaluating on").count(), 1, "{}", run.stderr);
    let json = scratch.run("eval out/scene.ply room --split train --json").succeeds().json();
    let views = json["views"].as_array().unwrap();
    assert_eq!((json["eval"][0]["views"].as_u64(), views.len()), (Some(8), 8));
    let mean = views.iter().map(|v| v["psnr"].as_f64().unwrap()).sum::<f64>() / 8.0;
    assert!((mean - json["eval"][0]["psnr_mean"].as_f64().unwrap()).abs() < 1e-9);
    let few = scratch.run("eval out/scene.ply room --split train --max-frames 2 --json");
    let few = few.succeeds().json();
    let indices: Vec<_> = few["views"].as_array().unwrap().iter().map(|v| &v["index"]).collect();
    assert_eq!(indices, [0, 1]);
    assert_eq!(few["views"][1]["psnr"], views[1]["psnr"]);
}

#[test]
fn training_brings_the_renders_closer_to_the_photographs() {
    let scratch = Scratch::empty();
    scratch
        .run("synth room --layout seven-scenes --size 96x72 --frames 24 --eval-frames 4")
        .succeeds();
    let psnr = |frames: &str| {
        let options =
            "--preset paper --set components=20000 --set scale_factor=1.41 --eval eval --json";
        let train = format!("train room --out out {options} --max-frames {frames}");
        scratch.run(&train).succeeds().json()["eval"][0]["psnr_mean"].as_f64().unwrap()
    };
    let (one, all) = (psnr("1"), psnr("24"));
    assert!(all > one + 5.0 && all > 15.0, "after one frame {one} dB, after all {all} dB");
}

#[test]
fn info_counts_what_there_is() {
    let scratch = Scratch::with_scene();
    let said = scratch.run("info room").succeeds().stdout;
    for part in ["blender dataset", "train: 8 frames of 64x48", "depth 0.", "0 defects found"] {
        assert!(said.contains(part), "`{part}` is missing from: {said}");
    }
    let json = scratch.run("info room --json").succeeds().json();
    assert_eq!(json["splits"][1]["name"], "train");
    assert_eq!(json["splits"][1]["frames"], 8);
    assert_eq!(json["defects"], serde_json::json!([]));
    let model = scratch.run("info out/scene.ply --json").succeeds().json();
    assert_eq!(model["kind"], "splats");
    assert_eq!(model["splats"], scratch.json("out/report.json")["summary"]["used"]);
    assert_eq!(model["bytes"].as_u64().unwrap(), scratch.bytes("out/scene.ply").len() as u64);
}

#[test]
fn synth_overwrites_nothing() {
    let scratch = Scratch::with_room();
    let list = scratch.bytes("room/transforms_train.json");
    scratch.run("synth room").fails(1, &["room", "expected a new or empty folder", "choose"]);
    assert_eq!(scratch.bytes("room/transforms_train.json"), list);
}

/// `-o` writes through symbolic links, FIFOs and devices and does not replace them.
#[cfg(unix)]
#[test]
fn outputs_go_through_links_and_fifos() {
    use std::fs;
    use std::os::unix::fs::{FileTypeExt, symlink};
    let scratch = Scratch::with_scene();
    fs::create_dir(scratch.path("far")).unwrap();
    symlink("far/real.ply", scratch.path("link.ply")).unwrap();
    for _ in 0..2 {
        scratch.run("export out/scene.ply -o link.ply").succeeds();
        assert!(scratch.path("link.ply").is_symlink());
    }
    let expected = scratch.bytes("far/real.ply");
    assert_eq!(scratch.model("link.ply").splats.len(), scratch.model("out/scene.ply").splats.len());

    let fifo = scratch.path("fifo.ply");
    assert!(std::process::Command::new("mkfifo").arg(&fifo).status().unwrap().success());
    let reader = std::thread::spawn({
        let fifo = fifo.clone();
        move || fs::read(fifo).unwrap()
    });
    scratch.run("export out/scene.ply -o fifo.ply").succeeds();
    assert!(reader.join().unwrap() == expected);
    assert!(fs::metadata(&fifo).unwrap().file_type().is_fifo());

    symlink("/dev/null", scratch.path("null.png")).unwrap();
    scratch.run("render out/scene.ply -o null.png --size 16x12").succeeds();
    assert!(fs::metadata("/dev/null").unwrap().file_type().is_char_device());
    assert!(scratch.path("null.png").is_symlink());
}
