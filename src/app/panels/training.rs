//! How what is opened or reset next is trained.

use super::explained::named;
use super::setting_rows::{self, OwnRow, SettingRows};
use crate::app::training::{AUTOSAVE_S, TrainSettings};
use crate::pipeline::settings::scene::SceneOverrides;
use crate::train::paper::config::{PaperConfig, PaperOverrides};
use crate::train::scene::config::DEFAULT_MAX_COMPONENTS;
use crate::train::scene::units::Budget;
use crate::train::setting::Preset;
use crate::train::setting::table::SettingLayer;
use eframe::egui::{CollapsingHeader, DragValue, RichText, Ui};
use std::ops::RangeInclusive;

/// Components of a budget when one is first set.
const FIRST_BUDGET: usize = 25_000;

/// Seconds between two saves on the way that can be chosen.
const AUTOSAVES_S: RangeInclusive<u32> = 1..=3600;

/// Rows of the scene preset, whose ranges the types of its settings know.
const SCENE: SettingRows<SceneOverrides> = SettingRows {
    own: &[OwnRow { field: "budget", default: "no budget", draw: budget }],
    check: |_| Ok(()),
};

/// Rows of the paper preset.
const PAPER: SettingRows<PaperOverrides> = SettingRows {
    own: &[],
    check: |paper| {
        PaperConfig::paper().with(paper).map(drop).map_err(|refused| refused.to_string())
    },
};

/// Draws the panel.
pub fn ui(settings: &mut TrainSettings, ui: &mut Ui) {
    ui.horizontal(|ui| {
        for (preset, label, tooltip) in [
            (Preset::Scene, "Scene preset", "Components are born where surfaces are seen"),
            (
                Preset::Paper,
                "Paper preset",
                "The published algorithm; 100,000 components unless Details say otherwise",
            ),
        ] {
            ui.selectable_value(&mut settings.preset, preset, label).on_hover_text(tooltip);
        }
    });
    if settings.preset == Preset::Scene {
        details(&SCENE, &mut settings.scene, ui);
    } else {
        details(&PAPER, &mut settings.paper, ui);
    }
    ui.label(RichText::new("Holds for what is opened next, and after Reset").weak());
    autosave(&mut settings.autosave_s, ui);
}

/// How often a run is saved on its way.
fn autosave(seconds: &mut Option<u32>, ui: &mut Ui) {
    ui.horizontal(|ui| {
        let mut is_on = seconds.is_some();
        let help = "Beside training, so that a crash costs no more than this; the next start offers to go on";
        if ui.checkbox(&mut is_on, "Autosave every").on_hover_text(help).changed() {
            *seconds = is_on.then_some(AUTOSAVE_S);
        }
        let mut shown = seconds.unwrap_or(AUTOSAVE_S);
        let value = DragValue::new(&mut shown).range(AUTOSAVES_S).suffix(" s");
        if named(ui.add_enabled(is_on, value), "Autosave every").changed() {
            *seconds = Some(shown);
        }
    });
}

/// A preset's settings, folded away until somebody wants to change one.
fn details<L: SettingLayer + Clone>(rows: &SettingRows<L>, layer: &mut L, ui: &mut Ui) {
    let n = setting_rows::n_changed(layer);
    let title = if n == 0 { "Details".to_owned() } else { format!("Details: {n} changed") };
    let details = CollapsingHeader::new(title).id_salt("details");
    details.show(ui, |ui| rows.ui(layer, ui));
}

fn budget(scene: &mut SceneOverrides, ui: &mut Ui) {
    ui.horizontal(|ui| {
        let mut is_set = scene.budget.is_some();
        if ui.checkbox(&mut is_set, "At most").changed() {
            scene.budget = is_set.then_some(Budget::Components(FIRST_BUDGET));
        }
        if let Some(budget) = scene.budget {
            let mut components = budget.components();
            let value =
                DragValue::new(&mut components).range(1..=DEFAULT_MAX_COMPONENTS).speed(100.0);
            if named(ui.add(value.suffix(" components")), "At most").changed() {
                scene.budget = Some(Budget::Components(components));
            }
        }
    });
}
