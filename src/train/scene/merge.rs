//! Reduction of the number of components: pairs whose union explains the points almost as well are merged in
//! closed form (joint moments), cheapest first.
//!
//! Every component proposes its best neighbour, disjoint pairs are taken in order of cost, and passes repeat
//! until the budget holds; a heap of all pairs would need repair after every merge. The cost is the increase
//! in the residual of colour and of distance to a plane, so that uniform walls are merged first and edges
//! last. Quality falls monotonically with the budget (`bench accuracy`).

use super::component_sums::ComponentSums;
use super::components::Components;
use super::grid::SeedGrid;
use super::seed_positions::SeedPositions;
use super::sum_scalar::SumScalar;
use crate::math::sym3::Sym3;
use crate::model::scene::sums::SceneSums;
use glam::DVec3;
use rayon::prelude::*;

/// Maximum standard deviation of a merged component, units of `h`: keeps sums within their range.
const MAX_SPREAD: f64 = 0.8;
/// Maximum distance of a merged component's mean from the seed of its sums, units of `h`.
const MAX_OFFSET: f64 = 1.5;
/// Squared colour error (0 to 1 per channel) equivalent to a squared distance of `h²` from the plane: a
/// surface `h/4` away costs as much as a colour error of 1/8.
const THICKNESS_COST: f64 = 0.25;
/// Ridge of the regression of colour on position, units of `h²`.
const RIDGE: f64 = 0.025;
/// Maximum number of passes over all components; every pass merges pairs.
const PASSES: usize = 12;

/// Statistics of a component, in units of `h`; the seed is relative to the scene's origin.
#[derive(Clone, Copy)]
struct Summary {
    sums: SceneSums,
    seed: DVec3,
    /// Residual of the component, without the part that merging leaves unchanged.
    error: f64,
}

/// Merges until at most `most` components are left, or a pass finds fewer than `worthwhile` pairs or none.
pub fn merge_down<W: SumScalar>(
    component_sums: &mut ComponentSums<W>,
    components: &mut Components,
    grid: &SeedGrid,
    h: f64,
    most: usize,
    worthwhile: usize,
) {
    for _ in 0..PASSES {
        let surplus = components.used().saturating_sub(most);
        if surplus == 0 {
            return;
        }
        let pairs = cheapest_pairs(component_sums, components, grid, h, surplus);
        if pairs.is_empty() {
            return;
        }
        for &(kept, dropped) in &pairs {
            let [a, b] =
                [kept, dropped].map(|id| summary(component_sums, components, grid, h, id as usize));
            component_sums.merge(
                kept as usize,
                dropped as usize,
                &b.sums.about_shifted_seed(b.seed - a.seed).to_array(),
            );
        }
        components.merge(&pairs);
        if pairs.len() < worthwhile {
            return;
        }
    }
}

/// Returns up to `n` disjoint pairs of neighbours of lowest cost, the older component first.
fn cheapest_pairs<W: SumScalar>(
    component_sums: &ComponentSums<W>,
    components: &Components,
    grid: &SeedGrid,
    h: f64,
    n: usize,
) -> Vec<(u32, u32)> {
    let ids = 0..components.n_rows();
    let summaries: Vec<Summary> = ids
        .clone()
        .into_par_iter()
        .map(|id| summary(component_sums, components, grid, h, id))
        .collect();
    let mut pairs: Vec<(f64, u32, u32)> = ids
        .into_par_iter()
        .filter_map(|id| best_partner(&summaries, components, grid, h, id))
        .collect();
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

fn summary<W: SumScalar>(
    component_sums: &ComponentSums<W>,
    components: &Components,
    grid: &SeedGrid,
    h: f64,
    id: usize,
) -> Summary {
    // Offsets stay in units of `h`, as costs weigh them against dimensionless colours.
    let sums = SceneSums::new(&component_sums.sums(id), 1.0);
    let seed = DVec3::from_array(SeedPositions { grid, components }.of(id).map(f64::from)) / h;
    Summary { sums, seed, error: if sums.count > 0.0 { error(&sums) } else { 0.0 } }
}

/// Returns a component's neighbour of lowest merging cost, and that cost.
fn best_partner(
    summaries: &[Summary],
    components: &Components,
    grid: &SeedGrid,
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

/// Returns the increase of the residual by merging; `None` if the union would be too large.
fn cost(a: &Summary, b: &Summary) -> Option<f64> {
    let union = a.sums + b.sums.about_shifted_seed(b.seed - a.seed);
    let is_small = union.covariance().trace() <= MAX_SPREAD * MAX_SPREAD
        && union.mean_offset().length() <= MAX_OFFSET;
    is_small.then(|| error(&union) - a.error - b.error)
}

/// Squared error over a component's points relative to a plane with a linear colour, without `Σ |c|²`, which
/// is the same for a union and for its parts.
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
    let thickness = covariance.eigen().values.min_element().max(0.0);
    n * (THICKNESS_COST * thickness - color.length_squared() - explained)
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
