//! Procedural room that replaces a recording: posed colour and exact depth at any resolution, rendered on
//! demand and deterministic by seed. It serves as the demo and as ground truth for tests of the loaders,
//! the trainer and the renderers.
//!
//! World: z up, metres, floor at z = 0, the room centred above the origin.
//!
//! The room is ray cast rather than rasterised, because tests of the loaders need depth exact to the last
//! bit of f64. The shapes are few and simple, so a frame takes milliseconds. Light is baked and independent
//! of the view, as a mixture of constant colours requires.

pub(in crate::dataset) mod scene;
pub mod write;

mod fine_texture;
mod free_views;
mod params;
mod phone;
mod plan;
mod room;
mod solid;
mod texture;
mod view;

pub use params::{ParamsError, PhoneScene, SyntheticCamera, SyntheticParams};
pub use phone::camera::Capture;
pub use plan::{RecordedFrame, ViewPlan};
pub use scene::{DEPTH_UNIT, FIELD_OF_VIEW, SyntheticScene};
pub use view::{SyntheticView, dataset, demo, position_range};
