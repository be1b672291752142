//! Eight f32 lanes, and the choice at run time of the instructions behind them. This folder is the
//! one place with code for a particular processor.
//!
//! Every operation gives the same bits on every instruction set: nothing is fused, nothing
//! approximated.

#[cfg(target_arch = "x86_64")]
mod avx2;
mod portable;

use portable::Portable;
use std::ops::{Add, Div, Mul, Sub};
use std::sync::LazyLock;

/// Lanes of a [`Vector`].
pub const LANES: usize = 8;

/// Name of the environment variable that forces an instruction set: `portable` or `avx2`.
pub const FORCE_VARIABLE: &str = "VBGS_SIMD";

/// Eight f32 lanes.
pub trait Vector:
    Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Div<Output = Self>
{
    /// The same value in every lane.
    fn splat(value: f32) -> Self;
    /// The first eight values.
    fn load(values: &[f32]) -> Self;
    /// Overwrites the first eight values.
    fn store(self, values: &mut [f32]);
    /// The smaller of each pair; of no use where a lane is NaN.
    fn min(self, other: Self) -> Self;
    /// The larger of each pair; of no use where a lane is NaN.
    fn max(self, other: Self) -> Self;
    /// Lane `i` sets bit `i` if it is at most that of `other`.
    fn at_most(self, other: Self) -> u32;
    /// In every lane the bits of `kept`, with `added` in place of the others.
    fn tag(self, kept: u32, added: u32) -> Self;
    /// Lane `i` sets bit `i` if it agrees with that of `other` in the bits of `mask`.
    fn agrees(self, other: Self, mask: u32) -> u32;
    /// The lanes whose bit is set in `mask` come first, in order; the others say nothing.
    fn compress(self, mask: u32) -> Self;
    /// A mask: lanes that are at most those of `other` have every bit set, the others none.
    fn mask_at_most(self, other: Self) -> Self;
    /// The bits that both have.
    fn and(self, other: Self) -> Self;
    /// Lanes of `yes` where the mask is set, those of `no` elsewhere.
    fn select(mask: Self, yes: Self, no: Self) -> Self;
    /// Lane `i` sets bit `i` if its sign bit is set, as it is where a mask is.
    fn signs(self) -> u32;
    /// Adds the integer in the bits of each lane of `exponent` to the exponent of the lane: times a
    /// power of two, as long as the result is a normal number.
    fn scale_by_bits(self, exponent: Self) -> Self;
    /// The lanes.
    fn to_array(self) -> [f32; LANES] {
        let mut lanes = [0.0; LANES];
        self.store(&mut lanes);
        lanes
    }
}

/// For every mask of eight lanes the set ones, ascending, then zeros.
const SET_LANES: [[u32; LANES]; 256] = {
    let mut table = [[0; LANES]; 256];
    let mut mask = 0;
    while mask < 256 {
        let (mut lane, mut n) = (0, 0);
        while lane < LANES {
            if mask >> lane & 1 == 1 {
                table[mask][n] = lane as u32;
                n += 1;
            }
            lane += 1;
        }
        mask += 1;
    }
    table
};

/// A computation on vectors of any instruction set. `run` must be `#[inline(always)]`, and so must
/// everything hot below it: what is not inlined is compiled for the baseline.
pub trait Kernel {
    /// What it gives.
    type Output;
    /// Runs on the vectors `V`.
    fn run<V: Vector>(self) -> Self::Output;
}

/// An instruction set this machine has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Isa(Kind);

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Portable,
    #[cfg(target_arch = "x86_64")]
    Avx2,
}

impl Isa {
    /// What every machine has: pairs of 128-bit vectors on x86-64 and 64-bit ARM.
    pub const PORTABLE: Self = Self(Kind::Portable);

    /// AVX2, if this machine has it.
    pub fn avx2() -> Option<Self> {
        #[cfg(target_arch = "x86_64")]
        if avx2::is_available() {
            return Some(Self(Kind::Avx2));
        }
        None
    }

    /// The best instruction set of this machine, or the one that [`FORCE_VARIABLE`] names where the
    /// machine has it. Looked up once.
    pub fn best() -> Self {
        static BEST: LazyLock<Isa> =
            LazyLock::new(|| match std::env::var(FORCE_VARIABLE).as_deref() {
                Ok("portable") => Isa::PORTABLE,
                _ => Isa::avx2().unwrap_or(Isa::PORTABLE),
            });
        *BEST
    }

    /// As reports spell it.
    pub fn name(self) -> &'static str {
        match self.0 {
            Kind::Portable => "portable",
            #[cfg(target_arch = "x86_64")]
            Kind::Avx2 => "avx2",
        }
    }

    /// Runs a kernel on this instruction set.
    #[inline]
    pub fn run<K: Kernel>(self, kernel: K) -> K::Output {
        match self.0 {
            Kind::Portable => kernel.run::<Portable>(),
            #[cfg(target_arch = "x86_64")]
            Kind::Avx2 => avx2::run(kernel),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Everything<'a>(&'a [f32], &'a [f32]);

    impl Kernel for Everything<'_> {
        type Output = Vec<u32>;

        #[inline(always)]
        fn run<V: Vector>(self) -> Vec<u32> {
            let (a, b) = (V::load(self.0), V::load(self.1));
            let vectors = [
                V::splat(self.0[3]),
                a + b,
                a - b,
                a * b,
                a.min(b),
                a.max(b),
                a.tag(!7, 5),
                a * b + a * a,
                a.compress(0xFF),
                a / b,
                a.mask_at_most(b),
                a.and(b),
                V::select(a.mask_at_most(b), a, b),
                a.scale_by_bits(V::splat(f32::from_bits(3))),
            ];
            let lanes = vectors.iter().flat_map(|v| v.to_array()).map(f32::to_bits);
            let some = a.compress(0b1010_0110).to_array().map(f32::to_bits);
            let some = some.into_iter().take(4);
            lanes.chain([a.at_most(b), a.agrees(b, !0xFFFF), a.signs()]).chain(some).collect()
        }
    }

    #[test]
    fn every_instruction_set_gives_the_same_bits() {
        let a = [0.1, -2.5e-30, 3.0, f32::INFINITY, 0.0, -0.0, 1e-42, 1.000_000_1];
        let b = [0.1, 7.5e10, -3.0, 1.0, -1.0, 4.0, 2e-42, 1.0];
        let expected = Isa::PORTABLE.run(Everything(&a, &b));
        assert_eq!(f32::from_bits(expected[8]), 0.2);
        assert_eq!(expected[104], 0.8f32.to_bits());
        assert_eq!(expected[96..99], [a[0], a[1], b[2]].map(f32::to_bits));
        assert_eq!(expected[112..115], [0b0110_0011, 0b1100_0001, 0b0010_0010]);
        assert_eq!(expected[115..], [a[1], a[2], a[5], a[7]].map(f32::to_bits));
        if let Some(avx2) = Isa::avx2() {
            assert_eq!(avx2.run(Everything(&a, &b)), expected);
        }
    }
}
