//! Settings panel: training, drawing and window.

use super::card::{choices, command_button, named, section};
use super::{card, training};
use crate::app::command::UiCommand;
use crate::app::training::TrainSettings;
use crate::app::viewer::settings::{
    Background, FISHEYE_FOV_DEG, GAINS, PINHOLE_FOV_DEG, SCALES, ViewSettings,
};
use crate::render::gpu::adapters::{AdapterChoice, AdapterInfo};
use crate::render::{Antialias, Exposing, Lens, Renderer};
use eframe::egui::{Button, Grid, Label, RichText, ScrollArea, Slider, ThemePreference, Ui};

pub struct SettingsContext<'a> {
    pub adapter: &'a str,
    /// Vertical field of view of the scene's own camera, degrees.
    pub own_fov_deg: f32,
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub enum SettingsAnswer {
    Command(UiCommand),
    /// Reopen the window on another adapter.
    Adapter(AdapterChoice),
    RetryGpu,
}

/// Draws the panel; returns requests that are not changes of settings.
pub fn ui(
    settings: &mut ViewSettings,
    train_settings: &mut TrainSettings,
    surroundings: &SettingsContext<'_>,
    adapters: Option<&Adapters<'_>>,
    ui: &mut Ui,
) -> Option<SettingsAnswer> {
    let mut asked = None;
    // Scrolls both ways: wide rows must not extend over the viewport.
    ScrollArea::both().auto_shrink(false).show(ui, |ui| {
        section("Training", ui);
        training::ui(train_settings, ui);
        let copy = UiCommand::CopyCommandLine;
        if command_button(copy, false, None, ui) {
            asked = Some(SettingsAnswer::Command(copy));
        }
        viewport(settings, surroundings.own_fov_deg, ui);
        section("Window", ui);
        theme(ui);
        section("Graphics", ui);
        ui.add(Label::new(surroundings.adapter).wrap());
        asked = adapters.and_then(|adapters| adapter(adapters, ui)).or(asked.take());
        ui.add_space(12.0);
        if ui.button("Reset all").on_hover_text("Restores the default of every setting").clicked() {
            // The colour mode is chosen above the viewport and never stored, so it is retained.
            *settings = ViewSettings { color_mode: settings.color_mode, ..ViewSettings::default() };
            *train_settings = TrainSettings::default();
        }
    });
    asked
}

/// Colour theme; stored by egui, like the sizes of panels.
fn theme(ui: &mut Ui) {
    // Not egui's own buttons, whose symbols are missing from the window's fonts.
    let mut chosen = ui.options(|options| options.theme_preference);
    let themes = [
        (ThemePreference::System, "System theme", ""),
        (ThemePreference::Dark, "Dark theme", ""),
        (ThemePreference::Light, "Light theme", ""),
    ];
    ui.horizontal(|ui| choices(&mut chosen, &themes, ui));
    ui.ctx().set_theme(chosen);
}

fn viewport(settings: &mut ViewSettings, own_fov_deg: f32, ui: &mut Ui) {
    let start = ViewSettings::default();
    marked_section(ui, settings, "Renderer", |s| {
        (s.renderer, s.antialias) = (start.renderer, start.antialias);
        // Selecting a fisheye lens again enforces the exact renderer, the only one that draws it.
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

/// Title of a section with a marker if `reset` would change a setting; a click on it applies `reset`.
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
        if card::ui(title, "the default", default != *settings, ui) {
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
        ui.label("Antialiasing").on_hover_text("Applies to the exact renderer");
        let all = [
            (Antialias::Footprint, "Footprint", "Enlarges splats to about a pixel"),
            (Antialias::None, "None", "No antialiasing: thin splats flicker"),
            (Antialias::Reference, "Reference", "As in the published renderer: thin splats fade"),
        ];
        choices(&mut settings.antialias, &all, ui);
    });
}

/// Draws lens and field of view; also used by the toolbar above the viewport.
pub fn lens(settings: &mut ViewSettings, own_fov_deg: f32, ui: &mut Ui) {
    let lenses = [
        (Lens::Pinhole, "Pinhole", "Straight lines stay straight"),
        (Lens::Fisheye, "Fisheye", "Equidistant, up to 360°; drawn by the exact renderer"),
    ];
    let mut lens = settings.lens;
    if ui.horizontal(|ui| choices(&mut lens, &lenses, ui)).inner {
        settings.set_lens(lens);
    }
    ui.horizontal(|ui| {
        let reset = match settings.lens {
            Lens::Pinhole => {
                // Rounded like the slider's value, which would otherwise count as changed.
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
        let undo = ui.add_enabled(reset, Button::new("Reset"));
        if undo.on_hover_text("Resets to the scene's own camera").clicked() {
            settings.pinhole_fov_deg = None;
        }
    });
    ui.label(RichText::new(FOV).weak());
}

const FOV: &str = "Vertical field of view";

fn degrees(fov: &mut f32, range: std::ops::RangeInclusive<f32>) -> Slider<'_> {
    Slider::new(fov, range).suffix("°").max_decimals(0)
}

fn splats(settings: &mut ViewSettings, ui: &mut Ui) {
    let start = ViewSettings::default();
    let row = |ui: &mut Ui, value: &mut f32, range, start: f32, [name, help]: [&str; 2]| {
        ui.label(name).on_hover_text(help);
        named(ui.add(Slider::new(value, range).max_decimals(2)), name);
        if ui.add_enabled(*value != start, Button::new("Reset")).clicked() {
            *value = start;
        }
        ui.end_row();
    };
    Grid::new("splats").num_columns(3).show(ui, |ui| {
        let texts = ["Scale", "Factor on the size of every splat"];
        row(ui, &mut settings.scale, SCALES, start.scale, texts);
        let texts = ["Minimum opacity", "Splats with lower opacity are not drawn"];
        row(ui, &mut settings.opacity_cut, 0.0..=1.0, start.opacity_cut, texts);
    });
}

fn exposure(settings: &mut ViewSettings, ui: &mut Ui) {
    let neutral = "Draws all views with the exposure of the first frames; next to a photograph, with its recorded exposure";
    let recorded =
        "Draws each view with the exposure of nearby frames, if the camera used automatic exposure";
    let all =
        [(Exposing::Neutral, "Neutral", neutral), (Exposing::Recorded, "As recorded", recorded)];
    ui.horizontal(|ui| choices(&mut settings.exposing, &all, ui));
}

fn background(settings: &mut ViewSettings, ui: &mut Ui) {
    ui.horizontal(|ui| {
        let all = [
            (Background::Dark, "Dark", ""),
            (Background::Grey, "Grey", ""),
            (Background::White, "White", ""),
            (Background::Black, "Black", ""),
        ];
        choices(&mut settings.background, &all, ui);
        let mut rgb = settings.background.rgb8();
        let name = "Any other colour";
        if named(ui.color_edit_button_srgb(&mut rgb), name).on_hover_text(name).changed() {
            settings.background = Background::Custom(rgb);
        }
    });
}

pub struct Adapters<'a> {
    pub there: &'a [AdapterInfo],
    pub current: &'a AdapterInfo,
    /// True if the CPU draws the scene because the GPU failed.
    pub gpu_failed: bool,
}

fn adapter(adapters: &Adapters, ui: &mut Ui) -> Option<SettingsAnswer> {
    let mut asked = None;
    ui.label(RichText::new("Graphics adapter").strong());
    let switch = "Reopens the window on this adapter; training continues";
    for adapter in adapters.there {
        let is_current = adapters.current == adapter;
        let name = adapter.to_string();
        let clicked = ui.selectable_label(is_current, &name).on_hover_text(switch).clicked();
        if clicked && !is_current {
            // By name, not by index: the choice is stored for the next start, when the list may differ.
            asked = Some(SettingsAnswer::Adapter(AdapterChoice::Named(name)));
        }
    }
    if ui.button("Choose automatically").on_hover_text(switch).clicked() {
        asked = Some(SettingsAnswer::Adapter(AdapterChoice::Auto));
    }
    if adapters.gpu_failed {
        ui.add(Label::new("The GPU failed, so the CPU draws the scene.").wrap());
        if ui.button("Retry GPU").on_hover_text("Reinitialises drawing on the GPU").clicked() {
            asked = Some(SettingsAnswer::RetryGpu);
        }
    }
    asked
}
