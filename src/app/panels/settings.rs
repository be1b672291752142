//! How scenes are trained and how the viewport draws them, all in one place.

use super::adapter::{self, AdapterRequest, Adapters};
use super::explained::named;
use super::{badge, draw_share, training};
use crate::app::command::UiCommand;
use crate::app::training::TrainSettings;
use crate::app::viewer::settings::{
    Background, FISHEYE_FOV_DEG, GAINS, PINHOLE_FOV_DEG, SCALES, ViewSettings,
};
use crate::render::Exposing;
use crate::render::{Antialias, Lens, Renderer};
use eframe::egui::{Grid, Label, RichText, ScrollArea, Slider, ThemePreference, Ui};

/// What the panel says beside the settings.
pub struct SettingsContext<'a> {
    /// Who draws the scene.
    pub adapter: &'a str,
    /// Vertical field of view of the scene's own camera, degrees.
    pub own_fov_deg: f32,
    /// What drawing takes of the cores, where the CPU draws.
    pub drawing: Option<&'a str>,
}

/// What the user asks for beyond settings.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum SettingsAnswer {
    /// Of the adapters.
    Adapter(AdapterRequest),
    /// A command.
    Command(UiCommand),
}

/// Draws the panel; what the user asks for beyond settings.
pub fn ui(
    settings: &mut ViewSettings,
    train_settings: &mut TrainSettings,
    surroundings: &SettingsContext<'_>,
    adapters: Option<&Adapters<'_>>,
    ui: &mut Ui,
) -> Option<SettingsAnswer> {
    let mut asked = None;
    // Both ways: rows wider than a narrow panel must not reach over the picture.
    ScrollArea::both().auto_shrink(false).show(ui, |ui| {
        section(ui, "Training");
        training::ui(train_settings, ui);
        let copy = UiCommand::CopyCommandLine;
        if ui.button(copy.label()).on_hover_text(copy.tooltip()).clicked() {
            asked = Some(SettingsAnswer::Command(copy));
        }
        viewport(settings, surroundings.own_fov_deg, ui);
        marked_section(ui, settings, "Drawing while training", |s| {
            s.draw_share = ViewSettings::default().draw_share;
        });
        draw_share::ui(&mut settings.draw_share, surroundings.drawing, ui);
        section(ui, "Window");
        theme(ui);
        section(ui, "Drawn by");
        ui.add(Label::new(surroundings.adapter).wrap());
        let request = adapters.and_then(|adapters| adapter::ui(adapters, ui));
        asked = request.map(SettingsAnswer::Adapter).or(asked.take());
        ui.add_space(12.0);
        if ui.button("Reset all").on_hover_text("Back to what a fresh start has").clicked() {
            // What colours mean is chosen above the viewport and never stored, so it stays.
            *settings = ViewSettings { color_mode: settings.color_mode, ..ViewSettings::default() };
            *train_settings = TrainSettings::default();
        }
    });
    asked
}

/// Light or dark; kept by egui, like the sizes of panels.
fn theme(ui: &mut Ui) {
    // Not by egui's own buttons: their symbols are in none of the window's fonts.
    let mut chosen = ui.options(|options| options.theme_preference);
    ui.horizontal(|ui| {
        for (theme, label) in [
            (ThemePreference::System, "System's theme"),
            (ThemePreference::Dark, "Dark theme"),
            (ThemePreference::Light, "Light theme"),
        ] {
            ui.selectable_value(&mut chosen, theme, label);
        }
    });
    ui.ctx().set_theme(chosen);
}

/// How the scene is drawn, section by section.
fn viewport(settings: &mut ViewSettings, own_fov_deg: f32, ui: &mut Ui) {
    let start = ViewSettings::default();
    marked_section(ui, settings, "Renderer", |s| {
        (s.renderer, s.antialias) = (start.renderer, start.antialias);
        // Only the exact renderer draws a fisheye.
        s.set_lens(s.lens);
    });
    renderer(settings, ui);
    marked_section(ui, settings, "Lens", |s| {
        (s.lens, s.pinhole_fov_deg) = (start.lens, start.pinhole_fov_deg);
        s.fisheye_fov_deg = start.fisheye_fov_deg;
    });
    lens(settings, own_fov_deg, ui);
    marked_section(ui, settings, "Splats", |s| {
        (s.scale, s.opacity_cut) = (start.scale, start.opacity_cut);
    });
    splats(settings, ui);
    marked_section(ui, settings, "Background", |s| s.background = start.background);
    background(settings, ui);
    marked_section(ui, settings, "Exposure", |s| s.exposing = start.exposing);
    exposure(settings, ui);
    marked_section(ui, settings, "Comparison", |s| {
        s.difference_gain = start.difference_gain;
    });
    ui.add(
        Slider::new(&mut settings.difference_gain, GAINS)
            .logarithmic(true)
            .max_decimals(0)
            .text("Difference gain"),
    );
}

fn section(ui: &mut Ui, title: &str) {
    ui.add_space(8.0);
    ui.label(RichText::new(title).strong());
    ui.add_space(2.0);
}

/// The title of a section with a mark if something in it is not as by default; `reset` takes it back.
fn marked_section(
    ui: &mut Ui,
    settings: &mut ViewSettings,
    title: &str,
    reset: impl Fn(&mut ViewSettings),
) {
    let mut default = *settings;
    reset(&mut default);
    ui.add_space(8.0);
    ui.horizontal(|ui| {
        ui.label(RichText::new(title).strong());
        if badge::ui(title, "the default", default != *settings, ui) {
            *settings = default;
        }
    });
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
                if named(ui.add(degrees(&mut fov, PINHOLE_FOV_DEG)), FOV).changed() {
                    settings.pinhole_fov_deg = Some(fov);
                }
                settings.pinhole_fov_deg.is_some()
            }
            Lens::Fisheye => {
                named(ui.add(degrees(&mut settings.fisheye_fov_deg, FISHEYE_FOV_DEG)), FOV);
                false
            }
        };
        let undo = ui.add_enabled(reset, eframe::egui::Button::new("Reset"));
        if undo.on_hover_text("As the scene's own camera sees").clicked() {
            settings.pinhole_fov_deg = None;
        }
    });
    ui.label(RichText::new(FOV).weak());
}

/// What the slider of the lens sets.
const FOV: &str = "Field of view from top to bottom";

fn degrees(fov: &mut f32, range: std::ops::RangeInclusive<f32>) -> Slider<'_> {
    Slider::new(fov, range).suffix("°").max_decimals(0)
}

fn splats(settings: &mut ViewSettings, ui: &mut Ui) {
    let start = ViewSettings::default();
    Grid::new("splats").num_columns(3).show(ui, |ui| {
        ui.label("Scale").on_hover_text("Factor on the size of every splat");
        named(ui.add(Slider::new(&mut settings.scale, SCALES).max_decimals(2)), "Scale");
        if ui.add_enabled(settings.scale != start.scale, reset()).clicked() {
            settings.scale = start.scale;
        }
        ui.end_row();
        ui.label("Opacity from").on_hover_text("Splats with a smaller opacity are left out");
        let cut = Slider::new(&mut settings.opacity_cut, 0.0..=1.0).max_decimals(2);
        named(ui.add(cut), "Opacity from");
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
        let name = "Any other colour";
        if named(ui.color_edit_button_srgb(&mut rgb), name).on_hover_text(name).changed() {
            settings.background = Background::Custom(rgb);
        }
    });
}
