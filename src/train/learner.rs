//! The seam between presets: what every learner can do, whatever it learns by.
//!
//! The mathematics of the presets is rightly two. Whoever drives them, shows them or saves them
//! knows only [`Learner`]; it is called a few times a frame, so a virtual call costs nothing.
//! [`Learns`] ties a learner to the one form of observation it understands: handing it the other
//! preset's does not compile.

use super::candidates::IndexError;
use super::comparer_use::ComparerUse;
use super::component_elbo::ComponentElbo;
use super::device_trial::DevicePolicy;
use super::outcome::{ComparedPhotograph, FrameOutcome};
use super::pass_use::PassUse;
use super::stages::TrainStage;
use super::warnings::TrainingWarning;
use crate::model::conjugate::posterior::ComponentPosterior;
use crate::model::device_error::DeviceError;
use crate::model::paper::mixture_device::MixtureDevice;
use crate::model::scene::photometric::PhotometricDeviations;
use crate::model::scene::points_device::PointsDevice;
use crate::model::splat::appearance::{Appearance, SplatSet};
use crate::model::splat::splats::Splat;
use crate::model::stored::StoredModel;
use crate::render::cpu::photometric::PhotometricComparer;
use glam::DVec3;

/// A model that learns. Components are numbered from 0; a number never changes its component.
pub trait Learner: Send + Sync {
    /// The stages of a frame, in the order they run: the rows of every table of its times.
    fn stages(&self) -> &'static [TrainStage];

    /// Frames learnt since the model began, those before a resumed checkpoint included.
    fn frames(&self) -> u64;

    /// Components, used or not: one above the highest number. Slots of what is drawn are as many.
    fn components(&self) -> usize;

    /// Components in use: with points in the published algorithm, with seeds in a scene.
    fn used(&self) -> usize;

    /// Components that the last frame changed: whose splats and attributes viewers ask for anew.
    fn changed(&self) -> Changed<'_>;

    /// Whether a frame changes components other than [`Self::changed`] says, by what it saw through
    /// them: these are told only when training rests.
    fn changes_unseen(&self) -> bool;

    /// Bytes the model itself occupies, without the buffers that learning takes.
    fn model_bytes(&self) -> usize;

    /// Posterior of a component. Positions are normalised, or of a scene in world units from its
    /// origin; colours are normalised. For the inspector and attributes: no E-step reads it.
    fn posterior(&self, component: usize) -> ComponentPosterior;

    /// Photographs that were compared with the scene in the last frame, or in [`Self::settle`] since.
    fn compared(&self) -> &[ComparedPhotograph] {
        &[]
    }

    /// Draws the scene as it will be once nothing waits any more to be learnt, until the next frame: runs
    /// go on as if it had not been asked for. Whether that changes anything.
    fn settle(&mut self) -> bool {
        false
    }

    /// Whether the scene is drawn as [`Self::settle`] says.
    fn is_settled(&self) -> bool {
        false
    }

    /// What photographs leave uncertain of a component's splat; `None` where they teach nothing.
    fn photographed(&self, _component: usize) -> Option<PhotometricDeviations> {
        None
    }

    /// Compares photographs on a device too from now on; nothing where they teach nothing.
    fn compare_on(&mut self, _comparer: Box<dyn PhotometricComparer>, _policy: DevicePolicy) {}

    /// What photographs were compared on; `None` where they teach nothing.
    fn comparer_use(&self) -> Option<ComparerUse> {
        None
    }

    /// Computes passes over frames on a device too from now on; nothing where none can.
    ///
    /// # Errors
    /// [`DeviceError`] if it has no room for the model; then it is not used.
    fn compute_on(
        &mut self,
        _device: Box<dyn MixtureDevice>,
        _policy: DevicePolicy,
    ) -> Result<(), DeviceError> {
        Ok(())
    }

    /// What passes over frames ran on; `None` where no device can run them.
    fn pass_use(&self) -> Option<PassUse> {
        None
    }

    /// Finds the seeds of points, and sums points, on a device too from now on; nothing where none can.
    fn fit_on(&mut self, _device: Box<dyn PointsDevice>, _policy: DevicePolicy) {}

    /// What points were fitted on; `None` where no device finds their seeds.
    fn point_use(&self) -> Option<PassUse> {
        None
    }

    /// Unit normal of the surface behind a component, towards the cameras that saw it, world axes; `None`
    /// where nothing is known of it.
    fn normal(&self, _component: usize) -> Option<DVec3> {
        None
    }

    /// What renderers draw of a component, world units; opacity 0 if nothing. Formed on demand:
    /// many at once come from [`Self::splats_of`], on all threads.
    fn splat(&self, component: usize) -> (Splat, Appearance);

    /// What renderers draw of all components, world units; slot `k` is component `k`.
    fn splats(&self) -> SplatSet;

    /// What files hold and what is measured: the splats in an order in which equal models give equal
    /// files, within the budget.
    fn stored_splats(&self) -> SplatSet {
        self.splats()
    }

    /// What renderers draw of the listed components, world units, in the order of the list: what a
    /// viewer puts into their slots.
    fn splats_of(&self, components: &[u32]) -> SplatSet;

    /// Evidence of each component's points of the last frame, while somebody asks for it.
    fn component_elbo(&self) -> &ComponentElbo;

    /// See [`Self::component_elbo`]: where sums are asked for, from the next frame on, or ended.
    fn component_elbo_mut(&mut self) -> &mut ComponentElbo;

    /// What a user should know about the model as it stands, told when training ends; empty if all
    /// points found their place.
    fn warnings(&self) -> Vec<TrainingWarning>;

    /// A copy of what a checkpoint holds: all that a run needs to go on with the same bits.
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

    /// Looks at a frame again that it has learnt: its points are known, only what its photograph differs
    /// by can still teach. Nothing where photographs teach nothing.
    fn look_again(&mut self, _observation: &Input) -> FrameOutcome {
        FrameOutcome::default()
    }
}

/// Components that a frame changed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Changed<'a> {
    /// These and no others, each once, in no particular order.
    Listed(&'a [u32]),
    /// All there are, whether or not they received a point.
    All,
}
