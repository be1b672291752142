//! Every bench at a tiny size: rows, file contents and plot.

use serde_json::Value;
use std::collections::BTreeSet;
use std::sync::Arc;
use vbgs_studio::bench::findings::{Bench, BenchOptions};
use vbgs_studio::bench::paper::ablation;
use vbgs_studio::bench::paper::ablation::AblationPlan;
use vbgs_studio::bench::paper::pareto;
use vbgs_studio::bench::paper::pareto::ParetoPlan;
use vbgs_studio::bench::paper::precision_search;
use vbgs_studio::bench::paper::precision_search::SearchPlan;
use vbgs_studio::bench::paper::scaling;
use vbgs_studio::bench::paper::scaling::ScalingPlan;
use vbgs_studio::bench::render;
use vbgs_studio::bench::render::{BenchDevice, BenchScene, RenderPlan};
use vbgs_studio::dataset::Dataset;
use vbgs_studio::dataset::synthetic::{self, SyntheticParams};
use vbgs_studio::train::paper::config::{
    Candidates, PaperConfig, PaperOverrides, Precision, ReassignPolicy, UpdateWidth,
};

const OPTIONS: BenchOptions =
    BenchOptions { quick: true, max_frames: Some(3), repeats: Some(2), seed: 3 };

fn room() -> Arc<Dataset> {
    let params = SyntheticParams {
        width: 64,
        height: 48,
        n_train: 6,
        n_eval: 2,
        seed: 3,
        depth_noise: 0.0,
        ..SyntheticParams::demo()
    };
    Arc::new(synthetic::dataset(&params).unwrap())
}

/// Runs a bench and checks that its progress reaches the total.
fn counted<T>(run: impl FnOnce(&mut dyn FnMut(usize, usize)) -> T) -> T {
    let mut last = None;
    let result = run(&mut |done, all| {
        assert!(done <= all, "{done} of {all}");
        last = Some((done, all));
    });
    let (done, all) = last.expect("no progress reported");
    assert_eq!(done, all);
    result
}

fn rows(bench: &Bench) -> Vec<Value> {
    bench.json["rows"].as_array().unwrap().clone()
}

fn number(row: &Value, field: &str) -> f64 {
    row[field].as_f64().unwrap_or_else(|| panic!("`{field}` is not a number: {row}"))
}

/// Checks the JSON header, that the CSV holds the same rows, and that the plot has marks and text.
fn check_forms(bench: &Bench, fields: &[&str]) {
    assert_eq!(bench.json["format"], "vbgs-bench/1");
    assert_eq!(bench.json["bench"], bench.name);
    assert!(bench.json["machine"]["threads"].as_u64().unwrap() >= 1);
    assert!(!bench.json["notes"].as_array().unwrap().is_empty());
    let rows = rows(bench);
    let mut csv = csv::Reader::from_reader(bench.csv.as_bytes());
    let header: BTreeSet<String> = csv.headers().unwrap().iter().map(str::to_owned).collect();
    assert_eq!(header, rows[0].as_object().unwrap().keys().cloned().collect());
    for field in fields {
        assert!(header.contains(*field), "{}: no `{field}` in {header:?}", bench.name);
    }
    assert_eq!(csv.records().map(Result::unwrap).count(), rows.len());
    assert_eq!((bench.plot.width, bench.plot.height), (1200, 800));
    let pixels = bench.plot.to_rgb8();
    let drawn = pixels.chunks(3).filter(|p| **p != [255; 3]).count() as f64 / (1200.0 * 800.0);
    assert!((0.01..0.3).contains(&drawn), "{}: marks cover a share of {drawn}", bench.name);
    let colors: BTreeSet<&[u8]> = pixels.chunks(3).collect();
    assert!(colors.len() > 20, "{}: {} colours: no text and marks", bench.name, colors.len());
}

fn check_times(row: &Value) {
    let [ms, low, high] = ["ms", "ms_q1", "ms_q3"].map(|field| number(row, field));
    assert!(0.0 < low && low <= ms && ms <= high, "{row}");
}

#[test]
fn ablation() {
    let plan = AblationPlan {
        components: 300,
        views: 1,
        dense_pairs: 300 * 256,
        ..AblationPlan::new(OPTIONS)
    };
    let bench = counted(|progress| ablation::run(&plan, room(), progress)).unwrap();
    check_forms(&bench, &["configuration", "points_share", "ms", "psnr", "e_step_ms"]);
    let rows = rows(&bench);
    assert_eq!(rows.len(), 7);
    rows.iter().for_each(check_times);
    let named = |part: &str| {
        let is_named = |r: &&Value| r["configuration"].as_str().unwrap().contains(part);
        rows.iter().find(is_named).unwrap_or_else(|| panic!("no row `{part}`"))
    };
    // Assignments are hard: the points and the moves decide the quality, not how they are computed.
    let dense = named("dense E-step");
    assert!(number(dense, "points_share") < 0.2, "{dense}");
    assert_eq!(number(dense, "psnr"), number(named("same points"), "psnr"));
    assert_eq!(number(named("fused kernels"), "points_share"), 1.0);
    assert!(number(named("forwarded"), "used") > number(named("fused kernels"), "used"));
    assert!(bench.text.contains("scaled to all points"), "{}", bench.text);
}

#[test]
fn pareto() {
    let base = PaperOverrides {
        components: Some(400),
        // Enough candidates that the truncation error stays below f32 rounding.
        candidates: Some(Candidates::Nearest(64)),
        reassign: Some(ReassignPolicy::Forwarded),
        ..PaperOverrides::default()
    };
    let plan = ParetoPlan {
        base,
        components: vec![50],
        candidates: vec![1],
        precisions: vec![Precision::F64],
        threads: vec![1],
        policies: vec![ReassignPolicy::Off],
        views: 1,
        oracle_pairs: 400 * 200,
        ..ParetoPlan::new(OPTIONS)
    };
    let bench = counted(|progress| pareto::run(&plan, room(), progress)).unwrap();
    let errors = [
        "elbo_diff_max",
        "elbo_diff_mean",
        "total_variation_mean",
        "mean_error_p99",
        "covariance_error_p99",
    ];
    check_forms(&bench, &errors);
    let rows = rows(&bench);
    rows.iter().for_each(check_times);
    let of = |sweep: &str| rows.iter().find(|r| r["sweep"] == sweep).unwrap();
    for field in errors {
        assert!(number(of("base"), field).is_finite());
        assert!(
            number(of("precision"), field) <= number(of("base"), field),
            "{field} in f64 exceeds the base: {} {}",
            of("precision"),
            of("base")
        );
    }
    assert!(number(of("precision"), "covariance_error_p99") < 1e-12, "{}", of("precision"));
    assert!(number(of("base"), "covariance_error_p99") > 0.0, "f32 rounds");
    assert!(!bench.json["summary"]["front"].as_array().unwrap().is_empty());
}

#[test]
fn scaling() {
    let plan = ScalingPlan {
        points: vec![1000, 8000],
        components: vec![100, 1000],
        threads: vec![1],
        base_points: 1000,
        base_components: 300,
        ..ScalingPlan::new(OPTIONS)
    };
    let bench = counted(|progress| scaling::run(&plan, progress)).unwrap();
    check_forms(&bench, &["sweep", "points", "components", "threads", "means", "path", "ms"]);
    let rows = rows(&bench);
    rows.iter().for_each(check_times);
    for row in rows.iter().filter(|r| r["path"] == "plain") {
        assert_eq!(number(row, "plain_over_this"), 1.0);
    }
    let many = rows.iter().map(|r| number(r, "points")).fold(0.0, f64::max);
    assert!((7000.0..9000.0).contains(&many), "{many} points, expected about 8000");
    let fits = bench.json["summary"]["fits"].as_array().unwrap();
    assert_eq!(fits.len(), 12, "three sweeps with four lines each");
    let points = fits.iter().find(|f| f["sweep"] == "points" && f["path"] == "plain").unwrap();
    // The value depends on the load of the machine.
    assert!(number(points, "exponent").is_finite(), "{points}");
}

#[test]
fn render_times_both_renderers_at_every_size() {
    let scene = BenchScene::synthetic();
    let plan = RenderPlan {
        splats: vec![100, 3000],
        sizes: vec![[64, 48], [160, 120]],
        device: BenchDevice::Cpu,
        ..RenderPlan::new(OPTIONS, &scene)
    };
    let bench = counted(|progress| render::run(&plan, &scene, progress)).unwrap();
    check_forms(&bench, &["path", "renderer", "splats", "width", "ms", "draw_ms", "skipped"]);
    let rows = rows(&bench);
    assert_eq!(rows.len(), 8);
    rows.iter().for_each(check_times);
    for row in &rows {
        assert_eq!((&row["path"], &row["frames"]), (&"cpu".into(), &2.into()), "{row}");
        assert!(row["skipped"].is_null(), "{row}");
    }
    assert!(bench.json["machine"]["adapter"].is_null());
}

/// Runs on any adapter, including a software one.
#[cfg(feature = "gui")]
#[test]
fn render_times_a_gpu_and_says_what_does_not_fit_it() {
    use crate::common::adapter::{turn, vulkan};
    let _turn = turn();
    let Some(adapter) = vulkan() else { return };
    let name = adapter.get_info().name;
    // No adapter allows textures of more than 32,768 pixels a side.
    let (fits, too_wide) = ([64, 48], [65_536, 1]);
    let scene = BenchScene::synthetic();
    let plan = RenderPlan {
        splats: vec![100, 3000],
        sizes: vec![fits, too_wide],
        device: BenchDevice::Gpu,
        adapter: Some(name.clone()),
        ..RenderPlan::new(OPTIONS, &scene)
    };
    let bench = counted(|progress| render::run(&plan, &scene, progress)).unwrap();
    let rows = rows(&bench);
    // Two renderers, two numbers of splats, two sizes.
    assert_eq!(rows.len(), 8);
    for row in &rows {
        assert_eq!(row["path"], "gpu");
        if row["width"] == fits[0] {
            check_times(row);
            assert!(row["skipped"].is_null() && number(row, "sort_ms") >= 0.0, "{row}");
        } else {
            assert!(row["ms"].is_null() && row["frames"] == 0, "{row}");
            assert!(row["skipped"].as_str().unwrap().contains("65536x1"), "{row}");
        }
    }
    assert!(bench.text.contains("skipped, "), "{}", bench.text);
    let named = bench.json["machine"]["adapter"].as_str().unwrap().contains(&name);
    assert!(named, "{}", bench.json["machine"]);
}

#[test]
fn precision_search_finds_settings_that_train_takes() {
    let mut plan = SearchPlan::new(OPTIONS, 1e-3).unwrap();
    plan.components = 300;
    let search = counted(|progress| precision_search::run(&plan, room(), progress)).unwrap();
    let options =
        ron::Options::default().with_default_extension(ron::extensions::Extensions::IMPLICIT_SOME);
    let overrides: PaperOverrides = options.from_str(&search.ron).unwrap();
    let config = PaperConfig::paper().with(&overrides).unwrap();
    assert_eq!(config.operations, search.operations);
    assert_eq!(search.json["combinations"].as_array().unwrap().len(), 32);
    assert!(number(&search.json["chosen"]["error"], "covariance_p99") <= 1e-3);
    assert_eq!(number(&search.json["named"][0]["error"], "covariance_max"), 0.0);
    for operation in ["distance", "log-score", "normaliser", "moments", "update"] {
        assert!(search.text.contains(operation), "{}", search.text);
    }
}

/// The oracle's own widths are among the combinations, so every bound can be met.
#[test]
fn a_bound_below_every_rounding_leaves_what_equals_the_oracle() {
    let mut plan = SearchPlan::new(OPTIONS, 1e-300).unwrap();
    plan.components = 300;
    let search = precision_search::run(&plan, room(), &mut |_, _| ()).unwrap();
    assert_eq!(search.operations.update, UpdateWidth::Fixed128);
    for field in ["mean_p99", "covariance_p99"] {
        assert_eq!(number(&search.json["chosen"]["error"], field), 0.0, "{field}");
    }
    for bound in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        assert_eq!(SearchPlan::new(OPTIONS, bound).unwrap_err().setting, "bound (`--bound`)");
    }
}
