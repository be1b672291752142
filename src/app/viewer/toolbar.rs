//! Toolbar above the viewport: renderer, comparison, colours, lens, overlays, dataset cameras.

use super::SceneView;
use super::comparison::ComparedModel;
use super::settings::{FISHEYE_FOV_DEG, GAINS, PINHOLE_FOV_DEG, ViewSettings};
use crate::app::color_mode::ColorMode;
use crate::app::command::{UiCommand, labelled};
use crate::app::panels::card::{choices, command_button, entry, named};
use crate::app::state::{Opened, Snapshot};
use crate::render::{Lens, Renderer};
use eframe::egui::{Button, ComboBox, DragValue, Label, RichText, Slider, Ui};
use std::ops::RangeInclusive;

/// Maximum height of the comparison menu, points.
// egui's default of 200 would need scrolling.
const MENU: f32 = 400.0;

/// Draws the toolbar. Returns a command that the view does not execute itself, if one is chosen.
pub fn ui(
    view: &mut SceneView,
    snapshot: &Snapshot,
    opened: &Opened,
    ui: &mut Ui,
) -> Option<UiCommand> {
    let mut asked = None;
    ui.horizontal_wrapped(|ui| {
        renderers(view, ui);
        ui.separator();
        asked = modes(view, opened, ui);
        if view.comparison.mode().is_difference() {
            let gain = DragValue::new(&mut view.settings.difference_gain)
                .range(GAINS)
                .speed(0.2)
                .max_decimals(0)
                .prefix("× ");
            named(ui.add(gain), "Difference gain")
                .on_hover_text("Amplification of differences: drag, or click to type");
        }
        ui.separator();
        colors(view, opened, ui);
        ui.separator();
        let label = match view.settings.lens {
            Lens::Pinhole => "Pinhole",
            Lens::Fisheye => "Fisheye",
        };
        let own_fov_deg = view.camera.own_fov_deg();
        ui.menu_button(label, |ui| lens(&mut view.settings, own_fov_deg, ui))
            .response
            .on_hover_text("Lens and field of view");
        ui.separator();
        for (command, is_on) in [
            (UiCommand::Cameras, view.settings.shows_cameras),
            (UiCommand::Points, view.settings.shows_points),
            (UiCommand::Grid, view.settings.shows_grid),
            (UiCommand::Measure, view.overlays.is_measuring()),
        ] {
            asked = toggle(command, is_on, snapshot, ui).or(asked);
        }
        if opened.dataset.is_some() {
            ui.separator();
            asked = cameras(view, snapshot, ui).or(asked);
        }
    });
    asked
}

fn toggle(command: UiCommand, is_on: bool, snapshot: &Snapshot, ui: &mut Ui) -> Option<UiCommand> {
    let why_not = command.unavailable_reason(snapshot.state, snapshot.source);
    command_button(command, is_on, why_not, ui).then_some(command)
}

fn renderers(view: &mut SceneView, ui: &mut Ui) {
    let fisheye = view.settings.lens == Lens::Fisheye;
    for (renderer, label, tooltip) in [
        (Renderer::Projected, "Projected", "Each splat's covariance projected to the image (Tab)"),
        (Renderer::Exact, "Exact", "Each splat's response along the pixel's true ray (Tab)"),
    ] {
        let is_chosen = view.settings.renderer == renderer;
        let why_not = (fisheye && renderer == Renderer::Projected)
            .then_some("Only the exact renderer supports a fisheye");
        if entry(is_chosen, [label, tooltip], why_not, ui) {
            view.settings.renderer = renderer;
        }
    }
}

fn modes(view: &mut SceneView, opened: &Opened, ui: &mut Ui) -> Option<UiCommand> {
    let mut asked = None;
    let shown = view.comparison.mode();
    ComboBox::from_id_salt("view mode")
        .width(150.0)
        .height(MENU)
        .selected_text(shown.label())
        .show_ui(ui, |ui| {
            for mode in ViewMode::ALL {
                let why_not = view.mode_unavailable_reason(mode, opened);
                if entry(shown == mode, [mode.label(), mode.tooltip()], why_not, ui) {
                    view.set_mode(mode, opened);
                }
            }
            ui.separator();
            for command in [UiCommand::CompareModel, UiCommand::RemoveModel] {
                let removes = command == UiCommand::RemoveModel;
                let why_not =
                    removes.then(|| view.comparison.remove_unavailable_reason()).flatten();
                if entry(false, [command.label(), command.tooltip()], why_not, ui) {
                    asked = Some(command);
                }
            }
        })
        .response
        .on_hover_text("Comparison mode");
    asked
}

fn colors(view: &mut SceneView, opened: &Opened, ui: &mut Ui) {
    let shown = view.settings.color_mode;
    ComboBox::from_id_salt("colour mode")
        .width(110.0)
        .selected_text(shown.label())
        .show_ui(ui, |ui| {
            for mode in ColorMode::ALL {
                let why_not = view.color_unavailable_reason(mode, opened);
                if entry(shown == mode, [mode.label(), mode.tooltip()], why_not, ui) {
                    view.settings.color_mode = mode;
                }
            }
        })
        .response
        .on_hover_text("Colour mode");
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

fn cameras(view: &SceneView, snapshot: &Snapshot, ui: &mut Ui) -> Option<UiCommand> {
    let mut asked = toggle(UiCommand::PreviousCamera, false, snapshot, ui);
    match view.camera.frame_ref() {
        Some(frame) => {
            let text = format!("Camera {} of {}", frame.number() + 1, frame.n_frames());
            let (name, split) = (&frame.entry().name, &frame.split().name);
            let label = ui.add(Label::new(text).extend());
            label.on_hover_text(format!("Frame {name} of the split {split}"));
        }
        None => {
            // Extended, so that the label wraps to the next line as a whole.
            ui.add(Label::new(RichText::new("Free camera").weak()).extend());
        }
    }
    for (command, is_on) in [
        (UiCommand::NextCamera, false),
        (UiCommand::ComparePhoto, view.comparison.mode().has_photo()),
        (UiCommand::AutoCamera, view.camera.is_guided()),
    ] {
        asked = toggle(command, is_on, snapshot, ui).or(asked);
    }
    asked
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
    Single: "Single", "The chosen renderer alone";
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
                "Only the exact renderer supports a fisheye; choose the pinhole above the viewport",
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
