//! Parameters of the photometric step (`photographs.md`, Constants).

use crate::model::scene::splat_rule::SplatRule;
use crate::model::splat::appearance::OPAQUE;
use crate::render::cpu::photometric::RowSubset;
use crate::train::setting::value::named_values;
use serde::{Deserialize, Serialize};
use strum::{Display, EnumString, VariantNames};

/// Maximum size of the shuffle buffer that can be configured, in photographs.
pub const MAX_WAITING: usize = 1000;
/// Maximum size of the shuffle buffer in bytes.
const MOST_WAITING_BYTES: usize = 64_000_000;

// Pixels per frame if rows are skipped at all: photographs of phones have millions.
const MOST_PIXELS: usize = 100_000;

/// Parameters of photometric training: weight of photographs, limits of steps, and prior of the splats.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PhotometricRule {
    /// Standard deviation of a pixel's colour, in units of the usual residual. The usual residual is the
    /// running root mean square of the residuals of covered pixels before each step.
    pub noise: f64,
    /// Share of a frame's curvature (Gauss-Newton matrix) that is added to a splat's precision. It is
    /// below 1 because the pixels of a splat are correlated and the model is not linear.
    pub kept: f64,
    /// Share of a splat's precision that is replaced by the prior's precision in every frame that shows
    /// the splat.
    pub forgotten: f64,
    /// Factor on a frame's curvature in the step for that frame. Values above 1 shorten the step.
    pub damping: f64,
    /// Residual at which the Cauchy weight is one half, colour units.
    pub tau: f64,
    /// Weight of a squared coverage error relative to a squared colour error.
    pub coverage: f64,
    /// Weight of a squared depth error relative to a squared colour error; 0 in files without this
    /// value. The depth error of a pixel is 1 if all its splats are far from the measured depth.
    #[serde(default)]
    pub depth: f64,
    /// Trust region: maximum change of a splat in one step. It limits means in units of the largest
    /// scale, logarithms of scales, and rotations in radians. Logarithms of opacities, and colours, may
    /// change three times as much.
    pub trust: f64,
    /// Stride of the pixel rows used for training: 1, 2, 4, 8 or 16. Each row is weighted by the stride,
    /// and the first row changes from frame to frame.
    #[serde(default = "every_row")]
    pub rows: u32,
    /// Number of points below which a component's splat is reinitialised from its points in every
    /// frame. A splat that was not yet trained on a photograph is reinitialised too.
    #[serde(default)]
    pub young: f64,
    /// Maximum number of photographs in the shuffle buffer; 0 disables the buffer. When the buffer is
    /// full, every new photograph causes a step on a random one.
    #[serde(default)]
    pub shuffle_buffer: usize,
    /// Standard deviations of the prior.
    pub prior: PriorDeviations,
    /// Maximum opacity of a splat after a step.
    // Follows from the kind of splats, which their own rule stores.
    #[serde(skip, default = "flat")]
    pub most_opacity: f64,
}

const MOST_OPACITY: f64 = 3.0;

fn flat() -> f64 {
    MOST_OPACITY
}

fn every_row() -> u32 {
    1
}

/// Prior standard deviations of a splat's parameters around their initial values, which derive from
/// points. A deviation of 0 excludes `directional` or `gradient` from training.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PriorDeviations {
    /// Position of the splat's mean, in units of its largest scale.
    pub mean: f64,
    /// Logarithm of a scale.
    pub scale: f64,
    /// Rotation about the splat's own axes, radians.
    pub turn: f64,
    /// Logarithm of the opacity.
    pub opacity: f64,
    /// Constant part of the colour, per channel.
    pub color: f64,
    /// Coefficients of the colour's dependence on the view direction.
    pub directional: f64,
    /// Change of colour over a distance of the largest scale.
    pub gradient: f64,
}

impl PhotometricRule {
    /// Returns this rule with training disabled for parameters that the given kind of splats does not
    /// have.
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

    /// Returns the row stride for an image of `pixels` pixels; one depth pixel covers `per_depth_pixel`
    /// pixels. Full training uses about one row per row of the depth image. Light training uses at most
    /// about 100,000 pixels.
    pub fn row_stride(&self, pixels: usize, per_depth_pixel: f64) -> u32 {
        let power_of_two =
            |rows: usize| rows.min(RowSubset::MAX_STRIDE as usize).next_power_of_two();
        let fewest = match self.rows {
            // The ratio is of areas, the stride of one axis.
            0 | 1 => per_depth_pixel.sqrt() as usize,
            _ => pixels.div_ceil(MOST_PIXELS),
        };
        (power_of_two(fewest.max(1)) as u32).clamp(self.rows.max(1), RowSubset::MAX_STRIDE)
    }

    /// Returns the maximum number of photographs in the shuffle buffer, if each takes `bytes` bytes.
    pub fn most_waiting(&self, bytes: usize) -> usize {
        self.shuffle_buffer.min(MOST_WAITING_BYTES / bytes.max(1))
    }

    /// Returns the maximum memory of the shuffle buffer, in bytes, for photographs of `pixels` pixels
    /// each.
    pub fn waiting_bytes(&self, pixels: usize) -> usize {
        let of_one = pixels / self.row_stride(pixels, 1.0) as usize
            * (size_of::<[u8; 4]>() + size_of::<u16>());
        of_one * self.most_waiting(of_one)
    }

    /// Rule for [`PhotometricMode::Light`]: two CPU cores suffice for training in real time.
    pub const LIGHT: Self = Self { rows: 4, ..Self::DEFAULT };

    /// Default rule, used for all sensors.
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

/// Amount of photometric training.
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Display, EnumString, VariantNames,
)]
#[serde(rename_all = "kebab-case")]
#[strum(serialize_all = "kebab-case")]
pub enum PhotometricMode {
    /// No photometric training: splats are derived from the points alone.
    Off,
    /// Training on every fourth row of pixels, for which two CPU cores suffice in real time.
    Light,
    /// Training on every pixel. If the photograph has more pixels than the depth image, about one row
    /// per depth row is used.
    Full,
}

impl PhotometricMode {
    /// Returns the mode that corresponds to a rule; [`Self::Off`] if there is no rule.
    pub fn of(rule: Option<PhotometricRule>) -> Self {
        match rule {
            None => Self::Off,
            Some(rule) if rule.rows > 1 => Self::Light,
            Some(_) => Self::Full,
        }
    }

    /// Returns the rule of this mode; `None` for [`Self::Off`].
    pub fn rule(self) -> Option<PhotometricRule> {
        match self {
            Self::Off => None,
            Self::Light => Some(PhotometricRule::LIGHT),
            Self::Full => Some(PhotometricRule::DEFAULT),
        }
    }
}

named_values!(by name PhotometricMode {
    "off" "Off" "Splats from points only";
    "light" "Light" "Also trains on some rows of every photograph: sharper, still real time";
    "full" "Full" "Also trains on every photograph in full: sharper, several times slower";
});

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn large_photographs_give_fewer_rows() {
        let rows = |pixels| PhotometricRule::LIGHT.row_stride(pixels, 1.0);
        assert_eq!([rows(400 * 400), rows(640 * 480), rows(800 * 800)], [4, 4, 8]);
        assert_eq!(rows(1920 * 1440), 16);
        let full = |ratio| PhotometricRule::DEFAULT.row_stride(1920 * 1440, ratio);
        assert_eq!([full(1.0), full(3.9), full(14.0), full(56.25), full(1e9)], [1, 1, 4, 8, 16]);
    }
}
