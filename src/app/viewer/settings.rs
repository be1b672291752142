//! What the user chose about the viewport; kept between sessions.

use crate::app::color_mode::ColorMode;
use crate::app::draw_budget::{DEFAULT_SHARE, SHARES};
use crate::app::panels::quality::DEFAULT_EVERY;
use crate::app::stored_text;
use crate::render::Exposing;
use crate::render::{
    Antialias, ExactOptions, Lens, RenderMethod, RenderOptions, Renderer, Response, SplatStyle,
};
use serde::{Deserialize, Serialize};
use std::ops::RangeInclusive;

/// Factors on the splats' sizes.
pub const SCALES: RangeInclusive<f32> = 0.1..=3.0;
/// Factors on a difference.
pub const GAINS: RangeInclusive<f32> = 1.0..=64.0;
/// Vertical fields of view of a pinhole, degrees.
pub const PINHOLE_FOV_DEG: RangeInclusive<f32> = 10.0..=150.0;
/// Vertical fields of view of a fisheye, degrees.
pub const FISHEYE_FOV_DEG: RangeInclusive<f32> = 60.0..=360.0;

/// Largest budget of earlier moments, MB.
pub const MAX_PAST_MB: u32 = 4096;

/// Colour behind the scene, sRGB bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Background {
    /// Nearly black.
    Dark,
    /// Middle grey.
    Grey,
    /// White.
    White,
    /// Black.
    Black,
    /// Any colour.
    Custom([u8; 3]),
}

impl Background {
    /// As bytes.
    pub fn rgb8(self) -> [u8; 3] {
        match self {
            Background::Dark => [23, 25, 31],
            Background::Grey => [128; 3],
            Background::White => [255; 3],
            Background::Black => [0; 3],
            Background::Custom(rgb) => rgb,
        }
    }

    /// As renderers want it.
    pub fn rgb(self) -> [f32; 3] {
        self.rgb8().map(|v| f32::from(v) / 255.0)
    }
}

/// What a frame may take unless another budget is chosen: the pace of a camera of 30 frames a second.
const FRAME_BUDGET_MS: f64 = 33.3;

/// Settings of the viewport.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct ViewSettings {
    /// The renderer; with a fisheye it is always the exact one.
    pub renderer: Renderer,
    /// What the exact renderer does about thin splats.
    pub antialias: Antialias,
    /// How pixels map to rays.
    pub lens: Lens,
    /// Vertical field of view of the pinhole, degrees; the scene's own camera's if `None`.
    pub pinhole_fov_deg: Option<f32>,
    /// Vertical field of view of the fisheye, degrees.
    pub fisheye_fov_deg: f32,
    /// Factor on the splats' sizes.
    pub scale: f32,
    /// Splats with a smaller opacity are left out.
    pub opacity_cut: f32,
    /// Colour behind the scene.
    pub background: Background,
    /// How bright a scene is drawn from anywhere whose cameras exposed by themselves; beside photographs
    /// it is always as they recorded it.
    pub exposing: Exposing,
    /// Factor on differences.
    pub difference_gain: f32,
    /// Whether the dataset's cameras are drawn when something else is there to see.
    pub shows_cameras: bool,
    /// Whether the points of the current frame are drawn.
    pub shows_points: bool,
    /// Whether the ground and the axes are drawn.
    pub shows_grid: bool,
    /// Whether what a file would give back is shown before it is written.
    pub previews_export: bool,
    /// Frames between two measurements of held-out views while training goes on; `None` measures at rest
    /// alone.
    pub quality_every: Option<usize>,
    /// What training a frame may take, milliseconds: a line in the plot of latencies.
    pub frame_budget_ms: f64,
    /// Share of all cores that drawing may take while frames are trained, where no GPU draws.
    pub draw_share: f32,
    /// What earlier moments of a scene in training may take to be walked back to, MB.
    pub past_mb: u32,
    /// What colours mean. Not kept: the next scene may not tell it.
    #[serde(skip)]
    pub color_mode: ColorMode,
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
            background: Background::Dark,
            exposing: Exposing::Neutral,
            difference_gain: 8.0,
            shows_cameras: false,
            shows_points: false,
            shows_grid: false,
            previews_export: true,
            quality_every: Some(DEFAULT_EVERY),
            frame_budget_ms: FRAME_BUDGET_MS,
            draw_share: DEFAULT_SHARE,
            past_mb: 128,
            color_mode: ColorMode::Color,
        }
    }
}

impl ViewSettings {
    /// Reads what an earlier session wrote by [`Self::to_text`]. What cannot be read falls back to
    /// the defaults, with a text that says so.
    pub fn from_text(text: &str) -> (Self, Option<String>) {
        let (read, notice) = stored_text::from_text::<Self>("the viewport", text);
        (read.in_range(), notice)
    }

    /// For the next session.
    pub fn to_text(&self) -> Result<String, ron::Error> {
        ron::to_string(self)
    }

    fn in_range(self) -> Self {
        let start = Self::default();
        let within = |value: f32, range: RangeInclusive<f32>, otherwise: f32| {
            // `clamp` lets a NaN through.
            if value.is_finite() { value.clamp(*range.start(), *range.end()) } else { otherwise }
        };
        let pinhole = self.pinhole_fov_deg.filter(|fov| fov.is_finite());
        // The text may be written by hand: only in the window does `set_lens` see to this.
        let renderer = if self.lens == Lens::Fisheye { Renderer::Exact } else { self.renderer };
        Self {
            renderer,
            pinhole_fov_deg: pinhole.map(|fov| within(fov, PINHOLE_FOV_DEG, fov)),
            fisheye_fov_deg: within(self.fisheye_fov_deg, FISHEYE_FOV_DEG, start.fisheye_fov_deg),
            scale: within(self.scale, SCALES, start.scale),
            opacity_cut: within(self.opacity_cut, 0.0..=1.0, start.opacity_cut),
            quality_every: self.quality_every.map(|every| every.max(1)),
            frame_budget_ms: match self.frame_budget_ms {
                ms if ms.is_finite() && ms > 0.0 => ms,
                _ => FRAME_BUDGET_MS,
            },
            draw_share: within(self.draw_share, SHARES, start.draw_share),
            past_mb: self.past_mb.min(MAX_PAST_MB),
            difference_gain: within(self.difference_gain, GAINS, start.difference_gain),
            ..self
        }
    }

    /// What earlier moments of a scene in training may take, bytes.
    pub fn past_bytes(&self) -> usize {
        self.past_mb as usize * 1_000_000
    }

    /// Chooses the lens; the projected renderer cannot follow to a fisheye.
    pub fn set_lens(&mut self, lens: Lens) {
        self.lens = lens;
        if lens == Lens::Fisheye {
            self.renderer = Renderer::Exact;
        }
    }

    /// A renderer as it is set here, through a lens.
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

    /// Everything else a picture depends on. `radius` is the scene's, in world units, `distance` the
    /// camera's from its middle.
    pub fn options(&self, method: RenderMethod, radius: f64, distance: f64) -> RenderOptions {
        let range = [(distance - radius).max(0.0), distance + radius].map(|d| d as f32);
        let look = SplatStyle {
            scale: self.scale,
            opacity_cut: self.opacity_cut,
            paint: self.color_mode.paint(range),
        };
        // Colours that stand for something else must not change with the place.
        let exposing = match self.color_mode {
            ColorMode::Color => self.exposing,
            _ => Exposing::Neutral,
        };
        let plain = RenderOptions::viewport(method, self.background.rgb(), radius);
        RenderOptions { look, exposing, ..plain }
    }

    /// The settings by which `eval` would measure the renderer chosen here at a dataset's camera.
    pub fn measured(&self) -> RenderOptions {
        let method = self.method(self.renderer, Lens::Pinhole);
        RenderOptions::evaluation(method, self.background.rgb())
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
            background: Background::Custom([1, 2, 3]),
            color_mode: ColorMode::Depth,
            ..ViewSettings::default()
        };
        let (read, notice) = ViewSettings::from_text(&chosen.to_text().unwrap());
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
        let text = "(scale: 99.0, opacity_cut: NaN, past_mb: 99999, pinhole_fov_deg: Some(500.0), lens: fisheye)";
        let (read, notice) = ViewSettings::from_text(text);
        assert_eq!((read.scale, read.opacity_cut, read.past_mb), (3.0, 0.0, MAX_PAST_MB));
        assert_eq!((read.pinhole_fov_deg, read.renderer), (Some(150.0), Renderer::Exact));
        assert_eq!(notice, None);
    }
}
