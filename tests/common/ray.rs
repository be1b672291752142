//! A Gaussian along a ray, evaluated numerically: maximum by search, integral by quadrature. Uses no closed
//! form, so the results are independent of the renderers' formulas.

use super::oracle::SplatF64;
use glam::{DMat3, DVec3};

/// Steps of the golden-section search. Each leaves 0.618 of the interval, so 2e-15 of it remains.
const SEARCH_STEPS: usize = 70;
/// Distance behind the mean at which the search ends, in largest standard deviations. The Gaussian is at most
/// e^−32 there.
const REACH: f64 = 8.0;
/// Half the range of the quadrature, standard deviations. The density outside is below e^−50.
const HALF_RANGE: f64 = 10.0;
/// Panels of the quadrature over that range.
const N_PANELS: usize = 8;

/// The Gaussian of a splat along `origin + t·direction`.
pub struct GaussianOnRay {
    from_mean: DVec3,
    direction: DVec3,
    axes: DMat3,
    scale: DVec3,
    reach: f64,
}

impl GaussianOnRay {
    /// `direction` is a unit vector; all in world units.
    pub fn new(splat: &SplatF64, origin: DVec3, direction: DVec3) -> Self {
        let from_mean = origin - splat.mean;
        Self {
            from_mean,
            direction,
            axes: DMat3::from_quat(splat.rotation.normalize()),
            scale: splat.scale,
            reach: from_mean.length() + REACH * splat.scale.max_element(),
        }
    }

    /// Density at a distance along the ray, 1 at the mean.
    pub fn density(&self, distance: f64) -> f64 {
        (-0.5 * self.mahalanobis2(distance)).exp()
    }

    /// Squared Mahalanobis distance from the mean at a distance along the ray.
    fn mahalanobis2(&self, distance: f64) -> f64 {
        self.deviations(self.from_mean + self.direction * distance).length_squared()
    }

    /// Converts a vector to standard deviations along each axis.
    fn deviations(&self, v: DVec3) -> DVec3 {
        DVec3::new(self.axes.x_axis.dot(v), self.axes.y_axis.dot(v), self.axes.z_axis.dot(v))
            / self.scale
    }

    /// Distance of the largest density on the ray, starting at its origin, and that density.
    pub fn maximum(&self) -> (f64, f64) {
        self.maximum_from(0.0)
    }

    /// Like [`Self::maximum`], but on the whole line.
    pub fn maximum_of_line(&self) -> (f64, f64) {
        self.maximum_from(-self.reach)
    }

    /// Searches from `start` to the reach by golden section.
    fn maximum_from(&self, start: f64) -> (f64, f64) {
        let share = 0.5 * (5f64.sqrt() - 1.0);
        let (mut lo, mut hi) = (start, self.reach);
        let mut inner = [hi - share * (hi - lo), lo + share * (hi - lo)];
        let mut values = inner.map(|t| self.mahalanobis2(t));
        for _ in 0..SEARCH_STEPS {
            if values[0] <= values[1] {
                hi = inner[1];
                inner = [hi - share * (hi - lo), inner[0]];
                values = [self.mahalanobis2(inner[0]), values[0]];
            } else {
                lo = inner[0];
                inner = [inner[1], lo + share * (hi - lo)];
                values = [values[1], self.mahalanobis2(inner[1])];
            }
        }
        // The search approaches the ends of the interval but never evaluates them.
        let candidates = [lo, inner[0], inner[1], hi].map(|t| (t, self.mahalanobis2(t)));
        let best = candidates.into_iter().min_by(|a, b| a.1.total_cmp(&b.1)).unwrap();
        (best.0, (-0.5 * best.1).exp())
    }

    /// Integral of the density over the line near `peak`, in standard deviations along the line, divided by
    /// `√2π`; `None` if part of the range lies behind the origin.
    pub fn integral_ahead(&self, peak: f64) -> Option<f64> {
        let half = HALF_RANGE / self.deviations_per_unit();
        (peak >= half).then(|| self.integral_around(peak))
    }

    /// Like [`Self::integral_ahead`], for any origin.
    pub fn integral_around(&self, peak: f64) -> f64 {
        let per_unit = self.deviations_per_unit();
        let half = HALF_RANGE / per_unit;
        let panel = half / N_PANELS as f64;
        let sum: f64 = (0..N_PANELS)
            .flat_map(|i| GAUSS_LEGENDRE.map(|node| (i, node)))
            .map(|(i, (x, weight))| {
                let middle = peak - half + panel * (2 * i + 1) as f64;
                let pair = self.density(middle - panel * x) + self.density(middle + panel * x);
                weight * panel * pair
            })
            .sum();
        sum * per_unit / std::f64::consts::TAU.sqrt()
    }

    fn deviations_per_unit(&self) -> f64 {
        self.deviations(self.direction).length()
    }
}

/// Positive nodes and weights of the 16-point Gauss–Legendre rule on [−1, 1].
const GAUSS_LEGENDRE: [(f64, f64); 8] = [
    (0.095_012_509_837_637_44, 0.189_450_610_455_068_5),
    (0.281_603_550_779_258_9, 0.182_603_415_044_923_6),
    (0.458_016_777_657_227_4, 0.169_156_519_395_002_54),
    (0.617_876_244_402_643_7, 0.149_595_988_816_576_73),
    (0.755_404_408_355_003, 0.124_628_971_255_533_87),
    (0.865_631_202_387_831_7, 0.095_158_511_682_492_78),
    (0.944_575_023_073_232_6, 0.062_253_523_938_647_89),
    (0.989_400_934_991_649_9, 0.027_152_459_411_754_09),
];
