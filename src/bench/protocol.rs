//! The paper's protocol on every scene of a folder (`pipeline.md`, Paper's protocol): 200 frames
//! with depth, up to 100 held-out views, both presets, both renderers, and latency as defined in
//! the paper.
//!
//! Eight scenes with two presets take hours on small machines. Each finished run is therefore stored in
//! its own file, and a restarted bench continues where it stopped. Runs of another build are measured
//! again, so that a table never mixes two builds.

use super::findings::{Bench, BenchError, BenchOptions, Findings, Progress, table};
use super::held_out_views;
use super::plot::{self, Axis, Mark, Panel, Series};
use crate::dataset::{self, Dataset, LoadOptions};
use crate::eval::choices::GroundTruth;
use crate::eval::metrics::Spread;
use crate::eval::views::{EvalOptions, evaluate};
use crate::export::atomic::write_atomic;
use crate::pipeline::plan::Selection;
use crate::pipeline::session::{Session, Step};
use crate::pipeline::settings::method::MethodRequest;
use crate::pipeline::settings::scene::SceneOverrides;
use crate::render::{RenderOptions, Renderer};
use crate::train::paper::config::PaperConfig;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Number of training frames and number of held-out views in the paper.
const PAPER: [usize; 2] = [200, 100];
/// Number of training frames and number of held-out views of a quick run.
const QUICK: [usize; 2] = [12, 4];

#[derive(Clone, Debug)]
pub struct ProtocolPlan {
    /// Folder of scenes. Every subfolder that can be opened and has depth is a scene.
    pub data: PathBuf,
    /// Folder in which the results of finished runs are stored.
    pub kept: PathBuf,
    pub options: BenchOptions,
}

/// Results of one preset on one scene, rendered by one renderer.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct ProtocolRow {
    pub scene: String,
    pub preset: String,
    pub renderer: String,
    pub frames: usize,
    pub views: usize,
    pub components: usize,
    pub drawn: usize,
    /// Time of training a frame and its quartiles over the frames, milliseconds.
    pub train_ms: f64,
    pub train_q1: f64,
    pub train_q3: f64,
    pub prepare_ms: f64,
    /// PSNR against photographs composited over black, dB.
    pub psnr: f64,
    /// PSNR against photographs with alpha dropped, as in the paper, dB.
    pub psnr_rgb: f64,
    pub ssim: f64,
    /// PSNR that the paper states for the scene at 800×800 pixels, with alpha dropped, dB.
    pub published: Option<f64>,
}

/// Scenes of the paper's table.
const PUBLISHED_SCENES: [&str; 8] =
    ["chair", "drums", "ficus", "hotdog", "lego", "materials", "mic", "ship"];

/// PSNR of the paper's table with its projected renderer and, if stated, its exact one, dB.
const PUBLISHED: [(&str, [Option<f64>; 2]); 3] = [
    ("chair", [Some(22.11), Some(22.50)]),
    ("lego", [Some(21.89), None]),
    ("mic", [Some(24.04), None]),
];

/// True if a recording is named after a scene, such as `lego400`.
fn is_scene(recording: &str, scene: &str) -> bool {
    recording.to_lowercase().starts_with(scene)
}

fn published(recording: &str, preset: &str, renderer: Renderer) -> Option<f64> {
    let (_, of) = PUBLISHED.iter().find(|(scene, _)| is_scene(recording, scene))?;
    of[usize::from(renderer == Renderer::Exact)].filter(|_| preset == "paper")
}

pub fn run(plan: &ProtocolPlan, progress: Progress) -> Result<Bench, BenchError> {
    let (scenes, left_out) = scenes(&plan.data)?;
    std::fs::create_dir_all(&plan.kept).map_err(file_error(&plan.kept))?;
    let [frames, views] = if plan.options.quick { QUICK } else { PAPER };
    let frames = plan.options.max_frames.unwrap_or(frames);
    let presets: [(&str, MethodRequest); 2] = [
        ("paper", PaperConfig { seed: plan.options.seed, ..PaperConfig::paper() }.into()),
        ("scene", SceneOverrides::default().into()),
    ];
    let mut rows = Vec::new();
    for (done, scene) in scenes.iter().enumerate() {
        for (half, (preset, request)) in presets.iter().enumerate() {
            progress(2 * done + half, 2 * scenes.len());
            let selection = Selection { max_frames: Some(frames), ..Selection::all_frames() };
            let session = Session::new(scene.clone(), request.clone(), selection)?;
            let inputs = json!({ "settings": session.config(), "views": views });
            let file = plan.kept.join(format!("{}-{preset}.json", scene.name));
            rows.extend(stored_or_new(&file, inputs, || measured(session, preset, views))?);
        }
    }
    let mut notes = vec![format!(
        "At most {frames} frames in listed order and {views} held-out views. `paper`: N = 100,000. `scene`: the defaults of the preset. ms: median training time per frame; other threads decode and prepare. PSNR rgb: photographs with alpha dropped, as in the paper. Renderers as published: `exact` has no pixel footprint."
    )];
    let is_absent = |scene: &&str| !scenes.iter().any(|found| is_scene(&found.name, scene));
    let absent: Vec<&str> = PUBLISHED_SCENES.into_iter().filter(is_absent).collect();
    if !absent.is_empty() {
        notes.push(format!("scenes of the paper that are absent: {}.", absent.join(", ")));
    }
    notes.extend(left_out);
    let names: Vec<String> = scenes.iter().map(|scene| scene.name.clone()).collect();
    Findings {
        name: "paper",
        dataset: &plan.data.display().to_string(),
        adapter: None,
        options: plan.options,
        notes,
        table: text(&rows),
        plot: plot::draw("The paper's protocol", &panels(&rows, &names))?,
        summary: json!({ "scenes": names }),
        rows,
    }
    .into_bench()
}

/// Opens all subfolders that are scenes with training frames, sorted by path. Also returns a note for
/// each skipped subfolder.
pub(super) fn scenes(data: &Path) -> Result<(Vec<Arc<Dataset>>, Vec<String>), BenchError> {
    let listing = std::fs::read_dir(data).map_err(file_error(data))?;
    let folders = listing.filter_map(|entry| Some(entry.ok()?.path())).filter(|path| path.is_dir());
    let mut folders: Vec<PathBuf> = folders.collect();
    // The order of a listing depends on the file system.
    folders.sort();
    let (mut scenes, mut left_out) = (Vec::new(), Vec::new());
    for folder in folders {
        let opened = dataset::open(&folder, &LoadOptions::default());
        match opened.and_then(|dataset| dataset.training_split().map(|_| dataset)) {
            Ok(dataset) => scenes.push(Arc::new(dataset)),
            // Other folders are common beside scenes, so they cause a note, not an error.
            Err(error) => left_out.push(format!("left out: {error}")),
        }
    }
    if scenes.is_empty() {
        let first =
            left_out.into_iter().next().unwrap_or_else(|| "there are no subfolders".to_owned());
        return Err(BenchError::NoScene { folder: data.to_owned(), first });
    }
    Ok((scenes, left_out))
}

pub(super) fn file_error(path: &Path) -> impl Fn(std::io::Error) -> BenchError {
    move |source| BenchError::File { path: path.to_owned(), source }
}

#[derive(Serialize, Deserialize)]
struct StoredRun<R> {
    /// Checksum of the executable that measured the rows.
    program: u32,
    /// All other inputs that affect the rows.
    of: Value,
    rows: Vec<R>,
}

/// Returns the rows stored in a file if they were measured by this executable with equal inputs `of`.
/// Otherwise runs `measure` and stores the rows.
pub(super) fn stored_or_new<R: Serialize + for<'a> Deserialize<'a>>(
    file: &Path,
    of: Value,
    measure: impl FnOnce() -> Result<Vec<R>, BenchError>,
) -> Result<Vec<R>, BenchError> {
    let program = program()?;
    let stored = std::fs::read(file).ok().and_then(|b| serde_json::from_slice(&b).ok());
    // A missing or damaged file only costs time: its run is measured again.
    match stored.filter(|run: &StoredRun<R>| run.program == program && run.of == of) {
        Some(StoredRun { rows, .. }) => Ok(rows),
        None => {
            let run = StoredRun { program, of, rows: measure()? };
            let text = serde_json::to_vec_pretty(&run)?;
            write_atomic(file, |out| out.write_all(&text))?;
            Ok(run.rows)
        }
    }
}

fn program() -> Result<u32, BenchError> {
    let path = std::env::current_exe().map_err(file_error(Path::new("running executable")))?;
    // Hash the executable, because the package version is equal for many builds.
    let bytes = std::fs::read(&path).map_err(file_error(&path))?;
    Ok(crc32fast::hash(&bytes))
}

/// Trains a session to its end and measures the scene with both renderers. Returns one row per renderer.
fn measured(
    mut session: Session,
    preset: &str,
    n_views: usize,
) -> Result<Vec<ProtocolRow>, BenchError> {
    while !matches!(session.step()?, Step::Finished) {}
    let (splats, dataset, frames) = (session.splats(), session.dataset(), session.frames());
    let (split, views) = held_out_views(dataset, session.plan().split, n_views);
    let train = Spread::of(frames.iter().map(|frame| frame.ms.stages.train).collect());
    let color_camera = session.config().method.as_any().color_camera();
    let drawn = splats.view().splats().iter().filter(|splat| splat.is_drawable()).count();
    let row = |renderer: Renderer| -> Result<ProtocolRow, BenchError> {
        let render = RenderOptions::published(renderer, [0.0; 3]);
        let quality = |truth| {
            let options = EvalOptions { color_camera, ..EvalOptions::plain(truth, render) };
            evaluate(&splats, dataset, split, &views, &options, |_| ()).map(|(report, _)| report)
        };
        let composited = quality(GroundTruth::Composited)?;
        Ok(ProtocolRow {
            scene: dataset.name.clone(),
            preset: preset.to_owned(),
            renderer: renderer.to_string(),
            frames: frames.len(),
            views: composited.views,
            components: session.learner().status().used,
            drawn,
            train_ms: train.median,
            train_q1: train.quartiles[0],
            train_q3: train.quartiles[1],
            prepare_ms: Spread::of(frames.iter().map(|frame| frame.ms.prepare).collect()).median,
            psnr: composited.means.psnr_mean,
            // The same views are drawn again, because evaluation does not keep its renderings.
            psnr_rgb: quality(GroundTruth::Rgb)?.means.psnr_mean,
            ssim: composited.means.ssim_mean,
            published: published(&dataset.name, preset, renderer),
        })
    };
    [Renderer::Projected, Renderer::Exact].into_iter().map(row).collect()
}

fn text(rows: &[ProtocolRow]) -> String {
    table(
        rows,
        [
            ("scene", |row| row.scene.clone()),
            ("preset", |row| row.preset.clone()),
            ("renderer", |row| row.renderer.clone()),
            ("drawn", |row| row.drawn.to_string()),
            ("ms/frame [quartiles]", |row| {
                Spread { median: row.train_ms, quartiles: [row.train_q1, row.train_q3] }.to_string()
            }),
            ("prepare ms", |row| format!("{:.1}", row.prepare_ms)),
            ("PSNR dB", |row| format!("{:.2}", row.psnr)),
            ("PSNR rgb dB", |row| format!("{:.2}", row.psnr_rgb)),
            ("SSIM", |row| format!("{:.4}", row.ssim)),
            ("published rgb", |row| {
                row.published.map_or_else(String::new, |psnr| format!("{psnr:.2}"))
            }),
        ],
    )
}

fn panels(rows: &[ProtocolRow], scenes: &[String]) -> [Panel; 2] {
    let panel = |title: &str, x: Axis, of: fn(&ProtocolRow) -> f64, renderers: &[&str]| {
        let series = |preset: &str, renderer: &str| {
            let mine = rows.iter().filter(|row| row.preset == preset && row.renderer == renderer);
            let mark = |row: &ProtocolRow| {
                let at = scenes.iter().position(|scene| *scene == row.scene)?;
                Some(Mark::exact(of(row), at as f64))
            };
            let marks = mine.filter_map(mark).collect();
            Series { name: format!("{preset}, {renderer}"), marks, connected: false }
        };
        let series = ["paper", "scene"]
            .into_iter()
            .flat_map(|preset| renderers.iter().map(move |renderer| (preset, *renderer)))
            .map(|(preset, renderer)| series(preset, renderer))
            .collect();
        Panel { title: title.to_owned(), x, y: Axis::Names(scenes.to_vec()), series }
    };
    let quality = Axis::Linear("PSNR, dB");
    let latency = Axis::Log("median ms per frame");
    [
        panel("quality", quality, |row| row.psnr, &["projected", "exact"]),
        // Training time does not depend on the renderer, so one renderer suffices.
        panel("latency", latency, |row| row.train_ms, &["projected"]),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_of_this_program_and_run_alone_are_taken_from_a_file() {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("run.json");
        let measured = |of: &str, rows: u32| {
            stored_or_new(&file, Value::from(of), || Ok(vec![rows])).expect("measured")
        };
        assert_eq!(measured("stream", 1), [1]);
        assert_eq!(measured("stream", 2), [1], "measured before");
        assert_eq!(measured("reversed", 3), [3], "another run");
        let text = std::fs::read_to_string(&file).expect("stored");
        let program = program().expect("a program");
        let other = text.replace(&program.to_string(), &program.wrapping_add(1).to_string());
        assert_ne!(text, other);
        std::fs::write(&file, other).expect("written");
        assert_eq!(measured("reversed", 4), [4], "another program");
    }
}
