//! Adds a frame's points to the sums of their components.

use super::config::LookRule;
use super::grid::SeedGrid;
use super::ledger::{Ledger, Look, Row, Word};
use crate::math::observation::SurfacePoint;
use crate::math::real::Real;
use crate::math::simd::{Isa, Kernel, Vector};
use crate::model::scene::sums::{MAX_OFFSET, terms};

/// Runs of components that threads take; the points of each are gathered by one thread.
const PARTS: usize = 16;

/// A frame's points with what became of them.
#[derive(Clone, Copy)]
pub struct Matched<'a> {
    /// The points.
    pub points: &'a [SurfacePoint],
    /// Component of each; values beyond the last component mean none.
    pub owners: &'a [u32],
    /// How far each moves along its ray, world units.
    pub shifts: &'a [f32],
    /// Factor on each channel.
    pub gain: [f32; 3],
}

/// Adds every point that has an owner, in whatever order: sums are exact. Replaces `touched` by the
/// owners, ascending.
pub fn accumulate<W: Word>(
    ledger: &mut Ledger<W>,
    grid: &SeedGrid,
    frame: Matched<'_>,
    h: f64,
    looks: LookRule,
    touched: &mut Vec<u32>,
) {
    let parts = std::sync::Mutex::new(Vec::with_capacity(PARTS));
    ledger.for_each_part(PARTS, |first, rows, _| {
        let part = Isa::best().run(Part { first, rows, grid, frame, h, looks });
        if let Ok(mut parts) = parts.lock() {
            parts.push((first, part));
        }
    });
    let mut parts = parts.into_inner().unwrap_or_default();
    parts.sort_unstable_by_key(|(first, _)| *first);
    touched.clear();
    touched.extend(parts.into_iter().flat_map(|(_, ids)| ids));
}

/// The points of consecutive components.
struct Part<'a, W> {
    first: usize,
    rows: &'a mut [Row<W>],
    grid: &'a SeedGrid,
    frame: Matched<'a>,
    h: f64,
    looks: LookRule,
}

impl<W: Word> Kernel for Part<'_, W> {
    type Output = Vec<u32>;

    #[inline(always)]
    fn run<V: Vector>(self) -> Vec<u32> {
        let Self { first, rows, grid, frame, h, looks } = self;
        let mine = first..first + rows.len();
        let mut order: Vec<u64> = Vec::new();
        for (i, &owner) in frame.owners.iter().enumerate() {
            if mine.contains(&(owner as usize)) {
                order.push(u64::from(owner) << 32 | i as u64);
            }
        }
        order.sort_unstable();
        let mut touched = Vec::new();
        for run in order.chunk_by(|a, b| a >> 32 == b >> 32) {
            let id = (run[0] >> 32) as usize;
            let row = &mut rows[id - first];
            let mut returns = 0.0;
            for key in run {
                let i = *key as u32 as usize;
                let point = &frame.points[i];
                add(row, point, frame.shifts[i], frame.gain, grid.position(id), h);
                returns += facing_pixels(point);
            }
            if looks == LookRule::Returned {
                row.look(Look::Seen, h * h * returns / run.len() as f64);
            }
            touched.push(id as u32);
        }
        touched
    }
}

/// Pixels per unit of area of a surface at a point, world units⁻².
#[inline(always)]
fn facing_pixels(point: &SurfacePoint) -> f64 {
    let (n, d) = (point.normal.map(f64::from), point.direction.map(f64::from));
    let facing = -(n[0] * d[0] + n[1] * d[1] + n[2] * d[2]);
    facing / f64::from(point.footprint).powi(2)
}

#[inline(always)]
fn add<W: Word>(
    row: &mut Row<W>,
    point: &SurfacePoint,
    shift: f32,
    gain: [f32; 3],
    seed: [f32; 3],
    h: f64,
) {
    let real = |x: f32| W::Term::of(f64::from(x));
    let per_h = W::Term::of(1.0 / h);
    let offset = [0, 1, 2].map(|i| {
        let offset = real(point.position[i]) - real(seed[i]) + real(shift) * real(point.direction[i]);
        clamp(offset * per_h, MAX_OFFSET)
    });
    let color = [0, 1, 2].map(|i| real((point.color[i] * gain[i]).min(1.0)));
    row.add(&terms(point, offset, color));
}

#[inline(always)]
fn clamp<R: Real>(value: R, most: f32) -> R {
    let most = R::of(f64::from(most));
    if value > most {
        most
    } else if value < -most {
        -most
    } else {
        value
    }
}
