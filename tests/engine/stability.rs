//! Numerically hard cases against exact sums: the same rows that `bench stability` prints.

use vbgs_studio::bench::paper::stability::{Case, StabilityRow, Truth, all};
use vbgs_studio::train::paper::config::Precision;

/// Cases with non-finite points, which the loader normally drops before training.
const BROKEN: [&str; 2] = ["points with NaN", "points with infinities"];
/// Case with a looser bound: splat positions are f32, whose resolution at 1e6 is 0.06.
const SHIFTED: &str = "scene shifted by 1e6";

fn rows(precision: Precision, is_chosen: impl Fn(&Case) -> bool) -> Vec<StabilityRow> {
    let cases = all(0);
    let chosen = cases.iter().filter(|case| is_chosen(case));
    chosen.map(|case| Truth::new(case).unwrap().measure(precision).unwrap()).collect()
}

fn sound(case: &Case) -> bool {
    !BROKEN.contains(&case.name)
}

/// Checks what must hold in every precision.
fn check_sane(row: &StabilityRow) {
    assert!(row.positive_definite, "{row:?}");
    assert_eq!(row.non_finite, 0, "{row:?}");
    assert!(row.used >= 1, "{row:?}");
    let resolution = if row.case == SHIFTED { 0.06 } else { 1e-2 };
    assert!(row.splat_error < resolution, "{row:?}");
}

#[test]
fn f64_is_exact_to_its_rounding() {
    let rows = rows(Precision::F64, sound);
    assert!(rows.len() >= 20, "{} cases", rows.len());
    for row in &rows {
        check_sane(row);
        assert!(row.responsibility_error < 1e-12, "{row:?}");
        assert!(row.count_error < 1e-12, "{row:?}");
        assert!(row.mean_error < 1e-13, "{row:?}");
        assert!(row.covariance_error < 1e-11, "{row:?}");
    }
}

#[test]
fn mixed_precision_is_exact_to_the_rounding_of_f32_about_the_mean() {
    // f32 rounding is relative to the distance from the initial mean, which these cases lie far from.
    let far = |case: &str| match case {
        "responsibilities that underflow" => [1e-5, 5e-3],
        "denormals" => [1e-4, 2e-2],
        _ => [3e-7, 1e-3],
    };
    for row in rows(Precision::Mixed, sound) {
        check_sane(&row);
        let [mean, covariance] = far(row.case);
        assert!(row.responsibility_error < 1e-5, "{row:?}");
        assert!(row.count_error < 1e-6, "{row:?}");
        assert!(row.mean_error < mean, "{row:?}");
        assert!(row.covariance_error < covariance, "{row:?}");
    }
}

#[test]
fn f32_stays_definite_and_finite() {
    for row in rows(Precision::F32, sound) {
        check_sane(&row);
        // Sums over 1e5 frames drift in f32; the bench reports by how much.
        if row.frames == 1 {
            assert!(row.mean_error < 1e-3 && row.covariance_error < 0.1, "{row:?}");
        }
    }
}

#[test]
fn points_that_are_no_numbers_do_not_count() {
    for precision in [Precision::F64, Precision::Mixed, Precision::F32] {
        for row in rows(precision, |case| !sound(case)) {
            check_sane(&row);
            assert_eq!(row.points_broken, 5);
            assert!(row.count_error < 1e-6 && row.mean_error < 1e-6, "{row:?}");
        }
    }
}
