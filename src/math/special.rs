//! Special functions of the Wishart and Dirichlet distributions; multivariate ones for D = 3.

/// Returns the digamma function `ψ(x)` for `x > 0`, NaN outside this domain. Applies the recurrence
/// until `x ≥ 12`, then the asymptotic series (Abramowitz & Stegun 6.3.18). The absolute error is below
/// 1e-14 · max(1, |ψ|).
pub fn digamma(mut x: f64) -> f64 {
    if x.is_nan() || x <= 0.0 {
        return f64::NAN;
    }
    let mut shift = 0.0;
    // From 12 on, seven terms of the series are accurate to rounding.
    while x < 12.0 {
        shift -= 1.0 / x;
        x += 1.0;
    }
    let z = 1.0 / (x * x);
    let series = z
        * (1.0 / 12.0
            - z * (1.0 / 120.0
                - z * (1.0 / 252.0
                    - z * (1.0 / 240.0 - z * (1.0 / 132.0 - z * (691.0 / 32760.0 - z / 12.0))))));
    shift + x.ln() - 0.5 / x - series
}

/// Returns `ln Γ(x)` for `x > 0`.
pub fn ln_gamma(x: f64) -> f64 {
    libm::lgamma(x)
}

/// Returns the multivariate digamma function `ψ_3(a) = Σ_{i=0..2} ψ(a − i/2)`, for `a > 1`.
pub fn mv_digamma3(a: f64) -> f64 {
    digamma(a) + digamma(a - 0.5) + digamma(a - 1.0)
}

/// Returns the logarithm of the multivariate gamma function, `ln Γ_3(a) = 3/2 · ln π + Σ_{i=0..2} ln Γ(a
/// − i/2)`, for `a > 1`.
pub fn mv_ln_gamma3(a: f64) -> f64 {
    // D(D − 1)/4 = 3/2 for D = 3.
    1.5 * std::f64::consts::PI.ln() + ln_gamma(a) + ln_gamma(a - 0.5) + ln_gamma(a - 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn known_values() {
        let euler = 0.577_215_664_901_532_9;
        assert!((digamma(1.0) + euler).abs() < 1e-15);
        assert!((digamma(0.5) + euler + 2.0 * 2f64.ln()).abs() < 1e-14);
        // Check value of the model's specification for nu = 5.
        assert!((mv_digamma3(2.5) - 1.162_430_949_722_287).abs() < 1e-14);
        assert!(digamma(0.0).is_nan() && digamma(-1.0).is_nan());
        assert!((digamma(1e-5) + 1e5 + euler).abs() < 1e-4);
        assert!((ln_gamma(5.0) - 24f64.ln()).abs() < 1e-14);
        // Γ(4) = 6, Γ(7/2) = 15√π/8 and Γ(3) = 2.
        let expected = 2.0 * std::f64::consts::PI.ln() + 22.5f64.ln();
        assert!((mv_ln_gamma3(4.0) - expected).abs() < 1e-14);
    }
}
