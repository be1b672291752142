//! What a scene's splats carry beyond position, shape and one colour (`rendering.md` (h)).

use super::splats::Splat;

/// Colour that varies over a splat and with the direction it is seen from. Zero is a plain splat.
#[derive(Clone, Copy, Debug, Default, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct Appearance {
    /// Colour gradient: row per channel, column per world axis; change per world unit from the
    /// mean. A pixel's change is held within ±0.5.
    pub gradient: [[f32; 3]; 3],
    /// Degree-1 colour: row per channel, times the unit direction from the camera to the mean.
    pub directional: [[f32; 3]; 3],
}

impl Appearance {
    /// Whether every coefficient is finite.
    pub fn is_valid(&self) -> bool {
        self.gradient.iter().chain(&self.directional).flatten().all(|x| x.is_finite())
    }
}

/// Splats as renderers take them.
#[derive(Clone, Copy, Debug)]
pub struct SplatView<'a> {
    splats: &'a [Splat],
    appearance: &'a [Appearance],
}

impl<'a> SplatView<'a> {
    /// Splats with their appearance, one each; no appearance at all makes them plain. `None` if the
    /// numbers differ.
    pub fn new(splats: &'a [Splat], appearance: &'a [Appearance]) -> Option<Self> {
        let fits = appearance.is_empty() || appearance.len() == splats.len();
        fits.then_some(Self { splats, appearance })
    }

    /// The splats.
    pub fn splats(&self) -> &'a [Splat] {
        self.splats
    }

    /// Their appearance: one each, or none at all.
    pub fn appearance(&self) -> &'a [Appearance] {
        self.appearance
    }
}

impl<'a> From<&'a [Splat]> for SplatView<'a> {
    fn from(splats: &'a [Splat]) -> Self {
        Self { splats, appearance: &[] }
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
