//! What photographs have taught a scene's splats: parameters and their precision, row by component.

use crate::model::splat::appearance::Appearance;
use crate::model::splat::splats::Splat;

/// Parameters of position and form: mean (world units), logarithms of the scales, turns about the
/// splat's own axes (radians), logarithm of the opacity.
pub const N_FORM: usize = 10;
/// Coefficients of a channel's colour: constant, by direction, by place (per world unit).
pub const N_COLOR: usize = 7;
/// Numbers of the lower triangle of the precision of position and form.
pub const N_FORM_PRECISION: usize = N_FORM * (N_FORM + 1) / 2;
/// Numbers of the lower triangle of the precision of a channel's colour.
pub const N_COLOR_PRECISION: usize = N_COLOR * (N_COLOR + 1) / 2;

/// Splats as photographs have corrected them. Rows are components; one of opacity 0 has no splat.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PhotometricState {
    /// The splats, world units.
    pub splats: Vec<Splat>,
    /// How their colour varies.
    pub appearance: Vec<Appearance>,
    /// Precision of mean, logarithms of scales, turns and logarithm of opacity: the lower triangle,
    /// row by row.
    pub form: Vec<[f32; N_FORM_PRECISION]>,
    /// Precision of the colour's coefficients, which all channels share.
    pub color: Vec<[f32; N_COLOR_PRECISION]>,
    /// Running mean square of the differences between photographs and the pictures drawn before
    /// these were learnt, per channel; and the weight behind it.
    pub noise: [f64; 2],
}

impl PhotometricState {
    /// Bytes of a component, beside those of its sums.
    pub const BYTES: usize = size_of::<Splat>()
        + size_of::<Appearance>()
        + size_of::<[f32; N_FORM_PRECISION]>()
        + size_of::<[f32; N_COLOR_PRECISION]>();

    /// Bytes that it takes of the model.
    pub fn bytes(&self) -> usize {
        self.splats.len() * Self::BYTES
    }

    /// Makes room for so many components; new ones have no splat.
    pub fn grow(&mut self, n: usize) {
        self.splats.resize(n, Splat::default());
        self.appearance.resize(n, Appearance::default());
        self.form.resize(n, [0.0; N_FORM_PRECISION]);
        self.color.resize(n, [0.0; N_COLOR_PRECISION]);
    }

    /// Those of the listed components, in their order.
    pub fn listed(&self, components: &[u32]) -> Self {
        Self {
            splats: listed_rows(&self.splats, components, Splat::default()),
            appearance: listed_rows(&self.appearance, components, Appearance::default()),
            form: listed_rows(&self.form, components, [0.0; N_FORM_PRECISION]),
            color: listed_rows(&self.color, components, [0.0; N_COLOR_PRECISION]),
            noise: self.noise,
        }
    }

    /// Whether a component has a splat.
    pub fn has(&self, component: usize) -> bool {
        self.splats.get(component).is_some_and(|splat| splat.opacity > 0.0)
    }
}

/// Rows that are not there yet are `none`.
fn listed_rows<T: Copy>(rows: &[T], list: &[u32], none: T) -> Vec<T> {
    list.iter().map(|&i| rows.get(i as usize).copied().unwrap_or(none)).collect()
}
