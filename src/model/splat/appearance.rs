//! Appearance of a scene's splats beyond position, shape and one colour (`rendering.md`, Native
//! appearance).
//!
//! It is stored beside the splats, not in them. So splats of a single colour, such as those from files
//! of other programs, need no memory for it.

use super::observed_cone::ObservedCone;
use super::pose_log::{ExposureLog, PoseLog};
use super::splats::Splat;
use super::texture::{LearnedTextures, ShownTextures, Textures};
use crate::math::camera::Camera;
use crate::math::pose::Pose;
use std::ops::Deref;
use std::sync::Arc;

/// Maximum amount by which a splat's gradient changes a colour channel of a pixel.
pub const GRADIENT_LIMIT: f64 = 0.5;

/// Colour that varies over a splat and with the view direction. All coefficients are zero for a splat
/// of a single colour.
#[derive(Clone, Copy, Debug, Default, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct Appearance {
    /// Colour gradient: one row per channel, one column per world axis. It is the colour change per
    /// world unit of distance from the mean. For each pixel, the change is clamped to
    /// ±[`GRADIENT_LIMIT`].
    pub gradient: [[f32; 3]; 3],
    /// Coefficients of the view-dependent colour (degree 1), one row per channel. They are multiplied by
    /// the unit direction from the camera to the mean, clamped to the observed directions. The splat's
    /// own colour is the constant term and may lie outside `[0, 1]`.
    pub directional: [[f32; 3]; 3],
    /// Range of the directions from which the splat was observed.
    pub observed: ObservedCone,
}

impl Appearance {
    /// True if every coefficient is finite.
    pub fn is_valid(&self) -> bool {
        let rows = self.gradient.iter().chain(&self.directional);
        rows.flatten().all(|x| x.is_finite()) && self.observed.is_valid()
    }
}

/// Borrowed splats as passed to renderers; [`SplatSet`] owns them.
#[derive(Clone, Copy, Debug)]
pub struct SplatView<'a> {
    splats: &'a [Splat],
    appearance: &'a [Appearance],
    finishing: &'a Finishing,
    learned: Option<&'a dyn LearnedTextures>,
}

impl<'a> SplatView<'a> {
    /// Combines splats with one appearance each. If `appearance` is empty, no splat has an appearance.
    /// Returns `None` if the lengths differ.
    pub fn new(splats: &'a [Splat], appearance: &'a [Appearance]) -> Option<Self> {
        let fits = appearance.is_empty() || appearance.len() == splats.len();
        fits.then_some(Self { splats, appearance, finishing: &PLAIN, learned: None })
    }

    /// Returns the view with other parameters for finishing composited pixels.
    pub fn with_finishing(self, finishing: &'a Finishing) -> Self {
        Self { finishing, ..self }
    }

    /// Returns the view with textures that are composed as they are read, by the CPU renderer only.
    pub fn with_learned(self, textures: &'a dyn LearnedTextures) -> Self {
        Self { learned: Some(textures), ..self }
    }

    /// Returns the textures to draw.
    pub fn textures(&self) -> Option<ShownTextures<'a>> {
        let composed = || self.finishing.textures.as_deref().map(ShownTextures::Composed);
        self.learned.map(ShownTextures::Learned).or_else(composed)
    }

    /// Returns the splats in order; slots of opacity 0 are empty.
    pub fn splats(&self) -> &'a [Splat] {
        self.splats
    }

    /// Returns one appearance per splat, or an empty slice if no splat has an appearance.
    pub fn appearance(&self) -> &'a [Appearance] {
        self.appearance
    }

    /// Returns the parameters used to finish composited pixels.
    pub fn finishing(&self) -> &'a Finishing {
        self.finishing
    }
}

/// Splats and their appearance. Dereferences to the splats.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SplatSet {
    splats: Vec<Splat>,
    /// One appearance per splat, or empty while no splat has an appearance.
    appearance: Vec<Appearance>,
    finishing: Finishing,
}

/// Parameters for finishing composited pixels, and logs of the training frames.
#[derive(Clone, Debug, PartialEq)]
pub struct Finishing {
    /// Opacity of the composited splats from which a pixel is treated as fully covered, in `(0, 1]`; 1
    /// for plain splats (standard 3DGS splats).
    pub full_coverage: f32,
    /// True if antialiasing lowers opacities by the area that it adds to a splat in the image, as for splats
    /// trained with the filter of Mip-Splatting (`rendering.md`, Opacity compensation).
    pub is_antialiased: bool,
    /// Exposures of the training frames, if known.
    pub exposures: Option<Arc<ExposureLog>>,
    /// Pose corrections of the training frames, if any.
    pub poses: Option<Arc<PoseLog>>,
    /// Poses of the training frames' photographs relative to those of their points, if they differ.
    pub photograph_poses: Option<Arc<PoseLog>>,
    /// Textures by splat, if any.
    pub textures: Option<Arc<Textures>>,
}

impl Finishing {
    /// Returns the corrected pose of a camera recorded at `pose`, predicted from the training frames.
    pub fn corrected_pose(&self, pose: &Pose) -> Pose {
        self.poses.as_ref().map_or(*pose, |log| log.at(pose))
    }

    /// Returns the camera of a photograph, at a pose predicted from the training frames. `camera` is the camera at the
    /// corrected pose of the frame.
    pub fn photograph_camera(&self, camera: Camera) -> Camera {
        let pose = self.photograph_poses.as_ref().map(|log| log.at(&camera.pose));
        Camera { pose: pose.unwrap_or(camera.pose), ..camera }
    }

    /// Returns the number of textures, and their memory in bytes.
    pub fn texture_size(&self) -> (usize, usize) {
        let textures = self.textures.iter().flat_map(|all| all.iter().flatten());
        textures.fold((0, 0), |(n, bytes), texture| (n + 1, bytes + texture.bytes()))
    }

    /// Returns the parameters for splats in other colours than the learned ones.
    pub fn without_textures(&self) -> Self {
        Self { textures: None, ..self.clone() }
    }
}

// Static, so that views of plain splats can borrow it.
static PLAIN: Finishing = Finishing {
    full_coverage: 1.0,
    is_antialiased: false,
    exposures: None,
    poses: None,
    photograph_poses: None,
    textures: None,
};

/// Parameters that leave pixels unchanged, as for plain splats (standard 3DGS splats).
impl Default for Finishing {
    fn default() -> Self {
        PLAIN.clone()
    }
}

impl SplatSet {
    /// Creates a set of splats with one appearance each.
    pub fn new(splats: Vec<Splat>, appearance: Vec<Appearance>) -> Self {
        assert_eq!(splats.len(), appearance.len(), "a splat has one appearance");
        Self { splats, appearance, ..Self::default() }
    }

    /// Returns the set with the given parameters for finishing composited pixels.
    pub fn finished(self, finishing: Finishing) -> Self {
        Self { finishing, ..self }
    }

    /// Returns the parameters for finishing composited pixels.
    pub fn finishing(&self) -> &Finishing {
        &self.finishing
    }

    /// Returns the splats for which `keep` returns true, given slot and splat, in order. Each keeps its
    /// appearance and texture.
    pub fn retained(&self, keep: impl Fn(usize, &Splat) -> bool) -> Self {
        let slots: Vec<usize> = (0..self.len()).filter(|&i| keep(i, &self.splats[i])).collect();
        let mut kept = Self::default().finished(self.finishing.clone());
        for &slot in &slots {
            kept.push(self.splats[slot], self.appearance_of(slot));
        }
        let of = |textures: &Arc<Textures>| {
            slots.iter().map(|&slot| textures.get(slot).cloned().flatten()).collect()
        };
        kept.finishing.textures = self.finishing.textures.as_ref().map(of).map(Arc::new);
        kept
    }

    /// Adds a splat.
    pub fn push(&mut self, splat: Splat, appearance: Appearance) {
        self.put(self.splats.len(), splat, appearance);
    }

    /// Writes the splats of `new` into the listed slots, in order, and copies the finishing parameters
    /// of `new`. Missing slots are added; added slots that are not listed stay empty.
    pub fn replace(&mut self, slots: &[u32], new: &SplatSet) {
        self.finishing.clone_from(&new.finishing);
        for (i, (&slot, splat)) in slots.iter().zip(&new.splats).enumerate() {
            self.put(slot as usize, *splat, new.appearance_of(i));
        }
    }

    fn put(&mut self, slot: usize, splat: Splat, appearance: Appearance) {
        let n = self.splats.len().max(slot + 1);
        self.splats.resize(n, Splat::default());
        self.splats[slot] = splat;
        // Plain splats take no memory for appearance until another kind is added.
        if !self.appearance.is_empty() || appearance != Appearance::default() {
            self.appearance.resize(n, Appearance::default());
            self.appearance[slot] = appearance;
        }
    }

    /// Returns the appearance of a splat.
    pub fn appearance_of(&self, slot: usize) -> Appearance {
        self.appearance.get(slot).copied().unwrap_or_default()
    }

    /// Returns the splats for modification in place.
    pub fn splats_mut(&mut self) -> &mut [Splat] {
        &mut self.splats
    }

    /// Returns the splats without their appearance.
    pub fn into_splats(self) -> Vec<Splat> {
        self.splats
    }

    /// Borrows the set for rendering.
    pub fn view(&self) -> SplatView<'_> {
        let Self { splats, appearance, finishing } = self;
        SplatView { splats, appearance, finishing, learned: None }
    }
}

impl Deref for SplatSet {
    type Target = [Splat];

    fn deref(&self) -> &[Splat] {
        &self.splats
    }
}

impl From<Vec<Splat>> for SplatSet {
    fn from(splats: Vec<Splat>) -> Self {
        Self { splats, ..Self::default() }
    }
}

impl<'a> From<&'a SplatSet> for SplatView<'a> {
    fn from(set: &'a SplatSet) -> Self {
        set.view()
    }
}

impl<'a> From<&'a [Splat]> for SplatView<'a> {
    fn from(splats: &'a [Splat]) -> Self {
        Self { splats, appearance: &[], finishing: &PLAIN, learned: None }
    }
}

impl<'a> From<&'a Vec<Splat>> for SplatView<'a> {
    fn from(splats: &'a Vec<Splat>) -> Self {
        splats.as_slice().into()
    }
}

impl<'a, const N: usize> From<&'a [Splat; N]> for SplatView<'a> {
    fn from(splats: &'a [Splat; N]) -> Self {
        splats.as_slice().into()
    }
}

/// Maximum opacity of a plain splat (a standard 3DGS splat). Renderers limit alpha to this value too.
pub const OPAQUE: f64 = 0.99;

/// Factor on the standard deviations of plain splats (standard 3DGS splats, without colour gradient).
/// The best picture requires 1.3 times the standard deviation of the points, while native splats
/// require 1.2.
pub const PLAIN_WIDTH: f64 = 1.3 / 1.2;

/// Converts a splat of `opacity` to a plain splat (a standard 3DGS splat) that covers the same area.
/// Returns the plain splat's opacity, and the factor on the standard deviations.
///
/// The given splat covers `∫ min(c, o·exp(−r²/2)) dA = 2πc·(1 + ln(o/c))`; a Gaussian of peak `c`
/// covers `2πc`.
pub fn plain_of_equal_area(opacity: f64) -> (f64, f64) {
    match opacity > OPAQUE {
        true => (OPAQUE, (1.0 + (opacity / OPAQUE).ln()).sqrt()),
        false => (opacity, 1.0),
    }
}

#[cfg(test)]
mod plain_tests {
    use super::*;
    use crate::model::splat::texture::{Lattice, Texture};

    #[test]
    fn retained_splats_keep_their_textures() {
        let texture = |half| {
            let axes = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
            let lattice = Lattice { anchor: [0.0; 3], axes, half, level: 0 };
            Some(Arc::new(Texture { lattice, index: vec![0], patches: Vec::new() }))
        };
        // The last splat is newer than the textures.
        let textures = Some(Arc::new(vec![texture(0.0), texture(1.0), None, texture(3.0)]));
        let set = SplatSet::from(vec![Splat::default(); 5]);
        let set = set.finished(Finishing { full_coverage: 0.5, textures, ..Finishing::default() });
        let kept = set.retained(|slot, _| slot != 0 && slot != 2);
        let expected = [texture(1.0), texture(3.0), None];
        assert_eq!(kept.finishing().textures.as_ref().unwrap()[..], expected);
        assert_eq!((kept.len(), kept.finishing().full_coverage), (3, 0.5));
        assert!(set.finishing().without_textures().textures.is_none());
    }

    #[test]
    fn a_plain_splat_covers_what_the_flat_top_did() {
        for opacity in [0.4, 0.99, 1.5, 3.0] {
            let (plain, factor) = plain_of_equal_area(opacity);
            let covered = |opacity: f64, deviation: f64| {
                let rings = (0..20_000).map(|i| (f64::from(i) + 0.5) * 1e-3);
                let alpha = |r: f64| OPAQUE.min(opacity * (-0.5 * (r / deviation).powi(2)).exp());
                rings.map(|r| alpha(r) * r * 1e-3).sum::<f64>()
            };
            let (native, flat) = (covered(opacity, 1.0), covered(plain, factor));
            assert!((native / flat - 1.0).abs() < 1e-3, "{opacity}: {native} and {flat}");
        }
    }
}
