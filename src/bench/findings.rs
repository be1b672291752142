//! What every bench is asked, what can go wrong, and the forms its findings take.
//!
//! A bench hands over its rows once; table, JSON, CSV and notes are formed from them here, so that
//! no two forms of one run can differ. The machine stands in each of them: a time means nothing
//! without it.

use crate::bench::peers::PeerError;
use crate::bench::plot::draw::PlotError;
use crate::dataset::synthetic::ParamsError;
use crate::eval::report;
use crate::eval::report::MachineReport;
use crate::eval::views::EvalError;
use crate::math::image::RgbImage;
use crate::pipeline::error::SessionError;
use crate::pipeline::prefetch::SpawnError;
#[cfg(feature = "gui")]
use crate::render::gpu::headless::HeadlessError;
use crate::train::candidates::IndexError;
use crate::train::setting::ConfigError;
use serde::Serialize;
use std::path::PathBuf;

/// Version tag of every bench's JSON.
pub const BENCH_FORMAT: &str = "vbgs-bench/1";

/// What a user may ask of every bench.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct BenchOptions {
    /// Less of everything: done within a minute on two cores.
    pub quick: bool,
    /// Frames at most.
    pub max_frames: Option<usize>,
    /// Runs of every configuration.
    pub repeats: Option<usize>,
    /// Seed of every random stream.
    pub seed: u64,
}

/// Why a bench gives no result.
#[derive(Debug, thiserror::Error)]
pub enum BenchError {
    /// The dataset cannot be trained on.
    #[error("{0}")]
    Session(#[from] SessionError),
    /// The decoding thread did not start.
    #[error("{0}")]
    Spawn(#[from] SpawnError),
    /// The synthetic scene cannot be made as asked.
    #[error("{0}")]
    Scene(#[from] ParamsError),
    /// A setting is out of its range.
    #[error("{0}")]
    Config(#[from] ConfigError),
    /// The candidate index cannot be built.
    #[error("{0}")]
    Index(#[from] IndexError),
    /// The held-out views cannot be measured.
    #[error("{0}")]
    Eval(#[from] EvalError),
    /// The plot cannot be drawn.
    #[error("{0}")]
    Plot(#[from] PlotError),
    /// The rows cannot be written as CSV.
    #[error("writing the rows as CSV failed: {0}")]
    Csv(#[from] csv::Error),
    /// The result cannot be written as JSON.
    #[error("writing the result as JSON failed: {0}")]
    Json(#[from] serde_json::Error),
    /// A program to compare with does not work.
    #[error("{0}")]
    Peer(#[from] PeerError),
    /// A pool of so many threads does not start.
    #[error("starting {threads} threads failed: {reason}; close other programs and try again")]
    Threads {
        /// Threads asked for.
        threads: usize,
        /// What the system said.
        reason: String,
    },
    /// No graphics adapter answers, or it fails.
    #[cfg(feature = "gui")]
    #[error("{0}")]
    Gpu(#[from] HeadlessError),
    /// The settings found cannot be written as RON.
    #[error("writing the settings as RON failed: {0}")]
    Ron(#[from] ron::Error),
    /// No combination of widths is good enough.
    #[error(
        "bound: expected a bound that f64 operations on f32 points keep, at least {best:.1e}, found {bound:e}; choose a larger one"
    )]
    Bound {
        /// What was asked for.
        bound: f64,
        /// Least error of any combination.
        best: f64,
    },
    /// A file of the bench's own cannot be read or written.
    #[error("{}: {source}; check the folder and its permissions", path.display())]
    File {
        /// The file or folder.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// No scene to train on.
    #[error(
        "{}: expected folders of scenes with depth, found none; the first problem: {first}",
        folder.display()
    )]
    NoScene {
        /// The folder that was looked through.
        folder: PathBuf,
        /// Why its first folder was left out.
        first: String,
    },
    /// Nothing to train on.
    #[error(
        "{dataset}: expected at least one usable frame, found none; the first problem: {first}"
    )]
    NoFrame {
        /// Name of the dataset.
        dataset: String,
        /// Message of the first frame that failed.
        first: String,
    },
}

/// Told after every step: steps done, steps in all.
pub type Progress<'a> = &'a mut dyn FnMut(usize, usize);

/// The result of a bench, ready to be printed and written.
pub struct Bench {
    /// Stem of its files.
    pub name: &'static str,
    /// The notes and the table, as printed.
    pub text: String,
    /// The result as written to the JSON file, with its version tag.
    pub json: serde_json::Value,
    /// The rows as comma-separated values under a header.
    pub csv: String,
    /// The rows drawn, as written to the PNG file.
    pub plot: RgbImage,
}

/// The JSON of a bench.
#[derive(Serialize)]
struct BenchReport<'a, R, S> {
    format: &'static str,
    bench: &'static str,
    dataset: &'a str,
    machine: MachineReport,
    options: BenchOptions,
    notes: &'a [String],
    rows: &'a [R],
    summary: S,
}

/// What a bench found, before it is put into forms.
pub(super) struct Findings<'a, R, S> {
    pub name: &'static str,
    pub dataset: &'a str,
    /// The graphics adapter that drew, if one did.
    pub adapter: Option<String>,
    pub options: BenchOptions,
    /// What the numbers mean and where they were scaled.
    pub notes: Vec<String>,
    pub rows: Vec<R>,
    /// What follows from the rows.
    pub summary: S,
    /// The rows for people.
    pub table: String,
    pub plot: RgbImage,
}

impl<R: Serialize, S: Serialize> Findings<'_, R, S> {
    pub fn into_bench(self) -> Result<Bench, BenchError> {
        let machine = report::describe(self.adapter);
        let MachineReport { threads, cpu, simd, adapter } = &machine;
        let adapter = adapter.as_ref().map_or_else(String::new, |name| format!("; {name}"));
        let place = format!("{}, {threads} threads, {cpu}, {simd}{adapter}", self.dataset);
        let said = [place, self.table].into_iter().chain(self.notes.iter().cloned());
        let text = said.collect::<Vec<_>>().join("\n");
        // Table and JSON say the machine and the notes alike: a number without them means nothing.
        let report = BenchReport {
            format: BENCH_FORMAT,
            bench: self.name,
            dataset: self.dataset,
            machine,
            options: self.options,
            notes: &self.notes,
            rows: &self.rows,
            summary: self.summary,
        };
        let json = serde_json::to_value(report)?;
        Ok(Bench { name: self.name, text, json, csv: csv(&self.rows)?, plot: self.plot })
    }
}

/// Comma-separated values under a header of the field names; rows must be flat.
pub(super) fn csv(rows: &[impl Serialize]) -> Result<String, csv::Error> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    for row in rows {
        writer.serialize(row)?;
    }
    let bytes = writer.into_inner().map_err(|e| e.into_error())?;
    Ok(String::from_utf8_lossy(&bytes).into_owned())
}
