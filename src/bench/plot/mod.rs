//! Label placement and axes of bench plots.

pub mod draw;

use crate::eval::metrics::Spread;
use plotters::coord::ranged1d::{KeyPointHint, NoDefaultFormatting, Ranged, ValueFormatter};
use std::ops::Range;

/// Width of a character and height of a line, pixels.
const CHARACTER: [i32; 2] = [8, 15];
/// Half the width of a mark, pixels.
const MARK: i32 = 6;
/// Number of vertical offsets tried in each direction.
const STEPS: i32 = 14;

#[derive(Clone, Copy)]
struct Rect {
    lo: [i32; 2],
    hi: [i32; 2],
}

impl Rect {
    fn meets(&self, other: &Self) -> bool {
        (0..2).all(|i| self.lo[i] < other.hi[i] && other.lo[i] < self.hi[i])
    }

    fn is_within(&self, lo: [i32; 2], hi: [i32; 2]) -> bool {
        (0..2).all(|i| self.lo[i] >= lo[i] && self.hi[i] <= hi[i])
    }
}

/// Places a text beside each mark and returns the texts' upper left corners, in order. All
/// positions are in pixels. `area` holds the two corners that texts must stay between.
pub fn place(marks: &[([i32; 2], &str)], area: [[i32; 2]; 2]) -> Vec<[i32; 2]> {
    let around = |[x, y]: [i32; 2]| Rect { lo: [x - MARK, y - MARK], hi: [x + MARK, y + MARK] };
    // Reserve all marks before placing texts, so that no text covers a later mark.
    let mut taken: Vec<Rect> = marks.iter().map(|(at, _)| around(*at)).collect();
    let mut corners = Vec::with_capacity(marks.len());
    for (at, text) in marks {
        let width = CHARACTER[0] * text.chars().count() as i32;
        let choices: Vec<Rect> = candidates(*at, width).collect();
        let free =
            |r: &&Rect| r.is_within(area[0], area[1]) && !taken.iter().any(|other| other.meets(r));
        // If no place is free, use the first one inside the area.
        let chosen = choices
            .iter()
            .find(free)
            .or_else(|| choices.iter().find(|r| r.is_within(area[0], area[1])))
            .unwrap_or(&choices[0]);
        taken.push(*chosen);
        corners.push(chosen.lo);
    }
    corners
}

/// Candidate places: beside the mark, then further up and down.
fn candidates([x, y]: [i32; 2], width: i32) -> impl Iterator<Item = Rect> {
    let [_, height] = CHARACTER;
    let shifts = (0..STEPS).flat_map(move |i| [-i * height, (i + 1) * height]);
    shifts.flat_map(move |shift| {
        let top = y + shift - height - 1;
        [x + MARK + 3, x - MARK - 3 - width]
            .map(|left| Rect { lo: [left, top], hi: [left + width, top + height] })
    })
}

/// Share of the span left free at both ends.
const MARGIN: f64 = 0.06;
/// Maximum number of ticks of a linear axis.
const MAX_TICKS: f64 = 9.0;

/// Kind of an axis with its title or names. Titles include the unit.
#[derive(Clone, Debug)]
pub enum Axis {
    Linear(String),
    /// Values at or below zero are drawn at the lower end.
    Log(String),
    /// Names from top to bottom. A value is the index of a name.
    Names(Vec<String>),
}

impl Axis {
    /// Title with the unit. Empty for an axis of names.
    pub fn title(&self) -> &str {
        match self {
            Self::Linear(title) | Self::Log(title) => title,
            Self::Names(_) => "",
        }
    }

    /// Names from top to bottom. Empty for other axes.
    pub fn names(&self) -> &[String] {
        match self {
            Self::Names(names) => names,
            _ => &[],
        }
    }
}

/// An axis with its range and ticks.
#[derive(Clone, Debug)]
pub struct Ticked {
    axis: Axis,
    /// In axis units: log10 of the value on a logarithmic axis.
    span: [f64; 2],
    ticks: Vec<f64>,
}

impl Ticked {
    /// Covers the values. `headroom` is the share of the axis left free at its far end.
    pub fn new(axis: &Axis, values: impl Iterator<Item = Spread>, headroom: f64) -> Self {
        let all = values.flat_map(|v| [v.median, v.quartiles[0], v.quartiles[1]]);
        let (span, ticks) = match axis {
            Axis::Linear(_) => linear(all),
            Axis::Log(_) => logarithmic(all),
            Axis::Names(names) => {
                let n = names.len();
                ([n as f64 - 0.5, -0.5], (0..n).map(|i| i as f64).collect())
            }
        };
        let [lo, hi] = span;
        // `headroom` is a share of the whole axis, not of the range of the values.
        let span = [lo, hi + (hi - lo) * headroom / (1.0 - headroom)];
        Self { axis: axis.clone(), span, ticks }
    }

    fn to_axis(&self, value: f64) -> f64 {
        match self.axis {
            // Zero has no logarithm and is drawn at the lower end.
            Axis::Log(_) if value <= 0.0 => self.span[0],
            Axis::Log(_) => value.log10(),
            _ => value,
        }
    }
}

fn span(values: impl Iterator<Item = f64>) -> Option<[f64; 2]> {
    values.filter(|v| v.is_finite()).fold(None, |span, v| match span {
        None => Some([v, v]),
        Some([lo, hi]) => Some([v.min(lo), v.max(hi)]),
    })
}

fn linear(values: impl Iterator<Item = f64>) -> ([f64; 2], Vec<f64>) {
    let [lo, hi] = span(values).unwrap_or([0.0, 1.0]);
    // A single value still needs an axis of non-zero length.
    let margin = MARGIN * (hi - lo).max(1e-3 * hi.abs()).max(1e-12);
    let [lo, hi] = [lo - margin, hi + margin];
    let rough = (hi - lo) / MAX_TICKS;
    let decade = 10f64.powf(rough.log10().floor());
    let step = [1.0, 2.0, 5.0, 10.0].map(|f| f * decade).into_iter().find(|&s| s >= rough);
    let step = step.unwrap_or(10.0 * decade);
    let ticks = ((lo / step).ceil() as i64..=(hi / step).floor() as i64).map(|i| i as f64 * step);
    ([lo, hi], ticks.collect())
}

fn logarithmic(values: impl Iterator<Item = f64>) -> ([f64; 2], Vec<f64>) {
    let [lo, hi] = span(values.filter(|&v| v > 0.0).map(f64::log10)).unwrap_or([0.0, 1.0]);
    let margin = MARGIN * (hi - lo).max(0.5);
    let [lo, hi] = [lo - margin, hi + margin];
    let decades = hi - lo;
    // With few decades there is room for ticks within them.
    let within: &[f64] = if decades < 2.5 { &[1.0, 2.0, 5.0] } else { &[1.0] };
    let every = (decades / MAX_TICKS).ceil().max(1.0) as usize;
    let powers = (lo.floor() as i32..=hi.ceil() as i32).step_by(every);
    let ticks = powers.flat_map(|p| within.iter().map(move |m| m * 10f64.powi(p)));
    ([lo, hi], ticks.filter(|t| (lo..=hi).contains(&t.log10())).collect())
}

impl Ranged for Ticked {
    type FormatOption = NoDefaultFormatting;
    type ValueType = f64;

    fn map(&self, value: &f64, limit: (i32, i32)) -> i32 {
        let [lo, hi] = self.span;
        let share = (self.to_axis(*value) - lo) / (hi - lo);
        // Clamp marks to just outside the axis: larger pixel values could overflow.
        limit.0 + (f64::from(limit.1 - limit.0) * share.clamp(-0.1, 1.1)).round() as i32
    }

    fn key_points<Hint: KeyPointHint>(&self, _: Hint) -> Vec<f64> {
        self.ticks.clone()
    }

    fn range(&self) -> Range<f64> {
        let [lo, hi] = self.span;
        match self.axis {
            Axis::Log(_) => 10f64.powf(lo)..10f64.powf(hi),
            _ => lo..hi,
        }
    }
}

impl ValueFormatter<f64> for Ticked {
    fn format_ext(&self, value: &f64) -> String {
        match &self.axis {
            Axis::Names(names) => names.get(*value as usize).cloned().unwrap_or_default(),
            _ => number(*value),
        }
    }
}

/// Formats a tick in as few characters as possible.
fn number(value: f64) -> String {
    let size = value.abs();
    if size != 0.0 && !(1e-3..1e5).contains(&size) {
        return format!("{value:.0e}");
    }
    // Ticks are multiples of 1, 2 or 5. Further digits are rounding errors.
    let text = format!("{value:.4}");
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}

#[cfg(test)]
mod labels_tests {
    use super::*;

    #[test]
    fn texts_of_equal_marks_do_not_cover_each_other() {
        let marks = [([50, 50], "one"), ([50, 50], "two"), ([52, 50], "three")];
        let corners = place(&marks, [[0, 0], [200, 200]]);
        let rects: Vec<Rect> = corners
            .iter()
            .zip(marks)
            .map(|(&lo, (_, text))| Rect {
                lo,
                hi: [lo[0] + 8 * text.len() as i32, lo[1] + CHARACTER[1]],
            })
            .collect();
        for (i, a) in rects.iter().enumerate() {
            assert!(rects[..i].iter().all(|b| !a.meets(b)), "{corners:?}");
        }
    }

    #[test]
    fn texts_stay_inside() {
        let [corner] = place(&[([195, 50], "long text")], [[0, 0], [200, 200]])[..] else {
            panic!()
        };
        assert!(corner[0] + 9 * 8 <= 195, "{corner:?}");
    }
}

#[cfg(test)]
mod axis_tests {
    use super::*;

    fn ticks(axis: Axis, values: &[f64]) -> Vec<String> {
        let ticked = Ticked::new(&axis, values.iter().map(|&v| Spread::exact(v)), 0.0);
        ticked.ticks.iter().map(|t| ticked.format_ext(t)).collect()
    }

    #[test]
    fn ticks_are_round_numbers_within_the_span() {
        assert_eq!(
            ticks(Axis::Linear("dB".into()), &[19.8, 21.9]),
            ["20", "20.5", "21", "21.5", "22"]
        );
        assert_eq!(ticks(Axis::Log("ms".into()), &[3.0, 60.0]), ["5", "10", "20", "50"]);
        assert_eq!(
            ticks(Axis::Log("error".into()), &[1e-9, 1e-5]),
            ["1e-9", "1e-8", "1e-7", "1e-6", "1e-5"]
        );
        assert_eq!(ticks(Axis::Names(vec!["a".into(), "b".into()]), &[0.0]), ["a", "b"]);
    }

    #[test]
    fn zero_lies_on_the_lower_end_of_a_logarithmic_axis() {
        let values = [0.0, 1e-3, 1.0].map(Spread::exact);
        let axis = Ticked::new(&Axis::Log("error".into()), values.into_iter(), 0.0);
        assert_eq!(axis.map(&0.0, (0, 100)), 0);
        assert!(axis.map(&1e-3, (0, 100)) > 0);
        assert!(axis.map(&1.0, (0, 100)) < 100);
    }
}
