//! Start page of an empty window.

use crate::app::command::UiCommand;
use crate::app::state::{RunState, Snapshot};
use crate::export::endings::{READ_ENDINGS, listed};
use eframe::egui::{Button, Color32, Frame, RichText, Stroke, Ui, Vec2};

/// Purpose of the program in one sentence.
pub const WHAT_HAPPENS: &str = "Turns photographs with depth into a Gaussian-splat scene while you watch, \
                                using each frame once";

/// Draws the page below `noticed` points of notices; returns the requested command.
pub fn ui(snapshot: &Snapshot, noticed: f32, ui: &mut Ui) -> Option<UiCommand> {
    let mut asked = None;
    ui.vertical_centered(|ui| {
        ui.add_space((ui.available_height() * 0.22).max(noticed + 10.0));
        if let Some(followed) = &snapshot.followed {
            let path = followed.path.display();
            ui.label(RichText::new(format!("Waiting for the first frame of {path}")).size(22.0));
            ui.label(followed.problem.as_deref().unwrap_or_default());
            return;
        }
        if snapshot.state == RunState::Loading {
            ui.label(RichText::new("Opening…").size(22.0));
            return;
        }
        ui.label(RichText::new("VBGS Studio").size(28.0).strong());
        ui.label(RichText::new(WHAT_HAPPENS).size(15.0));
        ui.add_space(18.0);
        target(ui);
        ui.add_space(12.0);
        let big = |text: &str| Button::new(RichText::new(text).size(15.0)).min_size(BUTTON);
        let open = ui.add(big(UiCommand::Open.label()));
        if open.on_hover_text(UiCommand::Open.hint(ui.ctx())).clicked() {
            asked = Some(UiCommand::Open);
        }
        let demo = ui.add(big("Try the synthetic scene"));
        if demo.on_hover_text(UiCommand::OpenDemo.hint(ui.ctx())).clicked() {
            asked = Some(UiCommand::OpenDemo);
        }
    });
    asked
}

const BUTTON: Vec2 = Vec2::new(220.0, 32.0);

/// Outlined target for dropped folders; the whole window accepts them.
fn target(ui: &mut Ui) {
    let width = (ui.available_width() - 40.0).clamp(100.0, 460.0);
    let line = Stroke::new(1.5, Color32::from_gray(110));
    // A frame, not a painted rectangle: it grows when lines wrap in a narrow window.
    let frame = Frame::new().stroke(line).corner_radius(8.0).inner_margin(14.0);
    ui.allocate_ui(Vec2::new(width, 0.0), |ui| {
        frame.show(ui, |ui| {
            ui.vertical_centered(|ui| {
                ui.label(RichText::new("Your own capture: drop a folder").size(20.0));
                ui.label("from a depth camera, a phone or a renderer; the format is detected");
                let endings = listed(&READ_ENDINGS);
                ui.label(
                    RichText::new(format!(
                        "or a checkpoint to resume, or splats to view ({endings})"
                    ))
                    .weak(),
                );
            });
        });
    });
}
