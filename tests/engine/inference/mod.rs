//! The model against the golden vectors: every array of `rand_soft`, `rand_hard`, `lego_small` and
//! `niw` that has a tolerance, in f64; hard assignments also in mixed precision.

mod laws;
mod lego_small;
mod rand_hard;
mod rand_soft;
mod reference;
mod sampler;
