//! Settings of the viewport, stored between sessions.

use crate::app::color_mode::ColorMode;
use crate::app::panels::quality::DEFAULT_INTERVAL;
use crate::app::settings_file;
use crate::render::{
    Antialias, DisplayStyle, ExactOptions, Exposing, Lens, RenderMethod, RenderOptions, Renderer,
    Response,
};
use serde::{Deserialize, Serialize};
use std::ops::RangeInclusive;

pub const SCALES: RangeInclusive<f32> = 0.1..=3.0;
pub const GAINS: RangeInclusive<f32> = 1.0..=64.0;
// A pinhole is accurate up to about 150° (`rendering.md`, Wide views and fisheye).
pub const PINHOLE_FOV_DEG: RangeInclusive<f32> = 10.0..=150.0;
pub const FISHEYE_FOV_DEG: RangeInclusive<f32> = 60.0..=360.0;

pub const MAX_PAST_MB: u32 = 4096;

pub const DARK: [u8; 3] = [23, 25, 31];

/// Default latency budget of a frame: the interval of a camera with 30 frames per second.
const FRAME_BUDGET_MS: f64 = 33.3;

#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct ViewSettings {
    /// Renderer for the pinhole lens. A fisheye always uses the exact renderer.
    pub renderer: Renderer,
    pub antialias: Antialias,
    pub lens: Lens,
    /// Vertical field of view of the pinhole lens, degrees; `None` uses the scene's default.
    pub pinhole_fov_deg: Option<f32>,
    pub fisheye_fov_deg: f32,
    pub scale: f32,
    /// Minimum opacity of splats that are drawn.
    pub opacity_cut: f32,
    /// Background colour, sRGB.
    pub background: [u8; 3],
    /// Exposure with which a scene is drawn if its cameras used automatic exposure. In comparisons with a
    /// photograph, the recorded exposure is always used.
    pub exposing: Exposing,
    pub difference_gain: f32,
    /// True if dataset cameras are drawn. Before training they are always drawn.
    pub shows_cameras: bool,
    pub shows_points: bool,
    pub shows_grid: bool,
    pub panels: PanelSettings,
    // Not stored, because the next scene may not support it.
    #[serde(skip)]
    pub color_mode: ColorMode,
}

/// Settings of panels and dialogs around the viewport.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct PanelSettings {
    pub previews_export: bool,
    /// Number of frames between two measurements of held-out views during training. `None` measures only
    /// while training is paused or finished.
    pub quality_every: Option<usize>,
    /// Latency budget of a training frame, milliseconds, drawn as a line in the latency plot.
    pub frame_budget_ms: f64,
    /// Maximum size on disk of stored earlier states of a scene in training, MB.
    pub past_mb: u32,
}

impl Default for PanelSettings {
    fn default() -> Self {
        Self {
            previews_export: true,
            quality_every: Some(DEFAULT_INTERVAL),
            frame_budget_ms: FRAME_BUDGET_MS,
            past_mb: 512,
        }
    }
}

impl PanelSettings {
    fn in_range(self) -> Self {
        Self {
            // 0 would measure in every pass.
            quality_every: self.quality_every.map(|every| every.max(1)),
            frame_budget_ms: match self.frame_budget_ms {
                ms if ms.is_finite() && ms > 0.0 => ms,
                _ => FRAME_BUDGET_MS,
            },
            past_mb: self.past_mb.min(MAX_PAST_MB),
            ..self
        }
    }

    pub fn past_bytes(&self) -> usize {
        self.past_mb as usize * 1_000_000
    }
}

impl Default for ViewSettings {
    fn default() -> Self {
        Self {
            renderer: Renderer::Projected,
            antialias: Antialias::Footprint,
            lens: Lens::Pinhole,
            pinhole_fov_deg: None,
            fisheye_fov_deg: 180.0,
            scale: 1.0,
            opacity_cut: 0.0,
            background: DARK,
            exposing: Exposing::Neutral,
            difference_gain: 8.0,
            shows_cameras: false,
            shows_points: false,
            shows_grid: false,
            panels: PanelSettings::default(),
            color_mode: ColorMode::Color,
        }
    }
}

impl ViewSettings {
    pub fn from_text(text: &str) -> (Self, Option<String>) {
        let (read, notice) = settings_file::from_text::<Self>("the viewport", text);
        (read.in_range(), notice)
    }

    fn in_range(self) -> Self {
        let start = Self::default();
        let within = |value: f32, range: RangeInclusive<f32>, otherwise: f32| {
            // `clamp` lets a NaN through.
            if value.is_finite() { value.clamp(*range.start(), *range.end()) } else { otherwise }
        };
        let pinhole = self.pinhole_fov_deg.filter(|fov| fov.is_finite());
        // Enforced here too, because the text may have been edited by hand.
        let renderer = if self.lens == Lens::Fisheye { Renderer::Exact } else { self.renderer };
        Self {
            renderer,
            pinhole_fov_deg: pinhole.map(|fov| within(fov, PINHOLE_FOV_DEG, fov)),
            fisheye_fov_deg: within(self.fisheye_fov_deg, FISHEYE_FOV_DEG, start.fisheye_fov_deg),
            scale: within(self.scale, SCALES, start.scale),
            opacity_cut: within(self.opacity_cut, 0.0..=1.0, start.opacity_cut),
            panels: self.panels.in_range(),
            difference_gain: within(self.difference_gain, GAINS, start.difference_gain),
            ..self
        }
    }

    /// Returns the background colour as sRGB-encoded values from 0 to 1.
    pub fn background_rgb(&self) -> [f32; 3] {
        self.background.map(|v| f32::from(v) / 255.0)
    }

    pub fn set_lens(&mut self, lens: Lens) {
        self.lens = lens;
        // The projected renderer does not support a fisheye.
        if lens == Lens::Fisheye {
            self.renderer = Renderer::Exact;
        }
    }

    pub fn method(&self, renderer: Renderer, lens: Lens) -> RenderMethod {
        match renderer {
            Renderer::Projected => RenderMethod::PROJECTED,
            Renderer::Exact => RenderMethod::Exact(ExactOptions {
                response: Response::Ray,
                antialias: self.antialias,
                lens,
            }),
        }
    }

    /// Returns the render options for the render method `method`. `radius` is the scene's radius and
    /// `distance` the distance between the camera and the scene's centre, both in world units.
    pub fn options(&self, method: RenderMethod, radius: f64, distance: f64) -> RenderOptions {
        // The scene's bounding sphere along the view, so that the depth colours use their whole range.
        let range = [(distance - radius).max(0.0), distance + radius].map(|d| d as f32);
        let look = DisplayStyle {
            scale: self.scale,
            opacity_cut: self.opacity_cut,
            paint: self.color_mode.paint(range),
        };
        // Colours that encode a value must not vary with the exposure.
        let exposing = match self.color_mode {
            ColorMode::Color => self.exposing,
            _ => Exposing::Neutral,
        };
        let plain = RenderOptions::viewport(method, self.background_rgb(), radius);
        RenderOptions { style: look, exposure_mode: exposing, ..plain }
    }

    /// Returns the options with which `eval` measures the chosen renderer at a dataset camera.
    pub fn measured(&self) -> RenderOptions {
        let method = self.method(self.renderer, Lens::Pinhole);
        RenderOptions::evaluation(method, self.background_rgb())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_survive_a_restart_but_not_the_colour_mode() {
        let chosen = ViewSettings {
            antialias: Antialias::None,
            exposing: Exposing::Recorded,
            pinhole_fov_deg: Some(90.0),
            scale: 0.5,
            background: [1, 2, 3],
            color_mode: ColorMode::Depth,
            ..ViewSettings::default()
        };
        let (read, notice) = ViewSettings::from_text(&ron::to_string(&chosen).unwrap());
        assert_eq!(read, ViewSettings { color_mode: ColorMode::Color, ..chosen });
        assert_eq!(notice, None);
    }

    #[test]
    fn what_cannot_be_read_is_said_and_what_is_out_of_range_is_held_in_it() {
        for text in ["", "(scale: \"big\")", "not RON at all", "(renderer: tomorrow)"] {
            let (read, notice) = ViewSettings::from_text(text);
            assert_eq!(read, ViewSettings::default(), "{text}");
            assert!(notice.unwrap().contains("the defaults are used"), "{text}");
        }
        let text = "(scale: 99.0, opacity_cut: NaN, panels: (past_mb: 99999), pinhole_fov_deg: Some(500.0), lens: fisheye)";
        let (read, notice) = ViewSettings::from_text(text);
        assert_eq!((read.scale, read.opacity_cut, read.panels.past_mb), (3.0, 0.0, MAX_PAST_MB));
        assert_eq!((read.pinhole_fov_deg, read.renderer), (Some(150.0), Renderer::Exact));
        assert_eq!(notice, None);
    }
}
