//! `precision-search`: the cheapest precision of every operation within an error bound.

use super::args::{DepthArgs, parse_count};
use super::bench::{CommonArgs, open};
use super::failure::Failure;
use super::{output, progress};
use clap::Args;
use std::path::PathBuf;
use vbgs_studio::bench::paper::precision_search;
use vbgs_studio::bench::paper::precision_search::SearchPlan;

#[derive(Args)]
pub struct PrecisionSearchArgs {
    /// Dataset folder
    pub dataset: PathBuf,
    /// Largest relative error of posterior means and covariances against f64 that 99 % of the
    /// evidence may have
    #[arg(long, value_name = "X", default_value_t = 1e-4, allow_negative_numbers = true)]
    pub bound: f64,
    /// Number of components [default: 100000, or 20000 with --quick]
    #[arg(long, value_name = "N", value_parser = parse_count, allow_negative_numbers = true)]
    pub components: Option<usize>,
    /// Sampled frames at most, evenly spaced
    #[arg(long, value_name = "N", value_parser = parse_count, allow_negative_numbers = true)]
    pub max_frames: Option<usize>,
    #[command(flatten)]
    pub common: CommonArgs,
    #[command(flatten)]
    pub depth: DepthArgs,
}

/// Searches as asked.
pub fn run(args: &PrecisionSearchArgs) -> Result<(), Failure> {
    let mut plan = SearchPlan::new(args.common.options(args.max_frames), args.bound)?;
    plan.components = args.components.unwrap_or(plan.components);
    let dataset = open(Some(&args.dataset), &args.depth)?;
    let out = &args.common.out;
    output::create_folder(out)?;
    let search =
        progress::steps("search", |progress| precision_search::run(&plan, dataset, progress))?;
    output::write_json(&out.join("precision-search.json"), &search.json)?;
    output::write_text(&out.join("precision-search.ron"), &search.ron)?;
    if args.common.json {
        return output::json(&search.json);
    }
    output::line(&search.text);
    output::line(format!(
        "wrote precision-search.json and precision-search.ron to {}; use the latter with `train --preset paper --config`",
        out.display()
    ));
    Ok(())
}
