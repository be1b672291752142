//! The page of benchmarks: every bench on the same machine, in a template of Markdown.
//!
//! Each table states the command that measures it alone, machine and options. A page that is written whole cannot mix
//! figures of two versions.

use super::findings::{Bench, BenchError, BenchOptions, Progress};
use super::paper::ablation::{self, AblationPlan};
use super::paper::pareto::{self, ParetoPlan};
use super::paper::scaling::{self, ScalingPlan};
use super::protocol::{self, ProtocolPlan};
use super::render::{self, BenchScene, RenderPlan};
use super::scene::retention;
use super::scene::views::{self, ViewsPlan};
use crate::dataset::{self, LoadOptions};
use crate::eval::report::describe;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::{SystemTime, UNIX_EPOCH};

/// Markdown whose lines `{{NAME}}` are replaced by the table of a bench.
const TEMPLATE: &str = include_str!("../../assets/benchmarks.md");

#[derive(Clone, Debug)]
pub struct ReportPlan {
    /// Folder of recordings.
    pub data: PathBuf,
    /// Recording on which the published algorithm is timed, and retention measured.
    pub dataset: PathBuf,
    /// Folder of tables and plots, beside which the page lies.
    pub out: PathBuf,
    pub options: BenchOptions,
}

pub struct Report {
    /// The page, Markdown.
    pub page: String,
    pub benches: Vec<Bench>,
}

type Work<'a> = Box<dyn FnOnce(Progress) -> Result<Bench, BenchError> + 'a>;

pub fn run(plan: &ReportPlan, progress: Progress) -> Result<Report, BenchError> {
    let options = plan.options;
    let dataset = Arc::new(dataset::open(&plan.dataset, &LoadOptions::default())?);
    let kept = |name: &str| plan.out.join("kept").join(name);
    let data = format!(" --data {}", plan.data.display());
    let of = format!(" {}", plan.dataset.display());
    let own = || dataset.clone();
    let works: Vec<(&str, Work<'_>)> = vec![
        (&data, {
            let plan = ViewsPlan { data: Some(plan.data.clone()), kept: kept("views"), options };
            Box::new(move |progress| views::run(&plan, progress))
        }),
        (&data, {
            let plan = ProtocolPlan { data: plan.data.clone(), kept: kept("paper"), options };
            Box::new(move |progress| protocol::run(&plan, progress))
        }),
        (&of, Box::new(|progress| ablation::run(&AblationPlan::new(options), own(), progress))),
        (&of, Box::new(|progress| pareto::run(&ParetoPlan::new(options), own(), progress))),
        ("", Box::new(|progress| scaling::run(&ScalingPlan::new(options), progress))),
        (&of, Box::new(|progress| retention::run(options, own(), progress))),
        ("", {
            let scene = BenchScene::synthetic();
            let plan = RenderPlan::new(options, &scene);
            Box::new(move |progress| render::run(&plan, &scene, progress))
        }),
    ];
    let total = works.len();
    let mut benches = Vec::new();
    for (done, (arguments, work)) in works.into_iter().enumerate() {
        // Benches count in steps of their own; the report counts benches.
        benches.push((arguments, work(&mut |_, _| progress(done, total))?));
    }
    let page = page(plan, &benches);
    Ok(Report { page, benches: benches.into_iter().map(|(_, bench)| bench).collect() })
}

/// Fills the template with the benches and the arguments of their commands.
fn page(plan: &ReportPlan, benches: &[(&str, Bench)]) -> String {
    let quick = if plan.options.quick { " --quick" } else { "" };
    let folder = plan.out.file_name().unwrap_or_default().to_string_lossy();
    benches.iter().fold(TEMPLATE.replace("{{machine}}", &place()), |page, (arguments, bench)| {
        let (name, text) = (bench.name, bench.text.trim_end());
        let command = format!("`vbgs-studio bench {name}{arguments}{quick}`");
        let block = format!(
            "{command}\n\n```text\n{text}\n```\n\n![Plot of `bench {name}`]({folder}/{name}.png)"
        );
        page.replace(&format!("{{{{{name}}}}}"), &block)
    })
}

fn place() -> String {
    let machine = describe(None);
    let seconds = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_secs());
    let [year, month, day] = civil_date(seconds / 86_400);
    format!(
        "Version {}, {year}-{month:02}-{day:02}, {} threads of {}, {}",
        env!("CARGO_PKG_VERSION"),
        machine.threads,
        machine.cpu,
        machine.simd
    )
}

/// Returns year, month and day of a day since 1970-01-01 in the Gregorian calendar. Years begin in March, so that the
/// leap day is their last (Hinnant, chrono-Compatible Low-Level Date Algorithms, `civil_from_days`).
fn civil_date(days: u64) -> [u64; 3] {
    let shifted = days + 719_468;
    let (era, of_era) = (shifted / 146_097, shifted % 146_097);
    let year = (of_era - of_era / 1460 + of_era / 36_524 - of_era / 146_096) / 365;
    let of_year = of_era - (365 * year + year / 4 - year / 100);
    let month = (5 * of_year + 2) / 153;
    let day = of_year - (153 * month + 2) / 5 + 1;
    let is_next_year = month >= 10;
    [
        era * 400 + year + u64::from(is_next_year),
        if is_next_year { month - 9 } else { month + 3 },
        day,
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::image::RgbImage;

    const TABLES: [&str; 7] =
        ["views", "paper", "ablation", "pareto", "scaling", "retention", "render"];

    #[test]
    fn every_bench_has_its_place_in_the_page() {
        let options = BenchOptions { quick: true, ..BenchOptions::default() };
        let (data, dataset) = (PathBuf::from("data"), PathBuf::from("data/lego"));
        let plan = ReportPlan { data, dataset, out: PathBuf::from("docs/figures"), options };
        let bench = |name: &'static str| Bench {
            name,
            text: format!("rows of {name}\n"),
            json: serde_json::Value::Null,
            csv: String::new(),
            plot: RgbImage::filled(1, 1, [0.0; 3]),
        };
        let benches = TABLES.map(|name| (" --data data", bench(name)));
        let filled = page(&plan, &benches);
        assert!(!filled.contains("{{"), "a place without a bench: {filled}");
        for name in TABLES {
            let command = format!("`vbgs-studio bench {name} --data data --quick`");
            assert!(
                filled.contains(&format!("{command}\n\n```text\nrows of {name}\n```")),
                "{name}"
            );
            assert!(filled.contains(&format!("(figures/{name}.png)")), "{name}");
        }
    }

    #[test]
    fn days_are_dates() {
        assert_eq!(civil_date(0), [1970, 1, 1]);
        assert_eq!(civil_date(11_016), [2000, 2, 29]);
        assert_eq!(civil_date(11_017), [2000, 3, 1]);
        assert_eq!(civil_date(20_787), [2026, 11, 30]);
    }
}
