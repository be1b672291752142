//! Painter of the viewport: a GPU, or the CPU if there is no real one.

use super::photo::PictureRequest;
use crate::app::drawing::{DrawSample, Painting, ViewRenderer};
use crate::app::software::{Effort, SoftwarePainter};
use crate::app::splat_updates::SplatChange;
use crate::app::viewport;
use crate::app::viewport::{GpuViewPainter, ViewPaintError, WindowDevice};
use crate::app::worker::Waker;
use crate::model::splat::appearance::SplatSet;
use eframe::egui::{Rect, Ui};

/// Painter in use.
pub enum ViewPainter {
    /// Paints with `render::gpu`.
    Gpu(Box<GpuViewPainter>),
    /// Paints with `render::cpu`.
    Software(Box<SoftwarePainter>),
}

impl ViewPainter {
    /// Creates a GPU painter if the adapter is a real GPU, else a CPU painter; also returns a line that
    /// names the renderer.
    pub fn choose(
        device: Option<&WindowDevice>,
        painting: Painting,
        waker: &Waker,
    ) -> std::io::Result<(Self, String)> {
        let Some(WindowDevice { state, faults, .. }) = device else {
            return Ok((Self::software(waker)?, "CPU renderer".to_owned()));
        };
        let capabilities = viewport::capabilities(state);
        tracing::info!("adapter: {capabilities}");
        // A software adapter would use the same cores and be far slower (`rendering.md`, Software
        // adapters).
        if capabilities.is_software() && painting == Painting::Auto {
            let who = format!("CPU renderer; window by {capabilities}");
            return Ok((Self::software(waker)?, who));
        }
        match GpuViewPainter::new(state, faults.clone()) {
            Ok(painter) => Ok((Self::Gpu(Box::new(painter)), capabilities.to_string())),
            Err(error) => {
                // The adapter may still draw the window itself; only the scene falls back to the CPU.
                tracing::warn!("{error}");
                Ok((Self::software(waker)?, format!("CPU renderer ({error})")))
            }
        }
    }

    /// Creates a CPU painter.
    pub fn software(waker: &Waker) -> std::io::Result<Self> {
        Ok(Self::Software(Box::new(SoftwarePainter::new(waker.clone())?)))
    }

    /// Device that draws.
    pub fn drawer(&self) -> ViewRenderer {
        match self {
            Self::Gpu(painter) => painter.drawer(),
            Self::Software(_) => ViewRenderer::Cpu,
        }
    }

    /// Applies a change; `splats` are all splats after it.
    pub fn change(&mut self, change: SplatChange, splats: &SplatSet) {
        match self {
            Self::Gpu(painter) => painter.change(change, splats),
            Self::Software(painter) => painter.change(change),
        }
    }

    /// Number of splats in the picture.
    pub fn n_drawn(&self) -> usize {
        match self {
            Self::Gpu(painter) => painter.n_drawn(),
            Self::Software(painter) => painter.n_drawn(),
        }
    }

    /// Paints over `rect`; `effort` applies to the CPU only. Returns the timing of a new picture. After
    /// an error this painter is unusable.
    pub fn paint(
        &mut self,
        ui: &Ui,
        rect: Rect,
        request: &PictureRequest,
        effort: Effort,
        splats: &SplatSet,
    ) -> Result<Option<DrawSample>, ViewPaintError> {
        match self {
            Self::Gpu(painter) => painter.paint(ui, rect, request, splats).map(Some),
            Self::Software(painter) => Ok(painter.paint(ui, rect, request, effort)),
        }
    }
}
