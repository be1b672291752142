//! Frames with their times, by whatever draws them.

use crate::eval::report;
use crate::math::camera::Camera;
use crate::model::splat::splats::Splat;
use crate::render::RenderOptions;
use crate::render::cpu::{CpuRenderer, CpuStage};
#[cfg(feature = "gui")]
use crate::render::gpu::{GpuError, headless::HeadlessError};
use serde::Serialize;
use std::time::Instant;

/// How a frame comes about.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, strum::Display)]
#[serde(rename_all = "kebab-case")]
#[strum(serialize_all = "kebab-case")]
pub enum FramePath {
    /// Tiles on the CPU.
    Cpu,
    /// Instanced quads on a GPU.
    #[cfg(feature = "gui")]
    Quads,
    /// Tiles in compute shaders of a GPU.
    #[cfg(feature = "gui")]
    Tiles,
}

/// Times of one frame, milliseconds; a stage that cannot be told apart is `None`.
#[derive(Clone, Copy, Debug)]
pub struct FrameStageMs {
    /// From the splats to the finished image.
    pub total: f64,
    /// In the order of [`STAGES`].
    pub stages: [Option<f64>; STAGES.len()],
}

/// Stages of a frame: splats to image records, their order, lists of tiles, pixels.
pub const STAGES: [&str; CpuStage::ALL.len()] = ["prepare", "sort", "bin", "draw"];

/// Why a frame is not drawn.
#[derive(Debug, thiserror::Error)]
pub enum TimedPaintError {
    /// The machine has not enough memory.
    #[error("needs about {needed_mb} MB of memory, {available_mb} MB are free")]
    Memory {
        /// Memory needed, 10⁶ bytes.
        needed_mb: u64,
        /// Free memory, 10⁶ bytes.
        available_mb: u64,
    },
    /// The scene or the image does not fit the adapter.
    #[cfg(feature = "gui")]
    #[error(transparent)]
    Gpu(#[from] GpuError),
    /// The device failed.
    #[cfg(feature = "gui")]
    #[error(transparent)]
    BenchDevice(#[from] HeadlessError),
}

/// Draws frames of one scene after the other.
pub trait TimedPainter {
    /// How its frames come about.
    fn path(&self) -> FramePath;

    /// The adapter that draws, if one does.
    fn adapter(&self) -> Option<String>;

    /// Takes a scene; the frames that follow show it.
    fn load(&mut self, splats: &[Splat]) -> Result<(), TimedPaintError>;

    /// Draws a frame of the scene taken last, which is handed over again.
    fn frame(
        &mut self,
        splats: &[Splat],
        camera: &Camera,
        options: &RenderOptions,
    ) -> Result<FrameStageMs, TimedPaintError>;
}

/// The CPU renderer on all threads of the pool.
#[derive(Default)]
pub struct TimedCpu(CpuRenderer);

/// Bytes of a splat in memory and in the buffers of the renderer, about.
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
        // Asked beforehand: running out of memory would take the rows that were timed along.
        match report::available_bytes() {
            Some(available) if available < needed => Err(TimedPaintError::Memory {
                needed_mb: needed.div_ceil(1_000_000),
                available_mb: available / 1_000_000,
            }),
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
            // Taken anew, so that noting a time is part of no stage.
            from = Instant::now();
        });
        Ok(FrameStageMs { total: ms_since(started), stages })
    }
}

/// Milliseconds since an instant.
pub fn ms_since(started: Instant) -> f64 {
    started.elapsed().as_secs_f64() * 1e3
}
