//! Frame time by stage against number of splats and resolution, for both renderers, on CPU and GPU.
//!
//! Painters draw the same views in turns, so that other load on the machine slows all of them
//! alike. The first round warms up buffers and clocks and is excluded. If a painter cannot draw a
//! scene, for example for lack of memory, its rows state the reason instead of a time.

#[cfg(feature = "gui")]
mod gpu;
mod painter;
mod report;
mod scene;

use super::plot;
use crate::bench::findings::{Bench, BenchError, BenchOptions, Findings, Progress, steps};
use crate::eval::metrics::Spread;
use crate::math::camera::{Camera, Intrinsics};
use crate::math::orbit::Orbit;
use crate::model::splat::framing::{Framing, core_sphere};
use crate::model::splat::splats::Splat;
#[cfg(feature = "gui")]
use crate::render::gpu::adapters::AdapterChoice;
use crate::render::{RenderOptions, Renderer};
use glam::DVec3;
#[cfg(feature = "gui")]
use gpu::TimedGpu;
use painter::{FramePath, FrameStageMs, TimedCpu, TimedPaintError, TimedPainter};
use report::{RenderRow, notes, panels, text};
use std::f64::consts::TAU;

pub use scene::BenchScene;

/// Horizontal field of view, radians.
const FOV: f64 = 1.0;
/// Elevation of the camera above the scene, radians.
const ELEVATION: f64 = 0.45;

/// Both renderers, in the order of the table's rows.
const RENDERERS: [Renderer; 2] = [Renderer::Projected, Renderer::Exact];

#[derive(Clone, Copy, Debug, PartialEq, Eq, strum::EnumString, strum::VariantNames)]
#[strum(serialize_all = "kebab-case")]
pub enum BenchDevice {
    Cpu,
    #[cfg(feature = "gui")]
    Gpu,
    /// The CPU renderer, and a graphics adapter unless it is a software adapter.
    All,
}

#[derive(Clone, Debug)]
pub struct RenderPlan {
    pub splats: Vec<usize>,
    /// Width and height of the images, pixels.
    pub sizes: Vec<[u32; 2]>,
    pub device: BenchDevice,
    /// Name or number of the graphics adapter, which may be a software adapter.
    #[cfg(feature = "gui")]
    pub adapter: Option<String>,
    /// Number of timed frames per combination, each from a different side.
    pub frames: usize,
    pub options: BenchOptions,
}

impl RenderPlan {
    /// Creates a plan with 10⁴ to 4·10⁶ splats (10⁶ if quick), and the model's own number of splats.
    pub fn new(options: BenchOptions, scene: &BenchScene) -> Self {
        let mut splats = vec![10_000, 100_000, 1_000_000];
        let mut sizes = vec![[400, 400], [1280, 720]];
        if !options.quick {
            splats.extend([30_000, 300_000, 4_000_000]);
            // In the middle, because plots show sizes in this order.
            sizes.insert(1, [800, 600]);
        }
        splats.extend(scene.own_count());
        // The model's own number may be among these.
        splats.sort_unstable();
        splats.dedup();
        Self {
            splats,
            sizes,
            device: BenchDevice::All,
            #[cfg(feature = "gui")]
            adapter: None,
            // `repeats` is the number of frames, each from a different side.
            frames: options.repeats.unwrap_or(if options.quick { 5 } else { 15 }),
            options,
        }
    }

    /// Creates all painters. With `All` and no named adapter, a missing GPU is reported as a note
    /// instead of an error.
    pub fn painters(
        &self,
        notes: &mut Vec<String>,
    ) -> Result<Vec<Box<dyn TimedPainter>>, BenchError> {
        let mut painters: Vec<Box<dyn TimedPainter>> = Vec::new();
        if matches!(self.device, BenchDevice::Cpu | BenchDevice::All) {
            painters.push(Box::new(TimedCpu::default()));
        }
        #[cfg(feature = "gui")]
        if self.device != BenchDevice::Cpu {
            let choice = self.adapter.as_deref().map_or(AdapterChoice::Auto, AdapterChoice::parse);
            match TimedGpu::new(&choice) {
                Ok(painter) => painters.push(Box::new(painter)),
                // A requested adapter must exist. As part of `All` it may be missing.
                Err(error) if self.device == BenchDevice::All && self.adapter.is_none() => {
                    notes.push(format!("CPU only: {error}"));
                }
                Err(error) => return Err(error.into()),
            }
        }
        #[cfg(not(feature = "gui"))]
        if self.device == BenchDevice::All {
            notes.push("CPU only: this build has no GPU support".to_owned());
        }
        Ok(painters)
    }
}

pub fn run(plan: &RenderPlan, scene: &BenchScene, progress: Progress) -> Result<Bench, BenchError> {
    let mut missing = Vec::new();
    let mut painters = plan.painters(&mut missing)?;
    let mut step = steps(progress, plan.splats.len() * plan.sizes.len());
    let mut rows = Vec::new();
    for &n in &plan.splats {
        let splats = scene.splats(n, plan.options.seed);
        let load = |painter: &mut Box<dyn TimedPainter>| painter.load(&splats).err();
        let refusals: Vec<Option<TimedPaintError>> = painters.iter_mut().map(load).collect();
        for &size in &plan.sizes {
            let targets = targets(&painters, &refusals);
            rows.extend(time(targets, &mut painters, &splats, plan.frames, size, scene.up()));
            step();
        }
    }
    let title = format!("Time per frame: {}", scene.name());
    Findings {
        name: "render",
        dataset: scene.name(),
        // At most one painter has an adapter.
        adapter: painters.iter().find_map(|painter| painter.adapter()),
        options: plan.options,
        notes: [missing, notes(plan, &rows)].concat(),
        table: text(&rows),
        plot: plot::draw(&title, &panels(plan, &rows))?,
        rows,
        summary: (),
    }
    .into_bench()
}

/// Lists the combinations of every painter with both renderers.
fn targets(
    painters: &[Box<dyn TimedPainter>],
    refusals: &[Option<TimedPaintError>],
) -> Vec<TimedTarget> {
    let mut targets = Vec::new();
    for (i, (painter, refusal)) in painters.iter().zip(refusals).enumerate() {
        targets.extend(RENDERERS.map(|renderer| TimedTarget {
            painter: i,
            path: painter.path(),
            renderer,
            times: Vec::new(),
            failure: refusal.as_ref().map(ToString::to_string),
        }));
    }
    targets
}

/// Times all targets in turns, one frame per round, while the camera circles the scene. The first round
/// only warms up and is excluded.
fn time(
    mut targets: Vec<TimedTarget>,
    painters: &mut [Box<dyn TimedPainter>],
    splats: &[Splat],
    frames: usize,
    size: [u32; 2],
    up: DVec3,
) -> Vec<RenderRow> {
    // A scene without finite splats draws nothing from any camera.
    let framing = core_sphere(splats).unwrap_or(Framing { centre: DVec3::ZERO, radius: 1.0 });
    for round in 0..=frames {
        // The warm-up view equals the last one, a full turn away, so that timed views cover
        // every side once.
        let camera = view(&framing, up, size, round as f64 / frames as f64 * TAU);
        for target in targets.iter_mut().filter(|target| target.failure.is_none()) {
            let method = target.renderer.into();
            let options = RenderOptions::viewport(method, [0.0; 3], framing.radius);
            match painters[target.painter].frame(splats, &camera, &options) {
                Ok(ms) if round > 0 => target.times.push(ms),
                // Warm-up round.
                Ok(_) => {}
                Err(error) => target.failure = Some(error.to_string()),
            }
        }
    }
    targets.into_iter().map(|target| target.into_row(splats.len(), size, frames)).collect()
}

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
            // The first frames of a GPU have no timestamps yet.
            let times: Vec<f64> = self.times.iter().filter_map(|ms| ms.stages[i]).collect();
            (is_drawn && !times.is_empty()).then(|| Spread::of(times).median)
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

/// Returns the camera at an azimuth (radians) at which the whole scene fits into the image.
fn view(framing: &Framing, up: DVec3, [width, height]: [u32; 2], azimuth: f64) -> Camera {
    let intrinsics = Intrinsics::from_horizontal_fov(width, height, FOV);
    // The narrower side decides whether the whole scene is visible.
    let narrower = 2.0 * (0.5 * f64::from(width.min(height)) / intrinsics.fx).atan();
    let distance = framing.distance(narrower);
    let orbit = Orbit { target: framing.centre, up, azimuth, elevation: ELEVATION, distance };
    Camera { intrinsics, pose: orbit.pose() }
}
