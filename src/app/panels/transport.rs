//! Top bar: menus, transport buttons, name, progress and level of detail, in one row to leave room for the
//! viewport.

use super::card::command_button;
use super::menus;
use super::menus::{BarAnswer, MenuContext};
use super::signal_color::SignalColor;
use crate::app::action_finder::Action;
use crate::app::command::UiCommand;
use crate::app::detail::{
    COARSEST_PX, EffectiveScale, FINEST_PX, effective_scale, forecast, retrainable_run,
};
use crate::app::state::{RunState, Snapshot};
use crate::train::scene::units::StructuralScale;
use eframe::egui::{Label, ProgressBar, RichText, Slider, Tooltip, Ui};

const BUTTONS: [&[UiCommand]; 2] = [
    &[UiCommand::Open, UiCommand::OpenDemo, UiCommand::Save, UiCommand::Export],
    &[UiCommand::Train, UiCommand::Step, UiCommand::Follow, UiCommand::Reset],
];

/// Draws the bar with menus and training controls. `scale` is the structural scale of the next run;
/// `None` uses the scale of the open run.
pub fn ui(
    snapshot: &Snapshot,
    menu: &MenuContext<'_>,
    scale: &mut Option<StructuralScale>,
    ui: &mut Ui,
) -> Option<BarAnswer> {
    let mut asked = None;
    ui.horizontal_wrapped(|ui| {
        asked = menus::ui(menu, ui);
        for group in BUTTONS {
            ui.separator();
            for &command in group {
                // Train and Pause share one button.
                let command = match (command, snapshot.state) {
                    (UiCommand::Train, RunState::Training) => UiCommand::Pause,
                    (other, _) => other,
                };
                let why_not = command.unavailable_reason(snapshot.state, snapshot.source);
                let is_on = command == UiCommand::Follow && snapshot.following.is_on;
                if command_button(command, is_on, why_not, ui) {
                    asked = Some(BarAnswer::Action(Action::Command(command)));
                }
            }
        }
        if let Some(opened) = &snapshot.opened {
            ui.separator();
            ui.label(RichText::new(&opened.name).strong());
        }
        if snapshot.n_frames > 0 {
            let share = snapshot.frames_done as f32 / snapshot.n_frames as f32;
            let text = format!("{} / {}", snapshot.frames_done, snapshot.n_frames);
            ui.add(ProgressBar::new(share).desired_width(160.0).text(text));
        }
        if matches!(snapshot.state, RunState::Loading | RunState::Waiting) {
            ui.spinner();
        }
        if detail(scale, snapshot, ui) {
            asked = Some(BarAnswer::Retrain);
        }
    });
    asked
}

const WIDTH: f32 = 90.0;

/// Draws the detail slider, and a retrain button if the next run would differ from the open one. Returns
/// true if the button is clicked. `chosen` is the structural scale of the next run; `None` uses the
/// scale of the open run.
fn detail(chosen: &mut Option<StructuralScale>, snapshot: &Snapshot, ui: &mut Ui) -> bool {
    let Some(run) = snapshot.opened.as_deref().and_then(retrainable_run) else { return false };
    ui.separator();
    let sample = snapshot.sampling.sample.as_ref();
    let asked = chosen.unwrap_or(run.scale);
    let finest = StructuralScale::Pixels(FINEST_PX);
    let finest =
        sample.map_or(FINEST_PX, |s| effective_scale(&run.engine, finest, s).length / s.footprint);
    let finest = finest.clamp(FINEST_PX, COARSEST_PX);
    let mut pixels = match (asked, sample) {
        (StructuralScale::Pixels(n), _) => n,
        (StructuralScale::World(length), Some(sample)) => length / sample.footprint,
        (StructuralScale::World(_), None) => finest,
    };
    // Otherwise the slider would clamp it and report a change.
    pixels = pixels.clamp(finest, COARSEST_PX);
    let name = ui.label("Detail");
    ui.spacing_mut().slider_width = WIDTH;
    let slider = Slider::new(&mut pixels, COARSEST_PX..=finest).logarithmic(true).show_value(false);
    let slider = ui.add(slider).labelled_by(name.id);
    if slider.changed() {
        *chosen = Some(StructuralScale::Pixels((100.0 * pixels).round() / 100.0));
    }
    let asked = chosen.unwrap_or(run.scale);
    let next = sample.map(|sample| effective_scale(&run.engine, asked, sample));
    // Opened by hand, so that keyboard users see the forecast too.
    let mut card = Tooltip::for_widget(&slider);
    card.popup = card.popup.open(slider.hovered() || slider.dragged() || slider.has_focus());
    card.show(|ui| forecast_card(asked, next, snapshot, ui));
    let is_same = next.map_or(asked == run.scale, |n| (n.length / run.engine.h - 1.0).abs() < 1e-3);
    let is_trained = snapshot.frames_done > 0 && snapshot.state != RunState::Loading;
    if is_same || !is_trained {
        return false;
    }
    let is_finer = next.is_none_or(|next| next.length < run.engine.h);
    let text = if is_finer { "Again, finer" } else { "Again, coarser" };
    ui.button(text)
        .on_hover_text("Train on the same frames again with this level of detail; the view stays")
        .clicked()
}

fn forecast_card(
    asked: StructuralScale,
    next: Option<EffectiveScale>,
    snapshot: &Snapshot,
    ui: &mut Ui,
) {
    ui.label(RichText::new("Level of detail, from coarse to fine").strong());
    let scale = match asked {
        StructuralScale::Pixels(n) => format!("Structural scale {n:.2} pixels"),
        StructuralScale::World(length) => format!("Structural scale {length} world units"),
    };
    ui.label(scale);
    let Some(next) = next else { return };
    if next.is_noise_limited {
        let text = format!(
            "Depth noise limits it to {:.2e} world units; in Settings, a scale in world units may be half of that",
            next.length
        );
        ui.add(Label::new(SignalColor::Yellow.text(text, ui)).wrap());
    }
    match forecast(snapshot, next.length) {
        Some(forecast) => {
            let text = format!(
                "About {:.0} components, {:.1} MB and {:.0} ms per frame after {} frames",
                forecast.components,
                1e-6 * forecast.model_bytes,
                forecast.frame_ms,
                snapshot.frames_done
            );
            ui.add(Label::new(text).wrap());
            if forecast.texture_bytes > 0.0 {
                let text = format!(
                    "{:.1} MB of these are textures: colour as fine as the photographs, whatever the scale; Settings limits their memory",
                    1e-6 * forecast.texture_bytes
                );
                ui.add(Label::new(RichText::new(text).weak()).wrap());
            }
        }
        None => {
            ui.label(RichText::new("A forecast appears after the first trained frame").weak());
        }
    }
}
