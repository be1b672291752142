//! Timings of the latest frames: stacked plot and table.

use super::controls::named;
use super::plot_axes;
use super::signal_color::swatch;
use crate::app::drawing::{DrawHistory, DrawStage, ViewRenderer};
use crate::app::state::Snapshot;
use crate::eval::report::{FrameReport, Summary, quantile};
use crate::train::timing::{MAX_STAGES, TrainStage};
use eframe::egui::{
    Align, Color32, DragValue, Grid, Layout, Response, RichText, ScrollArea, Ui, Vec2,
};
use egui_plot::{FilledArea, HLine, HoverPosition};
use std::ops::RangeInclusive;

/// Colours of the stages in order of execution.
// Distinguishable with red-green colour blindness (Okabe and Ito 2008; textures are Tol's wine).
const COLORS: [Color32; MAX_STAGES] = [
    Color32::from_rgb(86, 180, 233),
    Color32::from_rgb(230, 159, 0),
    Color32::from_rgb(0, 158, 115),
    Color32::from_rgb(240, 228, 66),
    Color32::from_rgb(213, 94, 0),
    Color32::from_rgb(204, 121, 167),
    Color32::from_rgb(136, 34, 85),
    Color32::from_rgb(0, 114, 178),
    Color32::from_rgb(153, 153, 153),
];

const BUDGETS_MS: RangeInclusive<f64> = 1.0..=10_000.0;
/// Width of a number column in the table, points.
// Fixed, so that columns do not move.
const NUMBER_WIDTH: f32 = 40.0;
const BUDGET: Color32 = Color32::from_rgb(240, 100, 90);

/// Draws the panel. Returns the timings as CSV if the user requests a file of them.
pub fn ui(
    snapshot: &Snapshot,
    drawn: &DrawHistory,
    budget_ms: &mut f64,
    ui: &mut Ui,
) -> Option<String> {
    let mut to_write = None;
    // Scrolls both ways: longer numbers must not widen the panel, which would resize the viewport.
    ScrollArea::both().auto_shrink(false).show(ui, |ui| {
        if snapshot.frames.recent.is_empty() {
            ui.label("Training timings appear after the first trained frame.");
        } else {
            ui.label(RichText::new("Training time per frame, ms").weak());
            plot(&snapshot.frames.recent, *budget_ms, ui);
            budget(&snapshot.frames.recent, budget_ms, ui);
        }
        ui.add_space(6.0);
        let table = Grid::new("latency table").num_columns(5).min_col_width(0.0);
        table.spacing([6.0, 4.0]).striped(true).show(ui, |ui| {
            if !snapshot.frames.recent.is_empty() {
                training_rows(&snapshot.frames.recent, ui);
            }
            if drawn.samples().len() > 0 {
                drawing_rows(drawn, ui);
            }
        });
        if drawn.drawer == ViewRenderer::UntimedGpu {
            ui.label(RichText::new("This adapter does not support GPU timings.").weak());
        }
        ui.add_space(6.0);
        let has_timings = !snapshot.frames.recent.is_empty() || drawn.samples().len() > 0;
        ui.add_enabled_ui(has_timings, |ui| {
            let save = "Writes the timings of these frames and pictures to a file next to the open dataset or model";
            if ui.button("Write CSV").on_hover_text(save).clicked() {
                to_write = Some(frames_csv(&snapshot.frames.recent) + &drawing_csv(drawn));
            }
        });
    });
    to_write
}

fn plot(frames: &[FrameReport], budget_ms: f64, ui: &mut Ui) {
    let x: Vec<f64> = frames.iter().map(ordinal).collect();
    let mut below = vec![0.0; frames.len()];
    // The axis excludes the slowest 2 % of frames, so that one outlier does not flatten the plot.
    let mut totals: Vec<f64> = frames.iter().map(|f| f.ms.stages.train).collect();
    totals.sort_by(f64::total_cmp);
    let top = (1.25 * quantile(&totals, 0.98)).max(f64::MIN_POSITIVE);
    plot_axes::plot("latency", ["frame", "ms"], 190.0)
        // Stacked areas start at 0.
        .include_y(0.0)
        .label_formatter(|at| {
            let x = match at {
                HoverPosition::NearDataPoint { position, .. }
                | HoverPosition::Elsewhere { position } => position.x,
            };
            frame_at(frames, x).map(tooltip_text)
        })
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
            if budget_ms < top {
                plot.hline(HLine::new("budget", budget_ms).color(BUDGET).width(1.5));
            }
        });
}

/// Returns the number of a frame in the order of training, from 1.
fn ordinal(frame: &FrameReport) -> f64 {
    frame.index as f64 + 1.0
}

fn frame_at(frames: &[FrameReport], x: f64) -> Option<&FrameReport> {
    let distance = |frame: &FrameReport| (ordinal(frame) - x).abs();
    frames.iter().min_by(|a, b| distance(a).total_cmp(&distance(b)))
}

fn tooltip_text(frame: &FrameReport) -> String {
    let ms = &frame.ms.stages;
    let mut text = format!("Frame {} ({}): {:.1} ms", ordinal(frame), frame.frame, ms.train);
    for (stage, value) in ms.names().iter().zip(ms.values()) {
        text += &format!("\n{}: {value:.1} ms", stage.label);
    }
    text
}

/// Draws the latency budget, the fraction of frames within it, and the points per second.
fn budget(frames: &[FrameReport], budget_ms: &mut f64, ui: &mut Ui) {
    ui.horizontal_wrapped(|ui| {
        ui.label("Budget");
        let value = DragValue::new(budget_ms).range(BUDGETS_MS).speed(0.5).max_decimals(1);
        let value = named(ui.add(value.suffix(" ms")), "Budget per frame");
        value.on_hover_text("Time allowed per frame; the red line in the plot");
        let share = share_within_budget(frames, *budget_ms);
        ui.label(format!("{:.0} % of frames within budget", 100.0 * share));
    });
    let rate = Summary::of_frames(frames, 0.0).points_per_s;
    ui.label(format!("{:.2} million points/s", rate * 1e-6));
}

fn share_within_budget(frames: &[FrameReport], budget_ms: f64) -> f64 {
    let n = frames.iter().filter(|frame| frame.ms.stages.train <= budget_ms).count();
    // At least 1, because no frame may exist yet.
    n as f64 / frames.len().max(1) as f64
}

fn training_rows(frames: &[FrameReport], ui: &mut Ui) {
    headings("Training, ms", ui);
    for (at, stage) in stages(frames).iter().enumerate() {
        row(ui, Some(COLORS[at]), stage.label, stage_ms(frames, at)).on_hover_text(stage.tooltip);
    }
    row(ui, None, "Total", frames.iter().map(|f| f.ms.stages.train));
    let beside = "Runs on another thread if the machine has a spare core, otherwise between two \
                  frames";
    row(ui, None, "Decode (not in total)", frames.iter().map(|f| f.ms.load)).on_hover_text(beside);
    row(ui, None, "Prepare (not in total)", frames.iter().map(|f| f.ms.prepare))
        .on_hover_text(beside);
}

fn drawing_rows(drawn: &DrawHistory, ui: &mut Ui) {
    headings("Drawing, ms", ui);
    for stage in DrawStage::ALL {
        let values: Vec<f64> = drawn.samples().filter_map(|s| s.ms(stage)).collect();
        if !values.is_empty() {
            row(ui, None, stage.label(), values.into_iter());
        }
    }
    if drawn.drawer != ViewRenderer::Cpu {
        let kib = drawn.samples().map(|s| s.uploaded_bytes as f64 / 1024.0);
        row(ui, None, "Uploaded, KiB", kib).on_hover_text("Data of changed splats sent to the GPU");
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
    swatch(color, ui);
    let named = ui.label(label);
    for q in [0.5, 0.95, 1.0] {
        let value = quantile(&values, q);
        // Five characters at most, so that a narrow panel shows all columns.
        let text = if value < 999.95 { format!("{value:.1}") } else { format!("{value:.0}") };
        number(ui, RichText::new(text).monospace());
    }
    ui.end_row();
    named
}

fn number(ui: &mut Ui, text: RichText) {
    let size = Vec2::new(NUMBER_WIDTH, ui.spacing().interact_size.y);
    ui.allocate_ui_with_layout(size, Layout::right_to_left(Align::Center), |ui| {
        // The column is as wide as the content of this layout.
        ui.set_min_width(NUMBER_WIDTH);
        ui.label(text)
    });
}

/// Returns the label of the stage that takes most of the training time, and its part of that time.
pub fn slowest_stage(frames: &[FrameReport]) -> Option<(&'static str, f64)> {
    let total = |at: usize| stage_ms(frames, at).sum::<f64>();
    let (at, ms) = (0..stages(frames).len())
        .map(|at| (at, total(at)))
        .max_by(|(_, a), (_, b)| a.total_cmp(b))?;
    let all: f64 = frames.iter().map(|frame| frame.ms.stages.train).sum();
    (all > 0.0).then(|| (stages(frames)[at].label, ms / all))
}

fn stages(frames: &[FrameReport]) -> &'static [TrainStage] {
    frames.last().map_or(&[], |frame| frame.ms.stages.names())
}

/// Returns the time of stage `at` (index into [`stages`]) in each frame, milliseconds; 0 for frames with
/// other stages.
fn stage_ms(frames: &[FrameReport], at: usize) -> impl Iterator<Item = f64> {
    let stages = stages(frames);
    frames.iter().map(move |frame| match &frame.ms.stages {
        ms if ms.names() == stages => ms.values()[at],
        _ => 0.0,
    })
}

fn frames_csv(frames: &[FrameReport]) -> String {
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

fn drawing_csv(drawn: &DrawHistory) -> String {
    // A separate block, since pictures do not correspond to frames.
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
pub mod tests {
    use super::*;
    use crate::app::drawing::DrawSample;
    use crate::eval::report::FrameMs;
    use crate::train::timing::{PAPER_STAGES, StageMs};

    /// Returns a report of a frame with `ms` milliseconds of training, all in the first stage.
    pub fn frame(ms: f64) -> FrameReport {
        let mut stages = StageMs::new(&PAPER_STAGES);
        stages.add(0, ms);
        stages.train = ms;
        FrameReport {
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
        }
    }

    #[test]
    fn the_slowest_stage_is_named_with_its_part() {
        assert_eq!(slowest_stage(&[]), None);
        let mut second = frame(10.0);
        second.ms.stages.add(1, 30.0);
        second.ms.stages.train = 40.0;
        let (label, part) = slowest_stage(&[frame(10.0), second]).unwrap();
        assert_eq!((label, part), (PAPER_STAGES[1].label, 0.6));
    }

    #[test]
    fn csv_has_a_column_per_heading() {
        let text = frames_csv(&[frame(1.0)]);
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(lines[0].split(',').count(), lines[1].split(',').count());
        assert!(lines[1].starts_with("3,10,0.5000,0.2500,1.0000,"));
    }

    #[test]
    fn pictures_leave_stages_empty_that_did_not_happen() {
        let mut drawn = DrawHistory::new(ViewRenderer::Gpu);
        let mut sample = DrawSample::new(640);
        sample.add(DrawStage::Sort, Some(0.5));
        sample.add(DrawStage::Draw, Some(1.25));
        drawn.push(sample);
        let text = drawing_csv(&drawn);
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(lines[1].split(',').count(), lines[2].split(',').count());
        assert_eq!(lines[2], "0,,,0.5000,1.2500,640");
    }

    #[test]
    fn frames_are_counted_against_the_budget_and_found_under_the_pointer() {
        let frames: Vec<_> = [(0, 10.0), (1, 20.0), (2, 30.0), (5, 40.0)]
            .map(|(index, ms)| FrameReport { index, ..frame(ms) })
            .into();
        assert_eq!(share_within_budget(&frames, 20.0), 0.5);
        assert_eq!(share_within_budget(&[], 20.0), 0.0);
        assert_eq!(frame_at(&frames, 4.9).map(|f| f.index), Some(5));
        assert!(tooltip_text(&frames[1]).starts_with("Frame 2 (r_3): 20.0 ms\n"));
    }
}
