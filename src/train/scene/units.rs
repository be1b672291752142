//! Lengths and sizes in the notation of settings.

use super::config::COMPONENT_BYTES;
use serde::{Deserialize, Serialize};

/// Default structural scale of depth images of [`LARGE_IMAGE`] pixels and more, in pixels.
pub(crate) const COARSEST_DEFAULT: f64 = 2.5;
/// Default structural scale of small depth images, in pixels. Finer ones bring less than 0.1 dB
/// (`scene.md`, Births).
const FINEST_DEFAULT: f64 = 2.0;
/// Pixels of a depth image of which two cores train a frame within 33 ms.
const LARGE_IMAGE: f64 = 640.0 * 480.0;
/// Minimum structural scale if seeds are searched for along rays, as a share of the sensor's depth
/// tolerance. The search assigns points displaced by depth noise (`scene.md`, Ray search).
const ALONG_RAYS: f64 = 0.8;

/// Structural scale: maximum distance of a point from its component's seed, the point at which that
/// component was created.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(into = "String", try_from = "Spelling")]
pub enum StructuralScale {
    /// Length in pixels at the 95th percentile of depth. On nearer surfaces the same length covers more
    /// pixels.
    Pixels(f64),
    /// Length in world units.
    World(f64),
}

impl StructuralScale {
    /// Returns the default scale for depth images of `n_pixels`. Smaller images get smaller components, as
    /// many in a view as in one of 640×480, so that a frame takes no longer.
    pub fn default_for(n_pixels: usize) -> Self {
        let pixels = COARSEST_DEFAULT * (n_pixels as f64 / LARGE_IMAGE).sqrt();
        let pixels = pixels.clamp(FINEST_DEFAULT, COARSEST_DEFAULT);
        Self::Pixels((100.0 * pixels).round() / 100.0)
    }

    /// True for a finite, positive length.
    pub fn is_positive(&self) -> bool {
        let (Self::Pixels(length) | Self::World(length)) = self;
        length.is_finite() && *length > 0.0
    }

    /// Returns the minimum structural scale, world units, for a sensor that cannot separate depths
    /// within `tolerance` (world units). A scale given in world units may be as small as half the
    /// tolerance.
    pub fn min_length(self, tolerance: f64, are_rays_searched: bool) -> f64 {
        match self {
            Self::Pixels(_) if are_rays_searched => ALONG_RAYS * tolerance,
            Self::Pixels(_) => tolerance,
            Self::World(_) => 0.5 * tolerance,
        }
    }
}

impl std::str::FromStr for StructuralScale {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (number, form): (&str, fn(f64) -> Self) = match text.strip_suffix("px") {
            Some(number) => (number, Self::Pixels),
            None => (text, Self::World),
        };
        match number.trim().parse() {
            Ok(value) if value > 0.0 && f64::is_finite(value) => Ok(form(value)),
            _ => Err(format!(
                "expected pixels such as 2.5px, or world units such as 0.02, found `{text}`"
            )),
        }
    }
}

impl TryFrom<Spelling> for StructuralScale {
    type Error = String;

    fn try_from(spelling: Spelling) -> Result<Self, String> {
        spelling.text().parse()
    }
}

impl From<StructuralScale> for String {
    fn from(scale: StructuralScale) -> Self {
        match scale {
            StructuralScale::Pixels(n) => format!("{n}px"),
            StructuralScale::World(h) => h.to_string(),
        }
    }
}

/// Maximum number of components of a scene.
///
/// ```
/// use vbgs_studio::train::scene::units::Budget;
///
/// assert_eq!("25000".parse(), Ok(Budget::Components(25_000)));
/// assert!("5MB".parse::<Budget>()?.components() > 20_000);
/// assert!("much".parse::<Budget>().is_err());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(into = "String", try_from = "Spelling")]
pub enum Budget {
    /// Number of components.
    Components(usize),
    /// Model size in bytes, at [`COMPONENT_BYTES`] per component.
    Bytes(usize),
}

impl Budget {
    /// Returns the budget as a number of components.
    pub fn components(self) -> usize {
        match self {
            Self::Components(n) => n,
            Self::Bytes(n) => n / COMPONENT_BYTES,
        }
    }
}

impl std::str::FromStr for Budget {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let wrong = || {
            format!("expected components such as 25000, or megabytes such as 5MB, found `{text}`")
        };
        match text.strip_suffix("MB") {
            None => text.parse().map(Self::Components).map_err(|_| wrong()),
            Some(number) => match number.trim().parse::<f64>() {
                Ok(mb) if mb > 0.0 && mb < 1e6 => Ok(Self::Bytes((mb * 1e6).round() as usize)),
                _ => Err(wrong()),
            },
        }
    }
}

impl TryFrom<Spelling> for Budget {
    type Error = String;

    fn try_from(spelling: Spelling) -> Result<Self, String> {
        spelling.text().parse()
    }
}

/// Number with or without a unit in a settings file: `"5MB"`, `"25000"` or `25000`.
#[derive(Deserialize)]
#[serde(untagged)]
enum Spelling {
    Text(String),
    Number(f64),
}

impl Spelling {
    fn text(self) -> String {
        match self {
            Self::Text(text) => text,
            Self::Number(number) => number.to_string(),
        }
    }
}

impl From<Budget> for String {
    fn from(budget: Budget) -> Self {
        match budget {
            Budget::Components(n) => n.to_string(),
            Budget::Bytes(n) => format!("{}MB", n as f64 / 1e6),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scales_are_pixels_or_world_units() {
        assert_eq!("2.5px".parse(), Ok(StructuralScale::Pixels(2.5)));
        assert_eq!("0.02".parse(), Ok(StructuralScale::World(0.02)));
        for wrong in ["", "px", "-1", "0px", "nan", "inf", "2 metres"] {
            assert!(wrong.parse::<StructuralScale>().is_err(), "{wrong}");
        }
        let back: StructuralScale = String::from(StructuralScale::Pixels(3.0)).parse().unwrap();
        assert_eq!(back, StructuralScale::Pixels(3.0));
    }

    #[test]
    fn the_default_scale_keeps_the_number_of_components_in_a_view() {
        let of = |size: [usize; 2]| StructuralScale::default_for(size[0] * size[1]);
        let sizes = [[320, 240], [400, 400], [512, 424], [640, 480], [1280, 720]];
        assert_eq!(sizes.map(of), [2.0, 2.0, 2.1, 2.5, 2.5].map(StructuralScale::Pixels));
    }

    #[test]
    fn lengths_and_budgets_follow_from_their_units() {
        let [pixels, world] = [StructuralScale::Pixels(2.0), StructuralScale::World(2.0)];
        assert_eq!(
            [
                pixels.min_length(0.5, true),
                pixels.min_length(0.5, false),
                world.min_length(0.5, true)
            ],
            [0.4, 0.5, 0.25]
        );
        for length in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            let lengths = [StructuralScale::Pixels(length), StructuralScale::World(length)];
            assert!(lengths.iter().all(|length| !length.is_positive()), "{length}");
        }
        assert!(pixels.is_positive() && world.is_positive());
        let components = [Budget::Components(7), Budget::Bytes(1_000_000)].map(Budget::components);
        assert_eq!(components, [7, 5000]);
        for wrong in ["0MB", "-1MB", "1000000MB", "nanMB", "MB", "1.5"] {
            assert!(wrong.parse::<Budget>().is_err(), "{wrong}");
        }
    }

    #[test]
    fn files_may_state_plain_numbers() {
        assert_eq!(ron::from_str("100"), Ok(Budget::Components(100)));
        assert_eq!(ron::from_str("\"5MB\""), Ok(Budget::Bytes(5_000_000)));
        assert_eq!(serde_json::from_str::<Budget>("25000").ok(), Some(Budget::Components(25_000)));
        assert_eq!(ron::from_str("0.02"), Ok(StructuralScale::World(0.02)));
        assert!(ron::from_str::<Budget>("1.5").is_err());
    }

    #[test]
    fn budgets_come_back_as_they_were() {
        for text in ["25000", "5MB", "20.3MB", "0.1MB"] {
            let budget: Budget = text.parse().unwrap();
            assert_eq!(String::from(budget), text);
        }
    }
}
