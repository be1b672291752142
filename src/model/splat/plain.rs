//! Plain splats, as every viewer draws them and files hold them. Native splats may exceed an opacity of 1,
//! which gives them a flat top.

/// Maximum opacity of a plain splat; renderers cap alpha at this value too.
pub const OPAQUE: f64 = 0.99;

/// Factor on the standard deviations of plain splats, which have no colour gradient: the best picture needs
/// 1.3 times the deviation of the points, where native splats need 1.2.
pub const PLAIN_WIDTH: f64 = 1.3 / 1.2;

/// Returns opacity and factor on the standard deviations of the plain splat that covers the same area as one
/// of `opacity`: `∫ min(c, o·exp(−r²/2)) dA = 2πc·(1 + ln(o/c))`, and a Gaussian of peak `c` covers `2πc`.
pub fn plain_of_equal_area(opacity: f64) -> (f64, f64) {
    match opacity > OPAQUE {
        true => (OPAQUE, (1.0 + (opacity / OPAQUE).ln()).sqrt()),
        false => (opacity, 1.0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_plain_splat_covers_what_the_flat_top_did() {
        for opacity in [0.4, 0.99, 1.5, 3.0] {
            let (plain, factor) = plain_of_equal_area(opacity);
            let covered = |opacity: f64, deviation: f64| {
                let rings = (0..20_000).map(|i| (f64::from(i) + 0.5) * 1e-3);
                let alpha = |r: f64| OPAQUE.min(opacity * (-0.5 * (r / deviation).powi(2)).exp());
                rings.map(|r| alpha(r) * r * 1e-3).sum::<f64>()
            };
            let (native, flat) = (covered(opacity, 1.0), covered(plain, factor));
            assert!((native / flat - 1.0).abs() < 1e-3, "{opacity}: {native} and {flat}");
        }
    }
}
