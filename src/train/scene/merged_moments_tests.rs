//! Tests of the moments of merged components, whose sums were moved between seeds.

use super::component_sums::ComponentSums;
use crate::math::rng::{Purpose, Rng};
use crate::math::sym3::Sym3;
use crate::model::scene::state::QUANTUM;
use crate::model::scene::sums::{N_SUMS, SceneSums, clamp_moments};
use glam::DVec3;
use proptest::array;
use proptest::collection::vec;
use proptest::prelude::*;
use proptest::sample::Index;

fn add(sums: &mut ComponentSums, id: usize, terms: &[f32; N_SUMS]) {
    sums.for_each_part(1, |_, rows, _| rows[id].add(terms));
}

/// After any number of merges over any distance, the sums stay within the bounds that files require.
#[test]
fn merging_keeps_moments_within_their_bounds() {
    for case in 0..400 {
        let mut rng = Rng::new(7, Purpose::Init, case);
        let mut component_sums = ComponentSums::default();
        component_sums.grow(6);
        let mut vector =
            |step: fn(f64) -> f64| DVec3::from_array([0; 3].map(|_| step(rng.range(-1.0, 1.0))));
        let seeds = [DVec3::ZERO; 6].map(|_| vector(|x| x));
        // Points on a line through the first seed, along an axis or in a coordinate plane: about that seed
        // some of their moments consist of rounding only.
        let direction = vector(f64::round);
        for (id, seed) in seeds.iter().enumerate() {
            for _ in 0..1 + id % 3 {
                let d = seeds[0] + direction * rng.range(0.0, 0.2) - *seed;
                let mut sums = SceneSums::new(&[0.0; N_SUMS], 1.0);
                (sums.count, sums.first, sums.second) = (1.0, d, Sym3::outer(d));
                add(&mut component_sums, id, &sums.to_array().map(|x| x as f32));
            }
        }
        for (id, seed) in seeds.iter().enumerate().skip(1) {
            let own = SceneSums::new(&component_sums.sums(id), 1.0);
            let moved = own.about_shifted_seed(*seed - seeds[0]).to_array();
            let count = component_sums.sums(0)[0] + moved[0];
            component_sums.merge(0, id, &moved);
            let mut union = component_sums.sums(0);
            assert!(!clamp_moments(&mut union), "case {case}, merge {id}: {union:?}");
            assert_eq!(union[0], count, "no point is lost");
        }
    }
}

/// True if some set of points can have the moments in `sums`. Decided in integers: all principal minors
/// of `N · Σ d dᵀ − Σ d Σ dᵀ` must be at least 0.
fn are_moments_of_points(sums: &[f64; N_SUMS]) -> bool {
    let quanta = |i: usize| (sums[i] / QUANTUM) as i128;
    let scatter = |i: usize, a: usize, b: usize| quanta(0) * quanta(i) - quanta(a) * quanta(b);
    let [xx, xy, xz] = [scatter(4, 1, 1), scatter(5, 1, 2), scatter(6, 1, 3)];
    let [yy, yz, zz] = [scatter(7, 2, 2), scatter(8, 2, 3), scatter(9, 3, 3)];
    let pairs = [xx * yy - xy * xy, xx * zz - xz * xz, yy * zz - yz * yz];
    let whole = xx * pairs[2] - xy * (xy * zz - yz * xz) + xz * (xy * yz - yy * xz);
    [xx, yy, zz, whole].into_iter().chain(pairs).all(|minor| minor >= 0)
}

/// Generates the components of a wall: seeds, each with points in one axis-parallel or tilted plane.
fn wall() -> impl Strategy<Value = Vec<([f64; 3], Vec<[f64; 3]>)>> {
    let unit = || array::uniform3(-1.0..1.0);
    let component = (unit(), vec(unit(), 1..3));
    (0..4usize, unit(), vec(component, 2..7)).prop_map(|(flat, tilt, mut components)| {
        let flatten = |p: &mut [f64; 3]| match flat {
            3 => p[2] = tilt[0] * p[0] + tilt[1] * p[1],
            axis => p[axis] = tilt[2],
        };
        components.iter_mut().flat_map(|(_, points)| points).for_each(flatten);
        components
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(1000))]
    #[test]
    fn whatever_is_merged_in_any_order_is_of_some_points(
        components in wall(),
        order in vec((any::<Index>(), any::<Index>()), 6),
    ) {
        let mut component_sums = ComponentSums::default();
        component_sums.grow(components.len());
        for (id, (seed, points)) in components.iter().enumerate() {
            for point in points {
                let d = DVec3::from_array(*point) - DVec3::from_array(*seed);
                let mut sums = SceneSums::new(&[0.0; N_SUMS], 1.0);
                (sums.count, sums.first, sums.second) = (1.0, d, Sym3::outer(d));
                add(&mut component_sums, id, &sums.to_array().map(|x| x as f32));
            }
        }
        let count = |sums: &ComponentSums| -> f64 {
            (0..components.len()).map(|id| sums.sums(id)[0]).sum()
        };
        let all = count(&component_sums);
        let mut left: Vec<usize> = (0..components.len()).collect();
        for (kept, dropped) in order {
            if left.len() < 2 {
                break;
            }
            let dropped = left.swap_remove(dropped.index(left.len()));
            let kept = left[kept.index(left.len())];
            let seed = |id: usize| DVec3::from_array(components[id].0);
            let own = SceneSums::new(&component_sums.sums(dropped), 1.0);
            let moved = own.about_shifted_seed(seed(dropped) - seed(kept)).to_array();
            component_sums.merge(kept, dropped, &moved);
            let union = component_sums.sums(kept);
            prop_assert!(are_moments_of_points(&union), "{:?}", &union[..10]);
            prop_assert!(!clamp_moments(&mut union.clone()));
            prop_assert_eq!(count(&component_sums), all);
        }
    }
}
