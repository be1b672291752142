//! Evaluation away from the camera path: `--hold-out sector`.

use super::runner::Scratch;
use serde_json::Value;

const TRAIN: &str = "train room --preset paper --set components=500";

/// Creates a recording `room` of 20 training and 3 evaluation frames.
fn recording() -> Scratch {
    let scratch = Scratch::empty();
    scratch.run("synth room --size 64x48 --frames 20 --eval-frames 3").succeeds();
    scratch
}

/// Group, split and number of views of every entry.
fn groups(entries: &Value) -> Vec<(&str, &str, u64)> {
    let mut found = Vec::new();
    for entry in entries.as_array().unwrap() {
        let [name, split] = ["group", "split"].map(|key| entry[key].as_str().unwrap_or("none"));
        found.push((name, split, entry["views"].as_u64().unwrap()));
    }
    found
}

const BOTH: [(&str, &str, u64); 2] = [("new views", "train", 2), ("from the side", "train", 6)];

#[test]
fn both_groups_are_measured_at_the_end_and_again_by_eval() {
    let scratch = recording();
    let run = scratch.run(&format!("{TRAIN} --out out --hold-out sector")).succeeds();
    let held_out = "note: held out for evaluation: a sector of a recording: 10 of 20 frames train";
    assert!(run.stderr.contains(held_out), "{}", run.stderr);
    for group in ["new views: projected on 2 views", "from the side: projected on 6 views"] {
        assert!(run.stdout.contains(group), "{}", run.stdout);
    }
    let report = scratch.json("out/report.json");
    assert_eq!(report["config"]["hold_out"], "sector");
    assert_eq!(
        (report["frames"].as_array().unwrap().len(), groups(&report["eval"])),
        (10, BOTH.to_vec())
    );

    // A checkpoint stores the rule; splats need the option.
    let of_run = scratch.run("eval out/checkpoint.vbgs room --json").succeeds().json();
    let of_splats = scratch.run("eval out/scene.ply room --hold-out sector --json").succeeds();
    for found in [&of_run, &of_splats.json()] {
        assert_eq!(groups(&found["eval"]), BOTH);
        for (group, views) in [("new views", vec![0, 8]), ("from the side", (14..20).collect())] {
            let mine = found["views"].as_array().unwrap().iter().filter(|v| v["group"] == group);
            assert_eq!(mine.map(|v| v["index"].as_u64().unwrap()).collect::<Vec<_>>(), views);
        }
    }
    for (again, entry) in [0, 1].map(|i| (&of_run["eval"][i], &report["eval"][i])) {
        assert_eq!((&again["psnr_mean"], &again["learnt_views"]), (&entry["psnr_mean"], &0.into()));
    }
    let other = "eval out/checkpoint.vbgs room --hold-out every-8th --json";
    let other = scratch.run(other).succeeds().json();
    assert_eq!(groups(&other["eval"]), [("new views", "eval", 3)]);
    // Together with a split that is chosen by name.
    let named = format!("{TRAIN} --out named --hold-out sector --eval eval");
    scratch.run(&named).succeeds();
    let named = scratch.json("named/report.json");
    assert_eq!(groups(&named["eval"]), [[("none", "eval", 3)].to_vec(), BOTH.to_vec()].concat());
}

#[test]
fn a_run_that_goes_on_keeps_its_sector() {
    let scratch = recording();
    scratch.run(&format!("{TRAIN} --out whole --hold-out sector")).succeeds();
    scratch.run(&format!("{TRAIN} --out half --hold-out sector --max-frames 4")).succeeds();
    let resume = "train room --out on --resume half/checkpoint.vbgs --max-frames 20";
    scratch.run(resume).succeeds();
    assert!(scratch.bytes("on/scene.ply") == scratch.bytes("whole/scene.ply"));
    let report = scratch.json("on/report.json");
    assert_eq!(report["config"]["hold_out"], "sector");
    assert_eq!(groups(&report["eval"]), BOTH);
    let parts = ["hold out (`--hold-out`): expected sector", "found every-8th"];
    scratch.run(&format!("{resume} --hold-out every-8th")).fails(2, &parts);
    scratch.run(&format!("{TRAIN} --out plain --max-frames 3")).succeeds();
    let plain = scratch.json("plain/report.json");
    assert_eq!((&plain["config"]["hold_out"], groups(&plain["eval"])), (&Value::Null, vec![]));
}

#[test]
fn what_leaves_too_few_views_is_refused() {
    let scratch = Scratch::empty();
    scratch.run("synth room --size 64x48 --frames 4 --eval-frames 0").succeeds();
    let train = format!("{TRAIN} --out out");
    let parts = ["--hold-out sector", "found 1, 1 and 1", "a recording, 4 frames", "longer"];
    scratch.run(&format!("{train} --hold-out sector")).fails(1, &parts);
    scratch.run(&format!("{train} --hold-out half")).fails(2, &["'half'", "--hold-out"]);
    let parts = ["hold-out", "every-8th with follow", "found sector"];
    scratch.run(&format!("{train} --follow --hold-out sector")).fails(2, &parts);
    assert!(!scratch.path("out").exists(), "no output is written");
    scratch.run("synth other --size 64x48 --frames 8 --eval-frames 1").succeeds();
    scratch.run("train other --preset paper --set components=100 --out out").succeeds();
    let both = "eval out/scene.ply other --split eval --hold-out sector";
    scratch.run(both).fails(2, &["--hold-out", "--split"]);
}
