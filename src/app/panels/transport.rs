//! Top bar: menus, training, name, progress and level of detail, in one row to leave room for the viewport.

use super::controls::{command_button, reset_dot};
use super::menus;
use super::menus::{BarAnswer, MenuContext};
use super::signal_color::SignalColor;
use crate::app::action_finder::Action;
use crate::app::command::UiCommand;
use crate::app::detail::{
    COARSEST_PX, EffectiveScale, FINEST_PX, default_scale, effective_scale, forecast,
    retrain_label, retrainable_run,
};
use crate::app::state::{RunState, Snapshot};
use crate::app::wording;
use crate::train::scene::units::StructuralScale;
use eframe::egui::{Label, ProgressBar, RichText, Slider, Tooltip, Ui};

/// Width of the progress bar, width reserved for the level of detail with its button, and least width for
/// the name, points.
const PROGRESS: f32 = 120.0;
const DETAIL: f32 = 270.0;
const NAME: f32 = 40.0;

/// Draws the bar with menus and training controls. `scale` is the structural scale of the next run;
/// `None` is the default scale.
pub fn ui(
    snapshot: &Snapshot,
    menu: &MenuContext<'_>,
    scale: &mut Option<StructuralScale>,
    ui: &mut Ui,
) -> Option<BarAnswer> {
    let mut asked = None;
    ui.horizontal(|ui| {
        asked = menus::ui(menu, ui);
        ui.separator();
        // Train and Pause share one button.
        let command = match snapshot.state {
            RunState::Training => UiCommand::Pause,
            _ => UiCommand::Train,
        };
        let why_not = command.unavailable_reason(snapshot.state, snapshot.source);
        if command_button(command, false, why_not, ui) {
            asked = Some(BarAnswer::Action(Action::Command(command)));
        }
        ui.spacing_mut().item_spacing.x = 4.0;
        asked = menus::training(menu, ui).or(asked.take());
        name_and_progress(snapshot, ui);
        if detail(scale, snapshot, ui) {
            asked = Some(BarAnswer::Retrain);
        }
    });
    asked
}

/// Draws the name and the progress as far as the level of detail leaves room. A long name is elided.
fn name_and_progress(snapshot: &Snapshot, ui: &mut Ui) {
    let has_progress = snapshot.n_frames > 0;
    let reserved = DETAIL + if has_progress { PROGRESS } else { 0.0 };
    let room = ui.available_width() - reserved;
    if let Some(opened) = snapshot.opened.as_ref().filter(|_| room >= NAME) {
        ui.separator();
        ui.scope(|ui| {
            ui.set_max_width(room);
            let name = Label::new(RichText::new(&opened.name).strong()).truncate();
            ui.add(name).on_hover_text(&opened.name);
        });
    }
    if has_progress && ui.available_width() >= DETAIL + PROGRESS {
        let share = snapshot.frames_done as f32 / snapshot.n_frames as f32;
        let text = format!("{} / {}", snapshot.frames_done, snapshot.n_frames);
        ui.add(ProgressBar::new(share).desired_width(PROGRESS).text(text));
    }
    if matches!(snapshot.state, RunState::Loading | RunState::Waiting) {
        ui.spinner();
    }
}

const WIDTH: f32 = 90.0;

/// Draws the detail slider, and a retrain button if the next run would differ from the open one. Returns
/// true if the button is clicked. `chosen` is the structural scale of the next run; `None` is the default
/// scale.
fn detail(chosen: &mut Option<StructuralScale>, snapshot: &Snapshot, ui: &mut Ui) -> bool {
    let Some(opened) = snapshot.opened.as_deref() else { return false };
    let Some((run, default)) = retrainable_run(opened).zip(default_scale(opened)) else {
        return false;
    };
    ui.separator();
    let sample = snapshot.sampling.sample.as_ref();
    let asked = chosen.unwrap_or(default);
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
    let differs = chosen.is_some_and(|chosen| chosen != default);
    if reset_dot("Detail", "the default", differs, ui) {
        *chosen = None;
    }
    let asked = chosen.unwrap_or(default);
    let next = sample.map(|sample| effective_scale(&run.engine, asked, sample));
    // Opened by hand, so that keyboard users see the forecast too.
    let mut card = Tooltip::for_widget(&slider);
    card.popup = card.popup.open(slider.hovered() || slider.dragged() || slider.has_focus());
    card.show(|ui| forecast_card(asked, next, snapshot, ui));
    let Some(text) = retrain_label(*chosen, snapshot) else { return false };
    ui.button(text)
        .on_hover_text("Trains the same frames with this level of detail. The view stays, and the current scene is kept beside the new one")
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
        StructuralScale::Pixels(n) => format!("Splats of {n:.2} depth pixels"),
        StructuralScale::World(length) => format!("Splats of {}", wording::length(length)),
    };
    ui.label(scale);
    let Some(next) = next else { return };
    if next.is_noise_limited {
        let text = format!(
            "Depth noise limits it to {}; in Settings, a length may be half of that",
            wording::length(next.length)
        );
        ui.add(Label::new(SignalColor::Yellow.text(text, ui)).wrap());
    }
    match forecast(snapshot, next.length) {
        Some(forecast) => {
            let text = format!(
                "About {:.0} splats, {:.1} MB and {:.0} ms a frame after {} frames",
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
