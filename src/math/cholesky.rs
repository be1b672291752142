//! Dense symmetric linear systems with few unknowns.

use super::simd::Vector;

/// Cholesky factor of a symmetric positive definite matrix.
///
/// ```
/// use vbgs_studio::math::cholesky::Cholesky;
///
/// let factor = Cholesky::new(2, &[4.0, 2.0, 2.0, 2.0]).unwrap();
/// assert_eq!(factor.solve(&[8.0, 6.0]), [1.0, 2.0]);
/// assert!(Cholesky::new(2, &[1.0, 2.0, 2.0, 1.0]).is_none(), "indefinite");
/// ```
#[derive(Clone, Debug)]
pub struct Cholesky {
    n: usize,
    /// Lower triangular factor as a row-major `n`×`n` matrix. Entries above the diagonal are unused
    /// copies of the input.
    lower: Vec<f64>,
}

impl Cholesky {
    /// Factors an `n`×`n` row-major matrix, of which only the lower triangle is read.
    ///
    /// Returns `None` unless the matrix is positive definite.
    pub fn new(n: usize, matrix: &[f64]) -> Option<Self> {
        let mut lower = matrix.to_vec();
        for row in 0..n {
            for column in 0..=row {
                let known = (0..column).map(|i| lower[row * n + i] * lower[column * n + i]);
                let rest = lower[row * n + column] - known.sum::<f64>();
                lower[row * n + column] = if row > column {
                    rest / lower[column * n + column]
                // NaN fails this comparison, so a matrix with NaN has no factor.
                } else if rest > 0.0 {
                    rest.sqrt()
                } else {
                    return None;
                };
            }
        }
        Some(Self { n, lower })
    }

    /// Solves `matrix · x = right` for `x`.
    pub fn solve(&self, right: &[f64]) -> Vec<f64> {
        let Self { n, lower } = self;
        let mut x = right.to_vec();
        for row in 0..*n {
            let known: f64 = (0..row).map(|i| lower[row * n + i] * x[i]).sum();
            x[row] = (x[row] - known) / lower[row * n + row];
        }
        for row in (0..*n).rev() {
            let known: f64 = (row + 1..*n).map(|i| lower[i * n + row] * x[i]).sum();
            x[row] = (x[row] - known) / lower[row * n + row];
        }
        x
    }
}

/// Returns the index of entry `(i, j)`, `j ≤ i`, in a lower triangle stored row by row.
pub const fn at(i: usize, j: usize) -> usize {
    i * (i + 1) / 2 + j
}

/// Computes the Cholesky factors of symmetric `N`×`N` matrices in place, one matrix per lane. Diagonals
/// of the factors are stored as reciprocals.
///
/// Returns a mask of the lanes whose matrix is positive definite. Factors in other lanes are undefined.
#[inline(always)]
pub fn factor<V: Vector, const N: usize, const P: usize>(lower: &mut [V; P]) -> V {
    let least = V::splat(f32::MIN_POSITIVE);
    let mut sound = V::splat(0.0).mask_at_most(V::splat(0.0));
    for k in 0..N {
        let pivot = lower[at(k, k)];
        // NaN fails this comparison, so a matrix with NaN has no factor.
        let positive = least.mask_at_most(pivot);
        sound = sound.and(positive);
        let per_root = V::splat(1.0) / V::select(positive, pivot, V::splat(1.0)).sqrt();
        lower[at(k, k)] = per_root;
        for i in k + 1..N {
            lower[at(i, k)] = lower[at(i, k)] * per_root;
        }
        // Right-looking update of all remaining entries: they are independent of one another.
        for i in k + 1..N {
            let factor = lower[at(i, k)];
            for j in k + 1..=i {
                lower[at(i, j)] = lower[at(i, j)] - factor * lower[at(j, k)];
            }
        }
    }
    sound
}

/// Solves one linear system per lane in place, given the factors from [`factor`]. On entry `x` holds the
/// right-hand sides, on return the solutions.
#[inline(always)]
pub fn substitute<V: Vector, const N: usize, const P: usize>(lower: &[V; P], x: &mut [V; N]) {
    for k in 0..N {
        x[k] = x[k] * lower[at(k, k)];
        for i in k + 1..N {
            x[i] = x[i] - lower[at(i, k)] * x[k];
        }
    }
    for k in (0..N).rev() {
        x[k] = x[k] * lower[at(k, k)];
        for i in 0..k {
            x[i] = x[i] - lower[at(k, i)] * x[k];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::simd::{Isa, Kernel, LANES};

    #[test]
    fn solutions_solve() {
        let matrix = [4.0, 1.0, -1.0, 1.0, 3.0, 0.5, -1.0, 0.5, 2.0];
        let x = Cholesky::new(3, &matrix).unwrap().solve(&[1.0, -2.0, 3.0]);
        for (row, right) in matrix.chunks(3).zip([1.0, -2.0, 3.0]) {
            let left: f64 = row.iter().zip(&x).map(|(a, x)| a * x).sum();
            assert!((left - right).abs() < 1e-14);
        }
    }

    #[test]
    fn singular_and_undefined_matrices_have_no_factor() {
        assert!(Cholesky::new(2, &[1.0, 1.0, 1.0, 1.0]).is_none());
        assert!(Cholesky::new(1, &[f64::NAN]).is_none());
    }

    /// Kernel that solves one 3×3 system per lane. Its lower triangles are `4 + lane, 1, 3, -1, 0.5, 2`
    /// with entry `.0` replaced by `.1`. The right side is `1, -2, 3`.
    struct Solve(usize, f32);

    impl Kernel for Solve {
        type Output = (u32, [[f32; LANES]; 3]);

        #[inline(always)]
        fn run<V: Vector>(self) -> Self::Output {
            let first = V::load(&[4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 10.0, 11.0]);
            let mut lower =
                [first, V::splat(1.0), V::splat(3.0), V::splat(-1.0), V::splat(0.5), V::splat(2.0)];
            lower[self.0] = V::splat(self.1);
            let mut x = [V::splat(1.0), V::splat(-2.0), V::splat(3.0)];
            let sound = factor::<V, 3, 6>(&mut lower);
            substitute::<V, 3, 6>(&lower, &mut x);
            (sound.sign_bits(), [x[0].to_array(), x[1].to_array(), x[2].to_array()])
        }
    }

    #[test]
    fn lanes_solve_as_one_does() {
        let (sound, x) = Isa::best().run(Solve(1, 1.0));
        assert_eq!(sound, 0xFF);
        for lane in 0..LANES {
            let matrix = [4.0 + lane as f64, 1.0, -1.0, 1.0, 3.0, 0.5, -1.0, 0.5, 2.0];
            let truth = Cholesky::new(3, &matrix).unwrap().solve(&[1.0, -2.0, 3.0]);
            for (x, truth) in x.iter().zip(truth) {
                assert!((f64::from(x[lane]) - truth).abs() < 1e-6);
            }
        }
        assert_eq!(Isa::PORTABLE.run(Solve(1, 1.0)), (sound, x));
    }

    #[test]
    fn lanes_without_a_factor_are_told() {
        let (sound, _) = Isa::best().run(Solve(1, 4.5));
        assert_eq!(sound, 0b1110_0000, "the determinant is 5.75·first − 48");
        assert_eq!(Isa::best().run(Solve(2, f32::NAN)).0, 0);
    }
}
