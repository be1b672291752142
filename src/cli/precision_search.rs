//! `precision-search`: finds the cheapest precision of every operation within an error bound.

use super::args::PrecisionSearchArgs;
use super::bench::open;
use super::failure::Failure;
use super::{output, progress};
use vbgs_studio::bench::paper::precision_search;
use vbgs_studio::bench::paper::precision_search::SearchPlan;

pub fn run(args: &PrecisionSearchArgs) -> Result<(), Failure> {
    // Created first, because the plan checks the bound before the dataset is opened.
    let mut plan = SearchPlan::new(args.common.options(args.max_frames), args.bound)?;
    plan.components = args.components.unwrap_or(plan.components);
    let dataset = open(Some(&args.dataset), &args.depth)?;
    let out = &args.common.out;
    output::create_folder(out)?;
    output::check_files(&["precision-search.json", "precision-search.ron"].map(|n| out.join(n)))?;
    let search =
        progress::steps("search", |progress| precision_search::run(&plan, dataset, progress))?;
    output::write_json(&out.join("precision-search.json"), &search.json)?;
    output::write_text(&out.join("precision-search.ron"), &search.ron)?;
    if args.common.json {
        return output::print_json(&search.json);
    }
    output::print_line(&search.text);
    output::print_line(format!(
        "wrote precision-search.json and precision-search.ron to {}; use the latter with `train --preset paper --config`",
        out.display()
    ));
    Ok(())
}
