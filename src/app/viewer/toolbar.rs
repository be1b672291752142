//! Toolbar above the viewport: renderer, comparison, colours, lens, overlays, dataset cameras.

use super::SceneView;
use super::comparison::ComparedModel;
use super::settings::GAINS;
use crate::app::color_mode::ColorMode;
use crate::app::command::UiCommand;
use crate::app::panels::card::named;
use crate::app::panels::settings::lens;
use crate::app::state::{Opened, Snapshot};
use crate::render::{Lens, Renderer};
use eframe::egui::{Button, ComboBox, DragValue, Label, RichText, Ui};

/// Maximum height of the comparison menu, points; it fits without scrolling.
const MENU: f32 = 400.0;

/// Draws the toolbar; returns a command that the view does not execute itself.
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
        if view.mode.is_difference() {
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
        ui.menu_button(lens_label(view.settings.lens), |ui| {
            let own_fov_deg = view.own_fov_deg();
            lens(&mut view.settings, own_fov_deg, ui);
        })
        .response
        .on_hover_text("Lens and field of view");
        ui.separator();
        asked = overlays(view, snapshot, ui).or(asked);
        if opened.dataset.is_some() {
            ui.separator();
            asked = cameras(view, snapshot, ui).or(asked);
        }
    });
    asked
}

fn renderers(view: &mut SceneView, ui: &mut Ui) {
    let fisheye = view.settings.lens == Lens::Fisheye;
    for (renderer, label, tooltip) in [
        (Renderer::Projected, "Projected", "Each splat's covariance projected to the image (Tab)"),
        (Renderer::Exact, "Exact", "Each splat's response along the pixel's true ray (Tab)"),
    ] {
        let is_chosen = view.settings.renderer == renderer;
        let enabled = !(fisheye && renderer == Renderer::Projected);
        let response = ui.add_enabled(enabled, Button::selectable(is_chosen, label));
        if response
            .on_hover_text(tooltip)
            .on_disabled_hover_text("Only the exact renderer supports a fisheye")
            .clicked()
        {
            view.settings.renderer = renderer;
        }
    }
}

/// Draws the comparison menu; returns a command about the second model.
fn modes(view: &mut SceneView, opened: &Opened, ui: &mut Ui) -> Option<UiCommand> {
    let mut asked = None;
    ComboBox::from_id_salt("view mode")
        .width(150.0)
        .height(MENU)
        .selected_text(view.mode.label())
        .show_ui(ui, |ui| {
            for mode in ViewMode::ALL {
                let why_not = view.mode_unavailable_reason(mode, opened);
                let button = Button::selectable(view.mode == mode, mode.label());
                let response = ui.add_enabled(why_not.is_none(), button);
                if response
                    .on_hover_text(mode.tooltip())
                    .on_disabled_hover_text(why_not.unwrap_or_default())
                    .clicked()
                {
                    view.set_mode(mode, opened);
                }
            }
            ui.separator();
            for command in [UiCommand::CompareModel, UiCommand::RemoveModel] {
                let removes = command == UiCommand::RemoveModel;
                let why_not = removes.then(|| view.remove_unavailable_reason()).flatten();
                let button = Button::selectable(false, command.label());
                let response = ui.add_enabled(why_not.is_none(), button);
                if response
                    .on_hover_text(command.tooltip())
                    .on_disabled_hover_text(why_not.unwrap_or_default())
                    .clicked()
                {
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
                let why_not = mode.unavailable_reason(opened.available_modes);
                let button = Button::selectable(shown == mode, mode.label());
                let response = ui.add_enabled(why_not.is_none(), button);
                if response
                    .on_hover_text(mode.tooltip())
                    .on_disabled_hover_text(why_not.unwrap_or_default())
                    .clicked()
                {
                    view.settings.color_mode = mode;
                }
            }
        })
        .response
        .on_hover_text("Colour mode");
}

fn lens_label(lens: Lens) -> &'static str {
    match lens {
        Lens::Pinhole => "Pinhole",
        Lens::Fisheye => "Fisheye",
    }
}

fn overlays(view: &SceneView, snapshot: &Snapshot, ui: &mut Ui) -> Option<UiCommand> {
    let mut asked = None;
    for (command, is_on) in [
        (UiCommand::Cameras, view.settings.shows_cameras),
        (UiCommand::Points, view.settings.shows_points),
        (UiCommand::Grid, view.settings.shows_grid),
        (UiCommand::Measure, view.is_measuring()),
    ] {
        let legal = command.is_available(snapshot.state, snapshot.source);
        let response = ui.add_enabled(legal, Button::new(command.label()).selected(is_on));
        if response.on_hover_text(command.hint(ui.ctx())).clicked() {
            asked = Some(command);
        }
    }
    asked
}

fn cameras(view: &SceneView, snapshot: &Snapshot, ui: &mut Ui) -> Option<UiCommand> {
    let mut asked = None;
    let mut button = |ui: &mut Ui, command: UiCommand, is_on: bool| {
        let legal = command.is_available(snapshot.state, snapshot.source);
        let response = ui.add_enabled(legal, Button::new(command.label()).selected(is_on));
        if response.on_hover_text(command.hint(ui.ctx())).clicked() {
            asked = Some(command);
        }
    };
    button(ui, UiCommand::PreviousCamera, false);
    match view.frame_ref() {
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
    button(ui, UiCommand::NextCamera, false);
    button(ui, UiCommand::ComparePhoto, view.mode.has_photo());
    button(ui, UiCommand::AutoCamera, view.is_guided());
    asked
}

/// Comparison mode: one picture, or two as a wipe or a difference.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ViewMode {
    /// The chosen renderer alone.
    #[default]
    Single,
    /// Projected renderer left of a divider, exact renderer right of it.
    Wipe,
    /// Difference between projected and exact renderer.
    Difference,
    /// Chosen renderer left of a divider, photograph right of it.
    PhotoWipe,
    /// Difference between the chosen renderer and the photograph.
    PhotoDifference,
    /// Scene left of a divider, second model right of it.
    ModelWipe,
    /// Difference between the scene and a second model.
    ModelDifference,
    /// Chosen renderer left of a divider, prepared photograph right of it.
    Preparation,
}

impl ViewMode {
    /// Every mode, in menu order.
    pub const ALL: [ViewMode; 8] = [
        ViewMode::Single,
        ViewMode::Wipe,
        ViewMode::Difference,
        ViewMode::PhotoWipe,
        ViewMode::PhotoDifference,
        ViewMode::ModelWipe,
        ViewMode::ModelDifference,
        ViewMode::Preparation,
    ];

    /// Label in menus.
    pub fn label(self) -> &'static str {
        match self {
            ViewMode::Single => "Single",
            ViewMode::Wipe => "Wipe renderers",
            ViewMode::Difference => "Renderer difference",
            ViewMode::PhotoWipe => "Wipe photograph",
            ViewMode::PhotoDifference => "Photograph difference",
            ViewMode::ModelWipe => "Wipe models",
            ViewMode::ModelDifference => "Model difference",
            ViewMode::Preparation => "Preparation",
        }
    }

    /// Tooltip in menus.
    pub fn tooltip(self) -> &'static str {
        match self {
            ViewMode::Single => "The chosen renderer alone",
            ViewMode::Wipe => "Projected left of a draggable divider, exact right of it",
            ViewMode::Difference => "Amplified difference between projected and exact renderer",
            ViewMode::PhotoWipe => "Render left of a draggable divider, photograph right of it",
            ViewMode::PhotoDifference => "Amplified difference between render and photograph",
            ViewMode::ModelWipe => "Scene left of a draggable divider, second model right of it",
            ViewMode::ModelDifference => {
                "Amplified difference between the scene and the second model"
            }
            ViewMode::Preparation => {
                "Which pixels of the photograph become points, and why the others are dropped"
            }
        }
    }

    /// True if the mode shows a photograph.
    pub fn has_photo(self) -> bool {
        matches!(self, ViewMode::PhotoWipe | ViewMode::PhotoDifference)
    }

    /// True if the mode shows a second model.
    pub fn has_model(self) -> bool {
        matches!(self, ViewMode::ModelWipe | ViewMode::ModelDifference)
    }

    /// True if the mode needs a dataset camera.
    pub fn needs_frame(self) -> bool {
        self.has_photo() || self == ViewMode::Preparation
    }

    /// True if the mode shows a difference.
    pub fn is_difference(self) -> bool {
        matches!(self, ViewMode::Difference | ViewMode::PhotoDifference | ViewMode::ModelDifference)
    }

    /// Reason why the mode is unavailable, if it is.
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
            ViewMode::Wipe | ViewMode::Difference if lens == Lens::Fisheye => {
                Some("Only the exact renderer supports a fisheye; choose the pinhole in Settings")
            }
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
