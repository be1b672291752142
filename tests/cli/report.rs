//! JSON output: every field, its type, and plausible values.

use super::runner::Scratch;
use serde_json::Value;
use vbgs_studio::export::{ModelFormat, WriteOptions, write};
use vbgs_studio::model::splat::splats::Splat;

/// Fields of `report.json` with one evaluated split: the documented names and those this version adds.
const REPORT: &str = "
config.camera_convention string
config.operations.distance string
config.operations.log_score string
config.operations.moments string
config.operations.normaliser string
config.operations.update string
config.candidates number
config.components number
config.conversion.form string
config.conversion.keep_unused bool
config.conversion.opacity number
config.conversion.scale_factor number
config.depth_range null
config.depth_scale null
config.edge_filter string
config.init string
config.low_elbo_floor number
config.max_frames null
config.order string
config.position_range[][] number
config.position_range_source string
config.precision string
config.preset string
config.reassign string
config.reassign_fraction number
config.seed number
config.shard null
config.split null
config.stride number
dataset.frames number
dataset.height number
dataset.layout string
dataset.path string
dataset.split string
dataset.width number
eval[].antialias null
eval[].background[] number
eval[].color_camera null
eval[].coverage_mean number
eval[].covered_from number
eval[].cracks.frames[].frame string
eval[].cracks.frames[].half_distance.interior number
eval[].cracks.frames[].half_distance.over_01 number
eval[].cracks.frames[].half_distance.over_03 number
eval[].cracks.frames[].training_distance.interior number
eval[].cracks.frames[].training_distance.over_01 number
eval[].cracks.frames[].training_distance.over_03 number
eval[].cracks.half_distance.interior number
eval[].cracks.half_distance.over_01 number
eval[].cracks.half_distance.over_03 number
eval[].cracks.split string
eval[].cracks.training_distance.interior number
eval[].cracks.training_distance.over_01 number
eval[].cracks.training_distance.over_03 number
eval[].cracks.views number
eval[].depth_mae_mean number
eval[].detail_mean.finest number
eval[].detail_mean.second number
eval[].exposure string
eval[].ground_truth string
eval[].learnt_views number
eval[].poses string
eval[].psnr_aligned_covered_mean number
eval[].psnr_aligned_mean number
eval[].psnr_covered_mean number
eval[].psnr_mean number
eval[].psnr_std number
eval[].renderer string
eval[].response null
eval[].scale number
eval[].seen_mean.coverage number
eval[].seen_mean.coverage_interior number
eval[].seen_mean.psnr number
eval[].skipped[]
eval[].split string
eval[].ssim_aligned_mean number
eval[].ssim_mean number
eval[].views number
format string
frames[].born number
frames[].components number
frames[].elbo_mean number
frames[].frame string
frames[].index number
frames[].merged number
frames[].ms.candidates number
frames[].ms.e_step number
frames[].ms.load number
frames[].ms.prepare number
frames[].ms.reassign number
frames[].ms.stats number
frames[].ms.train number
frames[].ms.update number
frames[].points number
frames[].points_dropped number
frames[].reassigned number
frames[].used number
machine.adapter null
machine.cpu string
machine.simd string
machine.threads number
passes.device null
passes.device_frames number
passes.given_up null
passes.open_share number
passes.processor_frames number
passes.trial null
seen[].after_frames number
seen[].coverage number
seen[].coverage_interior number
seen[].psnr number
seen[].renderer string
skipped[]
summary.components number
summary.drawn number
summary.model_bytes number
summary.peak_rss_bytes number
summary.points_per_s number
summary.train_ms_median number
summary.train_ms_p95 number
summary.used number
summary.wall_s number
";

/// Fields of a view in `eval --json`, and the field that names its group.
const VIEW: &str = "
eval[].group string
views[].coverage number
views[].depth_mae number
views[].detail.finest number
views[].detail.second number
views[].frame string
views[].group string
views[].index number
views[].psnr number
views[].psnr_aligned number
views[].psnr_aligned_covered number
views[].psnr_covered number
views[].renderer string
views[].seen.coverage number
views[].seen.coverage_interior number
views[].seen.psnr number
views[].ssim number
views[].ssim_aligned number
";

/// Collects every path of a document with its type; elements of a list share one path.
fn fields(value: &Value, path: &str, found: &mut Vec<String>) {
    match value {
        Value::Object(map) => {
            let dot = if path.is_empty() { "" } else { "." };
            map.iter().for_each(|(key, v)| fields(v, &format!("{path}{dot}{key}"), found));
        }
        Value::Array(list) if list.is_empty() => found.push(format!("{path}[]")),
        Value::Array(list) => list.iter().for_each(|v| fields(v, &format!("{path}[]"), found)),
        Value::Null => found.push(format!("{path} null")),
        Value::Bool(_) => found.push(format!("{path} bool")),
        Value::Number(_) => found.push(format!("{path} number")),
        Value::String(_) => found.push(format!("{path} string")),
    }
}

#[track_caller]
fn assert_fields(value: &Value, expected: &[&str]) {
    let mut found = Vec::new();
    fields(value, "", &mut found);
    found.sort();
    found.dedup();
    let mut expected: Vec<&str> = expected.iter().flat_map(|list| list.trim().lines()).collect();
    expected.sort();
    let missing: Vec<_> = expected.iter().filter(|e| !found.iter().any(|f| f == *e)).collect();
    let added: Vec<_> = found.iter().filter(|f| !expected.contains(&f.as_str())).collect();
    assert!(missing.is_empty() && added.is_empty(), "missing {missing:?}, added {added:?}");
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("expected a number, found {value}"))
}

fn numbers(list: &Value, pick: impl Fn(&Value) -> &Value) -> Vec<f64> {
    list.as_array().unwrap().iter().map(|item| number(pick(item))).collect()
}

#[test]
fn the_report_has_its_fields() {
    let scratch = Scratch::with_room();
    let run = scratch
        .run("train room --out out --preset paper --set components=2000 --eval eval --json")
        .succeeds();
    let report = run.json();
    assert_eq!(report, scratch.json("out/report.json"), "stdout is the file");
    assert_fields(&report, &[REPORT]);
    let eval = scratch.run("eval out/scene.ply room --json").succeeds().json();
    let of_eval: String = REPORT
        .lines()
        // A splat file does not record which views were trained.
        .filter(|l| l.starts_with("eval[]") && !l.contains("learnt_views"))
        .fold(String::new(), |text, line| text + line + "\n");
    assert_fields(&eval, &[&of_eval, VIEW]);
    let (a, b) = (&report["eval"][0]["psnr_mean"], &eval["eval"][0]["psnr_mean"]);
    // The file holds logarithms and logits.
    assert!((number(a) - number(b)).abs() < 1e-3, "in the run {a} dB, from the file {b} dB");
}

/// One entry per renderer, with the options of the exact renderer.
#[test]
fn the_report_names_every_renderer() {
    let scratch = Scratch::with_room();
    scratch.run("train room --out out --preset paper --set components=2000").succeeds();
    let eval = |protocol: &str| {
        let options = format!("--renderer both --protocol {protocol} --json");
        scratch.run(&format!("eval out/scene.ply room {options}")).succeeds().json()
    };
    let (fair, eval) = (eval("composited"), eval("paper"));
    for (entries, settings) in
        [(&fair["eval"], ["footprint", "ray"]), (&eval["eval"], ["reference", "line"])]
    {
        let entries = entries.as_array().unwrap();
        let names: Vec<&Value> = entries.iter().map(|e| &e["renderer"]).collect();
        assert_eq!(names, ["projected", "exact"]);
        assert!(entries[0]["antialias"].is_null() && entries[0]["response"].is_null());
        assert_eq!([&entries[1]["antialias"], &entries[1]["response"]], settings);
        assert!(entries.iter().all(|e| number(&e["depth_mae_mean"]) < 5.0), "{entries:?}");
    }
    let views = eval["views"].as_array().unwrap();
    let of = |renderer: &str| -> Vec<u64> {
        let mine = views.iter().filter(|v| v["renderer"] == renderer);
        mine.map(|v| v["index"].as_u64().unwrap()).collect()
    };
    assert_eq!((of("projected"), of("exact")), (vec![0, 1, 2], vec![0, 1, 2]));
    let exact = scratch.run("eval out/scene.ply room --renderer exact --json").succeeds().json();
    assert_eq!(exact["eval"][0]["renderer"], "exact");
    assert_eq!((exact["eval"].as_array().unwrap().len(), views.len()), (1, 6));
}

#[test]
fn the_reports_numbers_make_sense() {
    let scratch = Scratch::with_room();
    let train =
        "train room --out out --preset paper --set components=2000 --eval eval --json --threads 2";
    let report = scratch.run(train).succeeds().json();
    assert_eq!(report["format"], "vbgs-report/1");
    let dataset = &report["dataset"];
    assert_eq!((&dataset["path"], &dataset["split"]), (&"room".into(), &"train".into()));
    assert_eq!(dataset["frames"], 8);
    assert_eq!((&dataset["width"], &dataset["height"]), (&64.into(), &48.into()));
    assert_eq!(report["machine"]["threads"], 2);
    assert_ne!(report["machine"]["cpu"], "");

    let frames = &report["frames"];
    assert_eq!(numbers(frames, |f| &f["index"]), [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0]);
    let used = numbers(frames, |f| &f["used"]);
    assert!(used.is_sorted() && used[0] > 0.0 && used[7] <= 2000.0, "{used:?}");
    for frame in frames.as_array().unwrap() {
        let (points, dropped) = (number(&frame["points"]), number(&frame["points_dropped"]));
        assert!(points > 1000.0 && points + dropped <= 64.0 * 48.0, "{points} {dropped}");
        assert_eq!(frame["components"], 2000);
        assert!(number(&frame["elbo_mean"]).is_finite());
        let ms = frame["ms"].as_object().unwrap();
        assert!(ms.values().all(|v| number(v) >= 0.0), "{ms:?}");
        let stages = ["candidates", "e_step", "stats", "update", "reassign"];
        let sum: f64 = stages.iter().map(|stage| number(&ms[*stage])).sum();
        let train = number(&ms["train"]);
        assert!(sum > 0.3 * train && sum <= train * 1.001, "stages {sum} ms of {train} ms");
    }

    let summary = &report["summary"];
    let mut train_ms = numbers(frames, |f| &f["ms"]["train"]);
    train_ms.sort_by(f64::total_cmp);
    let median = (train_ms[3] + train_ms[4]) / 2.0;
    assert!((number(&summary["train_ms_median"]) - median).abs() < 1e-9);
    let p95 = number(&summary["train_ms_p95"]);
    assert!(p95 >= median && p95 <= train_ms[7]);
    let points: f64 = numbers(frames, |f| &f["points"]).iter().sum();
    let rate = points / (train_ms.iter().sum::<f64>() * 1e-3);
    assert!((number(&summary["points_per_s"]) / rate - 1.0).abs() < 1e-9);
    assert_eq!(number(&summary["used"]), used[7]);
    assert_eq!(summary["components"], 2000);
    assert!(number(&summary["peak_rss_bytes"]) > number(&summary["model_bytes"]));
    assert!(number(&summary["model_bytes"]) >= 2000.0 * 4.0 * 6.0);
    let wall = number(&summary["wall_s"]);
    assert!(wall * 1e3 >= train_ms.iter().sum::<f64>() && wall < 600.0);

    let eval = &report["eval"][0];
    assert_eq!((&eval["split"], &eval["renderer"]), (&"eval".into(), &"projected".into()));
    assert_eq!(eval["views"], 3);
    assert!((5.0..60.0).contains(&number(&eval["psnr_mean"])), "{eval}");
    assert!((0.0..10.0).contains(&number(&eval["psnr_std"])), "{eval}");
    assert!((-1.0..1.0).contains(&number(&eval["ssim_mean"])), "{eval}");
    for octave in ["finest", "second"] {
        assert!((-1.0..1.0).contains(&number(&eval["detail_mean"][octave])), "{eval}");
    }
    assert!((0.0..=1.0).contains(&number(&eval["coverage_mean"])), "{eval}");
    assert!((0.0..5.0).contains(&number(&eval["depth_mae_mean"])), "{eval}");
    let covered = number(&eval["psnr_covered_mean"]);
    assert!(number(&eval["psnr_aligned_covered_mean"]) > covered, "{eval}");
    let seen = &eval["seen_mean"];
    assert!((5.0..60.0).contains(&number(&seen["psnr"])), "{eval}");
    for share in [&seen["coverage"], &seen["coverage_interior"]] {
        assert!((0.5..=1.0).contains(&number(share)), "{eval}");
    }
    assert_eq!(numbers(&report["seen"], |s| &s["after_frames"]), [1.0]);
    assert!((5.0..60.0).contains(&number(&report["seen"][0]["psnr"])), "{}", report["seen"]);
    let cracks = &eval["cracks"];
    assert_eq!((&cracks["split"], &cracks["views"]), (&"eval".into(), &3.into()));
    for shares in [&cracks["training_distance"], &cracks["half_distance"]] {
        let [interior, over_01, over_03] =
            ["interior", "over_01", "over_03"].map(|name| number(&shares[name]));
        assert!((0.01..=1.0).contains(&interior), "{cracks}");
        assert!(0.0 <= over_03 && over_03 <= over_01 && over_01 <= 1.0, "{cracks}");
    }
}

/// A scene that covers no pixel has no covered PSNR; the report contains null.
#[test]
fn what_cannot_be_measured_is_null() {
    let scratch = Scratch::with_room();
    let far = Splat {
        mean: [0.0, 0.0, 1e4],
        opacity: 0.9,
        scale: [0.1; 3],
        rotation: [1.0, 0.0, 0.0, 0.0],
        ..Splat::default()
    };
    write(&scratch.path("far.ply"), &[far], &WriteOptions::new(ModelFormat::Ply)).unwrap();
    let eval = scratch.run("eval far.ply room --json").succeeds().json();
    let (total, view) = (&eval["eval"][0], &eval["views"][0]);
    assert!(total["psnr_covered_mean"].is_null() && total["depth_mae_mean"].is_null(), "{eval}");
    assert!(total["detail_mean"].is_null() && view["detail"].is_null(), "{eval}");
    let null =
        ["psnr_covered", "psnr_aligned", "psnr_aligned_covered", "ssim_aligned", "depth_mae"];
    assert!(null.iter().all(|name| view[*name].is_null()), "{eval}");
    assert_eq!(number(&total["cracks"]["training_distance"]["over_03"]), 1.0, "{eval}");
    assert_eq!(number(&total["coverage_mean"]), 0.0);
    let said = scratch.run("eval far.ply room").succeeds().stdout;
    assert!(said.contains("nothing covered") && !said.contains("NaN"), "{said}");
}
