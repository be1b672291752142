//! Dense symmetric systems of few unknowns.

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
    /// Lower triangle in rows of `n`; what lies above is the matrix's.
    lower: Vec<f64>,
}

impl Cholesky {
    /// Of an `n`×`n` matrix, row by row; only its lower triangle is read. `None` unless it is
    /// positive definite.
    pub fn new(n: usize, matrix: &[f64]) -> Option<Self> {
        let mut lower = matrix.to_vec();
        factor(n, &mut lower)?;
        Some(Self { n, lower })
    }

    /// The solution `x` of `matrix · x = right`.
    pub fn solve(&self, right: &[f64]) -> Vec<f64> {
        let mut x = right.to_vec();
        substitute(self.n, &self.lower, &mut x);
        x
    }
}

/// Factor of a symmetric positive definite matrix whose size is known: without memory of its own, for
/// the many small systems of splats.
#[derive(Clone, Copy, Debug)]
pub struct SmallCholesky<const N: usize>([[f64; N]; N]);

impl<const N: usize> SmallCholesky<N> {
    /// Of a matrix of which only the lower triangle is read. `None` unless it is positive definite.
    pub fn new(mut matrix: [[f64; N]; N]) -> Option<Self> {
        factor(N, matrix.as_flattened_mut())?;
        Some(Self(matrix))
    }

    /// The solution `x` of `matrix · x = right`.
    pub fn solve(&self, mut right: [f64; N]) -> [f64; N] {
        substitute(N, self.0.as_flattened(), &mut right);
        right
    }
}

/// Turns the lower triangle of a matrix into that of its factor; `None` unless it is positive definite.
#[inline]
fn factor(n: usize, lower: &mut [f64]) -> Option<()> {
    for row in 0..n {
        for column in 0..=row {
            let known = (0..column).map(|i| lower[row * n + i] * lower[column * n + i]);
            let rest = lower[row * n + column] - known.sum::<f64>();
            lower[row * n + column] = if row > column {
                rest / lower[column * n + column]
            // NaN fails this comparison: an undefined matrix has no factor either.
            } else if rest > 0.0 {
                rest.sqrt()
            } else {
                return None;
            };
        }
    }
    Some(())
}

/// Turns the right side of a system into its solution.
#[inline]
fn substitute(n: usize, lower: &[f64], x: &mut [f64]) {
    for row in 0..n {
        let known: f64 = (0..row).map(|i| lower[row * n + i] * x[i]).sum();
        x[row] = (x[row] - known) / lower[row * n + row];
    }
    for row in (0..n).rev() {
        let known: f64 = (row + 1..n).map(|i| lower[i * n + row] * x[i]).sum();
        x[row] = (x[row] - known) / lower[row * n + row];
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
    fn both_factors_solve_alike() {
        let rows = [[4.0, 1.0, -1.0], [1.0, 3.0, 0.5], [-1.0, 0.5, 2.0]];
        let right = [1.0, -2.0, 3.0];
        let any = Cholesky::new(3, rows.as_flattened()).unwrap().solve(&right);
        assert_eq!(SmallCholesky::new(rows).unwrap().solve(right), *any);
        assert!(SmallCholesky::new([[1.0, 2.0], [2.0, 1.0]]).is_none(), "indefinite");
        assert!(SmallCholesky::new([[f64::NAN]]).is_none());
    }

    #[test]
    fn singular_and_undefined_matrices_have_no_factor() {
        assert!(Cholesky::new(2, &[1.0, 1.0, 1.0, 1.0]).is_none());
        assert!(Cholesky::new(1, &[f64::NAN]).is_none());
    }
}
