//! Selection of the instruction set at run time.

#[cfg(target_arch = "x86_64")]
use super::avx2;
use super::portable::Portable;
use super::vector::Kernel;
use std::sync::LazyLock;

/// Environment variable that forces an instruction set: `portable` or `avx2`.
pub const FORCE_VARIABLE: &str = "VBGS_SIMD";

/// An instruction set supported by this machine.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Isa(Kind);

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Portable,
    #[cfg(target_arch = "x86_64")]
    Avx2,
}

impl Isa {
    /// Instruction set available on every machine. On x86-64 and 64-bit ARM it uses pairs of 128-bit
    /// vectors.
    pub const PORTABLE: Self = Self(Kind::Portable);

    /// Returns AVX2 if this machine supports it.
    pub fn avx2() -> Option<Self> {
        #[cfg(target_arch = "x86_64")]
        if avx2::is_available() {
            return Some(Self(Kind::Avx2));
        }
        None
    }

    /// Returns the best instruction set of this machine, or the one named by [`FORCE_VARIABLE`] if the
    /// machine supports it. The choice is made once per process.
    pub fn best() -> Self {
        static BEST: LazyLock<Isa> =
            LazyLock::new(|| match std::env::var(FORCE_VARIABLE).as_deref() {
                // `avx2` and unknown names select the best available: a wrong name must not stop the program.
                Ok("portable") => Isa::PORTABLE,
                _ => Isa::avx2().unwrap_or(Isa::PORTABLE),
            });
        *BEST
    }

    /// Returns the name used in reports.
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
    use crate::math::simd::vector::Vector;

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
                a.replace_low_bits(!7, 5),
                a * b + a * a,
                a.compress(0xFF),
                a / b,
                a.mask_at_most(b),
                a.and(b),
                V::select(a.mask_at_most(b), a, b),
                a.scale_by_power_of_two(V::splat(f32::from_bits(3))),
            ];
            let both: Vec<f32> = self.0.iter().chain(self.1).copied().collect();
            let columns = V::transposed([a, b, a + b, a, b, a - b, a, b]);
            let sums = V::lane_sums([a, b, a + b, a, b, a - b, a, b]);
            let even = V::load_even(&both);
            let vectors = vectors.into_iter().chain(columns).chain([sums, even]);
            let vectors: Vec<V> = vectors.collect();
            let lanes = vectors.iter().flat_map(|v| v.to_array()).map(f32::to_bits);
            let some = a.compress(0b1010_0110).to_array().map(f32::to_bits);
            let some = some.into_iter().take(4);
            let truncated = (b.min(V::splat(1e6)) * V::splat(1.25)).truncated();
            let masks = [a.at_most(b), a.bits_equal(b, !0xFFFF), a.sign_bits()];
            lanes.chain(masks).chain(some).chain(truncated.map(|lane| lane as u32)).collect()
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
        // Vectors of every lane number, then their sums.
        let second = [a[1], b[1], a[1] + b[1], a[1], b[1], a[1] - b[1], a[1], b[1]];
        assert_eq!(expected[120..128], second.map(f32::to_bits));
        let sum = b.iter().sum::<f32>();
        assert_eq!(expected[177], sum.to_bits());
        let even = [a[0], a[2], a[4], a[6], b[0], b[2], b[4], b[6]];
        assert_eq!(expected[184..192], even.map(f32::to_bits));
        assert_eq!(expected[192..195], [0b0110_0011, 0b1100_0001, 0b0010_0010]);
        assert_eq!(expected[195..199], [a[1], a[2], a[5], a[7]].map(f32::to_bits));
        assert_eq!(expected[199..], [0, 1_250_000, -3, 1, -1, 5, 0, 1].map(|lane| lane as u32));
        if let Some(avx2) = Isa::avx2() {
            assert_eq!(avx2.run(Everything(&a, &b)), expected);
        }
    }
}
