//! Helpers of the tests that the targets need as well.

#[path = "../../tests/common/bag.rs"]
pub mod bag;
#[path = "../../tests/common/layouts.rs"]
pub mod layouts;
#[path = "../../tests/common/lidar.rs"]
pub mod lidar;
#[path = "../../tests/common/scratch.rs"]
pub mod scratch;
