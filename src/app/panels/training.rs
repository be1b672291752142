//! Training settings for the next opened or reset run.

use super::explained::named;
use super::setting_rows::{self, CustomRow, SettingRows};
use crate::app::training::{AUTOSAVE_S, TrainSettings};
use crate::pipeline::settings::scene::SceneOverrides;
use crate::train::paper::config::{PaperConfig, PaperOverrides};
use crate::train::scene::config::DEFAULT_MAX_COMPONENTS;
use crate::train::scene::units::Budget;
use crate::train::setting::Preset;
use crate::train::setting::table::SettingLayer;
use eframe::egui::{CollapsingHeader, DragValue, RichText, Ui};
use std::ops::RangeInclusive;

/// Initial budget, components.
const FIRST_BUDGET: usize = 25_000;

/// Range of the autosave interval, seconds.
const AUTOSAVES_S: RangeInclusive<u32> = 1..=3600;

/// Rows of the scene preset; the types of its settings validate their ranges.
const SCENE: SettingRows<SceneOverrides> = SettingRows {
    custom: &[CustomRow { field: "budget", default: "no budget", draw: budget }],
    check: |_| Ok(()),
};

const PAPER: SettingRows<PaperOverrides> = SettingRows {
    custom: &[],
    check: |paper| {
        PaperConfig::paper().with(paper).map(drop).map_err(|refused| refused.to_string())
    },
};

pub fn ui(settings: &mut TrainSettings, ui: &mut Ui) {
    ui.horizontal(|ui| {
        for (preset, label, tooltip) in [
            (Preset::Scene, "Scene preset", "Creates components on observed surfaces"),
            (
                Preset::Paper,
                "Paper preset",
                "The published algorithm; 100,000 components unless changed in Details",
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
    ui.label(RichText::new("Applies to the next opened dataset, and after Reset").weak());
    autosave(&mut settings.autosave_s, ui);
}

/// Setting of the autosave interval.
fn autosave(seconds: &mut Option<u32>, ui: &mut Ui) {
    ui.horizontal(|ui| {
        let mut is_on = seconds.is_some();
        let help = "Saves during training; after a crash, the next start offers to resume";
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

/// Collapsible list of a preset's settings.
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
