//! Colour coding of component attributes: the position of a value in a range determines the colour.
//!
//! The range spans the middle of the values, because a single outlier would flatten all others to one
//! colour. It is replaced only after a visible change, because every new range recolours and uploads all
//! splats. Evidence and uncertainty span many orders of magnitude and use a logarithmic scale.

use super::finish::ramp;
use crate::model::attributes::ComponentAttributes;

/// Attribute that splats can be coloured by.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Attribute {
    /// Sum of responsibilities over all points of all frames (soft count); logarithmic scale.
    Evidence,
    /// Standard deviation of the splat's position, in world units; logarithmic scale.
    Uncertainty,
    /// Mean ELBO, in nats, of the component's points in the last frame.
    Elbo,
    /// Index of the frame that contributed the component's first points.
    Birth,
    /// Share of a pixel's colour that texels determine. Splats have 0, because texels hold their own shares
    /// ([`crate::model::splat::texture::painted_by_share`]). The range is 0 to 1.
    Texture,
}

/// Colour of splats whose attribute value is unknown.
pub const UNKNOWN: [f32; 3] = [0.35; 3];

// Fraction of the values that the range excludes at either end, so that outliers do not compress it.
const TAIL: f64 = 0.02;
// Maximum number of evenly spaced samples for a range. Its ends are then accurate to half a percent of
// the values, in 0.1 ms.
const MAX_SAMPLES: usize = 1 << 14;
// Tolerance for reusing a range, as a fraction of its width. Every change recolours all splats.
const RANGE_TOLERANCE: f64 = 0.1;

impl Attribute {
    /// Returns a component's value on the colour scale; base-10 logarithm if the scale is logarithmic.
    /// `None` if the value is unknown or not finite, or not positive on a logarithmic scale.
    fn scale_position(self, of: &ComponentAttributes) -> Option<f64> {
        let value = match self {
            Self::Evidence => of.evidence,
            Self::Uncertainty => of.uncertainty,
            Self::Elbo => of.elbo,
            // Exact up to 2²⁴ frames.
            Self::Birth => of.birth.map(|frame| frame as f32),
            Self::Texture => Some(0.0),
        };
        let value = value.map(f64::from).filter(|v| v.is_finite())?;
        match self.is_logarithmic() {
            true => (value > 0.0).then(|| value.log10()),
            false => Some(value),
        }
    }

    fn is_logarithmic(self) -> bool {
        matches!(self, Self::Evidence | Self::Uncertainty)
    }

    /// Unit of the values; empty for pure numbers.
    pub fn unit(self) -> &'static str {
        match self {
            Self::Evidence => "points",
            Self::Uncertainty => "world units",
            Self::Elbo => "nats",
            Self::Birth => "",
            Self::Texture => "share of colour",
        }
    }
}

/// Range of an attribute's values that the colour ramp spans.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Range {
    attribute: Attribute,
    /// Lower and upper end on the colour scale; base-10 logarithms if the scale is logarithmic.
    ends: [f64; 2],
}

impl Range {
    /// Computes the range of the middle 96 % of an attribute's known values; `None` if no value is
    /// known.
    pub fn of(attribute: Attribute, values: &[ComponentAttributes]) -> Option<Self> {
        if attribute == Attribute::Texture {
            return Some(Self { attribute, ends: [0.0, 1.0] });
        }
        // Strided over the whole list, because neighbours often have the same birth frame.
        let stride = values.len().div_ceil(MAX_SAMPLES).max(1);
        let sample = values.iter().step_by(stride);
        let mut known: Vec<f64> = sample.filter_map(|v| attribute.scale_position(v)).collect();
        if known.is_empty() {
            // All known values may lie between the samples.
            known = values
                .iter()
                .filter_map(|v| attribute.scale_position(v))
                .take(MAX_SAMPLES)
                .collect();
        }
        let last = known.len().checked_sub(1)?;
        // Selection is linear; only two ranks are needed, not a sorted list.
        let mut quantile = |share: f64| {
            let rank = (share * last as f64).round() as usize;
            *known.select_nth_unstable_by(rank, f64::total_cmp).1
        };
        Some(Self { attribute, ends: [quantile(TAIL), quantile(1.0 - TAIL)] })
    }

    /// True if switching to the other range would not change colours visibly.
    pub fn is_similar_to(&self, other: &Self) -> bool {
        let slack = RANGE_TOLERANCE * (self.ends[1] - self.ends[0]);
        let is_near = |i: usize| (self.ends[i] - other.ends[i]).abs() <= slack;
        self.attribute == other.attribute && is_near(0) && is_near(1)
    }

    /// Colour of a component; [`UNKNOWN`] if its value is unknown.
    pub fn color(&self, of: &ComponentAttributes) -> [f32; 3] {
        let [lo, hi] = self.ends;
        match self.attribute.scale_position(of) {
            // Grey is not part of the ramp, so an unknown value cannot be mistaken for a small one.
            None => UNKNOWN,
            // A range of zero width has neither a smallest nor a largest value.
            Some(_) if hi <= lo => ramp(0.5),
            Some(value) => ramp(((value - lo) / (hi - lo)) as f32),
        }
    }

    /// Returns the attribute whose values the range spans.
    pub fn attribute(&self) -> Attribute {
        self.attribute
    }

    /// Returns the values at the lower and upper end of the colour ramp, in the unit of
    /// [`Attribute::unit`].
    pub fn ends(&self) -> [f64; 2] {
        match self.attribute.is_logarithmic() {
            true => self.ends.map(|end| 10f64.powf(end)),
            false => self.ends,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn evidence(value: f32) -> ComponentAttributes {
        ComponentAttributes { evidence: Some(value), ..ComponentAttributes::default() }
    }

    #[test]
    fn strays_do_not_stretch_the_range_and_evidence_is_logarithmic() {
        let mut values: Vec<ComponentAttributes> =
            (0..1000).map(|i| evidence(1.0 + i as f32)).collect();
        values[3] = evidence(1e30);
        values[5] = ComponentAttributes::default();
        values[6] = evidence(f32::NAN);
        let range = Range::of(Attribute::Evidence, &values).unwrap();
        let [lo, hi] = range.ends();
        assert!((20.0..24.0).contains(&lo) && (978.0..984.0).contains(&hi), "{lo} {hi}");
        let middle = range.color(&evidence((lo * hi).sqrt() as f32));
        assert!(middle.iter().zip(ramp(0.5)).all(|(a, b)| (a - b).abs() < 1e-4));
        assert_eq!(range.color(&evidence(1e30)), ramp(1.0));
        assert_eq!(range.color(&ComponentAttributes::default()), UNKNOWN);
        assert_eq!(Range::of(Attribute::Birth, &values), None);
    }

    #[test]
    fn a_large_scene_is_sampled_and_one_value_has_the_middle_colour() {
        let mut values = vec![ComponentAttributes::default(); 100_000];
        values[77_777] = ComponentAttributes { birth: Some(3), ..ComponentAttributes::default() };
        let range = Range::of(Attribute::Birth, &values).unwrap();
        assert_eq!((range.ends(), range.color(&values[77_777])), ([3.0; 2], ramp(0.5)));
        let all: Vec<ComponentAttributes> = (0..100_000)
            .map(|i| ComponentAttributes {
                elbo: Some(-(i as f32)),
                ..ComponentAttributes::default()
            })
            .collect();
        let [lo, hi] = Range::of(Attribute::Elbo, &all).unwrap().ends();
        assert!((lo + 98_000.0).abs() < 500.0 && (hi + 2_000.0).abs() < 500.0, "{lo} {hi}");
    }

    #[test]
    fn shares_of_texels_have_the_range_from_0_to_1() {
        let range = Range::of(Attribute::Texture, &[]).unwrap();
        assert_eq!((range.ends(), range.color(&evidence(9.0))), ([0.0, 1.0], ramp(0.0)));
    }

    #[test]
    fn a_range_stays_while_little_changes() {
        let range = |ends| Range { attribute: Attribute::Elbo, ends };
        assert!(range([0.0, 10.0]).is_similar_to(&range([0.9, 9.1])));
        assert!(!range([0.0, 10.0]).is_similar_to(&range([0.0, 12.0])));
        let birth = Range { attribute: Attribute::Birth, ends: [0.0, 10.0] };
        assert!(!birth.is_similar_to(&range([0.0, 10.0])));
    }
}
