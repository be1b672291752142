//! How what is opened or reset next is trained.

use crate::app::training::TrainSettings;
use crate::pipeline::settings::scene::{
    Budget, DEFAULT_PIXELS, NEARER_SHARE, SceneOverrides, StructuralScale,
};
use crate::train::paper::config::Preset;
use crate::train::scene::config::{BirthRule, DEFAULT_MAX_COMPONENTS};
use eframe::egui::{Button, DragValue, Grid, RichText, Ui};
use std::ops::RangeInclusive;

/// Structural scales that can be chosen, pixels.
const SCALES_PX: RangeInclusive<f64> = 0.5..=20.0;
/// Components of a budget when one is first set.
const FIRST_BUDGET: usize = 25_000;

/// Draws the panel.
pub fn ui(settings: &mut TrainSettings, ui: &mut Ui) {
    ui.horizontal(|ui| {
        for (preset, label, tooltip) in [
            (Preset::Scene, "Scene preset", "Components are born where surfaces are seen"),
            (Preset::Paper, "Paper preset", "The published algorithm with its 100,000 components"),
        ] {
            ui.selectable_value(&mut settings.preset, preset, label).on_hover_text(tooltip);
        }
    });
    if settings.preset == Preset::Scene {
        ui.collapsing("Details", |ui| {
            Grid::new("training").num_columns(2).show(ui, |ui| {
                scale(&mut settings.scene, ui);
                births(&mut settings.scene, ui);
                budget(&mut settings.scene, ui);
            });
            stages(&mut settings.scene, ui);
        });
    }
    ui.label(RichText::new("Holds for what is opened next, and after Reset").weak());
}

fn scale(scene: &mut SceneOverrides, ui: &mut Ui) {
    ui.label("Structural scale").on_hover_text(format!(
        "Largest distance of a point from the seed of its component, in pixels at the distance that {:.0} % of the points are nearer than",
        100.0 * NEARER_SHARE
    ));
    ui.horizontal(|ui| {
        let mut pixels = match scene.scale {
            Some(StructuralScale::Pixels(n)) => n,
            Some(StructuralScale::World(_)) | None => DEFAULT_PIXELS,
        };
        let value = DragValue::new(&mut pixels).range(SCALES_PX).speed(0.02).suffix(" px");
        if ui.add(value.max_decimals(2)).changed() {
            scene.scale = Some(StructuralScale::Pixels(pixels));
        }
        if ui.add_enabled(scene.scale.is_some(), Button::new("Reset scale")).clicked() {
            scene.scale = None;
        }
    });
    ui.end_row();
}

fn births(scene: &mut SceneOverrides, ui: &mut Ui) {
    ui.label("Births");
    ui.horizontal(|ui| {
        for (rule, label, tooltip) in [
            (BirthRule::Seeds, "Seeds", "Where a point has no seed within the structural scale"),
            (
                BirthRule::Lattice,
                "Cubic",
                "Cells of a lattice: the order of frames does not matter",
            ),
            (
                BirthRule::BodyCentred,
                "Body-centred",
                "Cells of a lattice: the order of frames does not matter",
            ),
        ] {
            let is_chosen = scene.births.unwrap_or(BirthRule::Seeds) == rule;
            if ui.selectable_label(is_chosen, label).on_hover_text(tooltip).clicked() {
                scene.births = (rule != BirthRule::Seeds).then_some(rule);
            }
        }
    });
    ui.end_row();
}

fn budget(scene: &mut SceneOverrides, ui: &mut Ui) {
    ui.label("Budget").on_hover_text("Most components of a scene");
    ui.horizontal(|ui| {
        let mut is_set = scene.budget.is_some();
        if ui.checkbox(&mut is_set, "At most").changed() {
            scene.budget = is_set.then_some(Budget::Components(FIRST_BUDGET));
        }
        if let Some(budget) = scene.budget {
            let mut components = budget.components();
            let value =
                DragValue::new(&mut components).range(1..=DEFAULT_MAX_COMPONENTS).speed(100.0);
            if ui.add(value.suffix(" components")).changed() {
                scene.budget = Some(Budget::Components(components));
            }
        }
    });
    ui.end_row();
}

fn stages(scene: &mut SceneOverrides, ui: &mut Ui) {
    ui.label("Preparation of frames")
        .on_hover_text("The view “Preparation” shows what becomes of every pixel");
    for (stage, label, tooltip) in [
        (
            &mut scene.plane_fit,
            "Fit planes",
            "Depth of the plane around each pixel, else as measured",
        ),
        (&mut scene.flying_pixels, "Drop flying pixels", "Pixels that no plane explains"),
        (&mut scene.cosine, "Drop slanted surfaces", "Surfaces seen nearly from their edge"),
    ] {
        let mut is_on = stage.unwrap_or(true);
        if ui.checkbox(&mut is_on, label).on_hover_text(tooltip).changed() {
            *stage = (!is_on).then_some(false);
        }
    }
}
