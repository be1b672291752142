//! Growth of the structural scale when the budget cannot hold a finer one (`scene.md`, Merging and budget).

use super::component_sums::ComponentSums;
use super::sum_scalar::SumScalar;
use crate::model::scene::state::{MAX_COARSENING_STEPS, QUANTUM, SceneState, WHOLE};
use crate::model::scene::sums::N_SUMS;
use std::f64::consts::SQRT_2;

/// Returns the factor on the structural scale after `steps` steps; each halves the number of components.
pub fn factor(steps: u32) -> f64 {
    // Bounds the shift; valid steps are far below.
    let twice = f64::from(1u32 << (steps / 2).min(31));
    if steps.is_multiple_of(2) { twice } else { twice * SQRT_2 }
}

/// Converts the sums to a structural scale that is `steps` wider than the configured one. Seeds stay and
/// represent the same surface; sums are rounded to whole quanta. `None` if sums have another form, or the
/// scale is already wider.
pub fn coarsened<W: SumScalar>(state: SceneState, steps: u32) -> Option<SceneState> {
    if steps > MAX_COARSENING_STEPS {
        return None;
    }
    let by = factor(steps.checked_sub(state.coarsening_steps)?);
    if by == 1.0 {
        return Some(state);
    }
    let all = ComponentSums::<W>::restore(state.sums, state.visibility)?;
    let mut sums = ComponentSums::<W>::default();
    for id in 0..all.len() {
        sums.push(&in_units(all.sums(id), by), all.row(id).visibility());
    }
    let order: Vec<u32> = (0..all.len() as u32).collect();
    let (sums, visibility) = sums.state(&order);
    let shares = state.shares.unwrap_or_else(|| vec![WHOLE; state.seeds.len()]);
    let narrower = |share: u8| ((f64::from(share) / by).round() as u8).max(1);
    let shares = Some(shares.into_iter().map(narrower).collect());
    // Stored contributions of frames use the old unit: they are dropped, and those frames stay where they
    // are.
    Some(SceneState {
        coarsening_steps: steps,
        shares,
        sums,
        visibility,
        stored_frames: Vec::new(),
        ..state
    })
}

/// Converts sums to offsets in units `by` times as long, in whole quanta.
fn in_units(mut sums: [f64; N_SUMS], by: f64) -> [f64; N_SUMS] {
    // `Σ d`, `Σ d dᵀ` and `Σ c dᵀ`; the other sums contain no length.
    let lengths = [(1..4, by), (4..10, by * by), (13..22, by)];
    for (range, by) in lengths {
        for sum in &mut sums[range] {
            *sum = (*sum / by / QUANTUM).round_ties_even() * QUANTUM;
        }
    }
    sums
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::scene::state::{StoredSums, VisibilityCounts};
    use crate::model::scene::sums::{SceneSums, terms};

    /// Points of a wall about two seeds.
    fn scene() -> SceneState {
        let mut sums = ComponentSums::<i32>::default();
        for slope in [0.0, 0.3] {
            let mut of_points = [0.0; N_SUMS];
            for i in 0..50 {
                let [x, y] = [f64::from(i % 7) * 0.25 - 0.75, f64::from(i / 7) * 0.25 - 0.75];
                let color = [0.5, 0.25 + 0.1 * x, 0.75];
                let point = terms([x, y, slope * x], color, [0.0, 0.0, -1.0], [0.6, 0.0, 0.8]);
                of_points.iter_mut().zip(point).for_each(|(sum, term)| *sum += term);
            }
            let whole = of_points.map(|sum| (sum / QUANTUM).round_ties_even() * QUANTUM);
            sums.push(&whole, VisibilityCounts { expected: 64, hits: 3, misses: 0 });
        }
        let (sums, visibility) = sums.state(&[0, 1]);
        SceneState {
            origin: [0.0; 3],
            coarsening_steps: 0,
            seeds: vec![[0.0; 3], [1.0, 0.0, 0.0]],
            shares: None,
            components: None,
            sums,
            visibility,
            exposures: Vec::new(),
            poses: Vec::new(),
            trajectory: Vec::new(),
            photometric: None,
            stored_frames: Vec::new(),
        }
    }

    fn row(state: &SceneState, id: usize) -> [f64; N_SUMS] {
        let StoredSums::Mixed { rows, .. } = &state.sums else { panic!("integers") };
        rows[id].map(|quanta| f64::from(quanta) * QUANTUM)
    }

    #[test]
    fn a_wider_scale_describes_the_same_points() {
        let before = scene();
        for steps in 1..=MAX_COARSENING_STEPS {
            let after = coarsened::<i32>(before.clone(), steps).unwrap();
            assert_eq!((after.coarsening_steps, &after.seeds), (steps, &before.seeds));
            for id in 0..2 {
                let (h, wider) = (0.05, 0.05 * factor(steps));
                let [a, b] = [(&before, h), (&after, wider)]
                    .map(|(state, h)| SceneSums::new(&row(state, id), h));
                assert_eq!((a.count, a.color, a.normal), (b.count, b.color, b.normal));
                // Half a quantum of a sum is a hundred-thousandth of the scale, divided by the number of
                // points.
                assert!((a.mean_offset() - b.mean_offset()).length() < 1e-6 * wider);
                let moved = a.covariance().add_scaled(-1.0, b.covariance());
                assert!(moved.eigen().values.abs().max_element() < 1e-4 * wider * wider);
                assert!(b.covariance().eigen().values.min_element() >= 0.0);
            }
        }
    }

    #[test]
    fn steps_one_by_one_are_those_of_shares_and_refuse_to_go_back() {
        let once = coarsened::<i32>(scene(), 1).unwrap();
        assert_eq!(once.shares, Some(vec![45; 2]));
        let twice = coarsened::<i32>(once.clone(), 2).unwrap();
        assert_eq!(twice.shares, Some(vec![32; 2]));
        assert_eq!(coarsened::<i32>(twice.clone(), 2), Some(twice.clone()));
        assert_eq!(coarsened::<i32>(twice.clone(), 1), None);
        assert_eq!(coarsened::<i32>(twice, MAX_COARSENING_STEPS + 1), None);
        assert_eq!(coarsened::<f64>(once, 2), None, "another form");
        let far = coarsened::<i32>(scene(), MAX_COARSENING_STEPS).unwrap();
        assert_eq!(far.shares, Some(vec![1; 2]));
        assert_eq!([0, 1, 2, 5, 12].map(factor), [1.0, SQRT_2, 2.0, 4.0 * SQRT_2, 64.0]);
    }
}
