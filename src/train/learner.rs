//! Interface of the presets' learners.
//!
//! Code that drives, draws or saves a model uses only [`Learner`]. It is called a few times a frame,
//! so dynamic dispatch is cheap. [`Learns`] ties a learner to its type of observation at compile time.

use super::candidates::IndexError;
use super::component_elbo::ComponentElbo;
use super::device_trial::{ComparerUse, DevicePolicy, PassUse};
use super::outcome::{ComparedPhotograph, FrameOutcome, TrainingWarning};
use super::timing::TrainStage;
use crate::model::attributes::StoredModel;
use crate::model::conjugate::posterior::ComponentPosterior;
use crate::model::inspection::DeviceError;
use crate::model::paper::mixture_device::MixtureDevice;
use crate::model::scene::photometric::PhotometricDeviations;
use crate::model::scene::points_device::PointsDevice;
use crate::model::splat::appearance::{Appearance, SplatSet};
use crate::model::splat::splats::Splat;
use crate::render::cpu::photometric::PhotometricComparer;
use glam::DVec3;

/// A trainable model. Components are numbered from 0 and keep their numbers.
pub trait Learner: Send + Sync {
    /// Stages of a frame, in the order they run; rows of timing tables.
    fn stages(&self) -> &'static [TrainStage];

    /// Number of frames trained on, including those before a resumed checkpoint.
    fn frames(&self) -> u64;

    /// Number of components, used or not: one more than the highest id. Also the number of splat slots.
    fn components(&self) -> usize;

    /// Number of components in use: with points in the `paper` preset, with seeds in the `scene` preset.
    fn used(&self) -> usize;

    /// Components changed by the last frame, whose splats and attributes viewers must update.
    fn changed(&self) -> Changed<'_>;

    /// True if a frame also changes components that are not in [`Self::changed`], because it saw through
    /// them. Viewers update these when training pauses.
    fn changes_unlisted_components(&self) -> bool;

    /// Bytes of the model, without training buffers.
    fn model_bytes(&self) -> usize;

    /// Posterior of a component, for the inspector and attributes; the E-step does not use it.
    ///
    /// Positions are normalised, or for a scene in world units relative to its origin. Colours are
    /// normalised.
    fn posterior(&self, component: usize) -> ComponentPosterior;

    /// Photographs compared in the last frame or in the [`Self::settle`] after it.
    fn compared_photographs(&self) -> &[ComparedPhotograph] {
        &[]
    }

    /// Draws the scene as if all buffered photographs had been trained on, until the next frame.
    ///
    /// Does not affect later training. Returns true if this changes the drawn scene.
    fn settle(&mut self) -> bool {
        false
    }

    /// True if the scene is drawn as described at [`Self::settle`].
    fn is_settled(&self) -> bool {
        false
    }

    /// Uncertainty of a component's splat from photographs; `None` if the model does not train on them.
    fn photometric_deviations(&self, _component: usize) -> Option<PhotometricDeviations> {
        None
    }

    /// Adds a device for a part of training; ignored if the model has no such part.
    ///
    /// # Errors
    /// [`DeviceError`] if the device has too little memory for the model; it is then not used.
    fn add_device(
        &mut self,
        device: TrainingDevice,
        policy: DevicePolicy,
    ) -> Result<(), DeviceError>;

    /// Devices used so far.
    fn device_use(&self) -> DeviceUse;

    /// Unit normal of a component's surface in world axes, towards the cameras that saw it; `None` if
    /// unknown.
    fn normal(&self, _component: usize) -> Option<DVec3> {
        None
    }

    /// Splat of a component, in world units; opacity 0 if it draws nothing.
    ///
    /// Computed on demand. For many components, [`Self::splats_of`] uses all threads.
    fn splat(&self, component: usize) -> (Splat, Appearance);

    /// Splats of all components, in world units; slot `k` is component `k`. Equal models give the same order,
    /// so equal files.
    fn splats(&self) -> SplatSet;

    /// Splats of the listed components, in world units and in the order of the list.
    fn splats_of(&self, components: &[u32]) -> SplatSet;

    /// Per-component ELBO of the last frame's points, if enabled.
    fn component_elbo(&self) -> &ComponentElbo;

    /// Mutable access to [`Self::component_elbo`], to enable or disable it.
    fn component_elbo_mut(&mut self) -> &mut ComponentElbo;

    /// Warnings about the model, shown when training ends; empty if every point found a component.
    fn warnings(&self) -> Vec<TrainingWarning>;

    /// Copy of the model for a checkpoint; a run resumed from it gives the same bits.
    fn checkpoint_model(&self) -> StoredModel;
}

/// A learner for one type of observation.
pub trait Learns<Input>: Learner {
    /// Trains on one frame.
    ///
    /// # Errors
    /// [`IndexError`] if the candidate index cannot be rebuilt. A frame is applied completely or not at
    /// all. If only the reassignment after the fit fails, the frame is applied and no component moves.
    fn learn(&mut self, observation: &Input) -> Result<FrameOutcome, IndexError>;

    /// Revisits a frame already trained on: only its photograph's residual is used, its points are not
    /// counted again. Does nothing if the model does not train on photographs.
    fn revisit_photograph(&mut self, _observation: &Input) -> FrameOutcome {
        FrameOutcome::default()
    }
}

/// Components changed by a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Changed<'a> {
    /// Only these, each once, in any order.
    Listed(&'a [u32]),
    /// All components, whether or not they received a point.
    All,
}

/// Device for a part of training.
pub enum TrainingDevice {
    /// Compares photographs.
    Photographs(Box<dyn PhotometricComparer>),
    /// Computes the passes of a mixture over a frame.
    Passes(Box<dyn MixtureDevice>),
    /// Finds the seeds of points and sums them.
    Points(Box<dyn PointsDevice>),
}

/// Devices used for each part of training; `None` if the model has no such part.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct DeviceUse {
    /// Comparison of photographs.
    pub photographs: Option<ComparerUse>,
    /// Passes over frames.
    pub passes: Option<PassUse>,
    /// Search and sums of points.
    pub points: Option<PassUse>,
}
