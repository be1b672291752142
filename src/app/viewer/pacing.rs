//! Pacing of window passes during training if the CPU draws the window.

use super::SceneView;
use crate::app::draw_budget::DrawBudget;
use crate::app::drawing::ViewRenderer;
use crate::app::state::RunState;
use std::time::Duration;

/// Minimum time between two snapshots: with a real GPU, and if the CPU also draws the window.
const GPU_INTERVAL: Duration = Duration::from_millis(33);
const SOFTWARE_INTERVAL: Duration = Duration::from_millis(500);

impl SceneView {
    /// CPU budget of drawing; `None` if a GPU draws.
    pub fn budget(&self) -> Option<&DrawBudget> {
        (self.painter.drawer() == ViewRenderer::Cpu).then_some(&self.budget)
    }

    /// Minimum time between two snapshots during training. Every snapshot repaints the window, which a
    /// software adapter does on the cores that train (`rendering.md`, Software adapters).
    pub fn snapshot_interval(&self) -> Duration {
        match self.budget() {
            None => GPU_INTERVAL,
            Some(budget) => SOFTWARE_INTERVAL.max(budget.interval()),
        }
    }

    /// Starts a pass of the window; returns the time to wait before it. egui redraws the whole window
    /// on every pointer movement, much more often than the scene is rendered; during training these
    /// movements are merged.
    pub fn begin_pass(&mut self, state: RunState) -> Duration {
        self.budget.share = self.settings.draw_share;
        let is_shared = state == RunState::Training && self.budget().is_some();
        let is_steered = is_shared && self.moved_at.elapsed() < super::SETTLE;
        let pause = if is_steered { self.budget.pause_before_pass() } else { Duration::ZERO };
        self.budget.begin_pass(pause);
        pause
    }
}
