//! Totals of all components over everything seen so far.
//!
//! Fixed-point totals make the sum exact and associative: any frame order, thread count or sharding
//! gives the same bits as long as the initial model is the same. Components are split into shards
//! by id, so that threads can add without sharing a row.

use super::state::{Carry, Totals};
use super::statistics::{Moments, N_SUMS, Record};
use crate::math::fixed::{Split, from_fixed, to_fixed, to_quanta};
use crate::math::real::Real;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Most shards; a power of two.
const MAX_SHARDS: usize = 64;

/// Fraction bits of every sum in 64-bit totals (`engine.md` 6): counts and colours reach 1.3e8
/// before they carry, second moments resolve a standard deviation of 6e-8.
const FRACTION_BITS: [u32; N_SUMS] = [36, 40, 40, 40, 48, 48, 48, 48, 48, 48, 36, 36, 36];

/// How totals over all frames are kept.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum UpdateWidth {
    /// Single precision; not invariant to the order of frames.
    F32,
    /// 64-bit fixed point with a carry.
    Fixed64,
    /// 128-bit fixed point.
    Fixed128,
}

/// Totals of all components.
pub struct Statistics {
    form: Form,
    components: usize,
    /// Binary logarithm of the components in a shard.
    shard_bits: u32,
    used: usize,
    touched: Vec<u32>,
    frame: u32,
}

enum Form {
    F32(Vec<Shard<f32>>),
    Fixed64(Vec<Shard<i64>>),
    Fixed128(Vec<Shard<i128>>),
}

macro_rules! any_form {
    ($form:expr, $shards:ident => $body:expr) => {
        match $form {
            Form::F32($shards) => $body,
            Form::Fixed64($shards) => $body,
            Form::Fixed128($shards) => $body,
        }
    };
}

/// Rows of consecutive components.
struct Shard<T: Total> {
    rows: Vec<Row<T>>,
    carries: BTreeMap<u32, [i32; N_SUMS]>,
    /// Bit `i` of word `j` is set if row `64 j + i` has received something.
    used: Vec<u64>,
    n_used: usize,
    /// Ids whose rows the current frame has changed, each once.
    touched: Vec<u32>,
    /// Memory for records that must be put in order.
    sorted: Vec<Record<f64>>,
}

/// Two cache lines in 64-bit form.
#[derive(Clone, Copy)]
#[repr(align(64))]
struct Row<T> {
    sums: [T; N_SUMS],
    /// The frame that changed it last.
    frame: u32,
}

/// A number that totals are kept in.
trait Total: Copy + Default + PartialOrd + Send + Sync {
    /// Whether sums depend on the order of their terms.
    const ORDERED: bool;
    /// Adds `value` to sum number `index`; returns what has to be added to its high limb.
    fn add(&mut self, value: f64, index: usize) -> i32;
    /// The value of sum number `index` with its high limb.
    fn value(self, high: i32, index: usize) -> f64;
}

impl Total for f32 {
    const ORDERED: bool = true;

    #[inline(always)]
    fn add(&mut self, value: f64, _: usize) -> i32 {
        *self += value as f32;
        0
    }

    fn value(self, _: i32, _: usize) -> f64 {
        self.into()
    }
}

impl Total for i64 {
    const ORDERED: bool = false;

    #[inline(always)]
    fn add(&mut self, value: f64, index: usize) -> i32 {
        let sum = Split { high: 0, low: *self }.plus(to_quanta(value, FRACTION_BITS[index]));
        *self = sum.low;
        sum.high
    }

    fn value(self, high: i32, index: usize) -> f64 {
        Split { high, low: self }.value(FRACTION_BITS[index])
    }
}

impl Total for i128 {
    const ORDERED: bool = false;

    #[inline(always)]
    fn add(&mut self, value: f64, _: usize) -> i32 {
        *self = self.saturating_add(to_fixed(value));
        0
    }

    fn value(self, _: i32, _: usize) -> f64 {
        from_fixed(self)
    }
}

impl Statistics {
    /// Nothing seen.
    pub fn new(components: usize, width: UpdateWidth) -> Self {
        let form = match width {
            UpdateWidth::F32 => Form::F32(empty_shards(components)),
            UpdateWidth::Fixed64 => Form::Fixed64(empty_shards(components)),
            UpdateWidth::Fixed128 => Form::Fixed128(empty_shards(components)),
        };
        Self::from_form(form, components)
    }

    /// Totals as they stood.
    pub fn restore(totals: &Totals) -> Self {
        let form = match totals {
            Totals::F32(rows) => Form::F32(filled_shards(rows, &[])),
            Totals::Fixed64 { rows, carries } => Form::Fixed64(filled_shards(rows, carries)),
            Totals::Fixed128(rows) => Form::Fixed128(filled_shards(rows, &[])),
        };
        Self::from_form(form, totals.len())
    }

    fn from_form(form: Form, components: usize) -> Self {
        let used = any_form!(&form, s => s.iter().map(|s| s.n_used).sum());
        Self {
            form,
            components,
            shard_bits: shard_bits(components),
            used,
            touched: Vec::new(),
            frame: 0,
        }
    }

    /// The totals as they stand.
    pub fn state(&self) -> Totals {
        match &self.form {
            Form::F32(shards) => Totals::F32(rows(shards)),
            Form::Fixed128(shards) => Totals::Fixed128(rows(shards)),
            Form::Fixed64(shards) => Totals::Fixed64 {
                rows: rows(shards),
                carries: shards
                    .iter()
                    .flat_map(|s| s.carries.iter().map(|(&id, &limbs)| Carry { id, limbs }))
                    .collect(),
            },
        }
    }

    /// Number of components.
    pub fn len(&self) -> usize {
        self.components
    }

    /// Whether there are no components.
    pub fn is_empty(&self) -> bool {
        self.components == 0
    }

    /// Components with `N_k > 0`.
    pub fn used(&self) -> usize {
        self.used
    }

    /// Bytes of one component.
    pub fn row_bytes(&self) -> usize {
        fn bytes<T: Total>(_: &[Shard<T>]) -> usize {
            size_of::<Row<T>>()
        }
        any_form!(&self.form, shards => bytes(shards))
    }

    /// Number of shards.
    pub fn shards(&self) -> usize {
        any_form!(&self.form, shards => shards.len())
    }

    /// Components of a shard, as a binary logarithm: id `k` belongs to shard `k >> shard_bits`.
    pub fn shard_bits(&self) -> u32 {
        self.shard_bits
    }

    /// Adds one frame's records. `of_shard(s, add)` hands those of shard `s` to `add`, in any
    /// order; a tile's record of a component comes once. Records whose count rounds to nothing are
    /// left out whole.
    pub fn add_frame<R: Real>(
        &mut self,
        of_shard: impl Fn(usize, &mut dyn FnMut(&Record<R>)) + Sync,
    ) {
        if self.frame == u32::MAX {
            any_form!(&mut self.form, shards => shards.iter_mut().for_each(Shard::forget_frames));
            self.frame = 0;
        }
        self.frame += 1;
        let (frame, bits) = (self.frame, self.shard_bits);
        any_form!(&mut self.form, shards => {
            shards.par_iter_mut().with_max_len(1).enumerate().for_each(|(s, shard)| {
                shard.add_frame(frame, s << bits, |add| of_shard(s, add));
            });
            self.touched.clear();
            shards.iter().for_each(|s| self.touched.extend_from_slice(&s.touched));
            self.used = shards.iter().map(|s| s.n_used).sum();
        });
    }

    /// Components the last frame changed, each once.
    pub fn touched(&self) -> &[u32] {
        &self.touched
    }

    /// Ids of the components that have received nothing, ascending.
    pub fn unused(&self) -> impl Iterator<Item = u32> {
        (0..self.shards())
            .flat_map(move |s| {
                let used = any_form!(&self.form, shards => &shards[s].used);
                let first = (s as u32) << self.shard_bits;
                used.iter().zip((first..).step_by(64)).flat_map(|(&word, first)| {
                    std::iter::successors(Some(!word), |w| Some(w & (w - 1)))
                        .take_while(|&w| w != 0)
                        .map(move |w| first + w.trailing_zeros())
                })
            })
            .take_while(|&id| (id as usize) < self.components)
    }

    /// Statistics of one component.
    pub fn moments(&self, component: usize) -> Moments {
        let shard = component >> self.shard_bits;
        any_form!(&self.form, shards => shards[shard].moments(component, self.shard_bits))
    }
}

fn shard_bits(components: usize) -> u32 {
    components.div_ceil(MAX_SHARDS).next_power_of_two().max(64).trailing_zeros()
}

fn empty_shards<T: Total>(components: usize) -> Vec<Shard<T>> {
    let len = 1 << shard_bits(components);
    (0..components).step_by(len).map(|first| Shard::new(len.min(components - first))).collect()
}

fn filled_shards<T: Total>(rows: &[[T; N_SUMS]], carries: &[Carry]) -> Vec<Shard<T>> {
    let bits = shard_bits(rows.len());
    let mut shards = empty_shards(rows.len());
    for (id, &sums) in rows.iter().enumerate() {
        let (shard, place) = (&mut shards[id >> bits], id & ((1 << bits) - 1));
        shard.rows[place].sums = sums;
        if sums[0] != T::default() {
            shard.mark_used(place);
        }
    }
    for carry in carries {
        let (shard, place) = (carry.id as usize >> bits, carry.id as usize & ((1 << bits) - 1));
        shards[shard].carries.insert(carry.id, carry.limbs);
        shards[shard].mark_used(place);
    }
    shards
}

fn rows<T: Total>(shards: &[Shard<T>]) -> Vec<[T; N_SUMS]> {
    shards.iter().flat_map(|s| s.rows.iter().map(|row| row.sums)).collect()
}

impl<T: Total> Shard<T> {
    fn new(len: usize) -> Self {
        Self {
            rows: vec![Row { sums: [T::default(); N_SUMS], frame: 0 }; len],
            carries: BTreeMap::new(),
            used: vec![0; len.div_ceil(64)],
            n_used: 0,
            touched: Vec::with_capacity(len),
            sorted: Vec::new(),
        }
    }

    fn forget_frames(&mut self) {
        self.rows.iter_mut().for_each(|row| row.frame = 0);
    }

    fn add_frame<R: Real>(
        &mut self,
        frame: u32,
        first: usize,
        records: impl FnOnce(&mut dyn FnMut(&Record<R>)),
    ) {
        self.touched.clear();
        if !T::ORDERED {
            return records(&mut |record| self.add(frame, first, record.id, record.sums));
        }
        let mut sorted = std::mem::take(&mut self.sorted);
        sorted.clear();
        records(&mut |&Record { id, tile, sums }| {
            sorted.push(Record { id, tile, sums: sums.map(R::to_f64) });
        });
        sorted.sort_unstable_by_key(|record| (record.id, record.tile));
        sorted.iter().for_each(|record| self.add(frame, first, record.id, record.sums));
        self.sorted = sorted;
    }

    #[inline(always)]
    fn add<R: Real>(&mut self, frame: u32, first: usize, id: u32, sums: [R; N_SUMS]) {
        let mut least = T::default();
        least.add(sums[0].to_f64(), 0);
        if least <= T::default() {
            return;
        }
        let place = id as usize - first;
        let row = &mut self.rows[place];
        let mut limbs = [0; N_SUMS];
        for (index, (total, sum)) in row.sums.iter_mut().zip(sums).enumerate() {
            limbs[index] = total.add(sum.to_f64(), index);
        }
        if limbs != [0; N_SUMS] {
            let carry = self.carries.entry(id).or_insert([0; N_SUMS]);
            carry.iter_mut().zip(limbs).for_each(|(c, l)| *c = c.saturating_add(l));
        }
        if row.frame != frame {
            row.frame = frame;
            self.touched.push(id);
            self.mark_used(place);
        }
    }

    fn mark_used(&mut self, place: usize) {
        let (word, bit) = (&mut self.used[place / 64], 1 << (place % 64));
        self.n_used += usize::from(*word & bit == 0);
        *word |= bit;
    }

    fn moments(&self, component: usize, shard_bits: u32) -> Moments {
        let row = &self.rows[component & ((1 << shard_bits) - 1)];
        let none = [0; N_SUMS];
        let limbs = match self.carries.is_empty() {
            true => &none,
            false => self.carries.get(&(component as u32)).unwrap_or(&none),
        };
        Moments::from_sums(std::array::from_fn(|i| row.sums[i].value(limbs[i], i)))
    }
}
