//! Panels: each draws from the snapshot and answers with what the user asked for.

pub mod abandoned;
pub mod adapter;
pub mod badge;
pub mod detail;
pub mod draw_share;
pub mod edit;
pub mod histogram;
pub mod inspector;
pub mod latency;
pub mod legend;
pub mod notices;
pub mod path;
pub mod plot_axes;
pub mod quality;
pub mod ready;
pub mod retention;
pub mod scene;
pub mod setting_rows;
pub mod settings;
pub mod signal_color;
pub mod start;
pub mod status;
pub mod summary;
pub mod timings;
pub mod training;
pub mod transport;
