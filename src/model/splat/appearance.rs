//! What a scene's splats carry beyond position, shape and one colour (`rendering.md`, Native
//! appearance).
//!
//! Appearance lies beside the splats, not in them: plain splats, which files of other programs
//! hold, take no memory for it.

use super::exposure::ExposureLog;
use super::observed_cone::ObservedCone;
use super::pose_log::PoseLog;
use super::splats::Splat;
use crate::math::pose::Pose;
use std::ops::Deref;
use std::sync::Arc;

/// A pixel's change of colour by a splat's gradient is held within this.
pub const GRADIENT_LIMIT: f64 = 0.5;

/// Colour that varies over a splat and with the direction it is seen from. Zero is a plain splat.
#[derive(Clone, Copy, Debug, Default, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct Appearance {
    /// Colour gradient: row per channel, column per world axis; change per world unit from the
    /// mean. A pixel's change is held within ±[`GRADIENT_LIMIT`].
    pub gradient: [[f32; 3]; 3],
    /// Degree-1 colour: row per channel, times the unit direction from the camera to the mean, as far as
    /// that was observed. The
    /// splat's own colour is the constant term then and may lie outside `[0, 1]`.
    pub directional: [[f32; 3]; 3],
    /// The directions it was observed from.
    pub observed: ObservedCone,
}

impl Appearance {
    /// Whether every coefficient is finite.
    pub fn is_valid(&self) -> bool {
        let rows = self.gradient.iter().chain(&self.directional);
        rows.flatten().all(|x| x.is_finite()) && self.observed.is_valid()
    }
}

/// Splats as renderers take them; [`SplatSet`] owns what this borrows.
#[derive(Clone, Copy, Debug)]
pub struct SplatView<'a> {
    splats: &'a [Splat],
    appearance: &'a [Appearance],
    finishing: &'a Finishing,
}

impl<'a> SplatView<'a> {
    /// Splats with their appearance, one each; no appearance at all makes them plain. `None` if the
    /// numbers differ.
    pub fn new(splats: &'a [Splat], appearance: &'a [Appearance]) -> Option<Self> {
        let fits = appearance.is_empty() || appearance.len() == splats.len();
        fits.then_some(Self { splats, appearance, finishing: &PLAIN })
    }

    /// The splats in their order; slots of opacity 0 are empty.
    pub fn splats(&self) -> &'a [Splat] {
        self.splats
    }

    /// Appearance of the splats: one each, or none at all if all are plain.
    pub fn appearance(&self) -> &'a [Appearance] {
        self.appearance
    }

    /// What becomes of finished pixels.
    pub fn finishing(&self) -> &'a Finishing {
        self.finishing
    }
}

/// Splats together with their appearance. Dereferences to the splats; of plain ones there is
/// nothing else.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SplatSet {
    splats: Vec<Splat>,
    /// Empty until a splat comes that is not plain.
    appearance: Vec<Appearance>,
    finishing: Finishing,
}

/// What a scene says of finished pixels, and of the frames behind it.
#[derive(Clone, Debug, PartialEq)]
pub struct Finishing {
    /// Coverage from which on a pixel counts as covered in full, in `(0, 1]`; 1 for plain splats.
    pub full_coverage: f32,
    /// How the frames behind the splats were exposed, where that is known.
    pub exposures: Option<Arc<ExposureLog>>,
    /// How the poses of these frames were corrected, where they were.
    pub poses: Option<Arc<PoseLog>>,
}

impl Finishing {
    /// Where a camera really stood that was recorded at `pose`, as far as the frames behind the splats say.
    pub fn corrected(&self, pose: &Pose) -> Pose {
        self.poses.as_ref().map_or(*pose, |log| log.at(pose))
    }
}

static PLAIN: Finishing = Finishing { full_coverage: 1.0, exposures: None, poses: None };

/// Pixels of plain splats stay as they are.
impl Default for Finishing {
    fn default() -> Self {
        PLAIN.clone()
    }
}

impl SplatSet {
    /// Splats with one appearance each.
    pub fn new(splats: Vec<Splat>, appearance: Vec<Appearance>) -> Self {
        assert_eq!(splats.len(), appearance.len(), "a splat has one appearance");
        Self { splats, appearance, ..Self::default() }
    }

    /// These splats with another finishing of pixels.
    pub fn finished(self, finishing: Finishing) -> Self {
        Self { finishing, ..self }
    }

    /// What becomes of finished pixels.
    pub fn finishing(&self) -> &Finishing {
        &self.finishing
    }

    /// Adds a splat.
    pub fn push(&mut self, splat: Splat, appearance: Appearance) {
        self.put(self.splats.len(), splat, appearance);
    }

    /// Puts the splats of `new` into the listed slots, in their order, and finishes pixels as `new`
    /// does. Slots that are not there yet are added; those in between stay empty.
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
        if !self.appearance.is_empty() || appearance != Appearance::default() {
            self.appearance.resize(n, Appearance::default());
            self.appearance[slot] = appearance;
        }
    }

    /// Appearance of a splat.
    pub fn appearance_of(&self, slot: usize) -> Appearance {
        self.appearance.get(slot).copied().unwrap_or_default()
    }

    /// The splats, to be changed in place.
    pub fn splats_mut(&mut self) -> &mut [Splat] {
        &mut self.splats
    }

    /// The splats without their appearance.
    pub fn into_splats(self) -> Vec<Splat> {
        self.splats
    }

    /// What renderers take.
    pub fn view(&self) -> SplatView<'_> {
        SplatView { splats: &self.splats, appearance: &self.appearance, finishing: &self.finishing }
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
        Self { splats, appearance: &[], finishing: &PLAIN }
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
