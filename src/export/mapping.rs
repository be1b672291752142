//! Natively rendered splats as plain ones (`export.md`, Native splats as plain ones). Plain files
//! end at opacity 1 and hold no colour gradient; here a flat top becomes a wider splat, and a
//! gradient several splats.
//!
//! ```
//! use vbgs_studio::export::mapping::{Mapping, GradientSplit, to_plain};
//! use vbgs_studio::model::splat::appearance::{Appearance, SplatSet, SplatView};
//! use vbgs_studio::model::splat::splats::Splat;
//!
//! // A disc with a flat top, redder along its long axis.
//! let splat =
//!     Splat { opacity: 2.5, color: [0.5; 3], scale: [0.02, 0.01, 0.001], ..Splat::default() };
//! let mut native = SplatSet::default();
//! native.push(splat, Appearance { gradient: [[10.0, 0.0, 0.0], [0.0; 3], [0.0; 3]], ..Appearance::default() });
//!
//! let plain = to_plain(native.view(), Mapping::of(GradientSplit::Two)).ok_or("plain already")?;
//! assert_eq!(plain.len(), 2);
//! assert!(plain.iter().all(|s| s.opacity <= 0.99));
//! assert!(plain[0].color[0] < 0.4 && plain[1].color[0] > 0.6);
//! // Nothing is left to map.
//! assert!(to_plain(plain.view(), Mapping::default()).is_none());
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

use super::gaussian::{Gaussian, SCALE_FLOOR, drawable, from_rows, scale_floor};
use crate::model::splat::appearance::{Appearance, GRADIENT_LIMIT, SplatSet, SplatView};
use crate::model::splat::plain::{OPAQUE, PLAIN_WIDTH, of_equal_area};
use crate::model::splat::splats::Splat;
use glam::{DMat3, DVec3};
use serde::{Deserialize, Serialize};

/// How native splats become plain ones; `default()` writes one splat for each.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Mapping {
    /// What becomes of opacities above 1.
    pub opacity: OpacityMapping,
    /// What becomes of colour gradients.
    pub split: GradientSplit,
}

/// What becomes of opacities above 0.99.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum OpacityMapping {
    /// 0.99, and standard deviations that give the splat the area which its flat top covered.
    #[default]
    EqualArea,
    /// Opacity cut to 0.99, standard deviations kept: flat tops shrink.
    Clip,
}

/// Plain splats for each native one.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum GradientSplit {
    /// One: the colour gradient is lost.
    #[default]
    One,
    /// Two along the longest axis, coloured by the gradient.
    Two,
    /// Four along both tangential axes.
    Four,
}

impl Mapping {
    /// The opacity mapping that measured best with a split.
    pub fn of(split: GradientSplit) -> Self {
        // On Lego four clipped splats gave 26.6 dB and two of equal area 26.5; single ones 26.1 of
        // equal area, 25.7 clipped.
        let opacity = match split {
            GradientSplit::One | GradientSplit::Two => OpacityMapping::EqualArea,
            GradientSplit::Four => OpacityMapping::Clip,
        };
        Self { opacity, split }
    }

    /// Factor on standard deviations. Clipped splats without a gradient look best wider than such of equal
    /// area: at 1.5 times the deviation of the points where native ones have 1.2. What crack filling adds
    /// to opacity widens a splat too, by less than it would if its neighbours were not there.
    fn scale(self, full_coverage: f64) -> f64 {
        let narrower = full_coverage.powf(0.25);
        match (self.split, self.opacity) {
            (GradientSplit::One, OpacityMapping::EqualArea) => PLAIN_WIDTH * narrower,
            (GradientSplit::One, OpacityMapping::Clip) => 1.5 / 1.2,
            (GradientSplit::Two | GradientSplit::Four, _) => narrower,
        }
    }
}

impl GradientSplit {
    /// Axes along which a splat is split, the longest first.
    fn n_axes(self) -> usize {
        match self {
            GradientSplit::One => 0,
            GradientSplit::Two => 1,
            GradientSplit::Four => 2,
        }
    }

    /// Distance of the centres from the mean along each of these axes, in standard deviations.
    fn reach(self) -> f64 {
        match self {
            GradientSplit::One => 0.0,
            GradientSplit::Two => 0.75,
            GradientSplit::Four => 0.6,
        }
    }
}

/// Whether a plain file can hold the drawable splats as they are: none more opaque than 1, none with
/// a colour gradient, and cracks between them left open.
pub fn is_plain(view: SplatView) -> bool {
    view.finishing().full_coverage == 1.0
        && drawable(view).all(|(i, g)| g.opacity <= 1.0 && gradient(view, i) == DMat3::ZERO)
}

/// Splats that a plain file can hold, or `None` if these are (see [`is_plain`]). One native splat
/// makes a scene native, and all its splats are mapped alike. Degree-1 colour stays as it is; what
/// cannot be drawn is left out.
pub fn to_plain(view: SplatView, mapping: Mapping) -> Option<SplatSet> {
    if is_plain(view) {
        return None;
    }
    let mut plain = SplatSet::default();
    for (i, native) in drawable(view) {
        for k in 0..n_pieces(&native, mapping) {
            if let Some((splat, appearance)) = plain_piece(view, i, &native, k, mapping) {
                plain.push(splat, appearance);
            }
        }
    }
    Some(plain)
}

/// Piece `k` of splat `i`, which is `native`; `None` if it is more than a file can hold.
pub(super) fn plain_piece(
    view: SplatView,
    i: usize,
    native: &Gaussian,
    k: usize,
    mapping: Mapping,
) -> Option<(Splat, Appearance)> {
    let full_coverage = f64::from(view.finishing().full_coverage);
    let piece = piece(native, gradient(view, i), mapping.split, k);
    plain_of(piece, full_coverage, mapping).to_splat()
}

/// Number of pieces a splat becomes.
pub(super) fn n_pieces(native: &Gaussian, mapping: Mapping) -> usize {
    1 << split_axes(native, mapping.split).count()
}

fn gradient(view: SplatView, i: usize) -> DMat3 {
    view.appearance().get(i).map_or(DMat3::ZERO, |appearance| from_rows(appearance.gradient))
}

/// The axes a splat is split along: the longest, where a gradient changes the colour most.
fn split_axes(native: &Gaussian, split: GradientSplit) -> impl DoubleEndedIterator<Item = usize> {
    let scale = native.scale;
    let mut order = [0, 1, 2];
    order.sort_by(|&a, &b| scale[b].total_cmp(&scale[a]));
    // Along an axis without extent the pieces would lie on each other.
    order
        .into_iter()
        .take(split.n_axes())
        .filter(move |&i| scale[i] > scale_floor(scale) && scale[i] != SCALE_FLOOR)
}

/// One of the pieces of a splat, whose centres, covariances and colours together are its own.
fn piece(native: &Gaussian, gradient: DMat3, split: GradientSplit, k: usize) -> Gaussian {
    let frame = DMat3::from_quat(native.rotation);
    let (mut scale, mut offset) = (native.scale, DVec3::ZERO);
    for (bit, axis) in split_axes(native, split).rev().enumerate() {
        let step = split.reach() * native.scale[axis] * frame.col(axis);
        offset += if k >> bit & 1 == 1 { step } else { -step };
        // What the centres' spread adds to the variance, the pieces give up: together they have the
        // splat's own.
        scale[axis] *= (1.0 - split.reach().powi(2)).sqrt();
    }
    let limit = DVec3::splat(GRADIENT_LIMIT);
    Gaussian {
        mean: native.mean + offset,
        color: native.color + (gradient * offset).clamp(-limit, limit),
        scale,
        ..*native
    }
}

/// The splat with an opacity that plain files can hold.
fn plain_of(splat: Gaussian, full_coverage: f64, mapping: Mapping) -> Gaussian {
    let mut factor = mapping.scale(full_coverage);
    // Where one splat alone covers a pixel, that is what crack filling makes of it.
    let splat = Gaussian { opacity: splat.opacity / full_coverage, ..splat };
    if mapping.opacity == OpacityMapping::EqualArea {
        factor *= of_equal_area(splat.opacity).1;
    }
    Gaussian { opacity: splat.opacity.min(OPAQUE), scale: splat.scale * factor, ..splat }
}
