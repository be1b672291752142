//! `bench` and `precision-search` as a user runs them.

use super::runner::Scratch;

#[test]
fn a_bench_writes_three_files_and_prints_its_table() {
    let scratch = Scratch::with_room();
    let options = "--quick --max-frames 2 --repeats 1 --out found";
    let run = scratch.run(&format!("bench pareto room {options}")).succeeds();
    assert!(run.stdout.contains("ms/frame") && run.stdout.contains("PSNR"), "{}", run.stdout);
    assert!(run.stdout.contains("wrote pareto.json, pareto.csv and pareto.png"), "{}", run.stdout);
    let json = scratch.json("found/pareto.json");
    assert_eq!(json["options"]["max_frames"], 2);
    let lines = scratch.bytes("found/pareto.csv").iter().filter(|b| **b == b'\n').count();
    assert_eq!(lines, json["rows"].as_array().unwrap().len() + 1);
    let plot = image::load_from_memory(&scratch.bytes("found/pareto.png")).unwrap().to_rgb8();
    assert_eq!(plot.dimensions(), (1200, 800));
    assert!(plot.pixels().any(|p| p.0 == [0, 114, 178]), "a mark of the first series");
    let printed = scratch.run(&format!("bench pareto room {options} --json")).succeeds().json();
    assert_eq!(printed["bench"], "pareto");
}

#[test]
fn the_precision_found_is_what_train_uses() {
    let scratch = Scratch::with_room();
    let options = "--quick --components 300 --max-frames 2 --repeats 1 --out found";
    let run = scratch.run(&format!("precision-search room {options}")).succeeds();
    assert!(run.stdout.contains("train --config"), "{}", run.stdout);
    scratch.run("train room --out out --config found/precision-search.ron").succeeds();
    let chosen = &scratch.json("found/precision-search.json")["chosen"]["operations"];
    assert_eq!(&scratch.json("out/report.json")["config"]["operations"], chosen);
}

#[test]
fn wrong_usage_is_said_before_any_work() {
    let scratch = Scratch::with_room();
    let parts = ["--bound", "expected a positive relative error", "found 0"];
    scratch.run("precision-search room --bound 0").fails(2, &parts);
    let parts = ["none", "expected"];
    scratch.run("bench ablation none").fails(1, &parts);
    assert!(!scratch.path("vbgs-bench").exists(), "nothing is made before the dataset is there");
}
