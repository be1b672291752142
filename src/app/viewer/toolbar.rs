//! Toolbar above the viewport: how the scene is drawn, what it is compared with, and what is shown with it.

use super::SceneView;
use super::comparison::ComparedModel;
use super::settings::{FISHEYE_FOV_DEG, GAINS, PINHOLE_FOV_DEG, ViewSettings};
use crate::app::color_mode::ColorMode;
use crate::app::command::{UiCommand, labelled};
use crate::app::fonts::icon;
use crate::app::panels::controls::{choices, entry, entry_with_keys, named};
use crate::app::state::{Opened, Snapshot};
use crate::render::{Lens, Renderer};
use eframe::egui::containers::menu::{MenuButton, MenuConfig};
use eframe::egui::{Button, DragValue, PopupCloseBehavior, RichText, Slider, Ui};
use std::ops::RangeInclusive;

/// Draws the toolbar. Returns a command that the view does not execute itself, if one is chosen.
pub fn ui(
    view: &mut SceneView,
    snapshot: &Snapshot,
    opened: &Opened,
    ui: &mut Ui,
) -> Option<UiCommand> {
    let mut asked = None;
    ui.horizontal(|ui| {
        let renderer = view.settings.renderer;
        let drawn = match view.settings.lens {
            Lens::Pinhole => renderer_label(renderer).to_owned(),
            Lens::Fisheye => format!("{}, fisheye", renderer_label(renderer)),
        };
        let label = format!("Render: {drawn}");
        menu([icon::RENDER, &label], "Renderer, lens and field of view", ui, |ui| {
            render_choices(view, ui);
        });
        let mode = view.comparison.mode();
        let label = match mode {
            ViewMode::Single => "Compare".to_owned(),
            mode => format!("Compare: {}", mode.label()),
        };
        menu([icon::COMPARE, &label], "Photograph, renderers, or a second model", ui, |ui| {
            asked = modes(view, opened, ui);
        });
        if mode.is_difference() {
            let gain = DragValue::new(&mut view.settings.difference_gain)
                .range(GAINS)
                .speed(0.2)
                .max_decimals(0)
                .prefix("× ");
            named(ui.add(gain), "Difference gain")
                .on_hover_text("Amplification of differences: drag, or click to type");
        }
        let label = match view.settings.color_mode {
            ColorMode::Color => "Show".to_owned(),
            mode => format!("Show: {}", mode.label()),
        };
        let tooltip = "Cameras, points, grid, distances, and what colours mean";
        menu([icon::SHOW, &label], tooltip, ui, |ui| {
            asked = shown(view, snapshot, opened, ui).or(asked.take());
        });
    });
    asked
}

/// Draws a button that opens a menu. A click outside closes the menu, so that its sliders can be dragged.
fn menu([icon, label]: [&str; 2], tooltip: &str, ui: &mut Ui, contents: impl FnOnce(&mut Ui)) {
    let config = MenuConfig::new().close_behavior(PopupCloseBehavior::CloseOnClickOutside);
    let (button, _) = MenuButton::new((icon, label)).config(config).ui(ui, contents);
    named(button, label).on_hover_text(tooltip);
}

fn renderer_label(renderer: Renderer) -> &'static str {
    match renderer {
        Renderer::Projected => "Projected",
        Renderer::Exact => "Exact",
    }
}

fn render_choices(view: &mut SceneView, ui: &mut Ui) {
    let fisheye = view.settings.lens == Lens::Fisheye;
    for (renderer, tooltip) in [
        (Renderer::Projected, "Each splat's covariance projected to the image (Tab)"),
        (Renderer::Exact, "Each splat's response along the pixel's true ray (Tab)"),
    ] {
        let is_chosen = view.settings.renderer == renderer;
        let why_not = (fisheye && renderer == Renderer::Projected)
            .then_some("Only the exact renderer supports a fisheye");
        if entry(is_chosen, [renderer_label(renderer), tooltip], why_not, ui) {
            view.settings.renderer = renderer;
        }
    }
    ui.separator();
    let own_fov_deg = view.camera.own_fov_deg();
    lens(&mut view.settings, own_fov_deg, ui);
}

fn modes(view: &mut SceneView, opened: &Opened, ui: &mut Ui) -> Option<UiCommand> {
    let mut asked = None;
    let shown = view.comparison.mode();
    for mode in ViewMode::ALL {
        let why_not = view.mode_unavailable_reason(mode, opened);
        if entry(shown == mode, [mode.label(), mode.tooltip()], why_not, ui) {
            view.set_mode(mode, opened);
        }
    }
    ui.separator();
    for command in [UiCommand::CompareModel, UiCommand::RemoveModel] {
        let removes = command == UiCommand::RemoveModel;
        let why_not = removes.then(|| view.comparison.remove_unavailable_reason()).flatten();
        if entry(false, [command.label(), command.tooltip()], why_not, ui) {
            asked = Some(command);
        }
    }
    asked
}

/// Draws the overlays as checkable entries, and the colour modes.
fn shown(
    view: &mut SceneView,
    snapshot: &Snapshot,
    opened: &Opened,
    ui: &mut Ui,
) -> Option<UiCommand> {
    let mut asked = None;
    for (command, is_on) in [
        (UiCommand::Cameras, view.settings.shows_cameras),
        (UiCommand::Points, view.settings.shows_points),
        (UiCommand::Grid, view.settings.shows_grid),
        (UiCommand::Measure, view.overlays.is_measuring()),
    ] {
        let why_not = command.unavailable_reason(snapshot.state, snapshot.source);
        let texts = [command.label(), &command.keys(ui.ctx()), command.tooltip()];
        if entry_with_keys(is_on, texts, why_not, ui) {
            asked = Some(command);
        }
    }
    ui.separator();
    ui.label(RichText::new("Colours").weak());
    for mode in ColorMode::ALL {
        let why_not = view.color_unavailable_reason(mode, opened);
        let is_chosen = view.settings.color_mode == mode;
        if entry(is_chosen, [mode.label(), mode.tooltip()], why_not, ui) {
            view.settings.color_mode = mode;
        }
    }
    asked
}

fn lens(settings: &mut ViewSettings, own_fov_deg: f32, ui: &mut Ui) {
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

fn degrees(fov: &mut f32, range: RangeInclusive<f32>) -> Slider<'_> {
    Slider::new(fov, range).suffix("°").max_decimals(0)
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ViewMode {
    #[default]
    Single,
    Wipe,
    Difference,
    PhotoWipe,
    PhotoDifference,
    ModelWipe,
    ModelDifference,
    Preparation,
}

labelled! { ViewMode:
    Single: "Scene only", "The chosen renderer alone";
    Wipe: "Wipe renderers", "Projected left of a draggable divider, exact right of it";
    Difference: "Renderer difference", "Amplified difference between projected and exact renderer";
    PhotoWipe: "Wipe photograph", "Render left of a draggable divider, photograph right of it";
    PhotoDifference: "Photograph difference", "Amplified difference between render and photograph";
    ModelWipe: "Wipe models", "Scene left of a draggable divider, second model right of it";
    ModelDifference: "Model difference", "Amplified difference between the scene and the second model";
    Preparation: "Preparation", "Which pixels of the photograph become points, and why the others are dropped";
}

impl ViewMode {
    pub fn has_photo(self) -> bool {
        matches!(self, ViewMode::PhotoWipe | ViewMode::PhotoDifference)
    }

    pub fn has_model(self) -> bool {
        matches!(self, ViewMode::ModelWipe | ViewMode::ModelDifference)
    }

    pub fn needs_frame(self) -> bool {
        self.has_photo() || self == ViewMode::Preparation
    }

    pub fn is_difference(self) -> bool {
        matches!(self, ViewMode::Difference | ViewMode::PhotoDifference | ViewMode::ModelDifference)
    }

    pub fn unavailable_reason(
        self,
        lens: Lens,
        opened: &Opened,
        compared: Option<&ComparedModel>,
    ) -> Option<&'static str> {
        match self {
            _ if self.has_model() && compared.is_none() => {
                Some("No second model is open: choose “Compare with a model…” first")
            }
            ViewMode::Wipe | ViewMode::Difference if lens == Lens::Fisheye => Some(
                "Only the exact renderer supports a fisheye; choose the pinhole in the menu Render",
            ),
            _ if self.needs_frame() && opened.dataset.is_none() => {
                Some("A model has no photographs")
            }
            ViewMode::Preparation if opened.scene().is_none() => Some(
                "The paper preset does not prepare surfaces; choose the scene preset in Settings and reset",
            ),
            _ => None,
        }
    }
}
