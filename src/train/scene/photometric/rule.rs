//! Constants of the photometric step (`photometric.md`, Constants).

use crate::model::scene::splat_rule::SplatRule;
use crate::model::splat::plain::OPAQUE;
use crate::render::cpu::photometric::RowChoice;
use crate::train::setting::value::{Choice, SettingValue, ValueError};
use serde::{Deserialize, Serialize};
use std::ffi::OsStr;
use strum::{Display, EnumString, VariantNames};

/// Photographs that a user may let wait at most.
pub const MAX_WAITING: usize = 1000;
/// Bytes of photographs that wait at most.
const MOST_WAITING_BYTES: usize = 64_000_000;

/// Pixels that are learnt of a frame where rows are left out at all: photographs of phones have millions.
const MOST_PIXELS: usize = 100_000;

/// How much a photograph is believed, and what is expected of splats before any.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PhotometricRule {
    /// Standard deviation of a pixel's colour, in units of the root mean square difference of covered
    /// pixels between the frames so far and the pictures drawn before they were learnt.
    pub noise: f64,
    /// Share of a frame's curvature that precision keeps: pixels of a splat are not independent, and
    /// the model is not linear.
    pub kept: f64,
    /// Share of the precision that goes back to the prior's with every frame that shows the splat.
    pub forgotten: f64,
    /// Factor of a frame's curvature in its own step.
    pub damping: f64,
    /// Scale of the Cauchy weight of residuals, colour units.
    pub tau: f64,
    /// How much a coverage that is wrong by 1 counts beside a colour that is, squared.
    pub coverage: f64,
    /// The same of a pixel whose splats all lie far from the depth that was measured of it. None where
    /// that was not asked yet.
    #[serde(default)]
    pub depth: f64,
    /// Largest step: of means in units of the largest scale, of logarithms of scales, of turns in
    /// radians; opacities and colours may go three times as far.
    pub trust: f64,
    /// Every how many rows of pixels are learnt, each in place of so many: 1, 2, 4, 8 or 16, others in each
    /// frame.
    #[serde(default = "every_row")]
    pub rows: u32,
    /// Points of a component up to which its splat begins anew with every frame: what few of them say of
    /// a surface is no place to start from. Splats that no photograph has taught yet do so anyway.
    #[serde(default)]
    pub young: f64,
    /// Photographs that wait at most; out of them one is drawn at random for every one that comes.
    #[serde(default)]
    pub shuffle_buffer: usize,
    /// Standard deviations of the prior.
    pub prior: PriorDeviations,
    /// Largest opacity that a step leaves.
    // What splats are says it, and their rule holds that.
    #[serde(skip, default = "flat")]
    pub most_opacity: f64,
}

/// Largest opacity of a splat with a flat top.
const MOST_OPACITY: f64 = 3.0;

fn flat() -> f64 {
    MOST_OPACITY
}

fn every_row() -> u32 {
    1
}

/// How far a splat's parameters may lie from what the points say; those of colour by direction or by place
/// stay as they are where it is 0.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PriorDeviations {
    /// Of the mean, units of the largest scale.
    pub mean: f64,
    /// Of the logarithm of a scale.
    pub scale: f64,
    /// Of turns about the splat's own axes, radians.
    pub turn: f64,
    /// Of the logarithm of the opacity.
    pub opacity: f64,
    /// Of a channel's constant colour.
    pub color: f64,
    /// Of its part by direction.
    pub directional: f64,
    /// Of its change over the largest scale.
    pub gradient: f64,
}

impl PhotometricRule {
    /// With what splats of a rule do not have left alone.
    pub fn of_splats(self, splats: &SplatRule) -> Self {
        let of = |has: bool, deviation: f64| if has { deviation } else { 0.0 };
        let gradient = of(splats.gradient, self.prior.gradient);
        let directional = of(splats.directional, self.prior.directional);
        let most_opacity = if splats.flat_top { MOST_OPACITY } else { OPAQUE };
        Self {
            prior: PriorDeviations { gradient, directional, ..self.prior },
            most_opacity,
            ..self
        }
    }

    /// Every how many rows of an image of so many pixels are learned, of which so many belong to a pixel
    /// of depth: about a row for each row of depth at least.
    pub fn rows_of(&self, pixels: usize, per_depth_pixel: f64) -> u32 {
        let power_of_two = |rows: usize| rows.min(RowChoice::MOST as usize).next_power_of_two();
        let fewest = match self.rows {
            0 | 1 => per_depth_pixel.sqrt() as usize,
            _ => pixels.div_ceil(MOST_PIXELS),
        };
        (power_of_two(fewest.max(1)) as u32).clamp(self.rows.max(1), RowChoice::MOST)
    }

    /// How many photographs of so many bytes may wait.
    pub fn most_waiting(&self, bytes: usize) -> usize {
        self.shuffle_buffer.min(MOST_WAITING_BYTES / bytes.max(1))
    }

    /// Bytes of photographs of so many pixels that wait at most.
    pub fn waiting_bytes(&self, pixels: usize) -> usize {
        let of_one =
            pixels / self.rows_of(pixels, 1.0) as usize * (size_of::<[u8; 4]>() + size_of::<u16>());
        of_one * self.most_waiting(of_one)
    }

    /// What two cores can afford live.
    pub const LIGHT: Self = Self { rows: 4, ..Self::DEFAULT };

    /// One rule for all sensors.
    pub const DEFAULT: Self = Self {
        noise: 4.0,
        kept: 0.5,
        forgotten: 0.02,
        damping: 1.2,
        tau: 0.5,
        coverage: 1.5,
        depth: 0.5,
        trust: 0.2,
        rows: 1,
        young: 40.0,
        shuffle_buffer: 60,
        prior: PriorDeviations {
            mean: 0.5,
            scale: 0.26,
            turn: 0.3,
            opacity: 0.4,
            color: 0.3,
            directional: 0.3,
            gradient: 0.15,
        },
        most_opacity: MOST_OPACITY,
    };
}

/// How much of a photograph splats learn from.
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Display, EnumString, VariantNames,
)]
#[serde(rename_all = "kebab-case")]
#[strum(serialize_all = "kebab-case")]
pub enum PhotometricMode {
    /// Nothing: splats are what the points say.
    Off,
    /// Every fourth row of pixels: what two cores can afford live.
    Light,
    /// Every pixel; with more of them than depth has, about a row for each row of depth.
    Full,
}

impl PhotometricMode {
    /// The mode of a rule, if there is one.
    pub fn of(rule: Option<PhotometricRule>) -> Self {
        match rule {
            None => Self::Off,
            Some(rule) if rule.rows > 1 => Self::Light,
            Some(_) => Self::Full,
        }
    }

    /// Its rule.
    pub fn rule(self) -> Option<PhotometricRule> {
        match self {
            Self::Off => None,
            Self::Light => Some(PhotometricRule::LIGHT),
            Self::Full => Some(PhotometricRule::DEFAULT),
        }
    }
}

impl SettingValue for PhotometricMode {
    fn choices() -> Vec<Choice> {
        vec![
            Choice { name: "off", label: "Off", help: "Splats are what the points say" },
            Choice {
                name: "light",
                label: "Light",
                help: "Every frame also takes a step on some rows of its picture: sharper, and still live",
            },
            Choice {
                name: "full",
                label: "Full",
                help: "Every frame also takes a step on its picture: sharper, and several times slower",
            },
        ]
    }

    fn parse(text: &OsStr) -> Result<Self, ValueError> {
        let found = text.display();
        let mode = text.to_str().and_then(|text| text.parse().ok());
        mode.ok_or_else(|| {
            ValueError::Text(format!("expected off, light or full, found `{found}`"))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn large_photographs_give_fewer_rows() {
        let rows = |pixels| PhotometricRule::LIGHT.rows_of(pixels, 1.0);
        assert_eq!([rows(400 * 400), rows(640 * 480), rows(800 * 800)], [4, 4, 8]);
        assert_eq!(rows(1920 * 1440), 16);
        let full = |ratio| PhotometricRule::DEFAULT.rows_of(1920 * 1440, ratio);
        assert_eq!([full(1.0), full(3.9), full(14.0), full(56.25), full(1e9)], [1, 1, 4, 8, 16]);
    }
}
