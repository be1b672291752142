//! A procedural room that stands in for a recording: posed colour and exact depth at any size, on
//! demand, deterministic by seed. It is the demo a stranger sees first and the ground truth that
//! loaders, trainer and renderers are tested against.
//!
//! World: z up, metres, floor at 0, the room's centre above the origin.
//!
//! The room is ray cast, not rasterised, because its depth must be exact to the last bit of f64 where
//! a loader is tested against it; shapes are few and simple enough that a frame takes milliseconds.
//! Light is baked and does not depend on the view: what one frame shows every other confirms, as a
//! mixture of colours needs it.

pub(in crate::dataset) mod scene;
pub mod write;

mod capsule;
mod distance;
mod fine_texture;
mod free_views;
mod light;
mod on_demand;
mod params;
mod pattern;
mod phone;
mod plan;
mod room;
mod solid;
mod texture;
mod trajectory;
mod view;

pub use on_demand::{dataset, demo, position_range};
pub use params::{ParamsError, PhoneScene, SyntheticCamera, SyntheticParams};
pub use scene::{DEPTH_UNIT, FIELD_OF_VIEW, SyntheticScene};
pub use view::SyntheticView;
