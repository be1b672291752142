//! What tests share, as far as targets need it.

#[path = "../../tests/common/scratch.rs"]
pub mod scratch;
