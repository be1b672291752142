//! Whether a frame belongs to the scene, asked of its points before anything of it is learnt
//! (`photometric.md`, Frames that contradict).

use crate::math::camera::Camera;
use crate::model::scene::sums::SceneSums;
use crate::observation::surface::{Observation, SurfacePoint};
use crate::train::scene::component_sums::ComponentSums;
use crate::train::scene::grid::NONE;
use crate::train::scene::observe::is_seen_through;
use crate::train::scene::seed_positions::SeedPositions;
use crate::train::scene::sum_scalar::SumScalar;
use glam::DVec3;

/// Every so-many-th point is looked at: neighbours say the same.
const EVERY: usize = 8;
/// Components looked at, about: of more every so-many-th.
const MAX_COMPONENTS: usize = 4096;
/// Fewest points of a component that is trusted.
const MIN_POINTS: f64 = 20.0;
/// Fewest points, or components in view, that say anything of a frame.
const MIN_MATCHES: f64 = 100.0;

/// How a frame's points agree with the components as they are before it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FrameAgreement {
    /// Sum over points and channels of the squared difference from the mean colour of their component.
    pub squared_error: f64,
    /// Points it is over.
    pub points: f64,
    /// Components in view that the frame measured, or something behind them.
    pub in_view: f64,
    /// Those of them it measured something behind.
    pub seen_through: f64,
}

/// A frame beside the scene as it is before the frame is learnt.
pub struct FrameBesideScene<'a, W> {
    /// Sums of the components.
    pub component_sums: &'a ComponentSums<W>,
    /// Where they stand.
    pub seed_positions: SeedPositions<'a>,
    /// Structural scale, world units.
    pub h: f64,
    /// The frame as recorded.
    pub frame: &'a Observation,
    /// Its camera, where it really stood.
    pub camera: &'a Camera,
    /// Its points as seen from there.
    pub points: &'a [SurfacePoint],
    /// Component of each.
    pub owners: &'a [u32],
    /// Factors that bring its colours to the scene's exposure.
    pub gain: [f32; 3],
}

impl<W: SumScalar> FrameBesideScene<'_, W> {
    /// What points and components say; nothing where too few of either are known.
    pub fn agreement(&self) -> FrameAgreement {
        let mut found = FrameAgreement::default();
        for (point, &owner) in self.points.iter().zip(self.owners).step_by(EVERY) {
            if owner == NONE || owner as usize >= self.component_sums.len() {
                continue;
            }
            let (n, color) = self.component_sums.color_sums(owner as usize);
            if n >= MIN_POINTS {
                let difference = |i: usize| f64::from(point.color[i] * self.gain[i]) - color[i] / n;
                found.squared_error += (0..3).map(|i| difference(i).powi(2)).sum::<f64>();
                found.points += 1.0;
            }
        }
        let n_components = self.component_sums.len();
        for id in (0..n_components).step_by(n_components.div_ceil(MAX_COMPONENTS).max(1)) {
            let sums = SceneSums::new(&self.component_sums.sums(id), self.h);
            if sums.count >= MIN_POINTS {
                let seed = DVec3::from_array(self.seed_positions.of(id).map(f64::from));
                let mean = seed + sums.mean_offset();
                if let Some(is_through) = is_seen_through(self.frame, self.camera, mean) {
                    found.in_view += 1.0;
                    found.seen_through += f64::from(u8::from(is_through));
                }
            }
        }
        if found.points < MIN_MATCHES {
            (found.squared_error, found.points) = (0.0, 0.0);
        }
        if found.in_view < MIN_MATCHES {
            (found.seen_through, found.in_view) = (0.0, 0.0);
        }
        found
    }
}
