//! How much of the cores drawing may take from training.

use crate::app::draw_budget::{DrawBudget, SHARES};
use eframe::egui::{Label, RichText, Slider, Ui};

/// Draws the choice and what is taken now, as [`described`] says it; `None` where a GPU draws.
pub fn ui(share: &mut f32, taken: Option<&str>, ui: &mut Ui) {
    let mut percent = 100.0 * *share;
    let range = 100.0 * SHARES.start()..=100.0 * SHARES.end();
    let slider = Slider::new(&mut percent, range).max_decimals(0).suffix(" %");
    let slider = slider.text("of the cores");
    let hint = "What drawing the window and the scene may take of all cores while frames are trained: pictures come less often and smaller then";
    if ui.add_enabled(taken.is_some(), slider).on_hover_text(hint).changed() {
        *share = 0.01 * percent;
    }
    let text = taken.unwrap_or("A GPU draws: training keeps all cores.");
    ui.add(Label::new(RichText::new(text).weak()).wrap());
}

/// What drawing takes, in words.
pub fn described(budget: &DrawBudget) -> String {
    let (taken, scale) = (100.0 * budget.taken(), 100.0 * budget.scale(true));
    let apart = budget.interval().as_millis();
    format!(
        "Drawing took {taken:.0} % of late. While training, a moving camera is drawn every {apart} ms at {scale:.0} % of the size."
    )
}
