//! `bench`: tables, files and plots of speed against error.

mod args;

use super::args::DepthArgs;
use super::failure::Failure;
use super::train::announce;
use super::{output, progress};
pub use args::{BenchArgs, CommonArgs};
use args::{BenchName, DatasetBenchArgs};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use vbgs_studio::dataset::{self, Dataset};
use vbgs_studio::pipeline::bench::ablation::{self, AblationPlan};
use vbgs_studio::pipeline::bench::pareto::{self, ParetoPlan};
use vbgs_studio::pipeline::bench::scaling::{self, ScalingPlan};
use vbgs_studio::pipeline::bench::{Bench, BenchError, Progress, stability};
use vbgs_studio::pipeline::demo;

/// Measures as asked.
pub fn run(args: &BenchArgs) -> Result<(), Failure> {
    match &args.bench {
        BenchName::Ablation(args) => on_dataset(args, |dataset, progress| {
            let plan = AblationPlan::new(args.common.options(args.max_frames));
            ablation::run(&plan, dataset, progress)
        }),
        BenchName::Pareto(args) => on_dataset(args, |dataset, progress| {
            let plan = ParetoPlan::new(args.common.options(args.max_frames));
            pareto::run(&plan, dataset, progress)
        }),
        BenchName::Scaling(args) => {
            measure(args, |progress| scaling::run(&ScalingPlan::new(args.options(None)), progress))
        }
        BenchName::Stability(args) => {
            measure(args, |progress| stability::run(args.options(None), progress))
        }
    }
}

fn on_dataset(
    args: &DatasetBenchArgs,
    work: impl FnOnce(Arc<Dataset>, Progress) -> Result<Bench, BenchError>,
) -> Result<(), Failure> {
    let dataset = open(args.dataset.as_deref(), &args.depth)?;
    measure(&args.common, |progress| work(dataset, progress))
}

/// The dataset asked for, else the demo's.
pub fn open(path: Option<&Path>, depth: &DepthArgs) -> Result<Arc<Dataset>, Failure> {
    let Some(path) = path else { return Ok(demo::dataset()?) };
    let dataset = dataset::open(path, &depth.load_options())?;
    announce(&dataset);
    Ok(Arc::new(dataset))
}

fn measure(
    args: &CommonArgs,
    work: impl FnOnce(Progress) -> Result<Bench, BenchError>,
) -> Result<(), Failure> {
    output::create_folder(&args.out)?;
    let bench = progress::steps("bench", work)?;
    let file = |extension: &str| -> PathBuf { args.out.join(bench.name).with_extension(extension) };
    output::write_json(&file("json"), &bench.json)?;
    output::write_text(&file("csv"), &bench.csv)?;
    output::write_png(&file("png"), &bench.plot)?;
    if args.json {
        return output::json(&bench.json);
    }
    output::line(&bench.text);
    let name = bench.name;
    output::line(format!("wrote {name}.json, {name}.csv and {name}.png to {}", args.out.display()));
    Ok(())
}
