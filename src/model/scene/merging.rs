//! Exact addition of scenes on the same lattice that were trained on different frames: every merge tree gives
//! the same bits.
//!
//! Only lattices can be added: seeds born at points depend on the preceding frames, and two such runs have no
//! component in common. Sums are whole quanta below 2⁵³, so f64 adds them without rounding in any order.

use super::state::{
    MAX_SUM, QUANTUM, SceneState, StoredSums, VisibilityCounts, WIDE_POINTS, WideRow, seed_order,
};
use super::sums::N_SUMS;
use crate::model::paper::merging::AddError;

/// Adds two scenes: components with equal seeds become one. The result is in [`seed_order`], the order of
/// scenes whose components do not depend on the order of frames.
///
/// # Errors
/// [`AddError::Unlike`] for scenes with different origins or merged components, [`AddError::Inexact`] unless
/// both have integer sums, [`AddError::Overflow`] beyond the range of a wide row.
pub fn add(a: &SceneState, b: &SceneState) -> Result<SceneState, AddError> {
    if a.origin != b.origin || [a, b].iter().any(|scene| depends_on_order(scene)) {
        return Err(AddError::Unlike);
    }
    let sums = [Exact::of(&a.sums)?, Exact::of(&b.sums)?];
    let terms = |which: usize, state: &SceneState| {
        let terms = state.seeds.iter().zip(&state.visibility).enumerate();
        let term = move |(id, (&seed, &visibility))| Term { seed, visibility, which, id };
        terms.map(term).collect::<Vec<_>>()
    };
    let mut terms = [terms(0, a), terms(1, b)].concat();
    // Makes equal seeds adjacent; the result is in the order in which lattices are stored.
    terms.sort_unstable_by(|a, b| seed_order(&a.seed, &b.seed));
    let mut scene = SceneState {
        origin: a.origin,
        coarsening_steps: 0,
        seeds: Vec::with_capacity(terms.len()),
        shares: None,
        components: None,
        sums: StoredSums::Mixed { rows: Vec::new(), wide: Vec::new() },
        visibility: Vec::with_capacity(terms.len()),
        exposures: Vec::new(),
        poses: Vec::new(),
        trajectory: Vec::new(),
        photometric: None,
    };
    let (mut rows, mut wide) = (Vec::with_capacity(terms.len()), Vec::new());
    for same in terms.chunk_by(|a, b| a.seed == b.seed) {
        let mut total = [0.0; N_SUMS];
        for term in same {
            let sums = sums[term.which].row(term.id);
            total.iter_mut().zip(sums).for_each(|(total, sum)| *total += sum);
        }
        let component = rows.len();
        if total.iter().any(|sum| sum.abs() > MAX_SUM) {
            return Err(AddError::Overflow { component });
        }
        // The storage form depends on the count alone, so equal sums are stored alike whatever the merge
        // tree.
        if total[0] >= f64::from(WIDE_POINTS) {
            rows.push([0; N_SUMS]);
            wide.push(WideRow { id: component as u32, sums: total });
        } else {
            rows.push(total.map(|sum| (sum / QUANTUM) as i32));
        }
        scene.seeds.push(same[0].seed);
        scene.visibility.push(
            same.iter()
                .map(|term| term.visibility)
                .fold(VisibilityCounts::default(), VisibilityCounts::plus),
        );
    }
    scene.sums = StoredSums::Mixed { rows, wide };
    Ok(scene)
}

/// True for scenes that depend on the order of frames: seeds share components after merging under a budget,
/// and gains and poses depend on the preceding frames.
fn depends_on_order(scene: &SceneState) -> bool {
    scene.components.is_some() || !scene.exposures.is_empty() || !scene.poses.is_empty()
}

#[derive(Clone, Copy)]
struct Term {
    seed: [f32; 3],
    visibility: VisibilityCounts,
    /// Index of the scene, 0 or 1.
    which: usize,
    id: usize,
}

struct Exact<'a> {
    rows: &'a [[i32; N_SUMS]],
    wide: &'a [WideRow],
}

impl<'a> Exact<'a> {
    fn of(sums: &'a StoredSums) -> Result<Self, AddError> {
        match sums {
            StoredSums::Mixed { rows, wide } => Ok(Self { rows, wide }),
            StoredSums::F32(_) | StoredSums::F64(_) => Err(AddError::Inexact),
        }
    }

    /// Returns whole quanta below 2⁵³, which are exact in f64.
    fn row(&self, id: usize) -> [f64; N_SUMS] {
        match self.wide.binary_search_by_key(&id, |row| row.id as usize) {
            Ok(at) => self.wide[at].sums,
            Err(_) => self.rows[id].map(|quanta| f64::from(quanta) * QUANTUM),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Components on a line, given by seed and number of points; every sum equals the number of points.
    fn scene(components: &[(f32, u32)]) -> SceneState {
        let (mut rows, mut wide) = (Vec::new(), Vec::new());
        for (&(_, points), id) in components.iter().zip(0..) {
            let is_wide = points >= WIDE_POINTS;
            let quanta = if is_wide { 0 } else { points as i32 * 32768 };
            rows.push([quanta; N_SUMS]);
            wide.extend(is_wide.then_some(WideRow { id, sums: [f64::from(points); N_SUMS] }));
        }
        SceneState {
            origin: [1.0, 2.0, 3.0],
            coarsening_steps: 0,
            seeds: components.iter().map(|&(x, _)| [x, 0.5, -0.5]).collect(),
            shares: None,
            components: None,
            sums: StoredSums::Mixed { rows, wide },
            visibility: components
                .iter()
                .map(|&(_, points)| VisibilityCounts { expected: points, hits: 1, misses: 40_000 })
                .collect(),
            exposures: Vec::new(),
            poses: Vec::new(),
            trajectory: Vec::new(),
            photometric: None,
        }
    }

    #[test]
    fn equal_seeds_become_one_component() {
        let a = scene(&[(-1.5, 7), (0.5, 4000), (2.5, 5000), (9.5, 3)]);
        let b = scene(&[(0.5, 96), (1.5, 1), (2.5, 5000)]);
        let mut expected = scene(&[(-1.5, 7), (0.5, 4096), (1.5, 1), (2.5, 10_000), (9.5, 3)]);
        for (visibility, n) in expected.visibility.iter_mut().zip([1, 2, 1, 2, 1]) {
            visibility.hits = n;
            visibility.misses = if n == 2 { u16::MAX } else { 40_000 };
        }
        assert_eq!(add(&a, &b), Ok(expected.clone()));
        assert_eq!(add(&b, &a), Ok(expected.clone()));
        let nothing = scene(&[]);
        assert_eq!(add(&nothing, &expected), Ok(expected));
    }

    #[test]
    fn what_cannot_be_added() {
        let a = scene(&[(0.5, 1)]);
        let elsewhere = SceneState { origin: [0.0; 3], ..a.clone() };
        assert_eq!(add(&a, &elsewhere), Err(AddError::Unlike));
        let shared = SceneState { components: Some(vec![0]), ..a.clone() };
        assert_eq!(add(&a, &shared), Err(AddError::Unlike));
        let rounded = SceneState { sums: StoredSums::F64(vec![[1.0; N_SUMS]]), ..a.clone() };
        assert_eq!(add(&a, &rounded), Err(AddError::Inexact));
        let mut most = scene(&[(0.5, WIDE_POINTS)]);
        let StoredSums::Mixed { wide, .. } = &mut most.sums else { unreachable!() };
        wide[0].sums = [MAX_SUM; N_SUMS];
        assert_eq!(add(&most, &a), Err(AddError::Overflow { component: 0 }));
    }
}
