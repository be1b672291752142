//! Setting for the share of the cores used for drawing during training.

use crate::app::draw_budget::{DrawBudget, SHARES};
use eframe::egui::{Label, RichText, Slider, Ui};

/// Draws the slider and the current use, formatted by [`described`]; `taken` is `None` if a GPU draws.
pub fn ui(share: &mut f32, taken: Option<&str>, ui: &mut Ui) {
    let mut percent = 100.0 * *share;
    let range = 100.0 * SHARES.start()..=100.0 * SHARES.end();
    let slider = Slider::new(&mut percent, range).max_decimals(0).suffix(" %");
    let slider = slider.text("of all cores");
    let hint = "Limits the CPU time for drawing the window and the scene during training. A lower share gives fewer and smaller pictures";
    if ui.add_enabled(taken.is_some(), slider).on_hover_text(hint).changed() {
        *share = 0.01 * percent;
    }
    let text = taken.unwrap_or("A GPU draws, so training uses all cores.");
    ui.add(Label::new(RichText::new(text).weak()).wrap());
}

pub fn describe_use(budget: &DrawBudget) -> String {
    let (taken, scale) = (100.0 * budget.used_share(), 100.0 * budget.scale(true));
    let apart = budget.interval().as_millis();
    format!(
        "Drawing recently used {taken:.0} % of the cores. During training, the view is drawn every {apart} ms while the camera moves, at {scale:.0} % of its size."
    )
}
