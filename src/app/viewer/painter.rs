//! Who draws the viewport: a GPU, or the CPU where there is no real one.

use super::picture_request::PictureRequest;
use crate::app::device::WindowDevice;
use crate::app::draw_budget::DrawBudget;
use crate::app::drawing::{DrawSample, Drawer};
use crate::app::painting::Painting;
use crate::app::software::{Effort, SoftwarePainter};
use crate::app::splat_updates::SplatChange;
use crate::app::viewport::{self, GpuViewPainter, ViewPaintError};
use crate::app::worker::Waker;
use crate::model::splat::appearance::SplatSet;
use eframe::egui::{Rect, Ui};

/// The painter in use.
pub enum ViewPainter {
    /// `render::gpu`.
    Gpu(Box<GpuViewPainter>),
    /// `render::cpu`.
    Software(Box<SoftwarePainter>),
}

impl ViewPainter {
    /// A GPU painter if the adapter is a real GPU; and a line on who draws.
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
        // It would compute on the same cores, and far slower (`rendering.md`, Software adapters).
        if capabilities.is_software() && painting == Painting::Auto {
            let who = format!("CPU renderer; window by {capabilities}");
            return Ok((Self::software(waker)?, who));
        }
        match GpuViewPainter::new(state, faults.clone(), waker.clone()) {
            Ok(painter) => Ok((Self::Gpu(Box::new(painter)), capabilities.to_string())),
            Err(error) => {
                // The window itself may well be drawn by it; only the scene moves to the CPU.
                tracing::warn!("{error}");
                Ok((Self::software(waker)?, format!("CPU renderer ({error})")))
            }
        }
    }

    /// The CPU's painter.
    pub fn software(waker: &Waker) -> std::io::Result<Self> {
        Ok(Self::Software(Box::new(SoftwarePainter::new(waker.clone())?)))
    }

    /// Who draws.
    pub fn drawer(&self) -> Drawer {
        match self {
            Self::Gpu(painter) => painter.drawer(),
            Self::Software(_) => Drawer::Cpu,
        }
    }

    /// Hands changed splats over; `splats` are all of them, the change applied.
    pub fn change(&mut self, change: SplatChange, splats: &SplatSet) {
        match self {
            Self::Gpu(painter) => painter.change(change, splats),
            Self::Software(painter) => painter.change(change),
        }
    }

    /// Splats in the picture.
    pub fn n_drawn(&self) -> usize {
        match self {
            Self::Gpu(painter) => painter.n_drawn(),
            Self::Software(painter) => painter.n_drawn(),
        }
    }

    /// Paints over `rect`, the CPU with as much effort as is said; what a new picture took, which the
    /// budget learns. An error means that this painter is of no more use.
    pub fn paint(
        &mut self,
        ui: &Ui,
        rect: Rect,
        request: &PictureRequest,
        effort: Effort,
        budget: &mut DrawBudget,
        splats: &SplatSet,
    ) -> Result<Option<DrawSample>, ViewPaintError> {
        match self {
            Self::Gpu(painter) => painter.paint(ui, rect, request, splats).map(Some),
            Self::Software(painter) => {
                let drawn = painter.paint(ui, rect, request, effort);
                if let Some((ms, scale)) = drawn.and_then(|drawn| drawn.beside_training) {
                    budget.note_picture(ms, scale);
                }
                Ok(drawn.map(|drawn| drawn.sample))
            }
        }
    }
}
