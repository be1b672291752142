//! What the export dialog asks of scenes: how their splats become plain ones.

use crate::export::mapping::{GradientSplit, Mapping, OpacityMapping};
use eframe::egui::{Grid, Ui};

/// Draws the choices.
pub fn ui(mapping: &mut Mapping, ui: &mut Ui) {
    ui.add_space(4.0);
    ui.label("Other programs draw plain splats: opacity up to 1, one colour.");
    ui.weak("Trained with Splats: Plain (Settings), a scene is written exactly as it was learnt.");
    Grid::new("mapping").num_columns(2).show(ui, |ui| {
        ui.label("Splats for each");
        ui.horizontal(|ui| {
            for (split, label, tooltip) in [
                (GradientSplit::One, "1", "Colour no longer varies over a splat"),
                (GradientSplit::Two, "2", "Two along the longest axis, coloured by the gradient"),
                (
                    GradientSplit::Four,
                    "4",
                    "Four along both axes of the surface, coloured by the gradient",
                ),
            ] {
                let is_chosen = mapping.split == split;
                if ui.selectable_label(is_chosen, label).on_hover_text(tooltip).clicked() {
                    // Brings the opacity that measured best with it, which can
                    // still be changed below.
                    *mapping = Mapping::of(split);
                }
            }
        });
        ui.end_row();
        ui.label("Opacity above 1");
        ui.horizontal(|ui| {
            for (opacity, label, tooltip) in [
                (OpacityMapping::EqualArea, "Equal area", "Splats grow until they cover as much"),
                (OpacityMapping::Clip, "Clip", "Splats keep their size"),
            ] {
                ui.selectable_value(&mut mapping.opacity, opacity, label).on_hover_text(tooltip);
            }
        });
        ui.end_row();
    });
    ui.add_space(4.0);
}
