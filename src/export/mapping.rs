//! Conversion of native splats to plain ones (`files.md`, Native splats as plain ones). Plain splats are
//! standard 3D Gaussians with opacities up to 1 and no colour gradient. A flat top becomes a wider
//! splat. A splat with a gradient becomes several splats, its pieces.
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
//! let plain = to_plain(native.view(), Mapping::for_split(GradientSplit::Two)).ok_or("plain already")?;
//! assert_eq!(plain.len(), 2);
//! assert!(plain.iter().all(|s| s.opacity <= 0.99));
//! assert!(plain[0].color[0] < 0.4 && plain[1].color[0] > 0.6);
//! // Plain splats need no mapping.
//! assert!(to_plain(plain.view(), Mapping::default()).is_none());
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

use super::gaussian::{Gaussian, SCALE_FLOOR, color_change, drawable, from_rows, scale_floor};
use crate::model::splat::appearance::{
    Appearance, OPAQUE, PLAIN_WIDTH, SplatSet, SplatView, plain_of_equal_area,
};
use crate::model::splat::splats::Splat;
use glam::{DMat3, DVec3};
use serde::{Deserialize, Serialize};
use strum::{EnumMessage, EnumString, VariantNames};

/// Conversion of native splats to plain ones, which other programs can draw. The default writes one
/// plain splat for each native splat without a texture, and [`DETAIL`] small splats for all textures.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Mapping {
    /// Treatment of opacities above 0.99.
    pub opacity: OpacityMapping,
    /// Treatment of colour gradients.
    pub split: GradientSplit,
    /// Number of small splats, about, that replace splats with textures; `None` leaves textures out.
    pub detail: Option<usize>,
}

/// Treatment of opacities above 0.99.
#[derive(
    Clone,
    Copy,
    Debug,
    Default,
    PartialEq,
    Eq,
    Serialize,
    Deserialize,
    EnumMessage,
    EnumString,
    VariantNames,
)]
#[serde(rename_all = "kebab-case")]
#[strum(serialize_all = "kebab-case")]
pub enum OpacityMapping {
    /// Sets the opacity to 0.99 and enlarges the splat so that it covers the area of its flat top.
    #[default]
    EqualArea,
    /// Clips the opacity to 0.99 without changing the scales, so flat tops shrink.
    Clip,
}

/// Number of plain splats written for each native splat.
#[derive(
    Clone,
    Copy,
    Debug,
    Default,
    PartialEq,
    Eq,
    Serialize,
    Deserialize,
    EnumMessage,
    EnumString,
    VariantNames,
)]
#[serde(rename_all = "kebab-case")]
pub enum GradientSplit {
    /// One splat; the colour gradient is lost.
    #[default]
    #[strum(serialize = "1")]
    One,
    /// Two splats along the longest axis, coloured by the colour gradient.
    #[strum(serialize = "2")]
    Two,
    /// Four splats along both tangential axes, coloured by the colour gradient.
    #[strum(serialize = "4")]
    Four,
}

/// Default number of small splats, about, that replace splats with textures.
// The same files without textures are mush: a phone's door 28.2 instead of 31.9 dB against the scene.
pub const DETAIL: usize = 150_000;

impl Default for Mapping {
    fn default() -> Self {
        Self::for_split(GradientSplit::One)
    }
}

impl Mapping {
    /// Returns the mapping with the opacity treatment that gave the highest PSNR for a split.
    pub fn for_split(split: GradientSplit) -> Self {
        // On Lego, four clipped splats gave 26.6 dB and two of equal area 26.5. Single splats gave 26.1 with
        // equal area and 25.7 clipped.
        let opacity = match split {
            GradientSplit::One | GradientSplit::Two => OpacityMapping::EqualArea,
            GradientSplit::Four => OpacityMapping::Clip,
        };
        Self { opacity, split, detail: Some(DETAIL) }
    }

    /// Returns the factor by which a splat's standard deviations are multiplied. `full_coverage` is the
    /// opacity from which the native scene counts a pixel as fully covered; 1 without crack filling.
    fn scale(self, full_coverage: f64) -> f64 {
        // Crack filling also widens splats, by the fourth root of its opacity factor, because neighbours
        // overlap.
        let narrower = full_coverage.powf(0.25);
        match (self.split, self.opacity) {
            (GradientSplit::One, OpacityMapping::EqualArea) => PLAIN_WIDTH * narrower,
            // Measures best at 1.5 times the deviation of the points, where native splats use 1.2.
            (GradientSplit::One, OpacityMapping::Clip) => 1.5 / 1.2,
            (GradientSplit::Two | GradientSplit::Four, _) => narrower,
        }
    }
}

impl GradientSplit {
    /// Number of axes along which a splat is split.
    fn n_axes(self) -> usize {
        match self {
            GradientSplit::One => 0,
            GradientSplit::Two => 1,
            GradientSplit::Four => 2,
        }
    }

    /// Returns the distance of the pieces' centres from the splat's mean along each split axis, in
    /// standard deviations.
    fn piece_distance(self) -> f64 {
        match self {
            GradientSplit::One => 0.0,
            GradientSplit::Two => 0.75,
            GradientSplit::Four => 0.6,
        }
    }
}

/// True if all drawable splats are plain: no opacity above 1, no colour gradient and no crack filling.
pub fn is_plain(view: SplatView) -> bool {
    view.finishing().full_coverage == 1.0
        && drawable(view).all(|(i, g)| g.opacity <= 1.0 && gradient(view, i) == DMat3::ZERO)
}

/// Returns a sentence about textures, which no file of splats stores; `None` if there are none.
pub fn lost_textures(view: SplatView) -> Option<String> {
    let (n, bytes) = view.finishing().texture_size();
    let megabytes = 1e-6 * bytes as f64;
    (n > 0).then(|| {
        format!(
            "Textures of {n} splats, {megabytes:.1} MB, are not stored; a checkpoint stores them"
        )
    })
}

/// Converts splats to plain ones; `None` if all are plain already (see [`is_plain`]). If any splat is
/// native, all are mapped. View-dependent colour of degree 1 is unchanged. Undrawable splats are left
/// out.
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

/// Returns the `k`-th of the plain splats that splat `i` is exported as; `None` if it is not finite in
/// f32.
pub(super) fn plain_piece(
    view: SplatView,
    i: usize,
    native: &Gaussian,
    k: usize,
    mapping: Mapping,
) -> Option<(Splat, Appearance)> {
    let full_coverage = f64::from(view.finishing().full_coverage);
    let piece = piece(native, gradient(view, i), mapping.split, k);
    to_plain_opacity(piece, full_coverage, mapping).to_splat()
}

pub(super) fn n_pieces(native: &Gaussian, mapping: Mapping) -> usize {
    1 << split_axes(native, mapping.split).count()
}

fn gradient(view: SplatView, i: usize) -> DMat3 {
    view.appearance().get(i).map_or(DMat3::ZERO, |appearance| from_rows(appearance.gradient))
}

/// Returns the axes along which a splat is split, the longest first.
fn split_axes(native: &Gaussian, split: GradientSplit) -> impl DoubleEndedIterator<Item = usize> {
    // Along the longest axes the gradient changes the colour most.
    let scale = native.scale;
    let mut order = [0, 1, 2];
    order.sort_by(|&a, &b| scale[b].total_cmp(&scale[a]));
    // Along an axis without extent the pieces would coincide.
    order
        .into_iter()
        .take(split.n_axes())
        .filter(move |&i| scale[i] > scale_floor(scale) && scale[i] != SCALE_FLOOR)
}

/// Returns the `k`-th of the splats into which a splat with a colour gradient is split. Together they
/// have the mean, covariance and colour of the original splat.
fn piece(native: &Gaussian, gradient: DMat3, split: GradientSplit, k: usize) -> Gaussian {
    let frame = DMat3::from_quat(native.rotation);
    let (mut scale, mut offset) = (native.scale, DVec3::ZERO);
    for (bit, axis) in split_axes(native, split).rev().enumerate() {
        let step = split.piece_distance() * native.scale[axis] * frame.col(axis);
        offset += if k >> bit & 1 == 1 { step } else { -step };
        // The spread of the centres adds variance, so each piece gets correspondingly less.
        scale[axis] *= (1.0 - split.piece_distance().powi(2)).sqrt();
    }
    Gaussian {
        mean: native.mean + offset,
        color: native.color + color_change(gradient, offset),
        scale,
        ..*native
    }
}

fn to_plain_opacity(splat: Gaussian, full_coverage: f64, mapping: Mapping) -> Gaussian {
    let mut factor = mapping.scale(full_coverage);
    // Undoes crack filling, exactly where a single splat covers a pixel.
    let splat = Gaussian { opacity: splat.opacity / full_coverage, ..splat };
    if mapping.opacity == OpacityMapping::EqualArea {
        factor *= plain_of_equal_area(splat.opacity).1;
    }
    Gaussian { opacity: splat.opacity.min(OPAQUE), scale: splat.scale * factor, ..splat }
}
