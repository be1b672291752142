//! Dense symmetric linear systems with few unknowns.

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
    /// Lower triangle, row-major `n`×`n`; entries above the diagonal are those of the input and unused.
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
    fn singular_and_undefined_matrices_have_no_factor() {
        assert!(Cholesky::new(2, &[1.0, 1.0, 1.0, 1.0]).is_none());
        assert!(Cholesky::new(1, &[f64::NAN]).is_none());
    }
}
