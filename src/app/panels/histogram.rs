//! Histogram of the components' evidence.

use super::plot_axes::with_axes;
use crate::app::evidence_histogram::{EvidenceHistogram, PER_DECADE};
use eframe::egui::{Color32, Label, RichText, Ui};
use egui_plot::{Bar, BarChart, Plot};

const BAR: Color32 = Color32::from_rgb(86, 180, 233);

/// Draws the histogram while training is paused or finished; counting would slow training down.
pub fn ui(histogram: Option<&EvidenceHistogram>, is_at_rest: bool, ui: &mut Ui) {
    ui.add_space(6.0);
    ui.label(RichText::new("Evidence of the components").strong());
    let (true, Some(EvidenceHistogram { first, counts })) = (is_at_rest, histogram) else {
        ui.label(RichText::new("Shown while training is paused or finished.").weak());
        return;
    };
    let bars = (*first..).zip(counts).map(|(bar, &count)| {
        let middle = (f64::from(bar) + 0.5) / PER_DECADE;
        Bar::new(middle, count as f64).width(1.0 / PER_DECADE)
    });
    let chart = BarChart::new("Components", bars.collect()).color(BAR);
    let axes = ["log10 of the points per component", "components"];
    with_axes(Plot::new("evidence"), axes)
        .height(150.0)
        .allow_drag(false)
        .allow_zoom(false)
        .allow_scroll(false)
        .allow_boxed_zoom(false)
        .show(ui, |plot| plot.bar_chart(chart));
    let n: usize = counts.iter().sum();
    let text = format!("{n} components. The Edit tab can select those with low evidence.");
    ui.add(Label::new(RichText::new(text).weak()).wrap());
}
