//! The paper's protocol on every scene of a folder (`pipeline.md`, Paper's protocol): 200 frames
//! with depth, up to 100 held-out views, both presets, both renderers, and latency as defined in
//! the paper. Finished runs are stored, because eight scenes with two presets take hours on small
//! machines.

use super::findings::{Bench, BenchError, BenchOptions, Findings, Progress, table};
use super::folder;
use super::paper::sample::spaced;
use super::plot::{self, Axis, Mark, Panel, Series};
use crate::dataset::Dataset;
use crate::eval::choices::GroundTruth;
use crate::eval::metrics::Spread;
use crate::eval::views::{EvalOptions, evaluate};
use crate::model::splat::appearance::SplatSet;
use crate::pipeline::plan::Selection;
use crate::pipeline::session::{Session, Step};
use crate::pipeline::settings::method::MethodRequest;
use crate::pipeline::settings::scene::SceneOverrides;
use crate::render::{RenderMethod, RenderOptions};
use crate::train::paper::config::PaperConfig;
use serde::{Deserialize, Serialize};
use serde_json::json;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Frames and held-out views in the paper.
const PAPER: [usize; 2] = [200, 100];
/// Frames and held-out views of a quick run.
const QUICK: [usize; 2] = [12, 4];

#[derive(Clone, Debug)]
pub struct ProtocolPlan {
    /// Folder of scenes: all subfolders that can be opened and have depth.
    pub data: PathBuf,
    pub kept: PathBuf,
    pub options: BenchOptions,
}

/// One preset on one scene, rendered by one renderer.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct ProtocolRow {
    pub scene: String,
    pub preset: String,
    pub renderer: String,
    pub frames: usize,
    pub views: usize,
    pub components: usize,
    pub drawn: usize,
    pub train_ms: f64,
    pub prepare_ms: f64,
    /// Against photographs composited over black, dB.
    pub psnr: f64,
    /// Against photographs with alpha dropped, as in the paper, dB.
    pub psnr_rgb: f64,
    pub ssim: f64,
}

pub fn run(plan: &ProtocolPlan, progress: Progress) -> Result<Bench, BenchError> {
    let (scenes, left_out) = folder::scenes(&plan.data)?;
    folder::make(&plan.kept)?;
    let [frames, views] = if plan.options.quick { QUICK } else { PAPER };
    let frames = plan.options.max_frames.unwrap_or(frames);
    let mut rows = Vec::new();
    for (done, scene) in scenes.iter().enumerate() {
        for (half, preset) in ["paper", "scene"].into_iter().enumerate() {
            progress(2 * done + half, 2 * scenes.len());
            let run = ProtocolRun { scene, preset, frames, views, seed: plan.options.seed };
            rows.extend(run.kept_or_new(&plan.kept)?);
        }
    }
    let mut notes = vec![format!(
        "At most {frames} frames in listed order and {views} held-out views. `paper`: N = 100,000. `scene`: the defaults of the preset. ms: median training time per frame; other threads decode and prepare. PSNR rgb: photographs with alpha dropped, as in the paper."
    )];
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

struct ProtocolRun<'a> {
    scene: &'a Arc<Dataset>,
    preset: &'static str,
    frames: usize,
    views: usize,
    seed: u64,
}

impl ProtocolRun<'_> {
    fn kept_or_new(&self, kept: &Path) -> Result<Vec<ProtocolRow>, BenchError> {
        let selection = Selection { max_frames: Some(self.frames), ..Selection::all_frames() };
        let asked: MethodRequest = match self.preset {
            "paper" => PaperConfig { seed: self.seed, ..PaperConfig::paper() }.into(),
            _ => SceneOverrides::default().into(),
        };
        let session = Session::new(self.scene.clone(), asked, selection)?;
        // A stored run is reused only for the same version, settings and number of views.
        let of = json!({
            "program": env!("CARGO_PKG_VERSION"),
            "settings": session.config(),
            "views": self.views,
        });
        let file = kept.join(format!("{}-{}.json", self.scene.name, self.preset));
        folder::kept_or_new(&file, of, || self.measured(session))
    }

    fn measured(&self, mut session: Session) -> Result<Vec<ProtocolRow>, BenchError> {
        while !matches!(session.step()?, Step::Finished) {}
        let splats = session.splats();
        let median = |times: Vec<f64>| Spread::of(times).median;
        let frames = session.frames();
        let color_camera = session.config().method.as_any().color_camera();
        let drawn = splats.view().splats().iter().filter(|splat| splat.is_drawable()).count();
        let row = |method: RenderMethod| -> Result<ProtocolRow, BenchError> {
            let render = RenderOptions::evaluation(method, [0.0; 3]);
            let options = |truth| EvalOptions { color_camera, ..EvalOptions::plain(truth, render) };
            let composited = self.quality(&session, &splats, &options(GroundTruth::Composited))?;
            let rgb = self.quality(&session, &splats, &options(GroundTruth::Rgb))?;
            Ok(ProtocolRow {
                scene: self.scene.name.clone(),
                preset: self.preset.to_owned(),
                renderer: method.renderer().to_string(),
                frames: frames.len(),
                views: composited.0,
                components: session.learner().status().used,
                drawn,
                train_ms: median(frames.iter().map(|frame| frame.ms.stages.train).collect()),
                prepare_ms: median(frames.iter().map(|frame| frame.ms.prepare).collect()),
                psnr: composited.1,
                psnr_rgb: rgb.1,
                ssim: composited.2,
            })
        };
        [RenderMethod::PROJECTED, RenderMethod::EXACT].into_iter().map(row).collect()
    }

    /// Number of held-out views, their mean PSNR in dB and mean SSIM.
    fn quality(
        &self,
        session: &Session,
        splats: &SplatSet,
        options: &EvalOptions,
    ) -> Result<(usize, f64, f64), BenchError> {
        let held_out = self.scene.evaluation(session.plan().split).new_views;
        let views = spaced(&held_out.frames, self.views);
        let (found, _) = evaluate(splats, self.scene, held_out.split, &views, options, |_| ())?;
        Ok((found.views, found.means.psnr_mean, found.means.ssim_mean))
    }
}

fn text(rows: &[ProtocolRow]) -> String {
    table(
        rows,
        [
            ("scene", |row| row.scene.clone()),
            ("preset", |row| row.preset.clone()),
            ("renderer", |row| row.renderer.clone()),
            ("drawn", |row| row.drawn.to_string()),
            ("ms/frame", |row| format!("{:.1}", row.train_ms)),
            ("prepare ms", |row| format!("{:.1}", row.prepare_ms)),
            ("PSNR dB", |row| format!("{:.2}", row.psnr)),
            ("PSNR rgb dB", |row| format!("{:.2}", row.psnr_rgb)),
            ("SSIM", |row| format!("{:.4}", row.ssim)),
        ],
    )
}

fn panels(rows: &[ProtocolRow], scenes: &[String]) -> [Panel; 2] {
    let panel = |title: &str, x: Axis, of: fn(&ProtocolRow) -> f64, renderers: &[&str]| {
        let series = |preset: &str, renderer: &str| {
            let mine = rows.iter().filter(|row| row.preset == preset && row.renderer == renderer);
            let mark = |row: &ProtocolRow| {
                let at = scenes.iter().position(|scene| *scene == row.scene)?;
                Some(Mark::new(of(row), at as f64))
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
    let quality = Axis::Linear("PSNR, dB".to_owned());
    let latency = Axis::Log("median ms per frame".to_owned());
    [
        panel("quality", quality, |row| row.psnr, &["projected", "exact"]),
        // Training time does not depend on the renderer, so one renderer suffices.
        panel("latency", latency, |row| row.train_ms, &["projected"]),
    ]
}
