//! Sufficient statistics, centred about the initial means and summed in fixed point.

use crate::math::fixed::{from_fixed, to_fixed};
use crate::math::real::Real;
use crate::math::sym3::Sym3;
use crate::model::state::Totals;
use glam::DVec3;

/// Sums per component: `N`, `a' = Σ r d` (3), `B' = Σ r d dᵀ` (6), `b = Σ r c` (3), where
/// `d = s − m_k` (`model.md` 7 and 15).
pub const N_SUMS: usize = 13;

/// Sums of one component over one tile of points, not yet rounded to fixed point.
#[derive(Clone, Copy, Debug)]
pub struct Record<R> {
    /// Component.
    pub id: u32,
    /// In the order of [`N_SUMS`].
    pub sums: [R; N_SUMS],
}

impl<R: Real> Record<R> {
    /// No points yet.
    pub fn empty(id: u32) -> Self {
        Self { id, sums: [R::ZERO; N_SUMS] }
    }

    /// Adds a point of responsibility `r` at offset `d` from the component's initial mean.
    #[inline(always)]
    pub fn add(&mut self, r: R, d: [R; 3], color: [R; 3]) {
        let rd = d.map(|v| r * v);
        let terms = [
            r,
            rd[0],
            rd[1],
            rd[2],
            rd[0] * d[0],
            rd[0] * d[1],
            rd[0] * d[2],
            rd[1] * d[1],
            rd[1] * d[2],
            rd[2] * d[2],
            r * color[0],
            r * color[1],
            r * color[2],
        ];
        for (sum, term) in self.sums.iter_mut().zip(terms) {
            *sum += term;
        }
    }
}

/// Statistics of one component in f64, still centred about its initial mean.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Moments {
    /// `N_k = Σ r`.
    pub count: f64,
    /// `a' = Σ r (s − m_k)`.
    pub first: DVec3,
    /// `B' = Σ r (s − m_k)(s − m_k)ᵀ`.
    pub second: Sym3,
    /// `b = Σ r c`.
    pub color: DVec3,
}

impl Moments {
    /// Raw moments about the origin, `a = a' + N m` and `B = B' + a'mᵀ + m a'ᵀ + N m mᵀ`.
    pub fn raw(&self, mean_init: DVec3) -> (DVec3, Sym3) {
        let (a, m) = (self.first.to_array(), mean_init.to_array());
        let cross = |i: usize, j: usize| a[i] * m[j] + m[i] * a[j] + self.count * m[i] * m[j];
        let shift = [cross(0, 0), cross(0, 1), cross(0, 2), cross(1, 1), cross(1, 2), cross(2, 2)];
        (self.first + mean_init * self.count, self.second.add_scaled(1.0, Sym3::from_array(shift)))
    }
}

/// Totals of all components over everything seen so far.
///
/// Integer totals make the sum exact and associative: any frame order, thread count or sharding
/// gives the same bits as long as the initial model is the same.
#[derive(Clone, Debug, PartialEq)]
pub struct Statistics {
    totals: Vec<[i128; N_SUMS]>,
    used: usize,
}

impl Statistics {
    /// Nothing seen.
    pub fn new(components: usize) -> Self {
        Self { totals: vec![[0; N_SUMS]; components], used: 0 }
    }

    /// Number of components.
    pub fn len(&self) -> usize {
        self.totals.len()
    }

    /// Whether there are no components.
    pub fn is_empty(&self) -> bool {
        self.totals.is_empty()
    }

    /// Components with `N_k > 0`.
    pub fn used(&self) -> usize {
        self.used
    }

    /// Whether a component has received anything.
    #[inline]
    pub fn is_used(&self, component: usize) -> bool {
        self.totals[component][0] > 0
    }

    /// Adds one record; the id must be below [`Statistics::len`].
    #[inline]
    pub fn add<R: Real>(&mut self, record: &Record<R>) {
        let totals = &mut self.totals[record.id as usize];
        let was_used = totals[0] > 0;
        for (total, &sum) in totals.iter_mut().zip(&record.sums) {
            *total += to_fixed(sum.to_f64());
        }
        self.used += usize::from(!was_used && totals[0] > 0);
    }

    /// Totals as they stood.
    pub fn restore(totals: Totals) -> Self {
        let Totals::Fixed128(totals) = totals else {
            unimplemented!("follows with the other forms")
        };
        let used = totals.iter().filter(|row| row[0] > 0).count();
        Self { totals, used }
    }

    /// The totals as they stand.
    pub fn state(&self) -> Totals {
        Totals::Fixed128(self.totals.clone())
    }

    /// Statistics of one component.
    pub fn moments(&self, component: usize) -> Moments {
        let t = self.totals[component].map(from_fixed);
        Moments {
            count: t[0],
            first: DVec3::new(t[1], t[2], t[3]),
            second: Sym3::from_array([t[4], t[5], t[6], t[7], t[8], t[9]]),
            color: DVec3::new(t[10], t[11], t[12]),
        }
    }
}
