//! Options of the export dialog: conversion to standard 3DGS splats, and the preview with its report.

use super::panels::controls::choices;
use super::viewer::export_preview::{ExportChoice, PreviewReport};
use super::wording;
use crate::export::mapping::{self, DETAIL, GradientSplit, Mapping, OpacityMapping, is_plain};
use crate::export::mesh::MeshFormat;
use crate::export::{ExportError, ModelFormat, SpzVersion};
use crate::model::splat::appearance::SplatView;
use eframe::egui::{Grid, Ui};
use std::path::Path;
use strum::EnumMessage;

/// Content of an exported file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ExportKind {
    #[default]
    Splats,
    PointCloud,
    Mesh,
}

impl ExportKind {
    /// Returns the format of splats or points by the file extension.
    ///
    /// # Errors
    /// [`Fault::UnknownExtension`](crate::export::Fault::UnknownExtension) for another extension.
    pub fn splat_format(self, path: &Path) -> Result<ModelFormat, ExportError> {
        let format = ModelFormat::from_path(path)?;
        let is_cloud = self == Self::PointCloud && format == ModelFormat::Ply;
        Ok(if is_cloud { ModelFormat::PointCloudPly } else { format })
    }

    /// Checks that a file with this extension can have the content.
    ///
    /// # Errors
    /// As [`Self::splat_format`] and [`MeshFormat::from_path`].
    pub fn check(self, path: &Path) -> Result<(), ExportError> {
        match self {
            Self::Mesh => MeshFormat::from_path(path).map(drop),
            _ => self.splat_format(path).map(drop),
        }
    }
}

/// Draws the choice of the content. Meshes need the normals of a scene that is trained here.
pub fn kind(kind: &mut ExportKind, has_mesh: bool, ui: &mut Ui) {
    ui.horizontal(|ui| {
        ui.label("Content");
        let all = [
            (ExportKind::Splats, "Splats", "For viewers of Gaussian splats: .ply, .glb, .spz, .sog, .usda; for browsers: .html"),
            (ExportKind::PointCloud, "Point cloud", "A coloured point for each splat: .ply"),
            (
                ExportKind::Mesh,
                "Mesh",
                "Triangles of the surfaces: .glb and .obj with textures, .ply",
            ),
        ];
        let n = if has_mesh { all.len() } else { all.len() - 1 };
        choices(kind, &all[..n], ui);
    });
    if !has_mesh && *kind == ExportKind::Mesh {
        *kind = ExportKind::Splats;
    }
}

pub fn mapping(mapping: &mut Mapping, ui: &mut Ui) {
    ui.add_space(4.0);
    ui.label("Other programs draw plain splats: opacity at most 1, one colour each.");
    ui.weak("A scene trained with Splats: Plain (Settings) is exported exactly.");
    Grid::new("mapping").num_columns(2).show(ui, |ui| {
        ui.label("Split each splat into");
        let two = "Splits along the longest axis; colours follow the gradient";
        let four = "Splits along both surface axes; colours follow the gradient";
        let splits = [
            (GradientSplit::One, "1", "Drops the colour gradient"),
            (GradientSplit::Two, "2", two),
            (GradientSplit::Four, "4", four),
        ];
        let mut split = mapping.split;
        if ui.horizontal(|ui| choices(&mut split, &splits, ui)).inner {
            // Also sets the opacity mapping that measured best with this split; the user can still change
            // it below.
            *mapping = Mapping { detail: mapping.detail, ..Mapping::for_split(split) };
        }
        ui.end_row();
        ui.label("Opacity above 1");
        let opacities = [
            (OpacityMapping::EqualArea, "Enlarge", "Splats grow to cover the same area"),
            (OpacityMapping::Clip, "Clip", "Limits the opacity; splats keep their size"),
        ];
        ui.horizontal(|ui| choices(&mut mapping.opacity, &opacities, ui));
        ui.end_row();
        ui.label("Textures");
        let details = [
            (Some(DETAIL), "150,000 splats", "Replaces splats with textures by small ones"),
            (Some(400_000), "400,000 splats", "Sharper, in a file almost three times as large"),
            (None, "Leave out", "Writes each splat in its own colour: blurred, in a small file"),
        ];
        ui.horizontal(|ui| choices(&mut mapping.detail, &details, ui));
        ui.end_row();
    });
    ui.add_space(4.0);
}

pub fn spz(version: &mut SpzVersion, ui: &mut Ui) {
    ui.horizontal(|ui| {
        ui.label("Version");
        let versions = [SpzVersion::V2, SpzVersion::V3, SpzVersion::V4]
            .map(|version| (version, format!("SPZ {version}")));
        let hint = |version: &SpzVersion| version.get_documentation().unwrap_or_default();
        let shown: Vec<_> = versions.iter().map(|(v, name)| (*v, name.as_str(), hint(v))).collect();
        choices(version, &shown, ui);
    });
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
            ui.label(format!(
                "{}, about {:.1} MB",
                wording::count(*n_splats, "splat"),
                *bytes as f64 * 1e-6
            ));
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

/// Returns one sentence for each property of the splats that an export loses.
pub fn losses(scene: SplatView<'_>, choice: &ExportChoice) -> Vec<String> {
    let ExportChoice { format, mapping, .. } = *choice;
    let mut losses = Vec::new();
    if !is_plain(scene) {
        describe_plain_losses(scene, mapping, &mut losses);
    }
    losses.extend(match (mapping::lost_textures(scene), mapping.detail) {
        (Some(_), Some(most)) => {
            Some(format!("Textures become about {} small splats", wording::grouped(most)))
        }
        (lost, _) => lost,
    });
    if scene.finishing().exposures.is_some() {
        losses.push("Exposures of the photographs are not stored".to_owned());
    }
    if format == ModelFormat::Sog {
        losses.push(
            "SOG quantises: positions to a quarter of a small splat, sizes and colours to codebooks"
                .to_owned(),
        );
    }
    if matches!(format, ModelFormat::Spz | ModelFormat::Html) {
        losses.push(
            "SPZ quantises: positions to an eighth of a small splat, sizes and colours to 8 bits"
                .to_owned(),
        );
        let version = Some(choice.spz_version).filter(|_| format == ModelFormat::Spz);
        losses.extend(version.and_then(SpzVersion::loss).map(str::to_owned));
    }
    losses.push(
        "Evidence and uncertainty are not stored; a checkpoint (Save) stores them".to_owned(),
    );
    losses
}

fn describe_plain_losses(scene: SplatView<'_>, mapping: Mapping, losses: &mut Vec<String>) {
    let splats = || scene.splats().iter().enumerate().filter(|(_, splat)| splat.is_drawable());
    let n_opaque = splats().filter(|(_, splat)| splat.opacity > 1.0).count();
    if n_opaque > 0 {
        let become_what = match mapping.opacity {
            OpacityMapping::EqualArea => "0.99, with larger splats",
            OpacityMapping::Clip => "0.99",
        };
        losses.push(format!("Opacity above 1 of {n_opaque} splats: reduced to {become_what}"));
    }
    let varies = |i: usize| {
        scene.appearance().get(i).is_some_and(|appearance| appearance.gradient != [[0.0; 3]; 3])
    };
    let n_varying = splats().filter(|(i, _)| varies(*i)).count();
    if n_varying > 0 {
        let become_what = match mapping.split {
            GradientSplit::One => "replaced by one colour each",
            GradientSplit::Two => "replaced by two splats of one colour each",
            GradientSplit::Four => "replaced by four splats of one colour each",
        };
        losses.push(format!("Colour gradients of {n_varying} splats: {become_what}"));
    }
    if scene.finishing().full_coverage < 1.0 {
        losses.push(
            "Only this program closes the cracks between splats; other viewers show them"
                .to_owned(),
        );
    }
}

#[cfg(test)]
mod export_losses_tests {
    use super::*;
    use crate::app::edit::marks::LeftOut;
    use crate::model::splat::appearance::{Appearance, Finishing, SplatSet};
    use crate::model::splat::splats::Splat;
    use crate::model::splat::texture::{Lattice, TEXELS, Texel, Texture};
    use std::sync::Arc;

    #[test]
    fn only_what_is_lost_is_told() {
        let splat = Splat { opacity: 0.5, scale: [0.1; 3], ..Splat::default() };
        let told_with = |set: &SplatSet, format, mapping| {
            let (spz_version, left_out) = (SpzVersion::V2, LeftOut::default());
            losses(set.view(), &ExportChoice { format, mapping, spz_version, left_out })
        };
        let told = |set: &SplatSet, format| told_with(set, format, Mapping::default());
        let plain = SplatSet::from(vec![splat]);
        assert_eq!(told(&plain, ModelFormat::Ply).len(), 1, "evidence and uncertainty only");
        assert!(told(&plain, ModelFormat::Spz)[0].starts_with("SPZ quantises"));
        assert!(told(&plain, ModelFormat::Spz)[1].starts_with("SPZ version 2 rounds rotations"));

        let mut native = SplatSet::from(vec![splat]);
        let gradient = [[1.0, 0.0, 0.0], [0.0; 3], [0.0; 3]];
        let appearance = Appearance { gradient, ..Appearance::default() };
        native.push(Splat { opacity: 2.0, ..splat }, appearance);
        // Transparent splats do not count.
        native.push(Splat { opacity: 0.0, ..splat }, appearance);
        let told_of = told(&native, ModelFormat::Glb);
        assert!(told_of[0].starts_with("Opacity above 1 of 1 splats"), "{told_of:?}");
        assert!(told_of[1].starts_with("Colour gradients of 1 splats"), "{told_of:?}");
        assert_eq!(told_of.len(), 3);
        let closed = native.finished(Finishing { full_coverage: 0.5, ..Finishing::default() });
        assert_eq!(told(&closed, ModelFormat::Glb).len(), 4);

        let axes = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
        let lattice = Lattice { anchor: [0.0; 3], axes, half: 1.0, level: 0 };
        let texture = Texture { lattice, index: vec![0], patches: vec![[Texel(0); TEXELS]; 2000] };
        let textures = Some(Arc::new(vec![None, Some(Arc::new(texture))]));
        let textured = plain.finished(Finishing { textures, ..Finishing::default() });
        let told_of = told(&textured, ModelFormat::Ply);
        assert_eq!(told_of[0], "Textures become about 150,000 small splats");
        let left_out = Mapping { detail: None, ..Mapping::default() };
        let told_of = told_with(&textured, ModelFormat::Ply, left_out);
        assert!(told_of[0].starts_with("Textures of 1 splats, 0.1 MB, are not"), "{told_of:?}");
    }
}
