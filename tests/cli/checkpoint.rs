//! Resumed runs, merged shards, and checkpoints used as models.

use super::runner::Scratch;
use std::fs;

const TRAIN: &str = "train room --preset paper --set components=2000";

#[test]
fn a_run_goes_on_in_another_process() {
    let scratch = Scratch::with_room();
    for (reassign, threads) in [("off", 1), ("padded", 2), ("forwarded", 1)] {
        let options = format!("--set reassign={reassign} --threads {threads}");
        scratch.run(&format!("{TRAIN} --out whole {options}")).succeeds();
        scratch.run(&format!("{TRAIN} --out half {options} --max-frames 4")).succeeds();
        let resume = "train room --out on --resume half/checkpoint.vbgs --max-frames 8";
        scratch.run(&format!("{resume} --threads {}", 3 - threads)).succeeds();
        assert!(scratch.bytes("on/scene.ply") == scratch.bytes("whole/scene.ply"), "{options}");
    }
    let report = scratch.json("on/report.json");
    assert_eq!(report["frames"].as_array().unwrap().len(), 8);
    assert_eq!(report["config"]["components"], 2000);
    assert_eq!(report["config"]["max_frames"], 8);
    assert_eq!(report["dataset"]["frames"], 8);
}

#[test]
fn a_finished_run_says_that_nothing_is_left() {
    let scratch = Scratch::with_room();
    scratch.run(&format!("{TRAIN} --out out --max-frames 3")).succeeds();
    let scene = scratch.bytes("out/scene.ply");
    let run = scratch.run("train room --out out --resume out/checkpoint.vbgs").succeeds();
    assert!(run.stderr.contains("note: 3 frames are trained already"), "{}", run.stderr);
    assert!(scratch.bytes("out/scene.ply") == scene);
}

#[test]
fn options_that_contradict_the_checkpoint_are_wrong_usage() {
    let scratch = Scratch::with_room();
    scratch.run(&format!("{TRAIN} --out out --max-frames 3")).succeeds();
    fs::write(scratch.path("other.ron"), "(components: 7)").unwrap();
    let before = scratch.bytes("out/checkpoint.vbgs");
    for (options, parts) in [
        (
            "--set components=5",
            &["components: expected 2000", "out/checkpoint.vbgs", "found 5"][..],
        ),
        ("--config other.ron", &["components: expected 2000", "found 7"]),
        ("--set stride=2", &["stride: expected 1", "found 2", "leave it out"]),
        ("--depth-scale 0.5", &["depth scale (`--depth-scale`): expected no value", "found 0.5"]),
    ] {
        let run = format!("train room --out out --resume out/checkpoint.vbgs {options}");
        scratch.run(&run).fails(2, parts);
    }
    let usage = scratch.run("train room --out out --force");
    assert_eq!(usage.code, 2, "{}", usage.stderr);
    scratch.run("train room --out out --resume none.vbgs").fails(1, &["none.vbgs", "spelling"]);
    scratch.run("train room --out out --resume out/scene.ply").fails(1, &["found a PLY file"]);
    assert!(scratch.bytes("out/checkpoint.vbgs") == before);
}

#[test]
fn depth_options_are_kept() {
    let scratch = Scratch::with_room();
    let options = "--set reassign=off --depth-range 0.5 2.0";
    scratch.run(&format!("{TRAIN} --out whole {options}")).succeeds();
    scratch.run(&format!("{TRAIN} --out half {options} --max-frames 2")).succeeds();
    scratch.run("train room --out on --resume half/checkpoint.vbgs --max-frames 8").succeeds();
    assert!(scratch.bytes("on/scene.ply") == scratch.bytes("whole/scene.ply"));
    assert_eq!(
        scratch.json("on/report.json")["config"]["depth_range"],
        serde_json::json!([0.5, 2.0])
    );
}

#[test]
fn another_dataset_needs_force() {
    let scratch = Scratch::with_room();
    scratch.run(&format!("{TRAIN} --out out --max-frames 3")).succeeds();
    scratch.run("synth more --size 64x48 --frames 9 --eval-frames 3").succeeds();
    let train = "train more --out on --resume out/checkpoint.vbgs --max-frames 5";
    let parts = ["out/checkpoint.vbgs", "number of frames (expected 8, found 9)", "--force"];
    scratch.run(train).fails(1, &parts);
    assert!(!scratch.path("on").exists(), "no output is written");
    scratch.run(&format!("{train} --force")).succeeds();
    assert_eq!(scratch.json("on/report.json")["frames"].as_array().unwrap().len(), 5);
}

#[test]
fn scenes_are_merged_onto_the_run_they_went_on_from() {
    let scratch = Scratch::with_room();
    let saved = |out: &str| format!("{out}/checkpoint.vbgs");
    scratch.run("train room --shard 1/4 --out start").succeeds();
    let start = saved("start");
    for k in 1..=2 {
        let shard = format!("--resume {start} --shard {k}/2 --out s{k}");
        scratch.run(&format!("train room {shard}")).succeeds();
    }
    let [a, b] = ["s1", "s2"].map(saved);
    let onto = scratch.run(&format!("merge --start {start} {b} {a} -o all.vbgs"));
    let said = onto.succeeds();
    assert!(said.stdout.contains("wrote all.vbgs: 2 models, 8 frames"), "{}", said.stdout);
    // Two frames do not show the whole room.
    let parts = ["% of the components are not in the start", "--resume all.vbgs --set passes=2"];
    assert!(parts.iter().all(|part| said.stderr.contains(part)), "{}", said.stderr);
    scratch.run("train room --resume all.vbgs --set passes=2 --out again").succeeds();
    scratch.run("info all.vbgs").succeeds();
    scratch.run(&format!("merge {a} {b} -o m.vbgs")).fails(1, &["no frame in both", "--start"]);
    // Runs without a common start are merged, with a warning.
    for k in 1..=2 {
        let shard = format!("--shard {k}/2 --out own{k}");
        scratch.run(&format!("train room {shard}")).succeeds();
    }
    let [c, d] = ["own1", "own2"].map(saved);
    let apart = scratch.run(&format!("merge {c} {d} -o m.vbgs")).succeeds().stderr;
    assert!(apart.contains("a common start") && apart.contains("--start START"), "{apart}");
    let parts = [d.as_str(), &start, "other frames at its beginning"];
    scratch.run(&format!("merge --start {start} {a} {d} -o no.vbgs")).fails(1, &parts);
    scratch.run(&format!("merge --start none.vbgs {a} {b} -o no.vbgs")).fails(1, &["none.vbgs"]);
    assert!(!scratch.path("no.vbgs").exists());
}

#[test]
fn merged_shards_are_the_run_over_all_frames() {
    let scratch = Scratch::with_room();
    scratch.run(&format!("{TRAIN} --out whole --set reassign=off")).succeeds();
    for k in 1..=3 {
        let train = format!("{TRAIN} --out s{k} --set reassign=off --shard {k}/3 --threads {k}");
        scratch.run(&train).succeeds();
    }
    let [a, b, c] = ["s1/checkpoint.vbgs", "s2/checkpoint.vbgs", "s3/checkpoint.vbgs"];
    let said = scratch.run(&format!("merge {c} {a} {b} -o m.vbgs")).succeeds().stdout;
    assert!(said.contains("wrote m.vbgs: 3 models, 8 frames"), "{said}");
    scratch.run("export m.vbgs -o m.ply").succeeds();
    assert!(scratch.bytes("m.ply") == scratch.bytes("whole/scene.ply"));
    let merged = scratch.bytes("m.vbgs");
    let twice = ["expected no frame in both", "found 3", "--shard"];
    scratch.run(&format!("merge {a} {a} -o m.vbgs")).fails(1, &twice);
    scratch.run(&format!("merge m.vbgs {b} -o m.vbgs")).fails(1, &["m.vbgs and s2", "no frame"]);
    scratch.run(&format!("merge {a} none.vbgs -o m.vbgs")).fails(1, &["none.vbgs", "expected"]);
    scratch.run(&format!("merge {a} {b} -o no/m.vbgs")).fails(1, &["folder no does not exist"]);
    assert_eq!(scratch.run(&format!("merge {a} -o m.vbgs")).code, 2);
    assert!(scratch.bytes("m.vbgs") == merged, "a failed merge writes nothing");
    scratch.run(&format!("{TRAIN} --out other --set reassign=padded --shard 2/3")).succeeds();
    let parts = ["setting `reassign`", "\"off\" and \"padded\""];
    scratch.run(&format!("merge {a} other/checkpoint.vbgs -o m.vbgs")).fails(1, &parts);
    let usage = scratch.run(&format!("{TRAIN} --out s --shard 4/3"));
    assert!(usage.code == 2 && usage.stderr.contains("expected K/N"), "{}", usage.stderr);
}

#[test]
fn a_checkpoint_is_a_model() {
    let scratch = Scratch::with_room();
    scratch.run(&format!("{TRAIN} --out out --set covariance_form=legacy-cov")).succeeds();
    // By content, not by name.
    fs::copy(scratch.path("out/checkpoint.vbgs"), scratch.path("scene.glb")).unwrap();
    scratch.run("export scene.glb -o again.ply").succeeds();
    assert!(scratch.bytes("again.ply") == scratch.bytes("out/scene.ply"));
    scratch.run("render scene.glb -o a.png --size 40x30").succeeds();
    scratch.run("render out/scene.ply -o b.png --size 40x30").succeeds();
    assert!(scratch.bytes("a.png") == scratch.bytes("b.png"));
    let eval = |model: &str| {
        let run = scratch.run(&format!("eval {model} room --json")).succeeds();
        run.json()["eval"][0]["psnr_mean"].as_f64().unwrap()
    };
    // A PLY stores scales as logarithms and opacities as logits.
    assert!((eval("scene.glb") - eval("out/scene.ply")).abs() < 1e-3);
}

#[test]
fn damaged_checkpoints_are_refused_everywhere() {
    let scratch = Scratch::with_room();
    scratch.run(&format!("{TRAIN} --out out --max-frames 2")).succeeds();
    let bytes = scratch.bytes("out/checkpoint.vbgs");
    let mut flipped = bytes.clone();
    flipped[bytes.len() / 2] ^= 4;
    fs::write(scratch.path("flipped.vbgs"), flipped).unwrap();
    fs::write(scratch.path("short.vbgs"), &bytes[..bytes.len() / 2]).unwrap();
    let text = [b"\x89VBGS\n\x1a", &bytes[8..]].concat();
    fs::write(scratch.path("text.vbgs"), text).unwrap();
    for (file, part) in [
        ("flipped.vbgs", "the checksum does not match"),
        ("short.vbgs", "the file is cut short"),
        ("text.vbgs", "transfer in text mode"),
    ] {
        for command in [
            format!("info {file}"),
            format!("eval {file} room"),
            format!("render {file} -o a.png"),
            format!("export {file} -o a.ply"),
            format!("merge {file} out/checkpoint.vbgs -o a.vbgs"),
            format!("train room --out on --resume {file}"),
        ] {
            scratch.run(&command).fails(1, &[file, part]);
        }
    }
    for file in ["a.png", "a.ply", "a.vbgs", "on"] {
        assert!(!scratch.path(file).exists());
    }
}
