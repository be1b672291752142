//! How scenes are trained and how the viewport draws them, all in one place.

use super::adapter::{self, AdapterRequest, Adapters};
use super::training;
use crate::app::training::TrainSettings;
use crate::app::viewer::settings::{
    Background, FISHEYE_FOV_DEG, GAINS, PINHOLE_FOV_DEG, SCALES, ViewSettings,
};
use crate::render::Exposing;
use crate::render::{Antialias, Lens, Renderer};
use eframe::egui::{Grid, Label, RichText, ScrollArea, Slider, Ui};

/// What the panel says beside the settings.
pub struct SettingsContext<'a> {
    /// Who draws the scene.
    pub adapter: &'a str,
    /// Vertical field of view of the scene's own camera, degrees.
    pub own_fov_deg: f32,
}

/// Draws the panel; what the user asks of the adapters.
pub fn ui(
    settings: &mut ViewSettings,
    train_settings: &mut TrainSettings,
    surroundings: &SettingsContext<'_>,
    adapters: Option<&Adapters<'_>>,
    ui: &mut Ui,
) -> Option<AdapterRequest> {
    let mut asked = None;
    ScrollArea::vertical().show(ui, |ui| {
        section(ui, "Training");
        training::ui(train_settings, ui);
        section(ui, "Renderer");
        renderer(settings, ui);
        section(ui, "Lens");
        lens(settings, surroundings.own_fov_deg, ui);
        section(ui, "Splats");
        splats(settings, ui);
        section(ui, "Background");
        background(settings, ui);
        section(ui, "Exposure");
        exposure(settings, ui);
        section(ui, "Comparison");
        ui.add(
            Slider::new(&mut settings.difference_gain, GAINS)
                .logarithmic(true)
                .max_decimals(0)
                .text("Difference gain"),
        );
        section(ui, "Drawn by");
        ui.add(Label::new(surroundings.adapter).wrap());
        asked = adapters.and_then(|adapters| adapter::ui(adapters, ui));
        ui.add_space(12.0);
        if ui.button("Reset all").on_hover_text("Back to what a fresh start has").clicked() {
            // What colours mean is chosen above the viewport and never stored, so it stays.
            *settings = ViewSettings { color_mode: settings.color_mode, ..ViewSettings::default() };
            *train_settings = TrainSettings::default();
        }
    });
    asked
}

fn section(ui: &mut Ui, title: &str) {
    ui.add_space(8.0);
    ui.label(RichText::new(title).strong());
    ui.add_space(2.0);
}

fn renderer(settings: &mut ViewSettings, ui: &mut Ui) {
    let projected = settings.lens == Lens::Pinhole;
    ui.horizontal(|ui| {
        ui.add_enabled_ui(projected, |ui| {
            ui.selectable_value(&mut settings.renderer, Renderer::Projected, "Projected")
                .on_disabled_hover_text("Only the exact renderer draws a fisheye");
        });
        ui.selectable_value(&mut settings.renderer, Renderer::Exact, "Exact");
    });
    ui.horizontal(|ui| {
        ui.label("Antialiasing").on_hover_text("Of the exact renderer");
        for (antialias, label, tooltip) in [
            (Antialias::Footprint, "Footprint", "Splats cover at least about a pixel"),
            (Antialias::None, "None", "Thin splats flicker"),
            (Antialias::Reference, "Reference", "As the published renderer: thin splats fade"),
        ] {
            ui.selectable_value(&mut settings.antialias, antialias, label).on_hover_text(tooltip);
        }
    });
}

/// Lens and field of view; also shown by the strip above the viewport.
pub fn lens(settings: &mut ViewSettings, own_fov_deg: f32, ui: &mut Ui) {
    ui.horizontal(|ui| {
        for (choice, label, tooltip) in [
            (Lens::Pinhole, "Pinhole", "Straight lines stay straight"),
            (Lens::Fisheye, "Fisheye", "Equidistant, up to all around; by the exact renderer"),
        ] {
            let is_chosen = settings.lens == choice;
            if ui.selectable_label(is_chosen, label).on_hover_text(tooltip).clicked() {
                settings.set_lens(choice);
            }
        }
    });
    ui.horizontal(|ui| {
        let reset = match settings.lens {
            Lens::Pinhole => {
                // Rounded as the slider rounds, which else would count as a change.
                let mut fov = settings.pinhole_fov_deg.unwrap_or(own_fov_deg).round();
                if ui.add(degrees(&mut fov, PINHOLE_FOV_DEG)).changed() {
                    settings.pinhole_fov_deg = Some(fov);
                }
                settings.pinhole_fov_deg.is_some()
            }
            Lens::Fisheye => {
                ui.add(degrees(&mut settings.fisheye_fov_deg, FISHEYE_FOV_DEG));
                false
            }
        };
        let undo = ui.add_enabled(reset, eframe::egui::Button::new("Reset"));
        if undo.on_hover_text("As the scene's own camera sees").clicked() {
            settings.pinhole_fov_deg = None;
        }
    });
    ui.label(RichText::new("Field of view from top to bottom").weak());
}

fn degrees(fov: &mut f32, range: std::ops::RangeInclusive<f32>) -> Slider<'_> {
    Slider::new(fov, range).suffix("°").max_decimals(0)
}

fn splats(settings: &mut ViewSettings, ui: &mut Ui) {
    let start = ViewSettings::default();
    Grid::new("splats").num_columns(3).show(ui, |ui| {
        ui.label("Scale").on_hover_text("Factor on the size of every splat");
        ui.add(Slider::new(&mut settings.scale, SCALES).max_decimals(2));
        if ui.add_enabled(settings.scale != start.scale, reset()).clicked() {
            settings.scale = start.scale;
        }
        ui.end_row();
        ui.label("Opacity from").on_hover_text("Splats with a smaller opacity are left out");
        ui.add(Slider::new(&mut settings.opacity_cut, 0.0..=1.0).max_decimals(2));
        if ui.add_enabled(settings.opacity_cut != start.opacity_cut, reset()).clicked() {
            settings.opacity_cut = start.opacity_cut;
        }
        ui.end_row();
    });
}

fn reset() -> eframe::egui::Button<'static> {
    eframe::egui::Button::new("Reset")
}

fn exposure(settings: &mut ViewSettings, ui: &mut Ui) {
    ui.horizontal(|ui| {
        for (choice, label, tooltip) in [
            (Exposing::Neutral, "Neutral", "From everywhere as the first frames were exposed; beside photographs as recorded"),
            (
                Exposing::Recorded,
                "As recorded",
                "Every view as bright as the frames recorded around it, where the camera exposed by itself",
            ),
        ] {
            ui.selectable_value(&mut settings.exposing, choice, label).on_hover_text(tooltip);
        }
    });
}

fn background(settings: &mut ViewSettings, ui: &mut Ui) {
    ui.horizontal(|ui| {
        for (choice, label) in [
            (Background::Dark, "Dark"),
            (Background::Grey, "Grey"),
            (Background::White, "White"),
            (Background::Black, "Black"),
        ] {
            ui.selectable_value(&mut settings.background, choice, label);
        }
        let mut rgb = settings.background.rgb8();
        let picked = ui.color_edit_button_srgb(&mut rgb).on_hover_text("Any other colour");
        if picked.changed() {
            settings.background = Background::Custom(rgb);
        }
    });
}
