//! Settings panel: training, drawing and window.

use super::controls::{choices, command_button, named, section};
use super::{controls, training};
use crate::app::command::UiCommand;
use crate::app::training::TrainSettings;
use crate::app::viewer::settings::{DARK, SCALES, ViewSettings};
use crate::app::viewport::WindowDevice;
use crate::render::gpu::adapters::AdapterChoice;
use crate::render::{Antialias, Exposing};
use eframe::egui::{Grid, Label, RichText, ScrollArea, Slider, ThemePreference, Ui};

pub struct Graphics<'a> {
    /// Name of the renderer in use.
    pub renderer: &'a str,
    pub device: Option<&'a WindowDevice>,
    /// True if the CPU draws the scene because the GPU failed.
    pub gpu_failed: bool,
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub enum SettingsAnswer {
    Command(UiCommand),
    /// Reopens the window on another graphics adapter.
    Adapter(AdapterChoice),
    RetryGpu,
}

/// Draws the panel. Returns a request that is not a change of settings, if any.
pub fn ui(
    settings: &mut ViewSettings,
    train_settings: &mut TrainSettings,
    graphics: &Graphics<'_>,
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
        viewport(settings, ui);
        section("Window", ui);
        theme(ui);
        section("Graphics", ui);
        ui.add(Label::new(graphics.renderer).wrap());
        if let Some(device) = graphics.device {
            asked = adapter(device, graphics.gpu_failed, ui).or(asked.take());
        }
        ui.add_space(12.0);
        if ui.button("Reset all").on_hover_text("Restores the default of every setting").clicked() {
            // The colour mode is chosen above the viewport and never stored, so it is retained.
            *settings = ViewSettings { color_mode: settings.color_mode, ..ViewSettings::default() };
            *train_settings = TrainSettings::default();
        }
    });
    asked
}

// egui stores the theme, like the sizes of panels.
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

fn viewport(settings: &mut ViewSettings, ui: &mut Ui) {
    let start = ViewSettings::default();
    marked_section(ui, settings, "Antialiasing of the exact renderer", |s| {
        s.antialias = start.antialias;
    });
    let all = [
        (Antialias::Footprint, "Footprint", "Enlarges splats to about a pixel"),
        (Antialias::None, "None", "No antialiasing: thin splats flicker"),
        (Antialias::Reference, "Reference", "As in the published renderer: thin splats fade"),
    ];
    ui.horizontal(|ui| choices(&mut settings.antialias, &all, ui));
    marked_section(ui, settings, "Splats", |s| {
        (s.scale, s.opacity_cut) = (start.scale, start.opacity_cut);
    });
    splats(settings, ui);
    marked_section(ui, settings, "Background", |s| s.background = start.background);
    background(settings, ui);
    marked_section(ui, settings, "Exposure", |s| s.exposing = start.exposing);
    exposure(settings, ui);
}

/// Draws the title of a section, with a dot if `reset` would change a setting. A click on the dot resets
/// the section.
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
        if controls::reset_dot(title, "the default", default != *settings, ui) {
            *settings = default;
        }
    });
}

fn splats(settings: &mut ViewSettings, ui: &mut Ui) {
    let row = |ui: &mut Ui, value: &mut f32, range, [name, help]: [&str; 2]| {
        ui.label(name).on_hover_text(help);
        named(ui.add(Slider::new(value, range).max_decimals(2)), name);
        ui.end_row();
    };
    Grid::new("splats").num_columns(2).show(ui, |ui| {
        let texts = ["Scale", "Factor on the size of every splat"];
        row(ui, &mut settings.scale, SCALES, texts);
        let texts = ["Minimum opacity", "Splats with lower opacity are not drawn"];
        row(ui, &mut settings.opacity_cut, 0.0..=1.0, texts);
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
            (DARK, "Dark", ""),
            ([128; 3], "Grey", ""),
            ([255; 3], "White", ""),
            ([0; 3], "Black", ""),
        ];
        choices(&mut settings.background, &all, ui);
        let name = "Any other colour";
        named(ui.color_edit_button_srgb(&mut settings.background), name).on_hover_text(name);
    });
}

fn adapter(device: &WindowDevice, gpu_failed: bool, ui: &mut Ui) -> Option<SettingsAnswer> {
    let mut asked = None;
    ui.label(RichText::new("Graphics adapter").strong());
    let switch = "Reopens the window on this adapter; training continues";
    for adapter in &device.there {
        let is_current = device.adapter == *adapter;
        let name = adapter.to_string();
        let clicked = ui.selectable_label(is_current, &name).on_hover_text(switch).clicked();
        if clicked && !is_current {
            // Stored by name, not by index, because the list may differ at the next startup.
            asked = Some(SettingsAnswer::Adapter(AdapterChoice::Named(name)));
        }
    }
    if ui.button("Choose automatically").on_hover_text(switch).clicked() {
        asked = Some(SettingsAnswer::Adapter(AdapterChoice::Auto));
    }
    if gpu_failed {
        ui.add(Label::new("The GPU failed, so the CPU draws the scene.").wrap());
        if ui.button("Retry GPU").on_hover_text("Reinitialises drawing on the GPU").clicked() {
            asked = Some(SettingsAnswer::RetryGpu);
        }
    }
    asked
}
