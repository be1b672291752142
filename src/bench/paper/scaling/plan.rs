//! Which sizes are timed.

use super::row::Sweep;
use crate::bench::findings::BenchOptions;

/// Which sizes are timed.
#[derive(Clone, Debug)]
pub struct ScalingPlan {
    /// Points of a frame that are timed.
    pub points: Vec<usize>,
    /// Numbers of components that are timed.
    pub components: Vec<usize>,
    /// Threads; those above the machine's are left out.
    pub threads: Vec<usize>,
    /// Points where they are not swept.
    pub base_points: usize,
    /// Components where they are not swept.
    pub base_components: usize,
    /// Timed frames of every stop.
    pub repeats: usize,
    /// What was asked for.
    pub options: BenchOptions,
}

impl ScalingPlan {
    /// Up to 2·10⁵ points and 10⁶ components, or 3·10⁵ in the quick form.
    pub fn new(options: BenchOptions) -> Self {
        let mut components = vec![1000, 3000, 10_000, 30_000, 100_000, 300_000];
        if !options.quick {
            components.push(1_000_000);
        }
        let points: &[usize] = if options.quick {
            &[10_000, 50_000, 200_000]
        } else {
            &[10_000, 20_000, 50_000, 100_000, 200_000]
        };
        Self {
            points: points.to_vec(),
            components,
            threads: vec![1, 2, 4, 8, 16, 32, 64],
            base_points: if options.quick { 50_000 } else { 100_000 },
            base_components: 100_000,
            repeats: options.repeats.unwrap_or(if options.quick { 5 } else { 15 }),
            options,
        }
    }

    /// Every size that is timed.
    pub fn stops(&self) -> Vec<ScalingPoint> {
        let all = rayon::current_num_threads();
        let mut threads: Vec<usize> = self.threads.iter().copied().filter(|&t| t < all).collect();
        // More threads than the machine has would time its scheduler.
        threads.push(all);
        let at = |sweep, points, components, threads| ScalingPoint {
            sweep,
            points,
            components,
            threads,
        };
        let (p, n) = (self.base_points, self.base_components);
        let by_points = self.points.iter().map(|&points| at(Sweep::Points, points, n, all));
        let by_components = self.components.iter().map(|&n| at(Sweep::Components, p, n, all));
        let by_threads = threads.into_iter().map(|t| at(Sweep::Threads, p, n, t));
        by_points.chain(by_components).chain(by_threads).collect()
    }
}

/// One size of a sweep.
pub struct ScalingPoint {
    /// Size that is swept.
    pub sweep: Sweep,
    /// Points of the frame.
    pub points: usize,
    /// Number of components N.
    pub components: usize,
    /// Threads of the pool.
    pub threads: usize,
}
