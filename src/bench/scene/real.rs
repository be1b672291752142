//! Quality on recordings of real rooms (`pipeline.md`, Recordings bench): the default preset on
//! every recording of a folder, in one pass. Evaluation uses the standard metrics, and metrics that
//! are robust to pose errors.

use super::training::{Perturbed, Trained, ordered, prepare, train};
use crate::bench::findings::{Bench, BenchError, BenchOptions, Findings, Progress, table};
use crate::bench::folder;
use crate::bench::paper::sample::spaced;
use crate::bench::plot::{self, Axis, Mark, Panel, Series};
use crate::dataset::Dataset;
use crate::dataset::splits::{HoldOut, ViewGroup, ViewGroupName};
use crate::eval::choices::ViewPoses;
use crate::eval::metrics::Spread;
use crate::eval::report::EvalReport;
use crate::eval::views::{EvalOptions, evaluate};
use crate::pipeline::error::SessionError;
use crate::pipeline::plan::{Plan, Selection};
use crate::pipeline::settings::scene::SceneRun;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use std::path::PathBuf;
use std::sync::Arc;

/// Number of frame orders: as listed, reversed, shuffled.
const ORDERS: usize = 3;

#[derive(Clone, Debug)]
pub struct RecordingsPlan {
    /// Folder of recordings: all subfolders that can be opened and have depth.
    pub data: PathBuf,
    pub kept: PathBuf,
    /// `repeats` is the number of frame orders.
    pub options: BenchOptions,
    pub hold_out: HoldOut,
}

/// One group of views of a recording, trained in one order of its frames, or the median of each
/// value over several orders. Values are means over views; PSNR in dB, lengths in world units, angles in
/// degrees. `None` if nothing is covered or there is no depth.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct RecordingRow {
    pub recording: String,
    pub group: Option<ViewGroupName>,
    pub split: String,
    pub frames: usize,
    pub views: usize,
    pub drawn: f64,
    pub train_ms: f64,
    pub prepare_ms: f64,
    // From recorded poses.
    pub psnr: f64,
    pub psnr_covered: Option<f64>,
    pub psnr_aligned_covered: Option<f64>,
    pub ssim: f64,
    pub coverage: f64,
    pub depth_error: Option<f64>,
    // From poses corrected like those of the frames around them.
    pub corrected_psnr: f64,
    pub corrected_psnr_covered: Option<f64>,
    pub corrected_psnr_aligned_covered: Option<f64>,
    // Of another run, in which every tenth recorded pose is moved by 2 cm and rotated by one degree.
    pub perturbed_shift_left: Option<f64>,
    pub perturbed_turn_left: Option<f64>,
    pub perturbed_psnr: f64,
    pub perturbed_psnr_covered: Option<f64>,
    pub perturbed_pose_aligned_psnr_covered: Option<f64>,
    // From poses aligned to the photographs.
    pub pose_shift: Option<f64>,
    pub pose_turn: Option<f64>,
    pub pose_aligned_psnr: Option<f64>,
    pub pose_aligned_psnr_covered: Option<f64>,
    pub pose_aligned_psnr_aligned_covered: Option<f64>,
    pub pose_aligned_ssim_aligned: Option<f64>,
    pub gradient_ssim: Option<f64>,
    // By octave of detail, finest first, relative to the photograph.
    pub energy_1: Option<f64>,
    pub energy_2: Option<f64>,
    pub energy_3: Option<f64>,
    pub energy_4: Option<f64>,
    pub correlation_1: Option<f64>,
    pub correlation_2: Option<f64>,
    pub correlation_3: Option<f64>,
    pub correlation_4: Option<f64>,
}

pub fn run(plan: &RecordingsPlan, progress: Progress) -> Result<Bench, BenchError> {
    let (recordings, left_out) = folder::scenes(&plan.data)?;
    folder::make(&plan.kept)?;
    let n_orders = plan.options.repeats.unwrap_or(if plan.options.quick { 1 } else { ORDERS });
    let (mut rows, mut orders) = (Vec::new(), Vec::new());
    // Create all runs first: a recording too short for a sector fails before hours of work.
    let runs = recordings.iter().map(|dataset| RecordingRun::new(dataset, plan));
    let runs = runs.collect::<Result<Vec<_>, _>>()?;
    // Separate files per hold-out rule, so that both can be stored in one folder.
    let sector = if plan.hold_out == HoldOut::Sector { "-sector" } else { "" };
    for (done, run) in runs.iter().enumerate() {
        let mut found = Vec::new();
        for order in 0..n_orders {
            progress(done * n_orders + order, recordings.len() * n_orders);
            let file = plan.kept.join(format!("{}{sector}-{order}.json", run.dataset.name));
            let of = json!({
                "program": env!("CARGO_PKG_VERSION"),
                "settings": run.base,
                "views": run.groups,
                "frames": run.ordered(order).frames,
            });
            found.extend(folder::kept_or_new(&file, of, || run.measured(order))?);
        }
        // Each order has one row per group.
        for group in 0..run.groups.len() {
            let of_group: Vec<_> = found.iter().skip(group).step_by(run.groups.len()).collect();
            rows.extend(median(&of_group)?);
        }
        orders.extend(found);
    }
    let mut notes = vec![format!(
        "Default preset, one pass; each value is the median of {n_orders} orders of the frames. Held-out views, projected renderer, black background. corrected: poses moved like those of the frames around them. aligned: poses aligned to the view's photograph. energy, correlation: luma by octave of detail, finest first, against the photograph."
    )];
    notes.extend(left_out);
    Findings {
        name: "real",
        dataset: &plan.data.display().to_string(),
        adapter: None,
        options: plan.options,
        notes,
        table: text(&rows),
        plot: plot::draw("Recordings", &panels(&rows))?,
        summary: json!({ "orders": orders }),
        rows,
    }
    .into_bench()
}

struct RecordingRun<'a> {
    dataset: &'a Arc<Dataset>,
    plan: Plan,
    base: SceneRun,
    options: EvalOptions,
    groups: Vec<ViewGroup>,
    seed: u64,
}

impl<'a> RecordingRun<'a> {
    fn new(dataset: &'a Arc<Dataset>, plan: &RecordingsPlan) -> Result<Self, BenchError> {
        let RecordingsPlan { options, hold_out, .. } = *plan;
        let seed = options.seed;
        let selection = Selection { hold_out, ..Selection::all_frames() };
        let [frames, views] = if options.quick { [12, 4] } else { [usize::MAX; 2] };
        let frames = options.max_frames.unwrap_or(frames);
        let (plan, base, options) = prepare(dataset, &selection, frames, seed)?;
        let evaluation = dataset.evaluation_by(hold_out, plan.split).map_err(SessionError::from)?;
        let few = |group: ViewGroup| ViewGroup { frames: spaced(&group.frames, views), ..group };
        let groups = evaluation.into_groups().into_iter().map(few).collect();
        Ok(Self { dataset, plan, base, options, groups, seed })
    }

    fn ordered(&self, order: usize) -> Plan {
        ordered(&self.plan, order, self.seed)
    }

    fn trained(&self, dataset: &Arc<Dataset>, plan: &Plan) -> Result<Trained, BenchError> {
        let runs = std::slice::from_ref(&self.base);
        let trained = train(dataset, plan, runs, &mut || ())?;
        trained.into_iter().next().ok_or_else(|| {
            let first = "no frame is selected".to_owned();
            BenchError::NoFrame { dataset: dataset.name.clone(), first }
        })
    }

    fn measured(&self, order: usize) -> Result<Vec<RecordingRow>, BenchError> {
        let plan = self.ordered(order);
        let trained = self.trained(self.dataset, &plan)?;
        let perturbed = Perturbed::new(self.dataset, &plan, self.seed);
        let wrong = self.trained(&perturbed.dataset, &plan)?;
        let plain = self.options;
        let moved = EvalOptions { poses: ViewPoses::Corrected, ..plain };
        let [plain, aligned] = [plain, moved].map(|o| EvalOptions { align_poses: true, ..o });
        let left = perturbed.left(trained.poses(), wrong.poses());
        let row = |group: &ViewGroup| {
            let quality = |trained: &Trained, options| {
                let (split, views) = group.views();
                let splats = trained.splats.view();
                evaluate(splats, self.dataset, split, views, options, |_| ()).map(|found| found.0)
            };
            let recorded = quality(&trained, &plain)?;
            let (corrected, from_wrong) = (quality(&trained, &moved)?, quality(&wrong, &aligned)?);
            Ok(self.row(group, &trained, [&recorded, &corrected, &from_wrong], left))
        };
        self.groups.iter().map(row).collect()
    }

    fn row(
        &self,
        group: &ViewGroup,
        trained: &Trained,
        [recorded, corrected, from_wrong]: [&EvalReport; 3],
        left: Option<[f64; 2]>,
    ) -> RecordingRow {
        let median = |times: &[f64]| Spread::of(times.to_vec()).median;
        let aligned = recorded.means.pose_aligned_mean;
        let energy = |octave: usize| aligned.map(|view| view.bands[octave].energy_ratio);
        let correlation = |octave: usize| aligned.map(|view| view.bands[octave].correlation);
        RecordingRow {
            recording: self.dataset.name.clone(),
            group: group.name,
            split: recorded.split.clone(),
            frames: trained.train_ms.len(),
            views: recorded.views,
            drawn: trained.drawn() as f64,
            train_ms: median(&trained.train_ms),
            prepare_ms: median(&trained.prepare_ms),
            psnr: recorded.means.psnr_mean,
            psnr_covered: recorded.means.psnr_covered_mean,
            psnr_aligned_covered: recorded.means.psnr_aligned_covered_mean,
            ssim: recorded.means.ssim_mean,
            coverage: recorded.means.coverage_mean,
            depth_error: recorded.means.depth_mae_mean,
            corrected_psnr: corrected.means.psnr_mean,
            corrected_psnr_covered: corrected.means.psnr_covered_mean,
            corrected_psnr_aligned_covered: corrected.means.psnr_aligned_covered_mean,
            perturbed_shift_left: left.map(|[shift, _]| shift),
            perturbed_turn_left: left.map(|[_, turn]| turn),
            perturbed_psnr: from_wrong.means.psnr_mean,
            perturbed_psnr_covered: from_wrong.means.psnr_covered_mean,
            perturbed_pose_aligned_psnr_covered: from_wrong
                .means
                .pose_aligned_mean
                .map(|view| view.psnr_covered),
            pose_shift: aligned.map(|view| view.shift),
            pose_turn: aligned.map(|view| view.turn),
            pose_aligned_psnr: aligned.map(|view| view.psnr),
            pose_aligned_psnr_covered: aligned.map(|view| view.psnr_covered),
            pose_aligned_psnr_aligned_covered: aligned.map(|view| view.psnr_aligned_covered),
            pose_aligned_ssim_aligned: aligned.map(|view| view.ssim_aligned),
            gradient_ssim: aligned.map(|view| view.gradient_ssim),
            energy_1: energy(0),
            energy_2: energy(1),
            energy_3: energy(2),
            energy_4: energy(3),
            correlation_1: correlation(0),
            correlation_2: correlation(1),
            correlation_3: correlation(2),
            correlation_4: correlation(3),
        }
    }
}

impl RecordingRow {
    fn shown_group(&self) -> String {
        self.group.map_or_else(|| self.split.clone(), |group| group.to_string())
    }
}

/// Median of each number. `None` for no rows.
fn median(orders: &[&RecordingRow]) -> Result<Option<RecordingRow>, BenchError> {
    let rows: Vec<Value> = orders.iter().map(serde_json::to_value).collect::<Result<_, _>>()?;
    let Some(Value::Object(mut median)) = rows.first().cloned() else { return Ok(None) };
    for (name, value) in &mut median {
        // Counts, names and groups are those of the first order.
        if value.is_f64() || value.is_null() {
            // Null if any order has no value: medians over different orders are not comparable.
            let values: Option<Vec<f64>> = rows.iter().map(|row| row[name].as_f64()).collect();
            *value = values.map(|values| Spread::of(values).median).into();
        }
    }
    Ok(Some(serde_json::from_value(Value::Object(median))?))
}

fn number(value: Option<f64>, digits: usize) -> String {
    value.map_or_else(|| "–".to_owned(), |value| format!("{value:.digits$}"))
}

fn joined<const N: usize>(values: [Option<f64>; N]) -> String {
    values.map(|value| number(value, 2)).join(" / ")
}

fn text(rows: &[RecordingRow]) -> String {
    table(
        rows,
        [
            ("recording", |row| row.recording.clone()),
            ("views", RecordingRow::shown_group),
            ("drawn", |row| format!("{:.0}", row.drawn)),
            ("ms/frame", |row| format!("{:.1}", row.train_ms)),
            ("PSNR dB: full / covered / colours aligned", |row| {
                joined([Some(row.psnr), row.psnr_covered, row.psnr_aligned_covered])
            }),
            ("corrected poses", |row| {
                let covered = row.corrected_psnr_covered;
                joined([Some(row.corrected_psnr), covered, row.corrected_psnr_aligned_covered])
            }),
            ("trained on perturbed poses: full / covered / covered, aligned poses", |row| {
                let covered = row.perturbed_psnr_covered;
                joined([Some(row.perturbed_psnr), covered, row.perturbed_pose_aligned_psnr_covered])
            }),
            ("remaining of 2 cm, of 1°", |row| {
                joined([row.perturbed_shift_left, row.perturbed_turn_left])
            }),
            ("aligned poses", |row| {
                let [full, covered] = [row.pose_aligned_psnr, row.pose_aligned_psnr_covered];
                joined([full, covered, row.pose_aligned_psnr_aligned_covered])
            }),
            ("pose error", |row| {
                format!("{}, {}°", number(row.pose_shift, 4), number(row.pose_turn, 2))
            }),
            ("depth error", |row| number(row.depth_error, 4)),
            ("SSIM", |row| number(Some(row.ssim), 4)),
            ("SSIM of gradients", |row| number(row.gradient_ssim, 4)),
            ("energy by octave", |row| {
                joined([row.energy_1, row.energy_2, row.energy_3, row.energy_4])
            }),
            ("correlation", |row| {
                let (coarse, coarsest) = (row.correlation_3, row.correlation_4);
                joined([row.correlation_1, row.correlation_2, coarse, coarsest])
            }),
        ],
    )
}

fn panels(rows: &[RecordingRow]) -> [Panel; 2] {
    type Value = fn(&RecordingRow) -> Option<f64>;
    let name = |row: &RecordingRow| format!("{}, {}", row.recording, row.shown_group());
    let names: Vec<String> = rows.iter().map(name).collect();
    let panel = |title: &str, x: &str, series: &[(&str, Value)]| {
        let series = series.iter().map(|(name, value)| {
            let mark = |(at, row): (usize, &RecordingRow)| Some(Mark::new(value(row)?, at as f64));
            let marks = rows.iter().enumerate().filter_map(mark).collect();
            Series { name: (*name).to_owned(), marks, connected: false }
        });
        let (x, y) = (Axis::Linear(x.to_owned()), Axis::Names(names.clone()));
        Panel { title: title.to_owned(), x, y, series: series.collect() }
    };
    let quality: [(&str, Value); 3] = [
        ("recorded poses", |row| row.psnr_aligned_covered),
        ("corrected poses", |row| row.corrected_psnr_aligned_covered),
        ("aligned poses", |row| row.pose_aligned_psnr_aligned_covered),
    ];
    let sharpness: [(&str, Value); 2] =
        [("finest octave", |row| row.energy_1), ("second octave", |row| row.energy_2)];
    [
        panel("quality", "PSNR, covered, colours aligned, dB", &quality),
        panel("sharpness", "energy relative to the photograph", &sharpness),
    ]
}
