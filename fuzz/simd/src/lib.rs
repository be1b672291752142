//! Vector module of the product with its tests, and nothing else.
#![allow(dead_code)] // kernels elsewhere use what these tests do not

#[path = "."]
pub mod math {
    #[path = "../../../src/math/simd/mod.rs"]
    pub mod simd;
}
