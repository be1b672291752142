//! Where the milliseconds go: a stacked area over the latest frames, and a table.

use crate::app::drawing::{DrawHistory, DrawStage, Drawer};
use crate::app::state::Snapshot;
use crate::eval::report::{FrameReport, quantile};
use crate::train::stages::{MAX_STAGES, TrainStage};
use eframe::egui::{Align, Color32, Grid, Layout, Response, RichText, ScrollArea, Sense, Ui, Vec2};
use egui_plot::{FilledArea, Plot};

/// Colours of the stages, in the order they run; told apart by people with red-green blindness too
/// (Okabe and Ito 2008).
const COLORS: [Color32; MAX_STAGES] = [
    Color32::from_rgb(86, 180, 233),
    Color32::from_rgb(230, 159, 0),
    Color32::from_rgb(0, 158, 115),
    Color32::from_rgb(240, 228, 66),
    Color32::from_rgb(213, 94, 0),
    Color32::from_rgb(204, 121, 167),
    Color32::from_rgb(0, 114, 178),
    Color32::from_rgb(153, 153, 153),
];

/// Draws the panel.
pub fn ui(snapshot: &Snapshot, drawn: &DrawHistory, ui: &mut Ui) {
    ScrollArea::vertical().show(ui, |ui| {
        if snapshot.recent.is_empty() {
            ui.label("Timings of training appear with the first trained frame.");
        } else {
            ui.label(RichText::new("Milliseconds of training per frame").weak());
            plot(&snapshot.recent, ui);
        }
        ui.add_space(6.0);
        Grid::new("latency table").num_columns(5).spacing([12.0, 4.0]).striped(true).show(
            ui,
            |ui| {
                if !snapshot.recent.is_empty() {
                    training_rows(&snapshot.recent, ui);
                }
                if drawn.samples().len() > 0 {
                    drawing_rows(drawn, ui);
                }
            },
        );
        if drawn.drawer == Drawer::UntimedGpu {
            ui.label(RichText::new("This adapter cannot time its passes.").weak());
        }
        ui.add_space(6.0);
        if ui
            .button("Copy as CSV")
            .on_hover_text("Copies the timings of these frames and pictures to the clipboard")
            .clicked()
        {
            ui.ctx().copy_text(csv(&snapshot.recent) + &drawing_csv(drawn));
        }
    });
}

fn plot(frames: &[FrameReport], ui: &mut Ui) {
    let x: Vec<f64> = frames.iter().map(|f| f.index as f64).collect();
    let mut below = vec![0.0; frames.len()];
    // The top of the axis leaves out the slowest frames: one hiccup must not flatten the rest.
    let mut totals: Vec<f64> = frames.iter().map(|f| f.ms.stages.train).collect();
    totals.sort_by(f64::total_cmp);
    let top = 1.25 * quantile(&totals, 0.98);
    Plot::new("latency")
        .height(190.0)
        .include_y(0.0)
        // No gestures: the wheel scrolls the panel, and the bounds follow the newest frames.
        .allow_drag(false)
        .allow_zoom(false)
        .allow_scroll(false)
        .allow_boxed_zoom(false)
        .x_axis_label("frame")
        .show(ui, |plot| {
            plot.set_plot_bounds_y(0.0..=top);
            for (at, stage) in stages(frames).iter().enumerate() {
                let above: Vec<f64> =
                    stage_ms(frames, at).zip(&below).map(|(ms, b)| b + ms).collect();
                let area = FilledArea::new(stage.label, &x, &below, &above)
                    .fill_color(COLORS[at].gamma_multiply(0.85));
                plot.add(area);
                below = above;
            }
        });
}

fn training_rows(frames: &[FrameReport], ui: &mut Ui) {
    headings("Training, ms", ui);
    for (at, stage) in stages(frames).iter().enumerate() {
        row(ui, Some(COLORS[at]), stage.label, stage_ms(frames, at)).on_hover_text(stage.what);
    }
    row(ui, None, "Total", frames.iter().map(|f| f.ms.stages.train));
    let beside = "Done on another thread where the machine has a core to spare, else between two \
                  trainings";
    row(ui, None, "Decode (not in total)", frames.iter().map(|f| f.ms.load)).on_hover_text(beside);
    row(ui, None, "Prepare (not in total)", frames.iter().map(|f| f.ms.prepare))
        .on_hover_text(beside);
}

/// What pictures of the viewport take.
fn drawing_rows(drawn: &DrawHistory, ui: &mut Ui) {
    headings("Drawing, ms", ui);
    for stage in DrawStage::ALL {
        let values: Vec<f64> = drawn.samples().filter_map(|s| s.ms(stage)).collect();
        if !values.is_empty() {
            row(ui, None, stage.label(), values.into_iter());
        }
    }
    if drawn.drawer != Drawer::Cpu {
        let kib = drawn.samples().map(|s| s.uploaded_bytes as f64 / 1024.0);
        row(ui, None, "Uploaded, KiB", kib).on_hover_text("Changed splats sent to the GPU");
    }
}

fn headings(first: &str, ui: &mut Ui) {
    for title in ["", first] {
        ui.label(RichText::new(title).weak());
    }
    for title in ["median", "95 %", "max"] {
        number(ui, RichText::new(title).weak());
    }
    ui.end_row();
}

fn row(
    ui: &mut Ui,
    color: Option<Color32>,
    label: &str,
    values: impl Iterator<Item = f64>,
) -> Response {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    let (swatch, _) = ui.allocate_exact_size(Vec2::splat(10.0), Sense::hover());
    if let Some(color) = color {
        ui.painter().rect_filled(swatch, 2.0, color);
    }
    let named = ui.label(label);
    for q in [0.5, 0.95, 1.0] {
        number(ui, RichText::new(format!("{:.1}", quantile(&values, q))).monospace());
    }
    ui.end_row();
    named
}

fn number(ui: &mut Ui, text: RichText) {
    ui.with_layout(Layout::right_to_left(Align::Center), |ui| ui.label(text));
}

/// The stages of the preset that trains these frames.
fn stages(frames: &[FrameReport]) -> &'static [TrainStage] {
    frames.last().map_or(&[], |frame| frame.ms.stages.names())
}

/// Milliseconds of the stage at a position in [`stages`], frame by frame; 0 for frames that have
/// others, such as those that version 0.1.0 trained of a run that goes on.
fn stage_ms(frames: &[FrameReport], at: usize) -> impl Iterator<Item = f64> {
    let stages = stages(frames);
    frames.iter().map(move |frame| match &frame.ms.stages {
        ms if ms.names() == stages => ms.values()[at],
        _ => 0.0,
    })
}

fn csv(frames: &[FrameReport]) -> String {
    let names: Vec<&str> = stages(frames).iter().map(|stage| stage.key).collect();
    let mut text = format!("frame,points,load,prepare,{},train\n", names.join(","));
    let columns: Vec<Vec<f64>> =
        (0..names.len()).map(|at| stage_ms(frames, at).collect()).collect();
    for (i, f) in frames.iter().enumerate() {
        let stages: Vec<_> = columns.iter().map(|column| format!("{:.4}", column[i])).collect();
        let line = format!(
            "{},{},{:.4},{:.4},{},{:.4}\n",
            f.index,
            f.points,
            f.ms.load,
            f.ms.prepare,
            stages.join(","),
            f.ms.stages.train
        );
        text.push_str(&line);
    }
    text
}

/// A second block, since pictures are not frames of the training.
fn drawing_csv(drawn: &DrawHistory) -> String {
    let names = DrawStage::ALL.map(|stage| format!("{} ms", stage.label())).join(",");
    let mut text = format!("\npicture,{names},uploaded bytes\n");
    for (i, sample) in drawn.samples().enumerate() {
        let cell = |stage| sample.ms(stage).map_or_else(String::new, |ms| format!("{ms:.4}"));
        let stages = DrawStage::ALL.map(cell).join(",");
        text.push_str(&format!("{i},{stages},{}\n", sample.uploaded_bytes));
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::app::drawing::DrawSample;
    use crate::eval::report::FrameMs;
    use crate::train::stages::PAPER_STAGES;
    use crate::train::timing::StageMs;

    #[test]
    fn csv_has_a_column_per_heading() {
        let mut stages = StageMs::new(&PAPER_STAGES);
        stages.add(0, 1.0);
        let frame = FrameReport {
            behind_ms: None,
            tracked: None,
            index: 3,
            frame: "r_3".into(),
            points: 10,
            points_dropped: 0,
            components: 5,
            used: 2,
            born: 0,
            reassigned: 0,
            merged: 0,
            elbo_mean: 0.0,
            photograph: None,
            ms: FrameMs { load: 0.5, prepare: 0.25, stages },
        };
        let text = csv(&[frame]);
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(lines[0].split(',').count(), lines[1].split(',').count());
        assert!(lines[1].starts_with("3,10,0.5000,0.2500,1.0000,"));
    }

    #[test]
    fn pictures_leave_stages_empty_that_did_not_happen() {
        let mut drawn = DrawHistory::new(Drawer::Gpu);
        let mut sample = DrawSample::new(640);
        sample.add(DrawStage::Order, Some(0.5));
        sample.add(DrawStage::Draw, Some(1.25));
        drawn.push(sample);
        let text = drawing_csv(&drawn);
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(lines[1].split(',').count(), lines[2].split(',').count());
        assert_eq!(lines[2], "0,,0.5000,,,1.2500,640");
    }
}
