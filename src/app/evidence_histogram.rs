//! Histogram of the components' evidence.

use crate::model::attributes::ComponentAttributes;

/// Bars per factor of ten.
pub const PER_DECADE: f64 = 4.0;

/// Components counted by the logarithm of their evidence.
#[derive(Clone, Debug, PartialEq)]
pub struct EvidenceHistogram {
    /// Index of the first bar; bar `i` begins at `10^(i / PER_DECADE)` points.
    pub first: i32,
    /// Components per bar.
    pub counts: Vec<usize>,
}

impl EvidenceHistogram {
    /// Counts all components with known, positive evidence; `None` if there are none.
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

#[cfg(test)]
mod tests {
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
