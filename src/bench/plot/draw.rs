//! PNG plots of benches: panels side by side; linear, logarithmic or named axes; error bars.
//!
//! The font is bundled, because a bare machine has none. Panels share no axes, because a bench
//! plots two different quantities. A panel with a named axis gets the width of its longest name;
//! the others share the rest.

use crate::bench::plot;
use crate::bench::plot::{Axis, Ticked};
use crate::eval::metrics::Spread;
use crate::math::image::RgbImage;
use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::register_font;

/// Size of every plot, pixels.
pub const SIZE: [u32; 2] = [1200, 800];

/// Palette for colour-blind readers (Okabe and Ito).
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
/// Height reserved for labels and title of an axis, pixels.
const LABEL_HEIGHT: u32 = 56;
/// Height of a legend line, pixels.
const LEGEND_LINE: f64 = 22.0;
/// Approximate height of the plotting area, pixels.
const AXES_HEIGHT: f64 = 640.0;

#[derive(Debug, thiserror::Error)]
#[error("drawing the plot `{title}` failed: {reason}")]
pub struct PlotError {
    title: String,
    reason: String,
}

/// One point of a series.
#[derive(Clone, Debug)]
pub struct Mark {
    pub x: Spread,
    pub y: Spread,
    /// Text beside the mark.
    pub label: Option<String>,
}

/// Marks of one colour with one legend entry.
#[derive(Clone, Debug)]
pub struct Series {
    pub name: String,
    /// In the order of the connecting line.
    pub marks: Vec<Mark>,
    /// Draws a line through the marks.
    pub connected: bool,
}

/// One pair of axes with its series.
#[derive(Clone, Debug)]
pub struct Panel {
    pub title: String,
    pub x: Axis,
    pub y: Axis,
    pub series: Vec<Series>,
}

type Chart<'a, 'b> = ChartContext<'a, BitMapBackend<'b>, Cartesian2d<Ticked, Ticked>>;
// Errors of plotters contain the type of the drawing area. Only their text is needed here.
type Drawn<T> = Result<T, Box<dyn std::error::Error>>;

/// Draws panels side by side under a title.
pub fn draw(title: &str, panels: &[Panel]) -> Result<RgbImage, PlotError> {
    let [width, height] = SIZE;
    let mut bytes = vec![255; 3 * width as usize * height as usize];
    draw_into(&mut bytes, title, panels)
        .map_err(|e| PlotError { title: title.to_owned(), reason: e.to_string() })?;
    let pixels = bytes.chunks_exact(3).map(|p| [p[0], p[1], p[2]].map(|v| f32::from(v) / 255.0));
    Ok(RgbImage::from_vec(width as usize, height as usize, pixels.collect()))
}

fn draw_into(bytes: &mut [u8], title: &str, panels: &[Panel]) -> Drawn<()> {
    register_font(FONT, FontStyle::Normal, epaint_default_fonts::HACK_REGULAR)
        .map_err(|_| "the built-in font is damaged")?;
    let root = BitMapBackend::with_buffer(bytes, SIZE.into()).into_drawing_area();
    root.fill(&WHITE)?;
    let area = root.titled(title, (FONT, 24).into_font())?;
    // A panel with a named axis needs room for the names.
    let wide: Vec<u32> = panels.iter().map(Panel::label_width).collect();
    let plain = (SIZE[0] - wide.iter().sum::<u32>()) / panels.len().max(1) as u32;
    let mut rest = area;
    for (i, panel) in panels.iter().enumerate() {
        let (left, right) = if i + 1 < panels.len() {
            let (left, right) = rest.split_horizontally(plain + wide[i]);
            (left, Some(right))
        } else {
            (rest.clone(), None)
        };
        panel.draw(&left)?;
        match right {
            Some(right) => rest = right,
            None => break,
        }
    }
    root.present()?;
    Ok(())
}

impl Panel {
    /// Width of the y axis labels, pixels.
    fn label_width(&self) -> u32 {
        let longest = self.y.names().iter().map(|n| n.chars().count()).max();
        longest.map_or(64, |n| (CHARACTER * n) as u32 + 24)
    }

    fn draw(&self, area: &DrawingArea<BitMapBackend, Shift>) -> Drawn<()> {
        let marks = || self.series.iter().flat_map(|s| &s.marks);
        // Reserve headroom so that the legend does not cover marks.
        let n_lines = if self.series.len() > 1 { self.series.len() } else { 0 };
        let legend = (n_lines as f64 * LEGEND_LINE + 8.0) / AXES_HEIGHT;
        let x = Ticked::new(&self.x, marks().map(|m| m.x), 0.0);
        let y = Ticked::new(&self.y, marks().map(|m| m.y), legend);
        let mut chart = ChartBuilder::on(area)
            .caption(&self.title, (FONT, 19))
            .margin(14)
            .x_label_area_size(LABEL_HEIGHT)
            .y_label_area_size(self.label_width())
            .build_cartesian_2d(x, y)?;
        chart
            .configure_mesh()
            .x_desc(self.x.title())
            .y_desc(self.y.title())
            .label_style((FONT, 15))
            .axis_desc_style((FONT, 16))
            .bold_line_style(GRID)
            .light_line_style(TRANSPARENT)
            .draw()?;
        for (series, color) in self.colored() {
            series.draw(&mut chart, color)?;
        }
        self.draw_labels(&mut chart)?;
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

    fn colored(&self) -> impl Iterator<Item = (&Series, RGBColor)> {
        self.series.iter().zip(COLORS.into_iter().cycle())
    }

    fn draw_labels(&self, chart: &mut Chart) -> Drawn<()> {
        let of_series = |(series, color)| {
            let series: &Series = series;
            series.marks.iter().filter_map(move |m| Some((m, m.label.as_deref()?, color)))
        };
        let labelled: Vec<(&Mark, &str, RGBColor)> = self.colored().flat_map(of_series).collect();
        let area = chart.plotting_area();
        let (columns, rows) = area.get_pixel_range();
        let pixels: Vec<([i32; 2], &str)> = labelled
            .iter()
            .map(|(m, label, _)| (area.map_coordinate(&(m.x.median, m.y.median)).into(), *label))
            .collect();
        let bounds = [[columns.start, rows.start], [columns.end, rows.end]];
        for ((_, label, color), corner) in labelled.iter().zip(plot::place(&pixels, bounds)) {
            // Draw in pixels, because the corner of a text is not in axis units.
            let shift = (corner[0] - columns.start, corner[1] - rows.start);
            let style = (FONT, 15).into_font().color(color);
            area.strip_coord_spec().draw(&Text::new((*label).to_owned(), shift, style))?;
        }
        Ok(())
    }
}

impl Series {
    fn draw(&self, chart: &mut Chart, color: RGBColor) -> Drawn<()> {
        let at = |m: &Mark| (m.x.median, m.y.median);
        if self.connected {
            chart.draw_series(LineSeries::new(self.marks.iter().map(at), color.stroke_width(2)))?;
        }
        let bars = self.marks.iter().flat_map(|m| {
            let ((x, y), [x0, x1], [y0, y1]) = (at(m), m.x.quartiles, m.y.quartiles);
            [vec![(x0, y), (x1, y)], vec![(x, y0), (x, y1)]]
        });
        chart.draw_series(bars.map(|ends| PathElement::new(ends, color.stroke_width(2))))?;
        let dots = self.marks.iter().map(|m| Circle::new(at(m), 5, color.filled()));
        chart
            .draw_series(dots)?
            .label(self.name.as_str())
            .legend(move |(x, y)| Circle::new((x + 8, y), 5, color.filled()));
        Ok(())
    }
}
