//! Photometric state of a scene: splat parameters and their precision, one row per component.

use super::texels::TextureSums;
use super::waiting::BufferedPhotograph;
use crate::math::cholesky::{Cholesky, at};
use crate::model::splat::appearance::Appearance;
use crate::model::splat::observed_cone::ObservedCone;
use crate::model::splat::pose_log::FramePose;
use crate::model::splat::splats::Splat;
use rayon::prelude::*;
use std::sync::Arc;

/// Number of parameters of a splat's position, shape and opacity: mean (world units), logarithms of the
/// scales, rotation about the splat's own axes (radians), logarithm of the opacity.
pub const N_FORM: usize = 10;
/// Number of colour coefficients of a channel: the constant, the dependence on direction (3), and that
/// on position (3, per world unit).
pub const N_COLOR: usize = 7;
/// Number of entries in the lower triangle of the precision matrix of the [`N_FORM`] parameters.
pub const N_FORM_PRECISION: usize = N_FORM * (N_FORM + 1) / 2;
/// Number of entries in the lower triangle of the precision matrix of a channel's [`N_COLOR`]
/// coefficients.
pub const N_COLOR_PRECISION: usize = N_COLOR * (N_COLOR + 1) / 2;

/// Splats as corrected by photographs, one row per component; a component with opacity 0 has no splat.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PhotometricState {
    /// The splats, world units.
    pub splats: Vec<Splat>,
    /// Variation of the splats' colour with position and direction.
    pub appearance: Vec<Appearance>,
    /// Precision matrix of each splat's mean, log scales, rotation and log opacity: lower triangle, row
    /// by row.
    pub form: Vec<[f32; N_FORM_PRECISION]>,
    /// Precision matrix of each splat's colour coefficients, shared by all channels: lower triangle, row
    /// by row.
    pub color: Vec<[f32; N_COLOR_PRECISION]>,
    /// Textures of the splats; components beyond the end have none. Copies of the state share them.
    pub textures: Vec<Option<Arc<TextureSums>>>,
    /// Number of times that the pitch of all textures was doubled to keep their memory within the budget.
    pub texture_steps: u32,
    /// Running mean of the squared residual per channel, and its weight in frames. The residual is
    /// between a photograph and the scene rendered before training on it.
    pub noise: [f64; 2],
    /// Running mean of a squared colour difference, and its weight in frames. The difference is between
    /// a frame's points and the mean colours of their components, before training on the frame.
    pub points: [f64; 2],
    /// Running mean, and its weight in frames, of a share: that of the components in view behind which
    /// a frame measured a farther surface.
    pub seen_through: [f64; 2],
    /// Poses of the photographs relative to those of their points, in the order of their photometric steps. The
    /// recorded pose of an entry is that of the points.
    pub photograph_poses: Vec<FramePose>,
    /// Buffered photographs for later photometric steps, in no particular order.
    pub buffered: Vec<BufferedPhotograph>,
}

impl PhotometricState {
    /// Memory per component, in bytes, in addition to the component's sums.
    pub const BYTES: usize = size_of::<Splat>()
        + size_of::<Appearance>()
        + size_of::<[f32; N_FORM_PRECISION]>()
        + size_of::<[f32; N_COLOR_PRECISION]>();

    /// True if a splat has a texture.
    pub fn has_textures(&self) -> bool {
        self.textures.iter().any(Option::is_some)
    }

    /// Returns the memory used by splats, in bytes.
    pub fn splat_bytes(&self) -> usize {
        self.splats.len() * Self::BYTES
    }

    /// Returns the memory used by textures, in bytes.
    pub fn texture_bytes(&self) -> usize {
        // In chunks: an iterator per texture would take longer than its bytes.
        let chunks = self.textures.par_chunks(1024);
        chunks.map(|part| part.iter().flatten().map(|texture| texture.bytes()).sum::<usize>()).sum()
    }

    /// Grows the state to `n` components; new components have no splat.
    pub fn grow(&mut self, n: usize) {
        self.splats.resize(n, Splat::default());
        self.appearance.resize(n, Appearance::default());
        self.form.resize(n, [0.0; N_FORM_PRECISION]);
        self.color.resize(n, [0.0; N_COLOR_PRECISION]);
    }

    /// Returns a copy with `n` components, for a checkpoint. Observed directions are left out, as they derive
    /// from the components' sums.
    pub fn stored(&self, n: usize) -> Self {
        let mut appearance = copied_rows(&self.appearance, n, Appearance::default());
        appearance.par_iter_mut().for_each(|look| look.observed = ObservedCone::default());
        Self {
            splats: copied_rows(&self.splats, n, Splat::default()),
            appearance,
            form: copied_rows(&self.form, n, [0.0; N_FORM_PRECISION]),
            color: copied_rows(&self.color, n, [0.0; N_COLOR_PRECISION]),
            textures: self.stored_textures(n),
            texture_steps: self.texture_steps,
            noise: self.noise,
            points: self.points,
            seen_through: self.seen_through,
            photograph_poses: self.photograph_poses.clone(),
            // Pixels are shared, so this copies cameras and pointers only.
            buffered: self.buffered.clone(),
        }
    }

    /// Returns the textures of the first `n` components, shared with the state. Components beyond the last
    /// texture are left out, so that equal states are stored alike.
    fn stored_textures(&self, n: usize) -> Vec<Option<Arc<TextureSums>>> {
        let textures = self.textures.get(..n).unwrap_or(&self.textures);
        let n = textures.iter().rposition(Option::is_some).map_or(0, |last| last + 1);
        textures.iter().take(n).cloned().collect()
    }

    /// Merges the texture of one component into that of another, which keeps its lattice.
    pub fn merge_texture(&mut self, kept: usize, dropped: usize) {
        let Some(more) = self.textures.get_mut(dropped).and_then(Option::take) else { return };
        if kept >= self.textures.len() {
            self.textures.resize(kept + 1, None);
        }
        merge_textures(&mut self.textures[kept], more);
    }

    /// Doubles the pitch of all textures until they take at most `budget` bytes. Returns true if they have
    /// changed.
    pub fn coarsen_textures_to(&mut self, budget: usize) -> bool {
        let steps = self.texture_steps;
        let is_coarsest = |texture: &Arc<TextureSums>| texture.lattice.level == 0;
        while self.texture_bytes() > budget && !self.textures.iter().flatten().all(is_coarsest) {
            self.texture_steps += 1;
            self.textures.par_iter_mut().flatten().for_each(|texture| {
                Arc::make_mut(texture).coarsen();
            });
        }
        self.texture_steps != steps
    }

    /// Returns the splat of a component and its appearance; `None` if it has no splat.
    pub fn splat(&self, component: usize) -> Option<(Splat, Appearance)> {
        self.has_splat(component).then(|| (self.splats[component], self.appearance[component]))
    }

    /// True if a component has a splat.
    pub fn has_splat(&self, component: usize) -> bool {
        self.splats.get(component).is_some_and(|splat| splat.opacity > 0.0)
    }
}

/// Adds a texture to another one of the same surface, if there is one. The other one keeps its lattice.
pub fn merge_textures(kept: &mut Option<Arc<TextureSums>>, more: Arc<TextureSums>) {
    match kept {
        Some(kept) => Arc::make_mut(kept).merge(&more),
        None => *kept = Some(more),
    }
}

/// Posterior standard deviations of a splat's parameters. Parameters of shape and parameters of colour
/// are two blocks; each standard deviation is marginalised over the other parameters of its block.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PhotometricDeviations {
    /// Standard deviation of the mean along each world axis, world units.
    pub mean: [f64; 3],
    /// Standard deviation of each scale, relative to the scale.
    pub scale: [f64; 3],
    /// Standard deviation of the rotation about each of the splat's own axes, radians.
    pub turn: [f64; 3],
    /// Standard deviation of the opacity, relative to the opacity.
    pub opacity: f64,
    /// Standard deviation of the constant colour of a channel, colour units.
    pub color: f64,
}

impl PhotometricDeviations {
    /// Computes the standard deviations of one component's splat parameters. `None` if the component
    /// has no splat or its precision is not positive definite.
    pub fn of(state: &PhotometricState, component: usize) -> Option<Self> {
        if !state.has_splat(component) {
            return None;
        }
        let form: [f64; N_FORM] = deviations(&state.form[component])?;
        let color: [f64; N_COLOR] = deviations(&state.color[component])?;
        let three = |first: usize| std::array::from_fn(|i| form[first + i]);
        let (mean, scale, turn) = (three(0), three(3), three(6));
        Some(Self { mean, scale, turn, opacity: form[N_FORM - 1], color: color[0] })
    }

    /// Standard deviation of the mean's position, world units.
    pub fn position_deviation(&self) -> f64 {
        self.mean.iter().map(|x| x * x).sum::<f64>().sqrt()
    }
}

/// Returns the standard deviations of parameters whose precision matrix has the given lower triangle.
/// `None` if the matrix is not positive definite.
fn deviations<const N: usize>(triangle: &[f32]) -> Option<[f64; N]> {
    let entry = |i: usize| f64::from(triangle[at((i / N).max(i % N), (i / N).min(i % N))]);
    let matrix: Vec<f64> = (0..N * N).map(entry).collect();
    let factor = Cholesky::new(N, &matrix)?;
    Some(std::array::from_fn(|i| {
        let mut unit = vec![0.0; N];
        unit[i] = 1.0;
        factor.solve(&unit)[i].sqrt()
    }))
}

/// Returns a copy of the first `n` rows; rows that do not exist become `none`.
fn copied_rows<T: Copy + Send + Sync>(rows: &[T], n: usize, none: T) -> Vec<T> {
    // Parallel: this copies most bytes of a scene while training is blocked.
    let row = |i: usize| rows.get(i).copied().unwrap_or(none);
    (0..n).into_par_iter().with_min_len(4096).map(row).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn deviations_are_those_of_the_inverse() {
        let mut state = PhotometricState::default();
        state.grow(2);
        state.splats[1].opacity = 0.5;
        for i in 0..N_FORM {
            state.form[1][at(i, i)] = 4.0;
        }
        (0..N_COLOR).for_each(|i| state.color[1][at(i, i)] = 100.0);
        // Correlated parameters are less certain than either alone: 4/(4·4 − 3·3).
        state.form[1][at(4, 3)] = 3.0;
        let found = PhotometricDeviations::of(&state, 1).unwrap();
        assert_eq!((found.mean, found.opacity, found.color), ([0.5; 3], 0.5, 0.1));
        assert!((found.scale[0] - (4.0f64 / 7.0).sqrt()).abs() < 1e-12);
        assert!((found.position_deviation() - 0.75f64.sqrt()).abs() < 1e-12);
        assert_eq!(PhotometricDeviations::of(&state, 0), None);
        state.form[1][0] = -1.0;
        assert_eq!(PhotometricDeviations::of(&state, 1), None);
    }
}
