//! Painters that draw frames and time their stages.

use crate::eval::report;
use crate::math::camera::Camera;
use crate::model::splat::splats::Splat;
use crate::render::RenderOptions;
use crate::render::cpu::{CpuRenderer, CpuStage};
#[cfg(feature = "gui")]
use crate::render::gpu::{GpuError, headless::HeadlessError};
use serde::Serialize;
use std::time::Instant;

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, strum::Display)]
#[serde(rename_all = "kebab-case")]
#[strum(serialize_all = "kebab-case")]
pub enum FramePath {
    Cpu,
    #[cfg(feature = "gui")]
    Gpu,
}

/// Times of one frame, milliseconds. `None` for a stage that is not timed separately.
#[derive(Clone, Copy, Debug)]
pub struct FrameStageMs {
    /// Time from splats to the finished image.
    pub total: f64,
    /// Times of the stages, in the order of [`STAGES`].
    pub stages: [Option<f64>; STAGES.len()],
}

/// Stages of a frame: compute the image data of each splat, sort splats by depth, build tile lists, draw
/// pixels.
pub const STAGES: [&str; CpuStage::ALL.len()] = ["prepare", "sort", "bin", "draw"];

#[derive(Debug, thiserror::Error)]
pub enum TimedPaintError {
    #[error("needs about {needed_mb} MB of memory, {available_mb} MB are free")]
    Memory { needed_mb: u64, available_mb: u64 },
    #[cfg(feature = "gui")]
    #[error(transparent)]
    Gpu(#[from] GpuError),
    #[cfg(feature = "gui")]
    #[error(transparent)]
    BenchDevice(#[from] HeadlessError),
}

pub trait TimedPainter {
    fn path(&self) -> FramePath;

    fn adapter(&self) -> Option<String>;

    fn load(&mut self, splats: &[Splat]) -> Result<(), TimedPaintError>;

    /// Draws and times a frame of the loaded scene. `splats` must be those of the last call of `load`.
    fn frame(
        &mut self,
        splats: &[Splat],
        camera: &Camera,
        options: &RenderOptions,
    ) -> Result<FrameStageMs, TimedPaintError>;
}

#[derive(Default)]
pub struct TimedCpu(CpuRenderer);

/// Approximate bytes per splat in memory and in the renderer's buffers.
const BYTES_PER_SPLAT: u64 = 256;

impl TimedPainter for TimedCpu {
    fn path(&self) -> FramePath {
        FramePath::Cpu
    }

    fn adapter(&self) -> Option<String> {
        None
    }

    fn load(&mut self, splats: &[Splat]) -> Result<(), TimedPaintError> {
        let needed = BYTES_PER_SPLAT * splats.len() as u64;
        // Check in advance: running out of memory would lose the rows already timed.
        match report::available_bytes() {
            Some(available) if available < needed => Err(TimedPaintError::Memory {
                needed_mb: needed.div_ceil(1_000_000),
                available_mb: available / 1_000_000,
            }),
            // Some systems do not report their free memory.
            _ => Ok(()),
        }
    }

    fn frame(
        &mut self,
        splats: &[Splat],
        camera: &Camera,
        options: &RenderOptions,
    ) -> Result<FrameStageMs, TimedPaintError> {
        let (mut stages, mut from) = ([None; STAGES.len()], Instant::now());
        let started = from;
        self.0.render_observed(splats.into(), camera, options, |stage| {
            stages[stage as usize] = Some(ms_since(from));
            // Read the clock again, so that recording the time belongs to no stage.
            from = Instant::now();
        });
        Ok(FrameStageMs { total: ms_since(started), stages })
    }
}

pub fn ms_since(started: Instant) -> f64 {
    started.elapsed().as_secs_f64() * 1e3
}
