//! Inspector of the selected splat: posterior and drawing parameters.

use super::signal_color::{format_number, swatch, to_color32};
use crate::app::state::{Inspected, Snapshot};
use crate::math::sym3::Sym3;
use crate::model::inspection::Inspection;
use crate::model::scene::photometric::PhotometricDeviations;
use crate::model::splat::appearance::Appearance;
use eframe::egui::{Grid, Label, RichText, ScrollArea, Ui};
use glam::DVec3;

struct Section {
    title: &'static str,
    lines: Vec<Line>,
}

struct Line {
    label: &'static str,
    text: String,
    swatch: Option<[f32; 3]>,
}

pub fn ui(snapshot: &Snapshot, ui: &mut Ui) {
    let Some(inspected) = &snapshot.inspected else {
        ui.label("Nothing is selected.");
        ui.label(RichText::new("Click a splat in the viewport; Escape deselects it.").weak());
        return;
    };
    let origin = snapshot.opened.as_ref().map_or(DVec3::ZERO, |opened| opened.local_origin);
    let sections = sections(inspected, origin);
    let title = format!("Splat {}", inspected.id());
    ui.horizontal(|ui| {
        ui.label(RichText::new(&title).strong());
        let copy = ui.button("Copy").on_hover_text("Copies these values to the clipboard as text");
        if copy.clicked() {
            ui.ctx().copy_text(text(&title, &sections));
        }
    });
    ScrollArea::both().show(ui, |ui| {
        for section in &sections {
            ui.add_space(6.0);
            ui.label(RichText::new(section.title).strong());
            let grid = Grid::new(section.title).num_columns(2).spacing([12.0, 4.0]);
            grid.striped(true).show(ui, |ui| section.lines.iter().for_each(|l| row(l, ui)));
        }
    });
}

fn row(line: &Line, ui: &mut Ui) {
    ui.label(RichText::new(line.label).weak());
    let text = Label::new(RichText::new(&line.text).monospace());
    match line.swatch {
        None => drop(ui.add(text)),
        Some(color) => drop(ui.horizontal(|ui| {
            swatch(Some(to_color32(color)), ui);
            ui.add(text);
        })),
    }
    ui.end_row();
}

fn text(title: &str, sections: &[Section]) -> String {
    let mut text = format!("{title}\n");
    for section in sections {
        text.push_str(&format!("\n{}\n", section.title));
        for line in &section.lines {
            // Rows of a matrix are indented below their label.
            text.push_str(&format!("  {}: {}\n", line.label, line.text.replace('\n', "\n    ")));
        }
    }
    text
}

fn sections(inspected: &Inspected, origin: DVec3) -> Vec<Section> {
    match inspected {
        Inspected::Component(inspection) => {
            let mut sections = posterior_sections(inspection);
            sections.extend(inspection.photometric_deviations.as_ref().map(photometric_section));
            sections.push(splat_section("As drawn", inspected, origin));
            sections
        }
        Inspected::Splat { .. } => vec![splat_section("As stored in the file", inspected, origin)],
    }
}

fn posterior_sections(i: &Inspection) -> Vec<Section> {
    let (p, a) = (&i.posterior, &i.attributes);
    let known = |value: Option<String>| value.unwrap_or_else(|| "unknown".to_owned());
    let color = i.color.as_vec3().to_array();
    let q = i.rotation;
    let evidence = Section {
        title: "Evidence",
        lines: vec![
            line("Points N", format_number(p.count)),
            line("Weight", format!("{} %", format_number(100.0 * i.weight))),
            line("Born in frame", known(a.birth.map(|frame| (frame + 1).to_string()))),
            line("ELBO, frame", known(a.elbo.map(|e| format!("{} nats", format_number(e.into()))))),
        ],
    };
    let space = Section {
        title: "Posterior, world units",
        lines: vec![
            line("Mean", numbers(&i.mean.to_array())),
            line(
                "Uncertainty",
                known(a.uncertainty.map(|u| format!("± {}", format_number(u.into())))),
            ),
            line("Covariance", matrix(i.covariance)),
            line("Deviations", numbers(&i.scales.to_array())),
            line("Rotation wxyz", quaternion([q.w, q.x, q.y, q.z])),
        ],
    };
    let law = Section {
        title: "Parameters",
        lines: vec![
            line("κ", format_number(p.kappa_space)),
            line("ν", format_number(p.nu_space)),
            line("α", format_number(p.alpha)),
            line("κ colour", format_number(p.kappa_color)),
            Line {
                label: "Colour",
                text: numbers(&i.color.to_array()),
                // The mean of a Gaussian over colours may lie outside the range of a pixel.
                swatch: Some(color.map(|c| c.clamp(0.0, 1.0))),
            },
        ],
    };
    vec![evidence, space, law]
}

/// Returns the section with the standard deviations of the splat's parameters under the photometric
/// posterior.
fn photometric_section(found: &PhotometricDeviations) -> Section {
    let percent = |x: f64| 100.0 * x;
    let lines = vec![
        line("Centre ±", numbers(&found.mean)),
        line("Scales ± %", numbers(&found.scale.map(percent))),
        line("Rotation ± °", numbers(&found.turn.map(f64::to_degrees))),
        line("Opacity ± %", format_number(percent(found.opacity))),
        line("Colour ±", format_number(found.color)),
    ];
    Section { title: "From photographs", lines }
}

fn splat_section(title: &'static str, inspected: &Inspected, origin: DVec3) -> Section {
    let (splat, appearance) = (inspected.splat(), inspected.appearance());
    let wide = |v: [f32; 3]| v.map(f64::from);
    let mut lines = vec![
        line("Centre", numbers(&wide(splat.mean))),
        line("Scales", numbers(&wide(splat.scale))),
        line("Rotation wxyz", quaternion(splat.rotation.map(f64::from))),
        line("Opacity", format_number(splat.opacity.into())),
        Line { label: "Colour", text: numbers(&wide(splat.color)), swatch: Some(splat.color) },
    ];
    if origin != DVec3::ZERO {
        // Fixed decimals: map coordinates are large, and a millimetre must remain visible.
        let [x, y, z] = (origin + DVec3::from_array(wide(splat.mean))).to_array();
        lines.insert(1, line("World position", format!("{x:.3}  {y:.3}  {z:.3}")));
    }
    // Plain splats have neither gradient nor directional colour.
    if *appearance != Appearance::default() {
        lines.push(line("Gradient rgb", rows(appearance.gradient.map(wide))));
        lines.push(line("Degree 1 rgb", rows(appearance.directional.map(wide))));
    }
    Section { title, lines }
}

fn line(label: &'static str, text: String) -> Line {
    Line { label, text, swatch: None }
}

fn numbers(values: &[f64]) -> String {
    values.iter().map(|&v| format_number(v)).collect::<Vec<_>>().join("  ")
}

fn quaternion(wxyz: [f64; 4]) -> String {
    wxyz.map(|v| format!("{v:.3}")).join(" ")
}

fn matrix(m: Sym3) -> String {
    let [xx, xy, xz, yy, yz, zz] = m.to_array();
    rows([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
}

fn rows(rows: [[f64; 3]; 3]) -> String {
    // One width for all, so that columns align.
    let short = |v: f64| format!("{v:>9.2e}");
    rows.map(|row| row.map(short).join(" ")).join("\n")
}
