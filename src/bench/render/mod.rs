//! Frame time by stage against splats and resolution, by both renderers, on the CPU and on a GPU.

#[cfg(feature = "gui")]
mod gpu;
mod painter;
mod report;
mod scene;

pub use painter::FramePath;
pub use report::Ratio;
pub use scene::BenchScene;

use super::plot::draw;
use crate::bench::findings::{Bench, BenchError, BenchOptions, Findings, Progress};
use crate::eval::spread::Spread;
use crate::math::camera::{Camera, Intrinsics};
use crate::math::orbit::Orbit;
use crate::model::splat::splats::{Framing, Splat, framing};
#[cfg(feature = "gui")]
use crate::render::gpu::adapters::AdapterChoice;
use crate::render::{RenderOptions, Renderer};
use glam::DVec3;
#[cfg(feature = "gui")]
use gpu::TimedGpu;
use painter::{FrameStageMs, STAGES, TimedCpu, TimedPaintError, TimedPainter};
use report::{RenderSummary, notes, panels, text};
use serde::Serialize;
use std::f64::consts::TAU;

/// Horizontal field of view of every view, radians.
const FOV: f64 = 1.0;
/// Of every view, radians.
const ELEVATION: f64 = 0.45;
/// In the order of the rows.
const RENDERERS: [Renderer; 2] = [Renderer::Projected, Renderer::Exact];

/// Who draws.
#[derive(Clone, Copy, Debug, PartialEq, Eq, strum::EnumString, strum::VariantNames)]
#[strum(serialize_all = "kebab-case")]
pub enum BenchDevice {
    /// The CPU renderer.
    Cpu,
    /// A graphics adapter.
    #[cfg(feature = "gui")]
    Gpu,
    /// The CPU renderer, and a graphics adapter where there is one that is not software.
    All,
}

/// What is timed.
#[derive(Clone, Debug)]
pub struct RenderPlan {
    /// Numbers of splats.
    pub splats: Vec<usize>,
    /// Columns and rows of the images.
    pub sizes: Vec<[u32; 2]>,
    /// Who draws.
    pub device: BenchDevice,
    /// Name or number of the adapter, which may then be software.
    #[cfg(feature = "gui")]
    pub adapter: Option<String>,
    /// Timed frames of every combination, each from its own side.
    pub frames: usize,
    /// What was asked for.
    pub options: BenchOptions,
}

impl RenderPlan {
    /// 10⁴ to 4·10⁶ splats, or to 10⁶ in the quick form; a model's own number is among them.
    pub fn new(options: BenchOptions, scene: &BenchScene) -> Self {
        let mut splats = vec![10_000, 100_000, 1_000_000];
        let mut sizes = vec![[400, 400], [1280, 720]];
        if !options.quick {
            splats.extend([30_000, 300_000, 4_000_000]);
            sizes.insert(1, [800, 600]);
        }
        splats.extend(scene.own_count());
        splats.sort_unstable();
        splats.dedup();
        Self {
            splats,
            sizes,
            device: BenchDevice::All,
            #[cfg(feature = "gui")]
            adapter: None,
            frames: options.repeats.unwrap_or(if options.quick { 5 } else { 15 }),
            options,
        }
    }

    /// Everybody who draws; a GPU that was not asked for by name and is not there becomes a note.
    fn painters(&self, notes: &mut Vec<String>) -> Result<Vec<Box<dyn TimedPainter>>, BenchError> {
        let mut painters: Vec<Box<dyn TimedPainter>> = Vec::new();
        if matches!(self.device, BenchDevice::Cpu | BenchDevice::All) {
            painters.push(Box::new(TimedCpu::default()));
        }
        #[cfg(feature = "gui")]
        if matches!(self.device, BenchDevice::Gpu | BenchDevice::All) {
            let choice = self.adapter.as_deref().map_or(AdapterChoice::Auto, AdapterChoice::parse);
            match TimedGpu::all(&choice) {
                Ok(paths) => painters.extend(paths.into_iter().map(|p| Box::new(p) as _)),
                Err(error) if self.device == BenchDevice::All && self.adapter.is_none() => {
                    notes.push(format!("CPU only: {error}"));
                }
                Err(error) => return Err(error.into()),
            }
        }
        #[cfg(not(feature = "gui"))]
        if self.device == BenchDevice::All {
            notes.push("CPU only: this build draws on no GPU".to_owned());
        }
        Ok(painters)
    }
}

/// One timed combination.
#[derive(Clone, Debug, Serialize)]
pub struct RenderRow {
    /// How the frames came about.
    pub path: FramePath,
    /// Renderer.
    pub renderer: Renderer,
    /// Splats of the scene.
    pub splats: usize,
    /// Columns of the image.
    pub width: u32,
    /// Rows of the image.
    pub height: u32,
    /// Timed frames.
    pub frames: usize,
    /// Median milliseconds per frame; `None` where it could not be drawn.
    pub ms: Option<f64>,
    /// First quartile.
    pub ms_q1: Option<f64>,
    /// Third quartile.
    pub ms_q3: Option<f64>,
    /// Splats to records of the image; stages that cannot be told apart are `None`.
    pub prepare_ms: Option<f64>,
    /// Their order.
    pub sort_ms: Option<f64>,
    /// Lists of tiles.
    pub bin_ms: Option<f64>,
    /// Pixels.
    pub draw_ms: Option<f64>,
    /// Why it could not be drawn.
    pub skipped: Option<String>,
}

impl RenderRow {
    fn spread(&self) -> Option<Spread> {
        Some(Spread { median: self.ms?, quartiles: [self.ms_q1?, self.ms_q3?] })
    }

    fn stages(&self) -> [Option<f64>; STAGES.len()] {
        [self.prepare_ms, self.sort_ms, self.bin_ms, self.draw_ms]
    }
}

/// Times every combination; whoever draws takes turns frame by frame.
pub fn run(plan: &RenderPlan, scene: &BenchScene, progress: Progress) -> Result<Bench, BenchError> {
    let mut missing = Vec::new();
    let mut painters = plan.painters(&mut missing)?;
    let steps = plan.splats.len() * plan.sizes.len();
    let (mut rows, mut done) = (Vec::new(), 0);
    for &n in &plan.splats {
        let splats = scene.splats(n, plan.options.seed);
        let mut turns = Turns::new(&mut painters, &splats);
        for &size in &plan.sizes {
            rows.extend(turns.time(plan.frames, size, scene.up()));
            done += 1;
            progress(done, steps);
        }
    }
    let summary = RenderSummary::of(&rows);
    let title = format!("Time per frame: {}", scene.name());
    Findings {
        name: "render",
        dataset: scene.name(),
        adapter: painters.iter().find_map(|painter| painter.adapter()),
        options: plan.options,
        notes: [missing, notes(plan, &rows, &summary)].concat(),
        table: text(&rows),
        plot: draw::draw(&title, &panels(plan, &rows))?,
        rows,
        summary,
    }
    .into_bench()
}

/// Everybody who draws one scene.
struct Turns<'a> {
    splats: &'a [Splat],
    painters: &'a mut [Box<dyn TimedPainter>],
    /// Why a painter cannot draw this scene.
    refusals: Vec<Option<TimedPaintError>>,
}

impl<'a> Turns<'a> {
    fn new(painters: &'a mut [Box<dyn TimedPainter>], splats: &'a [Splat]) -> Self {
        let refusals = painters.iter_mut().map(|painter| painter.load(splats).err()).collect();
        Self { splats, painters, refusals }
    }

    /// All renderers of all painters in turns, one frame each, from the same sides of the scene.
    /// The first round warms up and does not count.
    fn time(&mut self, frames: usize, size: [u32; 2], up: DVec3) -> Vec<RenderRow> {
        let mut found: Vec<TimedTarget> = self.targets();
        let framing = framing(self.splats).unwrap_or(Framing { centre: DVec3::ZERO, radius: 1.0 });
        for round in 0..=frames {
            let camera = view(&framing, up, size, round as f64 / frames as f64 * TAU);
            for target in found.iter_mut().filter(|target| target.failure.is_none()) {
                let method = target.renderer.into();
                let options = RenderOptions::viewport(method, [0.0; 3], framing.radius);
                let painter = &mut self.painters[target.painter];
                match painter.frame(self.splats, &camera, &options) {
                    Ok(ms) if round > 0 => target.times.push(ms),
                    Ok(_) => {}
                    Err(error) => target.failure = Some(error.to_string()),
                }
            }
        }
        found.into_iter().map(|target| target.into_row(self.splats.len(), size, frames)).collect()
    }

    fn targets(&self) -> Vec<TimedTarget> {
        let mut targets = Vec::new();
        for (i, (painter, refusal)) in self.painters.iter().zip(&self.refusals).enumerate() {
            targets.extend(RENDERERS.into_iter().map(|renderer| TimedTarget {
                painter: i,
                path: painter.path(),
                renderer,
                times: Vec::new(),
                failure: refusal.as_ref().map(ToString::to_string),
            }));
        }
        targets
    }
}

/// One renderer of one painter, and its times.
struct TimedTarget {
    painter: usize,
    path: FramePath,
    renderer: Renderer,
    times: Vec<FrameStageMs>,
    failure: Option<String>,
}

impl TimedTarget {
    fn into_row(self, splats: usize, [width, height]: [u32; 2], frames: usize) -> RenderRow {
        let is_drawn = self.failure.is_none();
        let ms = is_drawn.then(|| Spread::of(self.times.iter().map(|ms| ms.total).collect()));
        let stage = |i: usize| {
            let told: Vec<f64> = self.times.iter().filter_map(|ms| ms.stages[i]).collect();
            (is_drawn && !told.is_empty()).then(|| Spread::of(told).median)
        };
        RenderRow {
            path: self.path,
            renderer: self.renderer,
            splats,
            width,
            height,
            frames: if is_drawn { frames } else { 0 },
            ms: ms.map(|ms| ms.median),
            ms_q1: ms.map(|ms| ms.quartiles[0]),
            ms_q3: ms.map(|ms| ms.quartiles[1]),
            prepare_ms: stage(0),
            sort_ms: stage(1),
            bin_ms: stage(2),
            draw_ms: stage(3),
            skipped: self.failure,
        }
    }
}

/// The whole scene from a distance at which it fills the image.
fn view(framing: &Framing, up: DVec3, [width, height]: [u32; 2], azimuth: f64) -> Camera {
    let intrinsics = Intrinsics::from_horizontal_fov(width, height, FOV);
    let narrower = 2.0 * (0.5 * f64::from(width.min(height)) / intrinsics.fx).atan();
    let distance = framing.distance(narrower);
    let orbit = Orbit { target: framing.centre, up, azimuth, elevation: ELEVATION, distance };
    Camera { intrinsics, pose: orbit.pose() }
}
