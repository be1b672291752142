//! Quality of views that training did not see, on recordings and synthetic scenes: from points alone to photographs in
//! full. Views lie on the camera's path (held out) and beside it (a sector left out, or free views of a synthetic
//! scene).

use super::training::{Trained, prepare_held_out, train};
use super::variants::{VIEW_VARIANTS, view_variants};
use crate::bench::findings::{Bench, BenchError, BenchOptions, Findings, Progress, steps, table};
use crate::bench::plot::{self, Axis, Mark, Panel, Series};
use crate::bench::protocol::{file_error, scenes, stored_or_new};
use crate::bench::spaced;
use crate::dataset::splits::{HoldOut, ViewGroup};
use crate::dataset::synthetic::write::{SyntheticLayout, write};
use crate::dataset::synthetic::{self, PhoneScene, SyntheticCamera, SyntheticParams};
use crate::dataset::{self, Dataset, LoadOptions};
use crate::eval::metrics::Spread;
use crate::eval::report::EvalMeans;
use crate::eval::views::{EvalOptions, evaluate};
use crate::pipeline::settings::scene::SceneRun;
use serde::{Deserialize, Serialize};
use serde_json::json;
use std::path::{Path, PathBuf};
use std::sync::Arc;

struct Sizes {
    /// Frames that a phone records in a synthetic scene, views between them, and free views.
    phone: [usize; 3],
    /// Width and height of the phone's photographs, pixels.
    photograph: [u32; 2],
    /// Maximum number of training frames, and of views in each group.
    frames: usize,
    views: usize,
}

const WHOLE: Sizes =
    Sizes { phone: [70, 12, 40], photograph: [720, 960], frames: usize::MAX, views: 50 };
const QUICK: Sizes = Sizes { phone: [8, 2, 3], photograph: [240, 320], frames: 12, views: 4 };

#[derive(Clone, Debug)]
pub struct ViewsPlan {
    /// Folder of recordings. Every subfolder that can be opened and has depth is one; `None` for synthetic scenes
    /// alone.
    pub data: Option<PathBuf>,
    /// Folder in which synthetic recordings and the results of finished runs are stored.
    pub kept: PathBuf,
    pub options: BenchOptions,
}

impl ViewsPlan {
    fn sizes(&self) -> Sizes {
        if self.options.quick { QUICK } else { WHOLE }
    }
}

/// Groups of views: on the camera's path, anywhere in a synthetic scene, and in a sector that training left out.
const NEW: &str = "new views";
const FREE: &str = "free views";
const SECTOR: &str = "sector";

/// Quality of one group of views, drawn from a scene that was trained with one configuration.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct ViewsRow {
    pub recording: String,
    pub group: String,
    pub views: usize,
    pub configuration: String,
    pub frames: usize,
    pub drawn: usize,
    /// Time of training a frame and its quartiles over the frames, milliseconds.
    pub train_ms: f64,
    pub train_q1: f64,
    pub train_q3: f64,
    pub prepare_ms: f64,
    pub psnr: f64,
    pub psnr_covered: Option<f64>,
    /// PSNR of covered pixels with each view's colours aligned, dB.
    pub psnr_aligned: Option<f64>,
    pub ssim: f64,
    pub detail_finest: Option<f64>,
    pub detail_second: Option<f64>,
    /// Mean absolute error of depth, world units.
    pub depth_error: Option<f64>,
}

struct Recording {
    name: String,
    dataset: Arc<Dataset>,
    /// Free views that the recording's layout stores as a dataset of their own.
    free: Option<Dataset>,
}

pub fn run(plan: &ViewsPlan, progress: Progress) -> Result<Bench, BenchError> {
    std::fs::create_dir_all(&plan.kept).map_err(file_error(&plan.kept))?;
    let (mut recordings, mut left_out) = (Vec::new(), Vec::new());
    if let Some(data) = &plan.data {
        let (datasets, skipped) = scenes(data)?;
        let of =
            |dataset: Arc<Dataset>| Recording { name: dataset.name.clone(), dataset, free: None };
        recordings.extend(datasets.into_iter().map(of));
        left_out = skipped;
    }
    recordings.extend(synthetic_recordings(plan)?);
    let methods = [HoldOut::Every8th, HoldOut::Sector];
    let mut step = steps(progress, methods.len() * recordings.len());
    let mut rows = Vec::new();
    for recording in &recordings {
        for hold_out in methods {
            match measured(plan, recording, hold_out) {
                Ok(found) => rows.extend(found),
                // Some recordings have no views that a sector could leave out.
                Err(BenchError::Dataset(error)) if hold_out == HoldOut::Sector => {
                    left_out.push(format!("no sector: {error}"));
                }
                Err(error) => return Err(error),
            }
            step();
        }
    }
    let mut notes = vec![
        "new views: the recording's own split for evaluation, or every 8th frame, held out of training. sector: views from the side, of a part that is left out of training (`--hold-out sector`). free views: from anywhere in a synthetic scene. Projected renderer, black background, poses and exposure as training predicts them.".to_owned(),
        "ms: training a frame, median over the frames, configurations in turns; other threads decode and prepare. covered: pixels with coverage ≥ 0.5. aligned: covered pixels after fitting a factor and an offset per channel to each view. detail: correlation with the photograph in the finest octave and the next one.".to_owned(),
    ];
    notes.extend(left_out);
    let names: Vec<String> = recordings.iter().map(|recording| recording.name.clone()).collect();
    let dataset = plan.data.as_ref().map_or_else(
        || "synthetic scenes".to_owned(),
        |data| format!("{} and synthetic scenes", data.display()),
    );
    Findings {
        name: "views",
        dataset: &dataset,
        adapter: None,
        options: plan.options,
        notes,
        table: text(&rows),
        plot: plot::draw("Views that training did not see", &panels(&rows, &names))?,
        summary: json!({ "recordings": names }),
        rows,
    }
    .into_bench()
}

fn synthetic_recordings(plan: &ViewsPlan) -> Result<Vec<Recording>, BenchError> {
    let Sizes { phone: [n_train, n_eval, n_free], photograph: [width, height], .. } = plan.sizes();
    let room = SyntheticParams { n_free, ..SyntheticParams::demo() };
    let dataset = Arc::new(synthetic::dataset(&room)?);
    let mut found = vec![Recording { name: dataset.name.clone(), dataset, free: None }];
    for (scene, name) in
        [(PhoneScene::Door, "phone before a door"), (PhoneScene::Room, "phone in a room")]
    {
        let camera = SyntheticCamera::Phone(scene);
        let params = SyntheticParams {
            width,
            height,
            n_train,
            n_eval,
            n_free,
            camera,
            ..SyntheticParams::demo()
        };
        let folder = plan.kept.join(name);
        // An earlier run that was stopped may have left a part.
        if folder.exists() {
            std::fs::remove_dir_all(&folder).map_err(file_error(&folder))?;
        }
        write(&params, &folder, SyntheticLayout::Record3d, &mut |_, _| {})?;
        let open = |path: &Path| dataset::open(path, &LoadOptions::default());
        let dataset = Arc::new(open(&folder)?);
        found.push(Recording {
            name: name.to_owned(),
            dataset,
            free: Some(open(&folder.join("free"))?),
        });
    }
    Ok(found)
}

/// Trains all configurations on the frames that a method leaves for training. Returns a row per group of views and
/// configuration.
fn measured(
    plan: &ViewsPlan,
    recording: &Recording,
    hold_out: HoldOut,
) -> Result<Vec<ViewsRow>, BenchError> {
    let Recording { name, dataset, free } = recording;
    let Sizes { frames, views, .. } = plan.sizes();
    let most = plan.options.max_frames.unwrap_or(frames);
    // First: a recording without a sector is left out, whereas other errors end the bench.
    let evaluation = dataset.evaluation_by(hold_out, dataset.training_split()?)?;
    let (training, base, options) = prepare_held_out(dataset, hold_out, most, plan.options.seed)?;
    let groups: Vec<(&str, &Dataset, ViewGroup)> = match hold_out {
        HoldOut::Every8th => {
            let own = evaluation.from_the_side.into_iter().map(|group| (FREE, &**dataset, group));
            let apart = free.iter().flat_map(|free| {
                let split = free.splits.iter().position(|split| split.name == "free");
                split.map(|split| (FREE, free, free.whole_split(split)))
            });
            std::iter::once((NEW, &**dataset, evaluation.new_views))
                .chain(own)
                .chain(apart)
                .collect()
        }
        // The sector's views come first; free views are in the other method's rows.
        HoldOut::Sector => {
            let side = evaluation.from_the_side.into_iter().take(1);
            side.map(|group| (SECTOR, &**dataset, group)).collect()
        }
    };
    let variants = view_variants(&base);
    let runs: Vec<SceneRun> = variants.iter().map(|(_, run)| run.clone()).collect();
    let inputs = json!({ "frames": training.frames, "runs": runs, "views": views });
    let file = plan.kept.join(format!("{name}-{hold_out:?}.json"));
    stored_or_new(&file, inputs, || {
        let trained = train(dataset, &training, &runs, &mut || ())?;
        let mut rows = Vec::new();
        for (label, of, group) in &groups {
            for ((configuration, _), trained) in variants.iter().zip(&trained) {
                let names = [&**name, label, configuration];
                rows.push(row(names, trained, of, group, views, &options)?);
            }
        }
        Ok(rows)
    })
}

/// Measures a group of views. `names` are those of the recording, the group and the configuration.
fn row(
    names: [&str; 3],
    trained: &Trained,
    dataset: &Dataset,
    group: &ViewGroup,
    views: usize,
    options: &EvalOptions,
) -> Result<ViewsRow, BenchError> {
    let frames = spaced(&group.frames, views);
    let (report, _) = evaluate(&trained.splats, dataset, group.split, &frames, options, |_| ())?;
    let EvalMeans { psnr_mean, psnr_covered_mean, psnr_aligned_covered_mean, .. } = report.means;
    let Spread { median, quartiles } = Spread::of(trained.train_ms.clone());
    let detail = report.means.detail_mean;
    let [recording, group, configuration] = names.map(str::to_owned);
    Ok(ViewsRow {
        recording,
        configuration,
        group,
        views: report.views,
        frames: trained.train_ms.len(),
        drawn: trained.drawn(),
        train_ms: median,
        train_q1: quartiles[0],
        train_q3: quartiles[1],
        prepare_ms: Spread::of(trained.prepare_ms.clone()).median,
        psnr: psnr_mean,
        psnr_covered: psnr_covered_mean,
        psnr_aligned: psnr_aligned_covered_mean,
        ssim: report.means.ssim_mean,
        detail_finest: detail.map(|detail| detail.finest),
        detail_second: detail.map(|detail| detail.second),
        depth_error: report.means.depth_mae_mean,
    })
}

fn text(rows: &[ViewsRow]) -> String {
    table(
        rows,
        [
            ("recording", |row| row.recording.clone()),
            ("views", |row| format!("{} {}", row.views, row.group)),
            ("configuration", |row| row.configuration.clone()),
            ("splats", |row| row.drawn.to_string()),
            ("ms/frame [quartiles]", |row| {
                Spread { median: row.train_ms, quartiles: [row.train_q1, row.train_q3] }.to_string()
            }),
            ("PSNR dB", |row| format!("{:.2}", row.psnr)),
            ("covered", |row| fixed(row.psnr_covered, 2)),
            ("aligned", |row| fixed(row.psnr_aligned, 2)),
            ("SSIM", |row| format!("{:.3}", row.ssim)),
            ("detail", |row| {
                format!("{} {}", fixed(row.detail_finest, 2), fixed(row.detail_second, 2))
            }),
            ("depth error", |row| fixed(row.depth_error, 4)),
        ],
    )
}

fn fixed(value: Option<f64>, digits: usize) -> String {
    value.map_or_else(String::new, |value| format!("{value:.digits$}"))
}

/// Plots PSNR over recordings, one panel a group of views.
fn panels(rows: &[ViewsRow], names: &[String]) -> [Panel; 2] {
    [("new views", &[NEW][..]), ("from the side", &[FREE, SECTOR])].map(|(title, groups)| {
        let of = |configuration: &'static str| {
            let mine = rows
                .iter()
                .filter(|row| groups.contains(&&*row.group) && row.configuration == configuration);
            let mark = |row: &ViewsRow| {
                let at = names.iter().position(|name| *name == row.recording)?;
                Some(Mark::exact(row.psnr_covered.unwrap_or(row.psnr), at as f64))
            };
            Series {
                name: configuration.to_owned(),
                marks: mine.filter_map(mark).collect(),
                connected: false,
            }
        };
        let series = VIEW_VARIANTS.map(|(name, _)| of(name)).into();
        let (x, y) = (Axis::Linear("PSNR of covered pixels, dB"), Axis::Names(names.to_vec()));
        Panel { title: title.to_owned(), x, y, series }
    })
}
