//! When the window is drawn beside training, where the CPU draws it.

use super::SceneView;
use crate::app::draw_budget::DrawBudget;
use crate::app::drawing::Drawer;
use crate::app::state::RunState;
use std::time::Duration;

/// Shortest time between two snapshots: of a real GPU, and where the CPU draws the window too.
const GPU_INTERVAL: Duration = Duration::from_millis(33);
const SOFTWARE_INTERVAL: Duration = Duration::from_millis(500);

impl SceneView {
    /// What drawing takes of the cores; `None` where a GPU draws and takes nothing.
    pub fn budget(&self) -> Option<&DrawBudget> {
        (self.painter.drawer() == Drawer::Cpu).then_some(&self.budget)
    }

    /// Shortest time between two snapshots while training. Every snapshot repaints the window, which a
    /// software adapter does on the cores that train (`rendering.md`, Software adapters).
    pub fn snapshot_interval(&self) -> Duration {
        match self.budget() {
            None => GPU_INTERVAL,
            Some(budget) => SOFTWARE_INTERVAL.max(budget.interval()),
        }
    }

    /// Begins a pass of the window; what to wait before it. egui draws the whole window anew with every
    /// movement of the pointer, many times as often as a picture is made: beside training the movements
    /// are taken together.
    pub fn begin_pass(&mut self, state: RunState) -> Duration {
        self.budget.share = self.settings.draw_share;
        let is_shared = state == RunState::Training && self.budget().is_some();
        let is_steered = is_shared && self.moved_at.elapsed() < super::SETTLE;
        let pause = if is_steered { self.budget.pause() } else { Duration::ZERO };
        self.budget.begin_pass(pause);
        pause
    }
}
