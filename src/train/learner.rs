//! The seam between presets: what every learner can do, whatever it learns by.
//!
//! The mathematics of the presets is rightly two. Whoever drives them, shows them or saves them
//! knows only [`Learner`]; it is called a few times a frame, so a virtual call costs nothing.
//! [`Learns`] ties a learner to the one form of observation it understands: handing it the other
//! preset's does not compile.

use super::candidates::IndexError;
use super::component_elbo::ComponentElbo;
use super::outcome::FrameOutcome;
use super::stages::TrainStage;
use super::warnings::TrainingWarning;
use crate::model::conjugate::posterior::ComponentPosterior;
use crate::model::splat::appearance::{Appearance, SplatSet};
use crate::model::splat::splats::Splat;
use crate::model::stored::StoredModel;

/// A model that learns. Components are numbered from 0; a number never changes its component.
pub trait Learner: Send + Sync {
    /// The stages of a frame, in the order they run.
    fn stages(&self) -> &'static [TrainStage];

    /// Frames learnt.
    fn frames(&self) -> u64;

    /// Components, used or not.
    fn components(&self) -> usize;

    /// Components with points.
    fn used(&self) -> usize;

    /// Components that the last frame changed.
    fn changed(&self) -> Changed<'_>;

    /// Whether a frame changes components other than [`Self::changed`] says, by what it saw through
    /// them: these are told only when training rests.
    fn changes_unseen(&self) -> bool;

    /// Bytes the model itself occupies.
    fn model_bytes(&self) -> usize;

    /// Posterior of a component, normalised coordinates.
    fn posterior(&self, component: usize) -> ComponentPosterior;

    /// What renderers draw of a component, world units; opacity 0 if nothing.
    fn splat(&self, component: usize) -> (Splat, Appearance);

    /// What renderers draw of all components, world units; slot `k` is component `k`.
    fn splats(&self) -> SplatSet;

    /// What files hold of all components: those of [`Self::splats`] in an order in which equal
    /// models give equal files.
    fn stored_splats(&self) -> SplatSet {
        self.splats()
    }

    /// What renderers draw of the listed components, in their order.
    fn splats_of(&self, components: &[u32]) -> SplatSet;

    /// Evidence of each component's points of the last frame, while somebody asks for it.
    fn component_elbo(&self) -> &ComponentElbo;

    /// See [`Self::component_elbo`]: where it is asked for.
    fn component_elbo_mut(&mut self) -> &mut ComponentElbo;

    /// What a user should know about the model as it stands.
    fn warnings(&self) -> Vec<TrainingWarning>;

    /// What a checkpoint holds.
    fn stored(&self) -> StoredModel;
}

/// A learner of one form of observation.
pub trait Learns<Input>: Learner {
    /// Learns from one frame.
    ///
    /// # Errors
    /// [`IndexError`] if the candidate index cannot be built again. A frame is applied whole or not
    /// at all; where only the reassignment after the fit fails, the frame is learnt and no component
    /// has moved.
    fn learn(&mut self, observation: &Input) -> Result<FrameOutcome, IndexError>;
}

/// Components that a frame changed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Changed<'a> {
    /// Each once.
    Listed(&'a [u32]),
    /// All there are.
    All,
}
