//! Reduces the number of components by merging pairs, cheapest first. Merging a pair is cheap if the
//! merged component explains the points almost as well. It has the joint moments of the pair, in closed
//! form.
//!
//! Every component proposes its best neighbour, and disjoint pairs are merged in order of cost. Such
//! passes repeat until the budget is met; a heap of all pairs would need repair after every merge. The
//! cost is the increase in the residuals of colour and of distance to a plane. So uniform walls are
//! merged first and edges last. Quality falls monotonically with the budget (`bench accuracy`).

use super::assign::assign;
use super::births::{Limits, create_components};
use super::component_sums::{ComponentSums, whole_quanta};
use super::components::Seeds;
use super::config::DEFAULT_MAX_COMPONENTS;
use super::grid::NONE;
use super::seed_groups::Reach;
use crate::math::sym3::Sym3;
use crate::model::scene::state::{MAX_COARSENING_STEPS, SceneState, WHOLE};
use crate::model::scene::sums::{N_SUMS, SceneSums};
use crate::observation::surface::SurfacePoint;
use glam::DVec3;
use rayon::prelude::*;
use std::f64::consts::SQRT_2;

// Maximum standard deviation of a merged component, units of `h`: keeps sums within their range.
const MAX_SPREAD: f64 = 0.8;
/// Maximum distance of a merged component's mean from its seed, in units of the structural scale `h`.
const MAX_OFFSET: f64 = 1.5;
// Squared colour error (0 to 1 per channel) equivalent to a squared distance of `h²` from the plane: a
// surface `h/4` away costs as much as a colour error of 1/8.
const THICKNESS_COST: f64 = 0.25;
/// Ridge of the regression of colour on position, in units of `h²`, where `h` is the structural scale.
const RIDGE: f64 = 0.025;
/// Maximum number of passes, each of which merges pairs of components.
const PASSES: usize = 12;

/// Statistics of a component, with lengths in units of the structural scale `h`. The seed is relative to
/// the scene's origin.
#[derive(Clone, Copy)]
struct Summary {
    sums: SceneSums,
    seed: DVec3,
    /// Squared error of the component's points, as returned by [`error()`].
    error: f64,
}

/// Merges pairs of components until at most `most` components are left. Stops early after a pass that
/// finds no pair or merges fewer than `worthwhile` pairs. `h` is the structural scale, world units.
pub fn merge_down(
    component_sums: &mut ComponentSums,
    seeds: &mut Seeds,
    h: f64,
    most: usize,
    worthwhile: usize,
) {
    for _ in 0..PASSES {
        let surplus = seeds.components.used().saturating_sub(most);
        if surplus == 0 {
            return;
        }
        let pairs = cheapest_pairs(component_sums, seeds, h, surplus);
        if pairs.is_empty() {
            return;
        }
        for &(kept, dropped) in &pairs {
            let [a, b] = [kept, dropped].map(|id| summary(component_sums, seeds, h, id as usize));
            component_sums.merge(
                kept as usize,
                dropped as usize,
                &b.sums.about_shifted_seed(b.seed - a.seed).to_array(),
            );
        }
        seeds.components.merge(&pairs);
        // Every pass costs a search over all components, however few pairs it finds.
        if pairs.len() < worthwhile {
            return;
        }
    }
}

/// Returns up to `n` disjoint pairs of neighbouring components with the lowest merging costs. The older
/// component of each pair comes first.
fn cheapest_pairs(
    component_sums: &ComponentSums,
    seeds: &Seeds,
    h: f64,
    n: usize,
) -> Vec<(u32, u32)> {
    let ids = (0..seeds.components.n_rows()).into_par_iter();
    let summaries: Vec<Summary> =
        ids.clone().map(|id| summary(component_sums, seeds, h, id)).collect();
    let mut pairs: Vec<(f64, u32, u32)> =
        ids.filter_map(|id| best_partner(&summaries, seeds, h, id)).collect();
    // Ties are resolved by number, so that the result is independent of the number of threads.
    pairs.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then((a.1, a.2).cmp(&(b.1, b.2))));
    let mut taken = vec![false; summaries.len()];
    let mut chosen = Vec::new();
    for (_, a, b) in pairs {
        // Disjoint pairs: the order of merging is irrelevant.
        if chosen.len() < n && !taken[a as usize] && !taken[b as usize] {
            (taken[a as usize], taken[b as usize]) = (true, true);
            chosen.push((a, b));
        }
    }
    chosen
}

fn summary(component_sums: &ComponentSums, seeds: &Seeds, h: f64, id: usize) -> Summary {
    // Offsets stay in units of `h`, as costs weigh them against dimensionless colours.
    let sums = SceneSums::new(&component_sums.sums(id), 1.0);
    let seed = DVec3::from_array(seeds.of(id).map(f64::from)) / h;
    Summary { sums, seed, error: if sums.count > 0.0 { error(&sums) } else { 0.0 } }
}

/// Returns the cheapest merge of component `id` with a neighbour, as (cost, older component, younger
/// component). `None` if no merge is possible.
fn best_partner(
    summaries: &[Summary],
    Seeds { grid, components }: &Seeds,
    h: f64,
    id: usize,
) -> Option<(f64, u32, u32)> {
    let own = &summaries[id];
    if own.sums.count == 0.0 {
        return None;
    }
    let mean = (own.seed + own.sums.mean_offset()) * h;
    // After earlier merges means lie up to 1.5 `h` from their seeds; neighbours are those of the mean.
    let mean = mean.as_vec3().to_array();
    if !grid.has_cell(mean) {
        return None;
    }
    let cell = grid.cell_of(mean);
    let mut best: Option<(f64, u32, u32)> = None;
    grid.visit(cell.map(|c| c - 1), cell.map(|c| c + 1), |seed, _| {
        let other_id = components.of_seed(seed);
        let other = &summaries[other_id as usize];
        if other_id as usize == id || other.sums.count == 0.0 {
            return;
        }
        // The older one is retained: its sums already refer to its seed.
        let is_older = components.reference_seed(id) < components.reference_seed(other_id as usize);
        let (a, b) = if is_older { (own, other) } else { (other, own) };
        let Some(cost) = cost(a, b) else { return };
        let pair = if is_older { (cost, id as u32, other_id) } else { (cost, other_id, id as u32) };
        // Ties are resolved by the lower ids, since seeds come in the order of buckets.
        if best.is_none_or(|best| (pair.0, pair.1, pair.2) < best) {
            best = Some(pair);
        }
    });
    best
}

/// Returns the increase of the squared error by merging two components; `None` if the union would be too
/// large.
fn cost(a: &Summary, b: &Summary) -> Option<f64> {
    let union = a.sums + b.sums.about_shifted_seed(b.seed - a.seed);
    let is_small = union.covariance().trace() <= MAX_SPREAD * MAX_SPREAD
        && union.mean_offset().length() <= MAX_OFFSET;
    is_small.then(|| error(&union) - a.error - b.error)
}

/// Returns the squared error of a component's points relative to a plane whose colour changes linearly.
/// The sum of the squared colours is omitted, since merging does not change it.
fn error(sums: &SceneSums) -> f64 {
    let n = sums.count;
    let (color, covariance) = (sums.color / n, sums.covariance());
    let explained = match covariance.add_scaled(1.0, Sym3::diagonal(RIDGE)).inverse() {
        Some(inverse) => {
            let rows = sums.color_covariance().transpose();
            let row = |v: DVec3| inverse.quadratic_form(v);
            row(rows.x_axis) + row(rows.y_axis) + row(rows.z_axis)
        }
        None => 0.0,
    };
    // Rounding can make the smallest eigenvalue of a flat component negative.
    let thickness = covariance.eigen().values.min_element().max(0.0);
    n * (THICKNESS_COST * thickness - color.length_squared() - explained)
}

/// Partition of points into components, which are created as in training.
///
/// ```
/// use vbgs_studio::observation::surface::SurfacePoint;
/// use vbgs_studio::train::scene::merge::Partition;
///
/// let at = |x: f32| SurfacePoint { position: [x, 0.0, 0.0], ..SurfacePoint::default() };
/// let mut partition = Partition::new(0.5);
/// assert_eq!(partition.assign(&[at(0.0), at(0.2), at(3.0)]), [Some(0), Some(0), Some(1)]);
/// assert_eq!(partition.assign(&[at(2.8)]), [Some(1)]);
/// assert_eq!(partition.components(), 2);
/// ```
pub struct Partition {
    h: f64,
    seeds: Seeds,
    owners: Vec<u32>,
}

impl Partition {
    /// Creates a partition without components; `h` is the structural scale, world units.
    pub fn new(h: f64) -> Self {
        Self { h, seeds: Seeds::new(h), owners: Vec::new() }
    }

    /// Returns the component of every point. Creates new components where none is within the structural
    /// scale. `None` for a point for which no component can be created.
    pub fn assign(&mut self, points: &[SurfacePoint]) -> Vec<Option<u32>> {
        let Self { h, seeds, owners } = self;
        assign(seeds, Reach::new(*h, 0.0), points, owners);
        let limits = Limits { components: DEFAULT_MAX_COMPONENTS, seeds: DEFAULT_MAX_COMPONENTS };
        create_components(*h, seeds, points, owners, limits);
        owners.iter().map(|&owner| (owner != NONE).then_some(owner)).collect()
    }

    /// Returns the number of components created so far.
    pub fn components(&self) -> usize {
        self.seeds.components.used()
    }
}

/// Returns the factor on the structural scale after `steps` coarsening steps. Each step about halves the
/// number of components.
pub fn factor(steps: u32) -> f64 {
    // Bounds the shift; valid steps are far below.
    let twice = f64::from(1u32 << (steps / 2).min(31));
    if steps.is_multiple_of(2) { twice } else { twice * SQRT_2 }
}

/// Converts a scene to the structural scale that is `steps` coarsening steps above the configured one.
/// Seeds keep their positions and the surface that they represent. Sums are rounded to whole quanta.
/// `None` if the scene already has a larger scale or `steps` is out of range.
pub fn coarsened(state: SceneState, steps: u32) -> Option<SceneState> {
    if steps > MAX_COARSENING_STEPS {
        return None;
    }
    let by = factor(steps.checked_sub(state.coarsening_steps)?);
    if by == 1.0 {
        return Some(state);
    }
    let all = ComponentSums::restore(state.sums, state.visibility);
    let mut sums = ComponentSums::default();
    for id in 0..all.len() {
        sums.push(&in_units(all.sums(id), by), all.row(id).visibility());
    }
    let (sums, visibility) = sums.state();
    let shares = state.shares.unwrap_or_else(|| vec![WHOLE; state.seeds.len()]);
    // A share of 0 would leave a seed without any extent.
    let narrower = |share: u8| ((f64::from(share) / by).round() as u8).max(1);
    let shares = Some(shares.into_iter().map(narrower).collect());
    Some(SceneState { coarsening_steps: steps, shares, sums, visibility, ..state })
}

/// Converts sums to a unit of length that is `by` times the old one. The results are rounded to whole
/// quanta.
fn in_units(mut sums: [f64; N_SUMS], by: f64) -> [f64; N_SUMS] {
    // `Σ d`, `Σ d dᵀ` and `Σ c dᵀ`; the other sums contain no length.
    let lengths = [(1..4, by), (4..10, by * by), (13..22, by)];
    for (range, by) in lengths {
        for sum in &mut sums[range] {
            *sum = whole_quanta(*sum / by);
        }
    }
    sums
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::scene::sums::{N_SUMS, outer};

    fn points(at: DVec3, color: impl Fn(DVec3) -> DVec3) -> SceneSums {
        let mut sums = SceneSums::new(&[0.0; N_SUMS], 1.0);
        for i in 0..25 {
            let offset = DVec3::new((i % 5) as f64 * 0.1, (i / 5) as f64 * 0.1, 0.0);
            let c = color(at + offset);
            sums.count += 1.0;
            sums.first += offset;
            sums.second = sums.second.add_scaled(1.0, Sym3::outer(offset));
            sums.color += c;
            sums.color_offset += outer(c, offset);
        }
        sums
    }

    fn at(seed: DVec3, color: impl Fn(DVec3) -> DVec3) -> Summary {
        let sums = points(seed, color);
        Summary { sums, seed, error: error(&sums) }
    }

    #[test]
    fn sums_are_the_same_about_any_seed() {
        let color = |p: DVec3| p * 0.3 + DVec3::splat(0.2);
        let (a, b) = (at(DVec3::ZERO, color), at(DVec3::X * 0.5, color));
        let union = a.sums + b.sums.about_shifted_seed(b.seed - a.seed);
        let back = b
            .sums
            .about_shifted_seed(DVec3::new(0.3, -1.0, 2.0))
            .about_shifted_seed(-DVec3::new(0.3, -1.0, 2.0));
        assert!((back.first - b.sums.first).length() < 1e-12);
        assert!((back.second.trace() - b.sums.second.trace()).abs() < 1e-9);
        assert!((union.mean_offset().x - 0.45).abs() < 1e-12);
    }

    #[test]
    fn flat_and_even_is_cheap_and_an_edge_is_dear() {
        let grey = |_: DVec3| DVec3::splat(0.5);
        let step = |p: DVec3| DVec3::splat(if p.x < 0.45 { 0.1 } else { 0.9 });
        let pair = |offset: DVec3, color: fn(DVec3) -> DVec3| {
            cost(&at(DVec3::ZERO, color), &at(offset, color))
        };
        let even = pair(DVec3::X * 0.5, grey).unwrap();
        assert!(even.abs() < 1e-9, "{even}");
        assert!(pair(DVec3::X * 0.5, step).unwrap() > 0.5);
        assert!(pair(DVec3::new(0.5, 0.0, 0.4), grey).unwrap() > 0.05, "two planes");
        assert!(pair(DVec3::X * 3.0, grey).is_none(), "too large");
    }
}

#[cfg(test)]
mod coarsening_tests {
    use super::*;
    use crate::model::scene::state::{QUANTUM, VisibilityCounts};
    use crate::model::scene::sums::{SceneSums, terms};

    /// Returns a scene of two components whose points are on planes of different slope.
    fn scene() -> SceneState {
        let mut sums = ComponentSums::default();
        for slope in [0.0, 0.3] {
            let mut of_points = [0.0; N_SUMS];
            for i in 0..50 {
                let [x, y] = [f64::from(i % 7) * 0.25 - 0.75, f64::from(i / 7) * 0.25 - 0.75];
                let color = [0.5, 0.25 + 0.1 * x, 0.75];
                let point = terms([x, y, slope * x], color, [0.0, 0.0, -1.0], [0.6, 0.0, 0.8]);
                of_points.iter_mut().zip(point).for_each(|(sum, term)| *sum += term);
            }
            let whole = of_points.map(whole_quanta);
            sums.push(&whole, VisibilityCounts { expected: 64, hits: 3, misses: 0 });
        }
        let (sums, visibility) = sums.state();
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
        }
    }

    fn row(state: &SceneState, id: usize) -> [f64; N_SUMS] {
        state.sums.rows[id].map(|quanta| f64::from(quanta) * QUANTUM)
    }

    #[test]
    fn a_wider_scale_describes_the_same_points() {
        let before = scene();
        for steps in 1..=MAX_COARSENING_STEPS {
            let after = coarsened(before.clone(), steps).unwrap();
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
        let once = coarsened(scene(), 1).unwrap();
        assert_eq!(once.shares, Some(vec![45; 2]));
        let twice = coarsened(once, 2).unwrap();
        assert_eq!(twice.shares, Some(vec![32; 2]));
        assert_eq!(coarsened(twice.clone(), 2), Some(twice.clone()));
        assert_eq!(coarsened(twice.clone(), 1), None);
        assert_eq!(coarsened(twice, MAX_COARSENING_STEPS + 1), None);
        let far = coarsened(scene(), MAX_COARSENING_STEPS).unwrap();
        assert_eq!(far.shares, Some(vec![1; 2]));
        assert_eq!([0, 1, 2, 5, 12].map(factor), [1.0, SQRT_2, 2.0, 4.0 * SQRT_2, 64.0]);
    }
}

/// Tests of the moments of merged components, whose sums were moved between seeds.
#[cfg(test)]
mod moments_tests {
    use crate::math::rng::{Purpose, Rng};
    use crate::math::sym3::Sym3;
    use crate::model::scene::state::QUANTUM;
    use crate::model::scene::sums::{N_SUMS, SceneSums, clamp_moments};
    use crate::train::scene::component_sums::ComponentSums;
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
            let mut vector = |step: fn(f64) -> f64| {
                DVec3::from_array([0; 3].map(|_| step(rng.range(-1.0, 1.0))))
            };
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
}
