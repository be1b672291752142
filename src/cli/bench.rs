//! `bench`: measures speed, error and size; writes tables, files and plots.

use super::args::{
    BenchName, CommonArgs, DatasetBenchArgs, HistoryArgs, PrecisionSearchArgs, ReadArgs,
    RenderBenchArgs, ReportBenchArgs, ViewsBenchArgs,
};
use super::failure::Failure;
use super::train::print_dataset_notes;
use super::{model, output};
use anyhow::anyhow;
use glam::DVec3;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use vbgs_studio::bench::findings::{Bench, BenchError, BenchOptions, Progress};
use vbgs_studio::bench::history;
use vbgs_studio::bench::history::HistoryPlan;
use vbgs_studio::bench::paper::ablation::AblationPlan;
use vbgs_studio::bench::paper::pareto::ParetoPlan;
use vbgs_studio::bench::paper::precision_search::SearchPlan;
use vbgs_studio::bench::paper::scaling::ScalingPlan;
use vbgs_studio::bench::paper::{ablation, pareto, precision_search, scaling};
use vbgs_studio::bench::protocol::ProtocolPlan;
#[cfg(feature = "gui")]
use vbgs_studio::bench::render::BenchDevice;
use vbgs_studio::bench::render::{BenchScene, RenderPlan};
use vbgs_studio::bench::report::ReportPlan;
use vbgs_studio::bench::scene::views::ViewsPlan;
use vbgs_studio::bench::scene::{AccuracyPlan, retention, views};
use vbgs_studio::bench::{protocol, render, report, scene};
use vbgs_studio::dataset;
use vbgs_studio::dataset::Dataset;
use vbgs_studio::export::video::write_png;
use vbgs_studio::pipeline::session::demo_dataset;

pub fn run(bench: &BenchName) -> Result<(), Failure> {
    match bench {
        BenchName::Ablation(args) => on_dataset(args, |dataset, progress| {
            let plan = AblationPlan::new(args.common.options(args.max_frames));
            ablation::run(&plan, dataset, progress)
        }),
        BenchName::Accuracy(args) => on_dataset(args, |dataset, progress| {
            let plan = AccuracyPlan::new(args.common.options(args.max_frames));
            scene::run(&plan, dataset, progress)
        }),
        BenchName::Pareto(args) => on_dataset(args, |dataset, progress| {
            let plan = ParetoPlan::new(args.common.options(args.max_frames));
            pareto::run(&plan, dataset, progress)
        }),
        BenchName::History(args) => run_history(args),
        BenchName::Paper(args) => {
            let plan = ProtocolPlan {
                data: args.data.clone(),
                kept: args.common.out.join("paper"),
                options: args.common.options(args.max_frames),
            };
            check_once("paper", &args.common)?;
            measure(&args.common, |progress| protocol::run(&plan, progress))
        }
        BenchName::Report(args) => run_report(args),
        BenchName::Views(args) => run_views(args),
        BenchName::Retention(args) => {
            check_once("retention", &args.common)?;
            on_dataset(args, |dataset, progress| {
                retention::run(args.common.options(args.max_frames), dataset, progress)
            })
        }
        BenchName::Scaling(args) => {
            // No maximum of frames: it renders its own.
            measure(args, |progress| scaling::run(&ScalingPlan::new(args.options(None)), progress))
        }
        BenchName::Render(args) => {
            let (scene, plan) = render_plan(args)?;
            measure(&args.common, |progress| render::run(&plan, &scene, progress))
        }
    }
}

fn run_history(args: &HistoryArgs) -> Result<(), Failure> {
    if let Some(kernel) = args.kernel {
        return Ok(kernel.run(args.times)?);
    }
    let HistoryArgs { data, file, commit, compiler, .. } = args.clone();
    let plan = HistoryPlan { data, file, commit, compiler };
    let file = &plan.file;
    let found = output::steps("bench", |progress| history::run(&plan, progress))?;
    out!("{}", found.line.trim_end());
    if let Some(reason) = &found.uncounted {
        note!("warning: {reason}");
    }
    if !found.worse.is_empty() {
        let worse = found.worse.join("; ");
        return Err(failed!(
            "{}: expected no instruction count 3 % and no PSNR .05 dB worse than in the last line, found {worse}; if that is intended, append the printed line",
            file.display()
        ));
    }
    out!("appended to {}", file.display());
    match found.uncounted.filter(|_| args.counted) {
        Some(reason) => Err(failed!("--counted: {reason}")),
        None => Ok(()),
    }
}

fn run_views(args: &ViewsBenchArgs) -> Result<(), Failure> {
    check_once("views", &args.common)?;
    let plan = ViewsPlan {
        data: args.data.clone(),
        kept: args.common.out.join("views"),
        options: args.common.options(args.max_frames),
    };
    measure(&args.common, |progress| views::run(&plan, progress))
}

fn run_report(args: &ReportBenchArgs) -> Result<(), Failure> {
    let ReportBenchArgs { data, dataset, out, quick, seed } = args;
    output::create_folder(out)?;
    let page = out.with_extension("md");
    // Checked first: the page must have a place when minutes of work are done.
    output::check_files(std::slice::from_ref(&page))?;
    let plan = ReportPlan {
        data: data.clone(),
        dataset: dataset.clone().unwrap_or_else(|| data.join("lego400")),
        out: out.clone(),
        options: BenchOptions { quick: *quick, max_frames: None, repeats: None, seed: *seed },
    };
    let report = output::steps("bench", |progress| report::run(&plan, progress))?;
    for bench in &report.benches {
        write_files(out, bench)?;
    }
    output::write_text(&page, &report.page)?;
    out!("wrote {} and its tables and plots to {}", page.display(), out.display());
    Ok(())
}

fn check_once(bench: &str, args: &CommonArgs) -> Result<(), Failure> {
    if args.repeats.is_some() {
        return Err(usage!(
            "--repeats: `bench {bench}` trains on the frames once, in order; leave the option out"
        ));
    }
    Ok(())
}

/// Maximum number of image sizes that the plot can show.
const MAX_SIZES: usize = 4;

fn render_plan(args: &RenderBenchArgs) -> Result<(BenchScene, RenderPlan), Failure> {
    let n_sizes = args.size.as_ref().map_or(0, Vec::len);
    if n_sizes > MAX_SIZES {
        return Err(usage!("--size: expected {MAX_SIZES} sizes at most, found {n_sizes}"));
    }
    #[cfg(feature = "gui")]
    if let (BenchDevice::Cpu, Some(adapter)) = (args.device, &args.adapter) {
        return Err(usage!(
            "--adapter: expected --device gpu or all, found --device cpu; leave `{adapter}` out"
        ));
    }
    let scene = match &args.model {
        None => BenchScene::synthetic(),
        Some(path) => scene_of(path)?,
    };
    let plan = RenderPlan::new(args.common.options(None), &scene);
    let plan = RenderPlan {
        splats: args.splats.clone().unwrap_or(plan.splats),
        sizes: args.size.clone().unwrap_or(plan.sizes),
        device: args.device,
        #[cfg(feature = "gui")]
        adapter: args.adapter.clone(),
        ..plan
    };
    Ok((scene, plan))
}

fn scene_of(path: &Path) -> Result<BenchScene, Failure> {
    let model = model::load(path)?;
    let scene = BenchScene::model(
        path.display().to_string(),
        model.up.unwrap_or(DVec3::Z),
        model.splats.into_splats(),
    );
    Ok(scene.ok_or_else(|| {
        anyhow!("{}: expected splats to draw, found none that can be drawn", path.display())
    })?)
}

fn on_dataset(
    args: &DatasetBenchArgs,
    work: impl FnOnce(Arc<Dataset>, Progress) -> Result<Bench, BenchError>,
) -> Result<(), Failure> {
    let dataset = open(args.dataset.as_deref(), &args.depth)?;
    measure(&args.common, |progress| work(dataset, progress))
}

/// Opens the dataset at `path`, or that of the demo if no path is given.
pub fn open(path: Option<&Path>, depth: &ReadArgs) -> Result<Arc<Dataset>, Failure> {
    let Some(path) = path else { return Ok(demo_dataset()?) };
    let dataset = dataset::open(path, &depth.recorded_load_options()?)?;
    print_dataset_notes(&dataset);
    Ok(Arc::new(dataset))
}

fn measure(
    args: &CommonArgs,
    work: impl FnOnce(Progress) -> Result<Bench, BenchError>,
) -> Result<(), Failure> {
    // Checked first: the result of minutes of work must have a place.
    output::create_folder(&args.out)?;
    let bench = output::steps("bench", work)?;
    write_files(&args.out, &bench)?;
    if args.json {
        return output::print_json(&bench.json);
    }
    output::print_line(&bench.text);
    let name = bench.name;
    out!("wrote {name}.json, {name}.csv and {name}.png to {}", args.out.display());
    Ok(())
}

fn write_files(out: &Path, bench: &Bench) -> Result<(), Failure> {
    let file = |extension: &str| -> PathBuf { out.join(bench.name).with_extension(extension) };
    output::write_json(&file("json"), &bench.json)?;
    output::write_text(&file("csv"), &bench.csv)?;
    Ok(write_png(&file("png"), &bench.plot)?)
}

pub fn run_precision_search(args: &PrecisionSearchArgs) -> Result<(), Failure> {
    // Created first, because the plan checks the bound before the dataset is opened.
    let mut plan = SearchPlan::new(args.common.options(args.max_frames), args.bound)?;
    plan.components = args.components.unwrap_or(plan.components);
    let dataset = open(Some(&args.dataset), &args.depth)?;
    let out = &args.common.out;
    output::create_folder(out)?;
    // Checked before the search, so that its result can be written.
    output::check_files(&["precision-search.json", "precision-search.ron"].map(|n| out.join(n)))?;
    let search =
        output::steps("search", |progress| precision_search::run(&plan, dataset, progress))?;
    output::write_json(&out.join("precision-search.json"), &search.json)?;
    output::write_text(&out.join("precision-search.ron"), &search.ron)?;
    if args.common.json {
        return output::print_json(&search.json);
    }
    output::print_line(&search.text);
    out!(
        "wrote precision-search.json and precision-search.ron to {}; use the latter with `train --preset paper --config`",
        out.display()
    );
    Ok(())
}
