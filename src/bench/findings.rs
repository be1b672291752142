//! Options, errors and outputs shared by all benches.
//!
//! A bench computes its rows once. Table, JSON, CSV and notes are all derived from them, so the
//! outputs of one run cannot disagree. Table and JSON state the machine, because a time is
//! meaningless without it.

use crate::dataset::error::{DatasetError, FrameError};
use crate::dataset::synthetic::ParamsError;
use crate::dataset::synthetic::write::WriteError;
use crate::eval::report;
use crate::eval::report::MachineReport;
use crate::eval::views::EvalError;
use crate::export::error::ExportError;
use crate::math::image::RgbImage;
use crate::pipeline::error::SessionError;
use crate::pipeline::prefetch::SpawnError;
#[cfg(feature = "gui")]
use crate::render::gpu::headless::HeadlessError;
use crate::train::candidates::IndexError;
use crate::train::setting::ConfigError;
use serde::Serialize;
use serde_json::json;
use std::path::PathBuf;

pub const BENCH_FORMAT: &str = "vbgs-bench/1";

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct BenchOptions {
    /// True to reduce all sizes, so that a bench takes less than a minute on two cores.
    pub quick: bool,
    pub max_frames: Option<usize>,
    pub repeats: Option<usize>,
    pub seed: u64,
}

#[derive(Debug, thiserror::Error)]
pub enum BenchError {
    #[error("{0}")]
    Session(#[from] SessionError),
    #[error("{0}")]
    Spawn(#[from] SpawnError),
    #[error("{0}")]
    Scene(#[from] ParamsError),
    #[error("{0}")]
    Config(#[from] ConfigError),
    #[error("{0}")]
    Index(#[from] IndexError),
    #[error("{0}")]
    Eval(#[from] EvalError),
    #[error("{0}")]
    Dataset(#[from] DatasetError),
    #[error("{0}")]
    Frame(#[from] FrameError),
    #[error("writing a synthetic recording failed: {0}")]
    Recording(#[from] WriteError),
    #[error(
        "counting instructions with valgrind failed: {0}; install it, such as by `apt-get install valgrind`"
    )]
    Counter(String),
    #[error(
        "{}: expected the columns {expected}, found {found}; name another file to begin a new history",
        file.display()
    )]
    Columns { file: PathBuf, expected: String, found: String },
    #[error("drawing the plot `{title}` failed: {reason}")]
    Plot { title: String, reason: String },
    #[error("reading or writing rows as CSV failed: {0}")]
    Csv(#[from] csv::Error),
    #[error("writing the result as JSON failed: {0}")]
    Json(#[from] serde_json::Error),
    #[error("{0}")]
    Write(#[from] ExportError),
    #[error("starting {threads} threads failed: {reason}; close other programs and retry")]
    Threads { threads: usize, reason: String },
    #[cfg(feature = "gui")]
    #[error("{0}")]
    Gpu(#[from] HeadlessError),
    #[error("writing the settings as RON failed: {0}")]
    Ron(#[from] ron::Error),
    #[error(
        "bound (`--bound`): expected at least {best:.1e}, the error of f64 operations on f32 points, found {bound:e}; choose a larger bound"
    )]
    Bound { bound: f64, best: f64 },
    #[error("{}: {source}; check the folder and its permissions", path.display())]
    File { path: PathBuf, source: std::io::Error },
    #[error(
        "{}: expected folders of scenes with depth, found none; the first problem: {first}",
        folder.display()
    )]
    NoScene { folder: PathBuf, first: String },
    #[error(
        "{dataset}: expected at least one usable frame, found none; the first problem: {first}"
    )]
    NoFrame { dataset: String, first: String },
}

/// Progress callback. Its arguments are the number of steps done and the total number of steps.
pub type Progress<'a> = &'a mut dyn FnMut(usize, usize);

/// Returns a callback that reports one more completed step, of `n` in total, at each call.
pub(super) fn steps(progress: Progress, n: usize) -> impl FnMut() {
    let mut done = 0;
    move || {
        done += 1;
        progress(done, n);
    }
}

pub struct Bench {
    pub name: &'static str,
    /// Text for the terminal: machine, table and notes.
    pub text: String,
    pub json: serde_json::Value,
    pub csv: String,
    pub plot: RgbImage,
}

pub(super) struct Findings<'a, R, S> {
    pub name: &'static str,
    pub dataset: &'a str,
    pub adapter: Option<String>,
    pub options: BenchOptions,
    pub notes: Vec<String>,
    pub rows: Vec<R>,
    pub summary: S,
    pub table: String,
    pub plot: RgbImage,
}

impl<R: Serialize, S: Serialize> Findings<'_, R, S> {
    pub fn into_bench(self) -> Result<Bench, BenchError> {
        let Self { name, dataset, options, notes, rows, summary, .. } = self;
        let machine = report::describe(self.adapter);
        let MachineReport { threads, cpu, simd, adapter } = &machine;
        // Only frames drawn on a GPU depend on an adapter.
        let adapter = adapter.as_ref().map_or_else(String::new, |name| format!("; {name}"));
        let place = format!("{dataset}, {threads} threads, {cpu}, {simd}{adapter}");
        let text = [&[place, self.table][..], &notes].concat().join("\n");
        // Table and JSON both state machine and notes: numbers are meaningless without them.
        let json = json!({
            "format": BENCH_FORMAT,
            "bench": name,
            "dataset": dataset,
            "machine": machine,
            "options": options,
            "notes": notes,
            "rows": serde_json::to_value(&rows)?,
            "summary": serde_json::to_value(summary)?,
        });
        Ok(Bench { name, text, json, csv: csv(&rows)?, plot: self.plot })
    }
}

/// Formats rows as CSV with a header of field names. Fields of a row must not be nested.
fn csv(rows: &[impl Serialize]) -> Result<String, csv::Error> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    for row in rows {
        writer.serialize(row)?;
    }
    // Flushes: the last rows may still be in the writer's buffer.
    let bytes = writer.into_inner().map_err(|e| e.into_error())?;
    // Loses nothing: all cells are formatted from UTF-8 strings.
    Ok(String::from_utf8_lossy(&bytes).into_owned())
}

/// Column of a table: its header, and a function that formats the cell of a row.
pub(super) type Column<'a, R> = (&'a str, fn(&R) -> String);

pub(super) fn table<R, const N: usize>(rows: &[R], columns: [Column<'_, R>; N]) -> String {
    let cells = |row: &R| columns.map(|(_, cell)| cell(row));
    report::text(columns.map(|(name, _)| name), &rows.iter().map(cells).collect::<Vec<_>>())
}
