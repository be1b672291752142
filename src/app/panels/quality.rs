//! Quality panel: error of held-out views over frames or seconds, and per view.

use super::controls::{optional_number, section, weak};
use super::plot_axes::plot;
use super::signal_color::{SignalColor, format_number, to_color32};
use crate::app::quality::QualityMonitor;
use crate::app::state::{Opened, Snapshot};
use crate::app::viewer::frame_refs::FrameRef;
use crate::app::viewer::thumbnails::Thumbnails;
use crate::app::wording;
use crate::eval::report::{Detail, QualityPoint, RetainedFrame, ViewReport};
use crate::model::attributes::ComponentAttributes;
use crate::render::finish::ramp;
use eframe::egui::{Button, Color32, Frame, Grid, Image, Margin, RichText, ScrollArea, Ui, Vec2};
use egui_plot::{Bar, BarChart, Corner, Legend, Line, PlotPoints, PlotUi, Points};

#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct QualityPlot {
    metric: Metric,
    against_seconds: bool,
}

#[derive(Clone, Copy, Debug, Default, PartialEq)]
enum Metric {
    #[default]
    Psnr,
    Ssim,
    DepthError,
    Components,
}

impl Metric {
    const ALL: [Self; 4] = [Self::Psnr, Self::Ssim, Self::DepthError, Self::Components];

    fn label_and_axis(self) -> [&'static str; 2] {
        match self {
            Self::Psnr => ["PSNR", "PSNR, dB"],
            Self::Ssim => ["SSIM", "SSIM"],
            Self::DepthError => ["Depth error", "depth error, world units"],
            Self::Components => ["Splats", "splats"],
        }
    }

    fn value_of(self, point: &QualityPoint) -> Option<f64> {
        match self {
            Self::Psnr => Some(point.psnr),
            Self::Ssim => Some(point.ssim),
            Self::DepthError => point.depth_error,
            Self::Components => Some(point.components as f64),
        }
    }
}

const EVERY: std::ops::RangeInclusive<usize> = 1..=1000;
pub const DEFAULT_INTERVAL: usize = 10;
const ROW: f32 = 28.0;
const NAME: f32 = 96.0;
const DETAIL_HELP: &str = "Correlation of fine structure, one and two pixels wide, between the drawn picture and the photograph: 1 if all of it is in the right place";

/// Draws the panel. Returns the view to which the camera moves, if one is clicked.
pub fn ui(
    quality: &QualityMonitor,
    snapshot: &Snapshot,
    thumbnails: Option<&mut Thumbnails>,
    plot: &mut QualityPlot,
    every: &mut Option<usize>,
    evidence: Option<&EvidenceHistogram>,
    ui: &mut Ui,
) -> Option<FrameRef> {
    let (Some(opened), Some(evaluation)) = (&snapshot.opened, &quality.evaluation) else {
        ui.label("Quality is measured on held-out photographs; no dataset is open.");
        return None;
    };
    let mut asked = None;
    // Room for axis names on the left, and for scroll bar and last axis label on the right.
    let inner = Frame::new().inner_margin(Margin { left: 4, right: 12, top: 0, bottom: 0 });
    // Scrolls both ways: longer names must not widen the panel, which would resize the viewport.
    ScrollArea::both().auto_shrink(false).show(ui, |ui| {
        inner.show(ui, |ui| {
            summary(quality, snapshot, ui);
            groups(quality, snapshot.frames_done, ui);
            weak(ui, &format!("Measured on {}", evaluation.why.replace('`', "")));
            if let Some(problem) = &quality.problem {
                ui.label(SignalColor::Yellow.text(problem, ui));
            }
            if !quality.history.is_empty() {
                curve(&quality.history, plot, ui);
            }
            retention(&quality.retention.frames, ui);
            histogram(evidence, snapshot.state.is_at_rest(), ui);
            let help = "Measures a few views on one thread that is idle 15/16 of the time; all views are measured when training pauses";
            let texts = ["While training, every", help, "Measure every", " frames"];
            optional_number(every, DEFAULT_INTERVAL, EVERY, texts, ui);
            if !quality.views.is_empty() {
                section("Views, worst first", ui);
                let split = evaluation.new_views.split;
                asked = table(&quality.views, opened, split, thumbnails, ui);
            }
        })
    });
    asked
}

fn summary(quality: &QualityMonitor, snapshot: &Snapshot, ui: &mut Ui) {
    let (done, all) = quality.progress();
    let after = |point: &QualityPoint| format!("after {}", wording::count(point.frames, "frame"));
    let (point, what) = match (quality.result(), quality.history.last()) {
        (Some(point), _) => (point, format!("Mean of {all} views {}", after(&point))),
        (None, Some(&point)) => {
            let after = after(&point);
            (point, format!("Sampled {after}; {done} of {all} views measured"))
        }
        (None, None) => {
            let text = match snapshot.frames_done {
                0 => "Appears after the first trained frames.",
                _ => "Measuring…",
            };
            ui.label(text);
            return;
        }
    };
    ui.label(RichText::new(format!("PSNR {:.2} dB", point.psnr)).size(24.0).strong());
    let mut line = format!("SSIM {:.3}{}", point.ssim, detail(" · ", point.detail));
    if let Some(error) = point.depth_error {
        line += &format!(" · depth error {}", format_number(error));
    }
    ui.label(line).on_hover_text(DETAIL_HELP);
    if let Some((psnr, share)) = point.covered {
        ui.label(format!("{psnr:.2} dB over the covered {:.0} % of the pixels", 100.0 * share));
    }
    ui.label(RichText::new(what).weak());
}

/// Returns detail as text after a separator; empty for views without any.
pub(super) fn detail(separator: &str, detail: Option<Detail>) -> String {
    detail.map_or_else(String::new, |detail| format!("{separator}detail {detail}"))
}

/// Draws one line of text each for the held-out views and for the views away from the camera path. Draws
/// nothing if the dataset has no views away from the path.
fn groups(quality: &QualityMonitor, frames: usize, ui: &mut Ui) {
    let side = quality.side_progress(frames);
    if side.1 == 0 || frames == 0 {
        return;
    }
    let new = (quality.progress(), quality.result());
    let side = (side, quality.side_result());
    for (name, ((done, all), result)) in [("New views", new), ("From the side", side)] {
        ui.label(match result {
            Some(point) => {
                let QualityPoint { psnr, ssim, .. } = point;
                let detail = detail(", ", point.detail);
                format!("{name}: {psnr:.2} dB, SSIM {ssim:.3}{detail} (views: {all})")
            }
            None => format!(
                "{name}: {done} of {all} views measured; the others follow when training pauses"
            ),
        });
    }
}

fn curve(history: &[QualityPoint], chosen: &mut QualityPlot, ui: &mut Ui) {
    ui.add_space(6.0);
    ui.horizontal_wrapped(|ui| {
        for metric in Metric::ALL {
            let is_known = history.iter().any(|point| metric.value_of(point).is_some());
            let button = Button::selectable(chosen.metric == metric, metric.label_and_axis()[0]);
            if ui.add_enabled(is_known, button).clicked() {
                chosen.metric = metric;
            }
        }
    });
    ui.horizontal(|ui| {
        ui.selectable_value(&mut chosen.against_seconds, false, "Frames");
        ui.selectable_value(&mut chosen.against_seconds, true, "Seconds");
    });
    let color = SignalColor::Blue.for_theme(ui.visuals().dark_mode);
    let QualityPlot { metric, against_seconds } = *chosen;
    let x = |point: &QualityPoint| match against_seconds {
        true => point.seconds,
        false => point.frames as f64,
    };
    let points: Vec<[f64; 2]> =
        history.iter().filter_map(|point| Some([x(point), metric.value_of(point)?])).collect();
    let unit = if against_seconds { "seconds of training" } else { "frames" };
    let [label, axis] = metric.label_and_axis();
    // Own bounds for each pair of axes, because egui stores them by id.
    let id = ("quality", label, against_seconds);
    plot(id, [unit, axis], 180.0).show(ui, |plot| {
        add_curve(plot, label, points, color);
    });
}

fn table(
    views: &[ViewReport],
    opened: &Opened,
    split: usize,
    mut thumbnails: Option<&mut Thumbnails>,
    ui: &mut Ui,
) -> Option<FrameRef> {
    let mut asked = None;
    let table = Grid::new("views").num_columns(6).min_col_width(0.0);
    table.spacing([8.0, 3.0]).striped(true).show(ui, |ui| {
        for title in ["", "view", "PSNR", "SSIM", "detail", "depth"] {
            let label = ui.label(RichText::new(title).weak());
            if title == "detail" {
                label.on_hover_text(DETAIL_HELP);
            }
        }
        ui.end_row();
        for view in views {
            let frame = opened.dataset.as_ref().and_then(|d| FrameRef::at(d, split, view.index));
            let known = match (&mut thumbnails, &frame) {
                (Some(thumbnails), Some(frame)) => thumbnails.get(ui.ctx(), frame, true),
                _ => None,
            };
            match known {
                Some(texture) => {
                    let size = texture.size_vec2();
                    ui.add(Image::new(texture).fit_to_exact_size(size * (ROW / size.y)));
                }
                None => drop(ui.allocate_space(Vec2::new(1.3 * ROW, ROW))),
            }
            let hint = format!("{}: move to this view and compare with its photograph", view.frame);
            let name = ui.allocate_ui(Vec2::new(NAME, ROW), |ui| {
                ui.set_min_width(NAME);
                ui.add(Button::selectable(false, &view.frame).truncate())
            });
            if name.inner.on_hover_text(hint).clicked() {
                asked = frame;
            }
            ui.label(RichText::new(format!("{:.2}", view.psnr)).monospace());
            ui.label(RichText::new(format!("{:.3}", view.ssim)).monospace());
            let detail = view.detail.map_or_else(String::new, |detail| detail.to_string());
            ui.label(RichText::new(detail).monospace());
            let depth = view.depth_mae.map_or_else(String::new, format_number);
            ui.label(RichText::new(depth).monospace());
            ui.end_row();
        }
    });
    asked
}

const BAR: Color32 = Color32::from_rgb(86, 180, 233);

/// Draws the evidence histogram while training is paused or finished.
fn histogram(histogram: Option<&EvidenceHistogram>, is_at_rest: bool, ui: &mut Ui) {
    section("Evidence of the splats", ui);
    // Counting would slow training down.
    let (true, Some(EvidenceHistogram { first, counts })) = (is_at_rest, histogram) else {
        ui.label(RichText::new("Shown while training is paused or finished.").weak());
        return;
    };
    let bars = (*first..).zip(counts).map(|(bar, &count)| {
        let middle = (f64::from(bar) + 0.5) / PER_DECADE;
        Bar::new(middle, count as f64).width(1.0 / PER_DECADE)
    });
    let chart = BarChart::new("Components", bars.collect()).color(BAR);
    let axes = ["log10 of the points per splat", "splats"];
    plot("evidence", axes, 150.0).show(ui, |plot| plot.bar_chart(chart));
    let n: usize = counts.iter().sum();
    weak(
        ui,
        &format!(
            "{}. The Edit tab can select those with low evidence.",
            wording::count(n, "splat")
        ),
    );
}

/// Number of histogram bars per power of ten of the evidence.
const PER_DECADE: f64 = 4.0;

/// Histogram of components by the logarithm of their evidence.
#[derive(Clone, Debug, PartialEq)]
pub struct EvidenceHistogram {
    /// Index of the first bar. Bar `i` begins at an evidence of `10^(i / PER_DECADE)` points.
    pub first: i32,
    pub counts: Vec<usize>,
}

impl EvidenceHistogram {
    /// Counts the components with known, positive evidence in each bar. `None` if there are none.
    pub fn count(known: &[ComponentAttributes]) -> Option<Self> {
        let evidence = known.iter().filter_map(|known| known.evidence).filter(|n| *n > 0.0);
        let bar = |n: f32| (PER_DECADE * f64::from(n).log10()).floor() as i32;
        let bars: Vec<i32> = evidence.map(bar).collect();
        let (first, last) = (*bars.iter().min()?, *bars.iter().max()?);
        // Evidence is an `f32`, so there are a few hundred bars at most.
        let mut counts = vec![0; (last - first) as usize + 1];
        for bar in bars {
            counts[(bar - first) as usize] += 1;
        }
        Some(Self { first, counts })
    }
}

fn retention(frames: &[RetainedFrame], ui: &mut Ui) {
    if frames.is_empty() {
        return;
    }
    ui.add_space(6.0);
    ui.label(RichText::new("Retention").strong())
        .on_hover_text("PSNR of earlier frames, measured again during training: a falling curve means that the frame is forgotten");
    let axes = ["frames trained", "PSNR, dB"];
    // Curves end high, at the newest figures.
    let legend = Legend::default().position(Corner::RightBottom);
    plot("retention", axes, 180.0).legend(legend).show(ui, |plot| {
        for (i, frame) in frames.iter().enumerate() {
            let color = to_color32(ramp(0.15 + 0.8 * i as f32 / frames.len() as f32));
            // Of one width, because the legend is sorted by text.
            let name = format!("frame {:>4}", frame.position + 1);
            add_curve(plot, &name, frame.psnr.clone(), color);
        }
    });
}

fn add_curve(plot: &mut PlotUi<'_>, name: &str, points: Vec<[f64; 2]>, color: Color32) {
    // Points too: a single measurement has no line.
    plot.line(Line::new(name, PlotPoints::from(points.clone())).color(color));
    plot.points(Points::new(name, PlotPoints::from(points)).radius(2.5).color(color));
}

#[cfg(test)]
mod evidence_histogram_tests {
    use super::*;

    #[test]
    fn every_component_with_points_is_counted_once() {
        let known = |n: f32| ComponentAttributes { evidence: Some(n), ..Default::default() };
        let all = [known(1.0), known(1.5), known(10.0), known(11.0), known(0.5), known(0.0)];
        let histogram = EvidenceHistogram::count(&all).unwrap();
        assert_eq!((histogram.first, histogram.counts), (-2, vec![1, 0, 2, 0, 0, 0, 2]));
        assert_eq!(EvidenceHistogram::count(&[known(0.0), Default::default()]), None);
    }
}
