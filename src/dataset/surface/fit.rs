//! Robust plane fit, eight pixels at a time (`dataset.md`, Plane fit).
//!
//! Inverse depths are relative to the pixel's own and in units of `q / z²`, where `q` is the half-width
//! of the noise at depth `z`. So thresholds are the same for every pixel, and f32 precision is not spent
//! on the depth itself. The sums of the normal equations are integers, so their determinant is exact.
//!
//! One lane is one pixel. Its window is read by unaligned loads from planes with an empty border, so
//! lanes never branch on their position. The depth gate excludes neighbours whose depth differs too much
//! from the pixel's. Their residual is set beyond every limit, so later rounds need not test the gate
//! again.
//!
//! Two variants were tested on the Lego scene and rejected (`dataset.md`, Plane fit): windows of other
//! sizes, and points weighted by the cosine of their slant or its square instead of a threshold.

use super::planes::{NOTHING, Planes, load};
use super::sensor::Profile;
use super::settings::{MIN_INLIERS, MIN_SHARE, PixelSampling, RADIUS, ROUNDS};
use crate::math::simd::{Kernel, LANES, SET_LANE, Vector};
use std::ops::Range;

const SIDE: usize = 2 * RADIUS + 1;
const WINDOW: usize = SIDE * SIDE;
/// Residual assigned to neighbours outside the depth gate; larger than every other residual.
const FAR: f32 = 1e30;
/// Limit that is larger than the residual of every neighbour inside the depth gate, and smaller than
/// [`FAR`].
const ANY: f32 = 1e29;

/// Fitted planes of some rows of pixels, in blocks of eight sampled pixels.
#[derive(Clone, Debug, Default)]
pub(super) struct Fitted {
    /// Bit `i` of a block is set if its pixel `i` is usable.
    pub usable: Vec<u8>,
    /// Bit `i` of a block is set if its pixel `i` is usable and its plane fit is accepted.
    pub accepted: Vec<u8>,
    /// Fitted inverse depth at the pixel divided by the measured one, minus 1.
    pub excess: Vec<f32>,
    /// Change of the plane's inverse depth per column, divided by the measured inverse depth at the
    /// pixel.
    pub step_x: Vec<f32>,
    /// Change of the plane's inverse depth per row, divided by the measured inverse depth at the pixel.
    pub step_y: Vec<f32>,
}

/// Fits planes to the sampled pixels of some rows. Entries of `out` for unusable pixels and skipped rows
/// are undefined.
pub(super) struct FitRows<'a> {
    pub planes: &'a Planes,
    pub rows: Range<usize>,
    pub sampling: PixelSampling,
    pub profile: &'a Profile,
    pub out: &'a mut Fitted,
}

impl Kernel for FitRows<'_> {
    type Output = ();

    #[inline(always)]
    fn run<V: Vector>(self) {
        match self.sampling.step() {
            1 => self.fit::<V, 1>(),
            _ => self.fit::<V, 2>(),
        }
    }
}

impl FitRows<'_> {
    #[inline(always)]
    fn fit<V: Vector, const STEP: usize>(self) {
        let Self { planes, rows, sampling, profile, out } = self;
        let t = &profile.thresholds;
        let limits = Limits {
            steepness: V::splat(profile.steepness as f32),
            inlier: V::splat(t.inlier as f32),
            square: V::splat((t.residual * t.residual) as f32),
            deviation: V::splat(t.deviation as f32),
        };
        let blocks = planes.blocks(STEP);
        out.resize(rows.len() * blocks);
        // Rows of tiles start at even rows.
        for (line, row) in rows.enumerate().step_by(sampling.step()) {
            for block in 0..blocks {
                let at = planes.at(block * LANES * STEP, row);
                // NOTHING is the largest f32; every valid depth is below half of it.
                let usable = load::<V, STEP>(&planes.z[at..]).at_most(V::splat(0.5 * NOTHING));
                let to = line * blocks + block;
                out.usable[to] = usable as u8;
                if usable != 0 {
                    out.accepted[to] =
                        fit_block::<V, STEP>(planes, at, usable, &limits, out, to * LANES) as u8;
                }
            }
        }
    }
}

impl Fitted {
    fn resize(&mut self, blocks: usize) {
        // Never shrinks: `usable` masks stale entries of an earlier frame.
        if self.accepted.len() < blocks {
            self.usable.resize(blocks, 0);
            self.accepted.resize(blocks, 0);
            for plane in [&mut self.excess, &mut self.step_x, &mut self.step_y] {
                plane.resize(blocks * LANES, 0.0);
            }
        }
    }
}

struct Limits<V> {
    steepness: V,
    inlier: V,
    square: V,
    deviation: V,
}

/// Fits planes to eight pixels, taking every `STEP`-th from `at`. Returns the usable lanes whose plane
/// is accepted.
#[inline(always)]
fn fit_block<V: Vector, const STEP: usize>(
    planes: &Planes,
    at: usize,
    usable: u32,
    limits: &Limits<V>,
    out: &mut Fitted,
    to: usize,
) -> u32 {
    let noise = load::<V, STEP>(&planes.noise[at..]);
    let inverse = load::<V, STEP>(&planes.inverse[at..]);
    let residuals = window::<V, STEP>(planes, at, noise, limits.steepness);
    let gated = [V::splat(0.0); 3];
    // The common case inside a surface: only the sums of depths are unknown.
    let mut is_whole = usable & !within(&residuals, gated, V::splat(ANY)) == 0;
    let mut sums = match is_whole {
        true => whole(&residuals),
        false => inliers(&residuals, gated, V::splat(ANY)),
    };
    // Accumulated over the rounds: too few inliers in one round reject a pixel even if a later one has enough.
    let mut sound = usable & sums.are_enough();
    let mut plane = sums.solve();
    for _ in 1..ROUNDS {
        // All neighbours are inliers: the sums would be the same as over the whole window.
        if is_whole && usable & !within(&residuals, plane, limits.inlier) == 0 {
            break;
        }
        let next = inliers(&residuals, plane, limits.inlier);
        sound &= next.are_enough();
        // If no inlier was lost, another round would yield the same plane.
        let is_settled = usable & !sums.n.at_most(next.n) == 0;
        (sums, is_whole) = (next, false);
        plane = sums.solve();
        if is_settled {
            break;
        }
    }
    // From units of q / z² to multiples of 1 / z.
    let unit = noise * inverse;
    let [excess, step_x, step_y] = [plane[0] * unit, plane[1] * unit, plane[2] * unit];
    excess.store(&mut out.excess[to..]);
    step_x.store(&mut out.step_x[to..]);
    step_y.store(&mut out.step_y[to..]);
    // Compared with an integer count, so rounding of the share is harmless.
    let least = V::splat((MIN_SHARE * WINDOW as f64) as f32);
    // |1/A − z| ≤ dev·q, times A/z.
    let near = abs(excess).at_most(limits.deviation * unit * (V::splat(1.0) + excess));
    let smooth = sums.residual(plane).at_most(limits.square * sums.n);
    sound & least.at_most(sums.n) & near & smooth
}

/// Returns the inverse depths in the windows around eight pixels, relative to the pixels' own. The unit
/// is `q / z²`, where `q` is the noise half-width. Neighbours outside the depth gate have the value
/// [`FAR`].
#[inline(always)]
fn window<V: Vector, const STEP: usize>(
    planes: &Planes,
    at: usize,
    noise: V,
    steepness: V,
) -> [V; WINDOW] {
    let z = load::<V, STEP>(&planes.z[at..]);
    let inverse = load::<V, STEP>(&planes.inverse[at..]);
    let per_unit = z * z / noise;
    let far = V::splat(FAR);
    // Wider with distance: depth on a slanted plane departs from the pixel's with every step, and the tilt
    // is unknown in the first round.
    let mut gates = [noise * V::splat(1.5); RADIUS + 1];
    for (distance, gate) in gates.iter_mut().enumerate().skip(1) {
        let distance = V::splat(distance as f32);
        *gate = noise * (V::splat(1.5) + V::splat(0.6) * distance) + steepness * distance * z;
    }
    let mut residuals = [far; WINDOW];
    for row in 0..SIDE {
        let start = at + row * planes.stride - RADIUS * planes.stride - RADIUS;
        let depths = &planes.z[start..start + SIDE - 1 + STEP * LANES];
        let inverses = &planes.inverse[start..start + SIDE - 1 + STEP * LANES];
        for column in 0..SIDE {
            let gate = gates[row.abs_diff(RADIUS).max(column.abs_diff(RADIUS))];
            let inside = abs(load::<V, STEP>(&depths[column..]) - z).mask_at_most(gate);
            let residual = (load::<V, STEP>(&inverses[column..]) - inverse) * per_unit;
            residuals[row * SIDE + column] = V::select(inside, residual, far);
        }
    }
    residuals
}

/// Sums over the inliers of eight pixels. `n` counts inliers, `a` and `b` are column and row offsets,
/// and `d` are inverse depths.
struct Sums<V> {
    n: V,
    a: V,
    b: V,
    aa: V,
    ab: V,
    bb: V,
    d: V,
    ad: V,
    bd: V,
    dd: V,
}

/// Returns the inverse depths of a plane in one row of the window, `offset` rows below the pixel.
#[inline(always)]
fn expected<V: Vector>([middle, step, step_down]: [V; 3], offset: V) -> [V; SIDE] {
    // Written out for a window of five columns: another radius needs other moments in `Sums`.
    let (double_step, centre) = (step + step, middle + offset * step_down);
    [centre - double_step, centre - step, centre, centre + step, centre + double_step]
}

/// Returns the lanes in which every residual of the window differs from `plane` by at most `limit`.
#[inline(always)]
fn within<V: Vector>(residuals: &[V; WINDOW], plane: [V; 3], limit: V) -> u32 {
    let mut inside = V::splat(SET_LANE);
    for row in 0..SIDE {
        let expected = expected(plane, V::splat(row as f32 - RADIUS as f32));
        for column in 0..SIDE {
            let residual = residuals[row * SIDE + column];
            inside = inside.and(abs(residual - expected[column]).mask_at_most(limit));
        }
    }
    inside.sign_bits()
}

#[inline(always)]
fn inliers<V: Vector>(residuals: &[V; WINDOW], plane: [V; 3], limit: V) -> Sums<V> {
    let (zero, one) = (V::splat(0.0), V::splat(1.0));
    let mut sums = Sums::none();
    for row in 0..SIDE {
        let offset = V::splat(row as f32 - RADIUS as f32);
        let expected = expected(plane, offset);
        let mut count = [zero; SIDE];
        let mut depths = [zero; SIDE];
        for column in 0..SIDE {
            let residual = residuals[row * SIDE + column];
            let inside = abs(residual - expected[column]).mask_at_most(limit);
            count[column] = one.and(inside);
            depths[column] = residual.and(inside);
        }
        sums.add(offset, count, depths);
    }
    sums
}

/// Returns the sums over all pixels of the window, added in the same order as by [`inliers`].
#[inline(always)]
fn whole<V: Vector>(residuals: &[V; WINDOW]) -> Sums<V> {
    let mut sums = Sums::none();
    for (row, depths) in residuals.as_chunks::<SIDE>().0.iter().enumerate() {
        let offset = V::splat(row as f32 - RADIUS as f32);
        // The same order of additions gives the same bits, whichever path a window takes.
        sums.add(offset, [V::splat(1.0); SIDE], *depths);
    }
    sums
}

impl<V: Vector> Sums<V> {
    #[inline(always)]
    fn none() -> Self {
        let zero = V::splat(0.0);
        let ([n, a, b, aa, ab, bb], [d, ad, bd, dd]) = ([zero; 6], [zero; 4]);
        Self { n, a, b, aa, ab, bb, d, ad, bd, dd }
    }

    /// Adds a row of the window. `count` is 1 and `depths` is the inverse depth for each inlier; both
    /// are 0 for other pixels. Column offsets are −2 to 2, so the row's moments are sums and
    /// differences.
    #[inline(always)]
    fn add(&mut self, offset: V, count: [V; SIDE], depths: [V; SIDE]) {
        let (n, a) = (total(count), first_moment(count));
        let (d, ad) = (total(depths), first_moment(depths));
        let aa = (count[4] + count[0]) * V::splat(4.0) + (count[3] + count[1]);
        self.n = self.n + n;
        self.a = self.a + a;
        self.aa = self.aa + aa;
        self.b = self.b + offset * n;
        self.ab = self.ab + offset * a;
        self.bb = self.bb + offset * offset * n;
        self.d = self.d + d;
        self.ad = self.ad + ad;
        self.bd = self.bd + offset * d;
        for depth in depths {
            self.dd = self.dd + depth * depth;
        }
    }

    #[inline(always)]
    fn are_enough(&self) -> u32 {
        let [c00, c01, c02] = self.first_row();
        let determinant = self.n * c00 + self.a * c01 + self.b * c02;
        // The determinant is an integer: 0 means that all neighbours are collinear.
        V::splat(MIN_INLIERS as f32).at_most(self.n) & V::splat(0.5).at_most(determinant)
    }

    #[inline(always)]
    fn first_row(&self) -> [V; 3] {
        [
            self.aa * self.bb - self.ab * self.ab,
            self.ab * self.b - self.a * self.bb,
            self.a * self.ab - self.aa * self.b,
        ]
    }

    /// Returns the least-squares plane: inverse depth at the pixel, and its change per column and per
    /// row. NaN if undetermined.
    #[inline(always)]
    fn solve(&self) -> [V; 3] {
        let [c00, c01, c02] = self.first_row();
        let c11 = self.n * self.bb - self.b * self.b;
        let c12 = self.a * self.b - self.n * self.ab;
        let c22 = self.n * self.aa - self.a * self.a;
        let determinant = self.n * c00 + self.a * c01 + self.b * c02;
        [
            (c00 * self.d + c01 * self.ad + c02 * self.bd) / determinant,
            (c01 * self.d + c11 * self.ad + c12 * self.bd) / determinant,
            (c02 * self.d + c12 * self.ad + c22 * self.bd) / determinant,
        ]
    }

    #[inline(always)]
    fn residual(&self, plane: [V; 3]) -> V {
        // At the least-squares plane, the sum of squares decreases by exactly this product.
        self.dd - (plane[0] * self.d + plane[1] * self.ad + plane[2] * self.bd)
    }
}

#[inline(always)]
fn total<V: Vector>([a, b, c, d, e]: [V; SIDE]) -> V {
    (a + b) + (d + e) + c
}

/// Returns the sum of the values times their offsets from the middle, −2 to 2.
#[inline(always)]
fn first_moment<V: Vector>(values: [V; SIDE]) -> V {
    (values[4] - values[0]) * V::splat(2.0) + (values[3] - values[1])
}

#[inline(always)]
fn abs<V: Vector>(v: V) -> V {
    // Clears the sign bit.
    v.and(V::splat(f32::from_bits(0x7FFF_FFFF)))
}
