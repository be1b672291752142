//! Panels: each draws from the snapshot and returns the user's request.

pub mod controls;
pub mod edit;
pub mod frame_strip;
pub mod inspector;
pub mod latency;
pub mod menus;
pub mod notices;
pub mod path;
pub mod plot_axes;
pub mod quality;
pub mod settings;
pub mod signal_color;
pub mod status;
pub mod summary;
pub mod training;
pub mod transport;
