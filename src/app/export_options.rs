//! Export options of the dialog: conversion to plain splats, preview, and its report.

use crate::app::viewer::export_preview::PreviewReport;
use crate::export::mapping::{GradientSplit, Mapping, OpacityMapping};
use eframe::egui::{Grid, Ui};

pub fn ui(mapping: &mut Mapping, ui: &mut Ui) {
    ui.add_space(4.0);
    ui.label("Other programs draw plain splats: opacity at most 1, one colour each.");
    ui.weak("A scene trained with Splats: Plain (Settings) is exported exactly.");
    Grid::new("mapping").num_columns(2).show(ui, |ui| {
        ui.label("Split each splat into");
        ui.horizontal(|ui| {
            for (split, label, tooltip) in [
                (GradientSplit::One, "1", "Drops the colour gradient"),
                (
                    GradientSplit::Two,
                    "2",
                    "Splits along the longest axis; colours follow the gradient",
                ),
                (
                    GradientSplit::Four,
                    "4",
                    "Splits along both surface axes; colours follow the gradient",
                ),
            ] {
                let is_chosen = mapping.split == split;
                if ui.selectable_label(is_chosen, label).on_hover_text(tooltip).clicked() {
                    // Also sets the opacity mapping that measured best with this split; the user can still
                    // change it below.
                    *mapping = Mapping::for_split(split);
                }
            }
        });
        ui.end_row();
        ui.label("Opacity above 1");
        ui.horizontal(|ui| {
            for (opacity, label, tooltip) in [
                (OpacityMapping::EqualArea, "Equal area", "Splats grow to cover the same area"),
                (OpacityMapping::Clip, "Clip", "Limits the opacity; splats keep their size"),
            ] {
                ui.selectable_value(&mut mapping.opacity, opacity, label).on_hover_text(tooltip);
            }
        });
        ui.end_row();
    });
    ui.add_space(4.0);
}

pub fn preview(is_on: &mut bool, ui: &mut Ui) {
    let hint = "Compares the scene with the exported file; drag the divider in the viewport";
    ui.checkbox(is_on, "Preview the file").on_hover_text(hint);
}

pub fn report(report: Option<&PreviewReport>, ui: &mut Ui) {
    match report {
        None => {}
        Some(PreviewReport::Converting) => {
            ui.weak("Converting…");
        }
        Some(PreviewReport::Refused(problem)) => {
            ui.colored_label(ui.visuals().error_fg_color, problem);
        }
        Some(PreviewReport::Shown { n_splats, bytes, psnr, losses }) => {
            ui.label(format!("{n_splats} splats, about {:.1} MB", *bytes as f64 * 1e-6));
            let figure = match psnr {
                // Identical images are reported as 120 dB.
                Some(psnr) if *psnr > 100.0 => "Identical to the scene from this view".to_owned(),
                Some(psnr) if psnr.is_finite() => {
                    format!("PSNR against the scene: {psnr:.1} dB from this view")
                }
                Some(_) => "Not measurable from this view".to_owned(),
                None => "Measuring…".to_owned(),
            };
            let hint =
                "PSNR between the exported file and the scene, rendered from the current view";
            ui.strong(figure).on_hover_text(hint);
            for loss in losses {
                ui.label(format!("• {loss}"));
            }
        }
    }
}
