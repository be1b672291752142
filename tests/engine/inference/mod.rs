//! The model against the golden vectors: every array of `rand_soft`, `rand_hard`, `lego_small` and
//! `niw` that has a tolerance, in f64; hard assignments also in mixed precision.

mod laws;
mod lego_small;
mod rand_hard;
mod rand_soft;
mod reference;
mod sampler;

/// Computes `ln Σ exp(v)` of finite values without overflow.
fn log_sum_exp(values: &[f64]) -> f64 {
    let max = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    max + values.iter().map(|v| (v - max).exp()).sum::<f64>().ln()
}
