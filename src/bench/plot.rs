//! PNG plots of benches: panels side by side; linear, logarithmic or named axes; error bars.

use super::findings::BenchError;
use crate::eval::metrics::Spread;
use crate::math::image::RgbImage;
use plotters::coord::Shift;
use plotters::coord::ranged1d::{AsRangedCoord, ValueFormatter};
use plotters::prelude::*;
use plotters::style::register_font;
use std::ops::Range;

/// Size of every plot, pixels.
const SIZE: [u32; 2] = [1200, 800];
/// Colours that colour-blind readers can distinguish (Okabe and Ito).
const COLORS: [RGBColor; 8] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(86, 180, 233),
    RGBColor(230, 159, 0),
    RGBColor(0, 0, 0),
    RGBColor(140, 110, 60),
];
const FONT: &str = "plot";
const GRID: RGBColor = RGBColor(225, 225, 225);
/// Width of a character of axis names, pixels.
const CHARACTER: usize = 9;
/// Fraction of the y axis covered by a line of the legend.
const LEGEND_LINE: f64 = 0.045;
/// Fraction of the range that is left free at both ends of an axis.
const MARGIN: f64 = 0.06;

/// Kind of an axis, with its title or the names along it. Titles include the unit.
#[derive(Clone, Debug)]
pub enum Axis {
    Linear(&'static str),
    /// Logarithmic axis. Values at or below zero are drawn at its lower end.
    Log(&'static str),
    /// Axis of names from top to bottom, for y only. A value on this axis is the index of a name.
    Names(Vec<String>),
}

#[derive(Clone, Debug)]
pub struct Mark {
    pub x: Spread,
    pub y: Spread,
    /// Text beside the mark.
    pub label: Option<String>,
}

impl Mark {
    pub fn new(x: Spread, y: Spread) -> Self {
        Self { x, y, label: None }
    }

    pub fn exact(x: f64, y: f64) -> Self {
        Self::new(Spread::exact(x), Spread::exact(y))
    }
}

/// Marks of one colour with one legend entry.
#[derive(Clone, Debug)]
pub struct Series {
    pub name: String,
    pub marks: Vec<Mark>,
    /// True if a line joins the marks in their order.
    pub connected: bool,
}

#[derive(Clone, Debug)]
pub struct Panel {
    pub title: String,
    pub x: Axis,
    pub y: Axis,
    pub series: Vec<Series>,
}

// Errors of plotters contain the type of the drawing area. Only their text is needed here.
type Drawn<T> = Result<T, Box<dyn std::error::Error>>;
type Area<'a> = DrawingArea<BitMapBackend<'a>, Shift>;

/// Draws panels side by side under a title and returns the image.
pub fn draw(title: &str, panels: &[Panel]) -> Result<RgbImage, BenchError> {
    let [width, height] = SIZE;
    let mut bytes = vec![255; 3 * width as usize * height as usize];
    draw_into(&mut bytes, title, panels)
        .map_err(|e| BenchError::Plot { title: title.to_owned(), reason: e.to_string() })?;
    let pixels = bytes.chunks_exact(3).map(|p| [p[0], p[1], p[2]].map(|v| f32::from(v) / 255.0));
    Ok(RgbImage::from_vec(width as usize, height as usize, pixels.collect()))
}

fn draw_into(bytes: &mut [u8], title: &str, panels: &[Panel]) -> Drawn<()> {
    // The font is bundled, because a bare machine has none.
    register_font(FONT, FontStyle::Normal, epaint_default_fonts::HACK_REGULAR)
        .map_err(|_| "the built-in font is damaged")?;
    let root = BitMapBackend::with_buffer(bytes, SIZE.into()).into_drawing_area();
    root.fill(&WHITE)?;
    let area = root.titled(title, (FONT, 24).into_font())?;
    // A panel with a named axis needs room for the names; all panels share the rest.
    let labels: Vec<u32> = panels.iter().map(Panel::label_width).collect();
    // Saturating: names wider than the plot must not panic.
    let rest = SIZE[0].saturating_sub(labels.iter().sum::<u32>()) / panels.len().max(1) as u32;
    let mut ends: Vec<u32> = Vec::new();
    for label in &labels[..panels.len().saturating_sub(1)] {
        ends.push(ends.last().unwrap_or(&0) + label + rest);
    }
    for (panel, area) in panels.iter().zip(area.split_by_breakpoints(&ends, [0; 0])) {
        panel.draw(&area)?;
    }
    root.present()?;
    Ok(())
}

impl Axis {
    fn title(&self) -> &str {
        match self {
            Self::Linear(title) | Self::Log(title) => title,
            Self::Names(_) => "",
        }
    }

    /// Returns the range of the axis that includes all values. `headroom` is the fraction of the axis
    /// left free at its far end.
    fn range(&self, values: impl Iterator<Item = Spread>, headroom: f64) -> Range<f64> {
        let ends = values.flat_map(|v| [v.median, v.quartiles[0], v.quartiles[1]]);
        let is_log = matches!(self, Self::Log(_));
        let ends = ends.filter(|v| v.is_finite() && (!is_log || *v > 0.0));
        let [lo, hi] =
            ends.fold([f64::INFINITY, f64::NEG_INFINITY], |[lo, hi], v| [v.min(lo), v.max(hi)]);
        // Without finite values, any valid range; above zero for logarithms.
        let [lo, hi] = if lo <= hi { [lo, hi] } else { [1.0, 2.0] };
        let farther = |[lo, hi]: [f64; 2]| lo..hi + (hi - lo) * headroom / (1.0 - headroom);
        match self {
            Self::Names(names) => farther([-0.5, names.len() as f64 - 0.5]),
            Self::Linear(_) => {
                // A single value still needs an axis of non-zero length.
                let margin = MARGIN * (hi - lo).max(1e-3 * hi.abs()).max(1e-12);
                farther([lo - margin, hi + margin])
            }
            Self::Log(_) => {
                // Whole decades, because plotters labels nothing between two of them.
                let [lo, hi] = [lo.log10().floor(), (1.01 * hi).log10().ceil()];
                let decades = farther([lo, hi]);
                10f64.powf(decades.start)..10f64.powf(decades.end)
            }
        }
    }

    /// Returns the position of a value on the axis; numbers are clamped to the range. The first name is
    /// at the top.
    fn position(&self, value: f64, range: &Range<f64>) -> f64 {
        match self {
            // Positions count from the bottom, names from the top.
            Self::Names(names) => names.len() as f64 - 1.0 - value,
            Self::Linear(_) | Self::Log(_) => value.clamp(range.start, range.end),
        }
    }

    fn label(&self, position: f64) -> String {
        match self {
            // A tick may lie between two names.
            Self::Names(names) if (position - position.round()).abs() < 1e-6 => {
                names.iter().rev().nth(position.round() as usize).cloned().unwrap_or_default()
            }
            Self::Names(_) => String::new(),
            Self::Linear(_) | Self::Log(_) => number(position),
        }
    }
}

/// Formats the label of a tick in as few characters as possible.
fn number(value: f64) -> String {
    let size = value.abs();
    if size != 0.0 && !(1e-3..1e5).contains(&size) {
        return format!("{value:.0e}");
    }
    let text = format!("{value:.4}");
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}

impl Panel {
    /// Returns the width of the y axis labels in pixels.
    fn label_width(&self) -> u32 {
        match &self.y {
            Axis::Names(names) => {
                let longest = names.iter().map(|name| name.chars().count()).max();
                (CHARACTER * longest.unwrap_or(0)) as u32 + 24
            }
            Axis::Linear(_) | Axis::Log(_) => 64,
        }
    }

    fn draw(&self, area: &Area) -> Drawn<()> {
        let marks = || self.series.iter().flat_map(|s| &s.marks);
        // Headroom, so that the legend does not cover marks.
        // A single series has no legend.
        let n_lines = if self.series.len() > 1 { self.series.len() } else { 0 };
        let x = self.x.range(marks().map(|m| m.x), 0.0);
        let y = self.y.range(marks().map(|m| m.y), LEGEND_LINE * n_lines as f64);
        let ranges = (x.clone(), y.clone());
        // In plotters each pair of axes is a type of its own.
        match (&self.x, &self.y) {
            (Axis::Log(_), Axis::Log(_)) => {
                self.draw_on(area, x.log_scale(), y.log_scale(), &ranges)
            }
            (Axis::Log(_), _) => self.draw_on(area, x.log_scale(), y, &ranges),
            (_, Axis::Log(_)) => self.draw_on(area, x, y.log_scale(), &ranges),
            _ => self.draw_on(area, x, y, &ranges),
        }
    }

    fn draw_on<X: AsRangedCoord<Value = f64>, Y: AsRangedCoord<Value = f64>>(
        &self,
        area: &Area,
        x: X,
        y: Y,
        ranges: &(Range<f64>, Range<f64>),
    ) -> Drawn<()>
    where
        X::CoordDescType: ValueFormatter<f64>,
        Y::CoordDescType: ValueFormatter<f64>,
    {
        let mut chart = ChartBuilder::on(area)
            .caption(&self.title, (FONT, 19))
            .margin(14)
            .x_label_area_size(56)
            .y_label_area_size(self.label_width())
            .build_cartesian_2d(x, y)?;
        let n_labels = if let Axis::Names(names) = &self.y { names.len() + 4 } else { 10 };
        chart
            .configure_mesh()
            .x_desc(self.x.title())
            .y_desc(self.y.title())
            .y_labels(n_labels)
            .x_label_formatter(&|v| self.x.label(*v))
            .y_label_formatter(&|v| self.y.label(*v))
            .label_style((FONT, 15))
            .axis_desc_style((FONT, 16))
            .bold_line_style(GRID)
            .light_line_style(TRANSPARENT)
            .draw()?;
        let at = |x: f64, y: f64| (self.x.position(x, &ranges.0), self.y.position(y, &ranges.1));
        let middle = |mark: &Mark| at(mark.x.median, mark.y.median);
        for (series, color) in self.series.iter().zip(COLORS.into_iter().cycle()) {
            let marks = || {
                // Benches mark a missing value by NaN.
                let is_there = |m: &&Mark| m.x.median.is_finite() && m.y.median.is_finite();
                series.marks.iter().filter(is_there)
            };
            if series.connected {
                let line = marks().map(middle);
                chart.draw_series(LineSeries::new(line, color.stroke_width(2)))?;
            }
            // Bars along both axes. A value that was not repeated has a bar without length.
            let bars = marks().flat_map(|m| {
                let ([x0, x1], [y0, y1]) = (m.x.quartiles, m.y.quartiles);
                let (x, y) = (m.x.median, m.y.median);
                [vec![at(x0, y), at(x1, y)], vec![at(x, y0), at(x, y1)]]
            });
            chart.draw_series(bars.map(|ends| PathElement::new(ends, color.stroke_width(2))))?;
            let dots = marks().map(|m| {
                let label = m.label.clone().unwrap_or_default();
                let style = (FONT, 15).into_font().color(&color);
                EmptyElement::at(middle(m))
                    + Circle::new((0, 0), 5, color.filled())
                    // Above and to the right, clear of the dot.
                    + Text::new(label, (9, -16), style)
            });
            chart
                .draw_series(dots)?
                .label(series.name.as_str())
                .legend(move |(x, y)| Circle::new((x + 8, y), 5, color.filled()));
        }
        if self.series.len() > 1 {
            chart
                .configure_series_labels()
                .label_font((FONT, 15))
                .background_style(WHITE.mix(0.85))
                .border_style(GRID)
                .position(SeriesLabelPosition::UpperLeft)
                .draw()?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_hold_all_values_and_labels_are_short() {
        let of =
            |axis: &Axis, values: &[f64]| axis.range(values.iter().map(|&v| Spread::exact(v)), 0.0);
        let log = Axis::Log("ms");
        assert_eq!(of(&log, &[3.0, 60.0, 0.0, f64::NAN]), 1.0..100.0);
        assert_eq!(log.position(0.0, &(1.0..100.0)), 1.0);
        let linear = of(&Axis::Linear("dB"), &[19.8, 21.9]);
        assert!(linear.start < 19.8 && linear.end > 21.9 && linear.end < 22.1);
        assert!(!of(&Axis::Linear("dB"), &[5.0]).is_empty());
        let names = Axis::Names(vec!["top".into(), "bottom".into()]);
        let range = of(&names, &[]);
        assert_eq!([0.0, 1.0].map(|i| names.label(names.position(i, &range))), ["top", "bottom"]);
        assert_eq!([0.5, 20.0, 1e-7].map(number), ["0.5", "20", "1e-7"]);
    }
}
