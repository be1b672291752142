//! Checkpoints of scenes: resumed runs, merged shards, and checkpoints as input of every command.

use super::runner::Scratch;
use std::fs;
use vbgs_studio::export::checkpoint::{StoredModel, read};

const TRAIN: &str = "train room --preset scene";

fn model(scratch: &Scratch, folder: &str) -> StoredModel {
    read(&scratch.path(&format!("{folder}/checkpoint.vbgs"))).unwrap().checkpoint.model
}

#[test]
fn a_scene_goes_on_in_another_process() {
    let scratch = Scratch::with_room();
    let train = format!("{TRAIN} --set refine=false --threads 1");
    scratch.run(&format!("{train} --out whole")).succeeds();
    scratch.run(&format!("{train} --out half --max-frames 4")).succeeds();
    let resume = "train room --out on --resume half/checkpoint.vbgs --max-frames 8 --threads 2";
    scratch.run(resume).succeeds();
    assert!(scratch.bytes("on/scene.ply") == scratch.bytes("whole/scene.ply"));
    assert!(model(&scratch, "on") == model(&scratch, "whole"));
    let report = scratch.json("on/report.json");
    assert_eq!(report["frames"].as_array().unwrap().len(), 8);
    assert_eq!(report["config"]["refine"], false);
}

#[test]
fn scenes_of_different_presets_are_not_merged() {
    let scratch = Scratch::with_room();
    let merge = "merge s1/checkpoint.vbgs s2/checkpoint.vbgs -o m.vbgs";
    scratch.run("train room --preset paper --set components=500 --out s2 --shard 2/2").succeeds();
    scratch.run(&format!("{TRAIN} --out s1 --shard 1/2")).succeeds();
    scratch.run(merge).fails(1, &["expected the same setting `preset`", "scene and paper"]);
    assert!(!scratch.path("m.vbgs").exists());
}

#[test]
fn options_that_contradict_a_scene_are_wrong_usage() {
    let scratch = Scratch::with_room();
    scratch.run(&format!("{TRAIN} --out out --max-frames 3")).succeeds();
    fs::write(scratch.path("other.ron"), "(scale: \"4px\")").unwrap();
    fs::write(scratch.path("paper.ron"), "(components: 7)").unwrap();
    let before = scratch.bytes("out/checkpoint.vbgs");
    for (options, parts) in [
        (
            "--scale 3px",
            &["scale (`--scale`): expected 2px", "out/checkpoint.vbgs", "found 3px"][..],
        ),
        ("--config other.ron", &["scale (`--scale`): expected 2px", "found 4px"]),
        ("--budget 5MB", &["budget (`--budget`): expected 2000000", "found 5MB"]),
        ("--set crack_filling=false", &["crack_filling: expected true"]),
        ("--set refine=false", &["refine: expected true", "found false"]),
        ("--preset paper", &["preset (`--preset`): expected scene", "found paper"]),
        (
            "--preset paper --config paper.ron",
            &["preset (`--preset`): expected scene", "found paper"],
        ),
        ("--set components=5", &["components: expected no value", "found 5", "leave"]),
        ("--set stride=2", &["stride: expected 1", "found 2", "leave it out"]),
    ] {
        let run = format!("train room --out out --resume out/checkpoint.vbgs {options}");
        scratch.run(&run).fails(2, parts);
    }
    assert!(scratch.bytes("out/checkpoint.vbgs") == before);
    let repeated =
        "--preset scene --scale 2px --set refine=true --set crack_filling=true --budget 2000000";
    scratch.run(&format!("train room --out on --resume out/checkpoint.vbgs {repeated}")).succeeds();
}

#[test]
fn a_stored_scene_is_a_model() {
    let scratch = Scratch::with_room();
    scratch.run(&format!("{TRAIN} --out out")).succeeds();
    // Checkpoints are recognised by content, not by name.
    fs::copy(scratch.path("out/checkpoint.vbgs"), scratch.path("scene.glb")).unwrap();
    scratch.run("export scene.glb -o again.ply").succeeds();
    assert!(scratch.bytes("again.ply") == scratch.bytes("out/scene.ply"));
    scratch.run("export scene.glb -o split.ply --export-split 2").succeeds();
    assert!(scratch.model("split.ply").splats.len() > scratch.model("again.ply").splats.len());
    scratch.run("render scene.glb -o a.png --dataset room --view 0").succeeds();
    assert!(scratch.path("a.png").exists());
    let eval = |model: &str| {
        let run = scratch.run(&format!("eval {model} room --json")).succeeds();
        run.json()["eval"][0]["psnr_mean"].as_f64().unwrap()
    };
    // PLY files lose the flat tops and colour gradients that a checkpoint stores.
    let (native, plain) = (eval("scene.glb"), eval("out/scene.ply"));
    assert!(native > 15.0 && native != plain, "{native} {plain}");
}

#[test]
fn info_tells_what_a_stored_scene_holds() {
    let scratch = Scratch::with_room();
    scratch.run(&format!("{TRAIN} --out out --max-frames 5 --set textures=0")).succeeds();
    let info = scratch.run("info out/checkpoint.vbgs --json").succeeds().json();
    let summary = scratch.json("out/report.json")["summary"].clone();
    assert_eq!((&info["kind"], &info["version"]), (&"checkpoint".into(), &"1.2".into()));
    assert_eq!((&info["frames"], &info["planned_frames"]), (&5.into(), &5.into()));
    assert_eq!((&info["components"], &info["used"]), (&summary["components"], &summary["used"]));
    let drawn = scratch.model("out/scene.ply").splats.len();
    assert_eq!(info["drawn"], drawn);
    assert_eq!(info["bytes"], scratch.bytes("out/checkpoint.vbgs").len());
    let (components, size) = (&info["components"], &info["bytes_per_component"]);
    assert!(components.as_u64() >= Some(drawn as u64) && size.as_f64() < Some(700.0), "{size}");
    assert_eq!(info["config"]["scale"], "2px");
    assert_eq!(info["defects"], serde_json::json!([]));
    let said = scratch.run("info out/checkpoint.vbgs").succeeds().stdout;
    for part in [
        "checkpoint, version 1.2",
        "5 of 5 frames",
        &format!("of {components} components used, {drawn} drawn"),
        "\"preset\":\"scene\"",
        "0 defects",
    ] {
        assert!(said.contains(part), "`{part}` is missing from: {said}");
    }
    fs::rename(scratch.path("room"), scratch.path("elsewhere")).unwrap();
    let said = scratch.run("info out/checkpoint.vbgs").succeeds().stdout;
    assert!(
        said.contains("defect: its dataset cannot be opened") && said.contains("1 defect found")
    );
    scratch.run("train elsewhere --out on --resume out/checkpoint.vbgs").succeeds();
}

#[test]
fn autosaves_keep_the_one_before() {
    let scratch = Scratch::with_room();
    scratch.run(&format!("{TRAIN} --out out --set autosave=3 --max-frames 7")).succeeds();
    let frames = |file: &str| {
        let info = scratch.run(&format!("info {file} --json")).succeeds().json();
        info["frames"].as_u64().unwrap()
    };
    assert_eq!(frames("out/checkpoint.vbgs"), 7);
    // The frame count depends on disk speed: an autosave that is due during a save is postponed.
    assert!((3..=7).contains(&frames("out/checkpoint.vbgs.bak")));
    assert_eq!(fs::read_dir(scratch.path("out")).unwrap().count(), 4);
    let resume = "train room --out on --resume out/checkpoint.vbgs.bak --max-frames 7";
    scratch.run(resume).succeeds();
    assert!(model(&scratch, "on") == model(&scratch, "out"));
}

/// The structural scale is estimated from readable frames all over the dataset.
#[test]
fn the_first_frames_train_where_the_others_are_lost() {
    let scratch = Scratch::with_room();
    let read = |name: &str| scratch.bytes(name);
    let lost: Vec<_> = fs::read_dir(scratch.path("room/train")).unwrap().flatten().collect();
    for file in lost.iter().map(fs::DirEntry::path) {
        let name = file.file_name().unwrap().to_str().unwrap().to_owned();
        if !name.starts_with("r_0") && !name.starts_with("r_1") {
            fs::write(&file, "lost").unwrap();
        }
    }
    scratch.run(&format!("{TRAIN} --out two --max-frames 2")).succeeds();
    scratch.run(&format!("{TRAIN} --out one --max-frames 1")).succeeds();
    let resume = "train room --out on --resume one/checkpoint.vbgs --max-frames 2";
    scratch.run(resume).succeeds();
    assert!(read("on/scene.ply") == read("two/scene.ply"));
}

/// Merging moves sums to other seeds: rounding must not produce moments that no points can have.
#[test]
fn what_a_small_budget_writes_is_read_back() {
    let scratch = Scratch::empty();
    scratch
        .run("synth s --layout seven-scenes --size 160x120 --frames 3 --eval-frames 1")
        .succeeds();
    for budget in [100, 300, 1000] {
        scratch.run(&format!("train s --out b --budget {budget}")).succeeds();
        let info = scratch.run("info b/checkpoint.vbgs --json").succeeds().json();
        assert_eq!(info["frames"], 3, "{info}");
    }
    scratch.run("export b/checkpoint.vbgs -o again.ply").succeeds();
}

#[test]
fn scene_settings_out_of_range_are_wrong_usage() {
    let scratch = Scratch::with_room();
    fs::write(scratch.path("none.ron"), "(budget: \"0\")").unwrap();
    for (option, parts) in [
        ("--budget 0", &["budget (`--budget`): expected 1 to 20000000 components", "found 0"][..]),
        ("--budget 20000001", &["budget (`--budget`): ", "found 20000001"]),
        ("--config none.ron", &["budget (`--budget`): ", "found 0"]),
        ("--scale 0", &["--scale", "'0'"]),
    ] {
        scratch.run(&format!("{TRAIN} --out out {option}")).fails(2, parts);
    }
}
