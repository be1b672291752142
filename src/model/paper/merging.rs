//! Addition of the totals of models that have the same initial model but were trained on different
//! points. It is exact: merging in any order gives bit-identical results.

use super::state::{Carry, Totals};
use super::total_scalar::TotalScalar;
use crate::math::real::Real;
use crate::model::conjugate::statistics::{Moments, N_SUMS, TileRecord};
use std::collections::BTreeMap;

/// Reasons why totals cannot be added.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum AddError {
    /// The totals differ in number format, number of components or origin.
    #[error("totals of different forms, numbers of components or origins cannot be added")]
    Unlike,
    /// A sum exceeds the range of its number format.
    #[error("a sum of component {component} exceeds the range of its form")]
    Overflow {
        /// Index of the component.
        component: usize,
    },
}

/// Adds two totals of equal number format and length.
///
/// ```
/// use vbgs_studio::model::paper::merging::add;
/// use vbgs_studio::model::paper::state::Totals;
/// use vbgs_studio::model::conjugate::statistics::N_SUMS;
///
/// let of = |quanta| Totals::Fixed128(vec![[quanta; N_SUMS]]);
/// assert_eq!(add(&of(2), &of(3)), Ok(of(5)));
/// assert!(add(&of(2), &Totals::Fixed128(Vec::new())).is_err());
/// ```
pub fn add(a: &Totals, b: &Totals) -> Result<Totals, AddError> {
    match (a, b) {
        (
            Totals::Fixed64 { rows: a, carries: carries_a },
            Totals::Fixed64 { rows: b, carries: carries_b },
        ) if a.len() == b.len() => add_fixed64(a, carries_a, b, carries_b),
        (Totals::Fixed128(a), Totals::Fixed128(b)) if a.len() == b.len() => {
            let add_rows = |(component, (a, b)): (usize, (&[i128; N_SUMS], &[i128; N_SUMS]))| {
                let mut row = *a;
                for (sum, term) in row.iter_mut().zip(b) {
                    *sum = sum.checked_add(*term).ok_or(AddError::Overflow { component })?;
                }
                Ok(row)
            };
            let rows: Result<_, _> = a.iter().zip(b).enumerate().map(add_rows).collect();
            Ok(Totals::Fixed128(rows?))
        }
        _ => Err(AddError::Unlike),
    }
}

fn add_fixed64(
    a: &[[i64; N_SUMS]],
    carries_a: &[Carry],
    b: &[[i64; N_SUMS]],
    carries_b: &[Carry],
) -> Result<Totals, AddError> {
    // Wider than the stored limbs, so that adding two cannot overflow before the range check.
    // Ordered by id, as carries are stored.
    let mut limbs: BTreeMap<u32, [i64; N_SUMS]> = BTreeMap::new();
    for carry in carries_a.iter().chain(carries_b) {
        let sums = limbs.entry(carry.id).or_default();
        sums.iter_mut().zip(carry.limbs).for_each(|(sum, limb)| *sum += i64::from(limb));
    }
    let mut rows = a.to_vec();
    for (component, (row, b)) in rows.iter_mut().zip(b).enumerate() {
        for (i, (sum, &term)) in row.iter_mut().zip(b).enumerate() {
            let (wrapped, overflows) = sum.overflowing_add(term);
            if overflows {
                // Wrapping removed exactly one limb from the row, with the sign of the terms.
                limbs.entry(component as u32).or_default()[i] += term.signum();
            }
            *sum = wrapped;
        }
    }
    let carry = |(id, limbs): (u32, [i64; N_SUMS])| {
        let mut carry = Carry { id, limbs: [0; N_SUMS] };
        for (to, from) in carry.limbs.iter_mut().zip(limbs) {
            let overflow = AddError::Overflow { component: id as usize };
            *to = i32::try_from(from).map_err(|_| overflow)?;
        }
        Ok(carry)
    };
    // Limbs that cancelled are not stored: equal sums then have equal bits.
    let any = |(_, limbs): &(u32, [i64; N_SUMS])| limbs.iter().any(|&limb| limb != 0);
    let carries: Result<_, _> = limbs.into_iter().filter(any).map(carry).collect();
    Ok(Totals::Fixed64 { rows, carries: carries? })
}

// Records whose rows are prefetched together. With the frame stamp in the first cache line this is two to
// three times as fast as row by row.
const ROWS_AHEAD: usize = 16;

pub(super) struct TotalShard<T: TotalScalar> {
    pub rows: Vec<TotalRow<T>>,
    /// High limbs (bits above the low 64) by component id, for components with a sum outside the range
    /// of its row.
    pub carries: BTreeMap<u32, [i32; N_SUMS]>,
    /// Bit `i` of word `j` is set if row `64 j + i` has received points.
    pub used: Vec<u64>,
    pub n_used: usize,
    /// Ids of the rows changed by the current frame, each once.
    pub touched: Vec<u32>,
}

/// Sums of one component, with a frame stamp; two cache lines in 64-bit form.
#[derive(Clone, Copy)]
// `C` keeps the stamp in front: it is read together with the first sums, on one cache line.
#[repr(C, align(64))]
pub(super) struct TotalRow<T> {
    /// Number of the frame that last changed the row.
    frame: u32,
    /// Sums in the order listed at [`N_SUMS`]; only their low bits if the component has high limbs.
    pub sums: [T; N_SUMS],
}

pub(super) fn row_bytes<T: TotalScalar>(_: &[TotalShard<T>]) -> usize {
    size_of::<TotalRow<T>>()
}

impl<T: TotalScalar> TotalShard<T> {
    pub fn new(len: usize) -> Self {
        Self {
            rows: vec![TotalRow { frame: 0, sums: [T::default(); N_SUMS] }; len],
            carries: BTreeMap::new(),
            used: vec![0; len.div_ceil(64)],
            n_used: 0,
            // Reserved for all rows, so that a warm frame allocates nothing.
            touched: Vec::with_capacity(len),
        }
    }

    /// Resets the frame stamps of all rows.
    pub fn reset_frame_stamps(&mut self) {
        self.rows.iter_mut().for_each(|row| row.frame = 0);
    }

    /// Adds the records of one frame to the rows of this shard, whose first row belongs to component
    /// `first`.
    pub fn add_frame<R: Real>(
        &mut self,
        frame: u32,
        first: usize,
        records: impl FnOnce(&mut dyn FnMut(&[TileRecord<R>])),
    ) {
        self.touched.clear();
        records(&mut |records| self.add_records(frame, first, records));
    }

    /// Adds records in groups. All rows of a group are prefetched before any of them is changed, which
    /// hides memory latency.
    #[inline(always)]
    fn add_records<R: Real>(&mut self, frame: u32, first: usize, records: &[TileRecord<R>]) {
        for records in records.chunks(ROWS_AHEAD) {
            for record in records {
                self.prefetch_and_mark(frame, record.id as usize - first, record);
            }
            for record in records {
                self.add(record.id as usize - first, record);
            }
        }
    }

    #[inline(always)]
    fn prefetch_and_mark<R: Real>(&mut self, frame: u32, place: usize, record: &TileRecord<R>) {
        let row = &mut self.rows[place];
        // The value is not used: reading it fetches the row's second cache line.
        std::hint::black_box(row.sums[N_SUMS - 1]);
        let is_new = row.frame != frame;
        if is_new && !T::rounds_to_zero(record.sums[0].to_f64()) {
            row.frame = frame;
            self.touched.push(record.id);
            self.mark_used(place);
        }
    }

    #[inline(always)]
    fn add<R: Real>(&mut self, place: usize, record: &TileRecord<R>) {
        let sums = record.sums.map(R::to_f64);
        // All or nothing: otherwise a component that counts as unused would have moments.
        if T::rounds_to_zero(sums[0]) {
            return;
        }
        if let Some(limbs) = T::add(&mut self.rows[place].sums, &sums) {
            let carry = self.carries.entry(record.id).or_insert([0; N_SUMS]);
            // A limb is 2⁶⁴ quanta: only broken coordinates reach the end of its range.
            carry.iter_mut().zip(limbs).for_each(|(c, l)| *c = c.saturating_add(l));
        }
    }

    pub fn mark_used(&mut self, place: usize) {
        let (word, bit) = (&mut self.used[place / 64], 1 << (place % 64));
        self.n_used += usize::from(*word & bit == 0);
        *word |= bit;
    }

    /// Returns the statistics of one component of this shard, about its initial mean.
    pub fn moments(&self, component: usize, shard_bits: u32) -> Moments {
        // The number of components per shard is a power of two, so the low bits are the row.
        let row = &self.rows[component & ((1 << shard_bits) - 1)];
        let none = [0; N_SUMS];
        // Few models have carries at all: this avoids a lookup per component.
        let limbs = match self.carries.is_empty() {
            true => &none,
            false => self.carries.get(&(component as u32)).unwrap_or(&none),
        };
        Moments::from_sums(std::array::from_fn(|i| row.sums[i].value(limbs[i], i)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn fixed64(value: i128) -> Totals {
        let row = value as i64;
        let limb = ((value - i128::from(row)) >> 64) as i32;
        let carry = (limb != 0).then_some(Carry { id: 0, limbs: [limb; N_SUMS] });
        Totals::Fixed64 { rows: vec![[row; N_SUMS]], carries: carry.into_iter().collect() }
    }

    proptest! {
        #[test]
        fn sums_with_carries_are_exact(
            a in -(1i128 << 90)..1i128 << 90,
            b in -(1i128 << 66)..1i128 << 66,
        ) {
            prop_assert_eq!(add(&fixed64(a), &fixed64(b)), Ok(fixed64(a + b)));
            let wide = |v| Totals::Fixed128(vec![[v; N_SUMS]]);
            prop_assert_eq!(add(&wide(a), &wide(b)), Ok(wide(a + b)));
        }
    }

    #[test]
    fn carries_come_and_go() {
        let edge = i128::from(i64::MAX);
        assert_eq!(add(&fixed64(edge), &fixed64(1)), Ok(fixed64(edge + 1)));
        assert_eq!(add(&fixed64(edge + 1), &fixed64(-1)), Ok(fixed64(edge)));
        assert_eq!(add(&fixed64(1 << 80), &fixed64(-(1 << 80))), Ok(fixed64(0)));
    }

    #[test]
    fn what_cannot_be_added() {
        let wide = Totals::Fixed128(vec![[0; N_SUMS]]);
        assert_eq!(add(&wide, &fixed64(0)), Err(AddError::Unlike));
        assert_eq!(
            add(&Totals::Fixed128(Vec::new()), &Totals::Fixed128(vec![[0; N_SUMS]])),
            Err(AddError::Unlike)
        );
        let most = Totals::Fixed128(vec![[i128::MAX; N_SUMS]]);
        assert_eq!(add(&most, &most), Err(AddError::Overflow { component: 0 }));
        let most = fixed64(i128::from(i32::MAX) << 64);
        assert_eq!(add(&most, &most), Err(AddError::Overflow { component: 0 }));
    }
}
