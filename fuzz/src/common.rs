//! What tests share, as far as targets need it.

#[path = "../../tests/common/layouts.rs"]
pub mod layouts;
#[path = "../../tests/common/scratch.rs"]
pub mod scratch;
