//! Interface of the presets' learners.
//!
//! Code that drives, draws or saves a model uses only [`Learner`]. It is called a few times a frame,
//! so dynamic dispatch is cheap. [`Learns`] ties a learner to its type of observation at compile time.

use super::candidates::IndexError;
use super::component_elbo::ComponentElbo;
use super::device_trial::{ComparerUse, DevicePolicy, PassUse};
use super::outcome::{ComparedPhotograph, FrameOutcome, TrainingWarning};
use crate::model::attributes::StoredModel;
use crate::model::conjugate::posterior::ComponentPosterior;
use crate::model::inspection::DeviceError;
use crate::model::paper::mixture_device::MixtureDevice;
use crate::model::scene::photometric::PhotometricDeviations;
use crate::model::scene::points_device::PointsDevice;
use crate::model::splat::appearance::SplatSet;
use crate::render::cpu::photometric::PhotometricComparer;
use glam::DVec3;

/// A trainable model. Components are numbered from 0; a component keeps its number.
pub trait Learner: Send + Sync {
    /// Returns size and state of the model.
    fn status(&self) -> Status;

    /// Returns the memory of the model. Takes longer than [`Self::status`], because it visits all textures.
    fn memory(&self) -> ModelMemory;

    /// Returns the effects of the last frame or, if [`Self::settle`] has been called since, of that
    /// call.
    fn last_frame(&self) -> LastFrame<'_>;

    /// Returns posterior and surface normal of a component, for the inspector and for attributes. They
    /// are not used in the E-step.
    fn component(&self, component: usize) -> Component;

    /// Returns the number of points received by a component, `N_k`; 0 if it is unused.
    fn evidence(&self, component: usize) -> f64;

    /// Returns the splats of all components, in world units. Slot `k` is component `k`; its opacity is 0
    /// if the component is not drawn. Equal models give equal files, because the order is fixed.
    fn splats(&self) -> SplatSet;

    /// Returns the splats of the listed components, in world units and in the order of the list.
    fn splats_of(&self, components: &[u32]) -> SplatSet;

    /// Makes the scene appear, until the next frame, as if all buffered photographs had been trained
    /// on.
    ///
    /// Does not affect later training. Returns true if this changes the drawn scene.
    fn settle(&mut self) -> bool {
        false
    }

    /// Adds a device that computes a part of training; ignored if the model has no such part.
    ///
    /// # Errors
    /// [`DeviceError`] if the device has too little memory for the model; it is then not used.
    fn add_device(
        &mut self,
        device: TrainingDevice,
        policy: DevicePolicy,
    ) -> Result<(), DeviceError>;

    /// Returns the devices used so far.
    fn device_use(&self) -> DeviceUse;

    /// Returns [`LastFrame::component_elbo`] for modification: to enable or disable it.
    fn component_elbo_mut(&mut self) -> &mut ComponentElbo;

    /// Returns a copy of the model for a checkpoint. Training resumed from it gives bit-identical
    /// results.
    fn checkpoint_model(&self) -> StoredModel;
}

/// Size and state of a model.
#[derive(Clone, Debug, PartialEq)]
pub struct Status {
    /// Number of frames trained on, including those before a resumed checkpoint.
    pub frames: u64,
    /// Number of components, used or not: one more than the highest index. It equals the number of
    /// splat slots.
    pub components: usize,
    /// Number of components in use: with points in the `paper` preset, with seeds (creation points) in
    /// the `scene` preset.
    pub used: usize,
    /// True if the scene is drawn as if all buffered photographs had been trained on (see
    /// [`Learner::settle`]).
    pub is_settled: bool,
    /// Warnings shown when training ends, if any.
    pub warnings: Vec<TrainingWarning>,
}

/// Memory of a model.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ModelMemory {
    /// Memory in bytes, without training buffers.
    pub bytes: usize,
    /// Memory of textures in bytes, part of `bytes`.
    pub texture_bytes: usize,
}

/// Effects of a frame on a model.
#[derive(Clone, Copy)]
pub struct LastFrame<'a> {
    /// Components whose splats and attributes viewers must update.
    pub changed: Changed<'a>,
    /// Results of comparing photographs with the scene.
    pub compared_photographs: &'a [ComparedPhotograph],
    /// Per-component ELBO of the frame's points, if enabled.
    pub component_elbo: &'a ComponentElbo,
}

/// Posterior and surface normal of a component.
pub struct Component {
    /// Posterior. Positions are normalised, or for a scene in world units relative to its origin.
    /// Colours are normalised in any case.
    pub posterior: ComponentPosterior,
    /// Unit normal of the component's surface in world axes, towards the cameras that saw it; `None` if
    /// unknown.
    pub normal: Option<DVec3>,
    /// Standard deviations of the splat's parameters, as estimated from photographs. `None` if the
    /// model does not train on photographs.
    pub photometric_deviations: Option<PhotometricDeviations>,
}

/// A learner for one type of observation.
pub trait Learns<Input>: Learner {
    /// Trains on one frame. A frame is applied completely or not at all.
    ///
    /// # Errors
    /// [`IndexError`] if the candidate index cannot be rebuilt. If only the reassignment after the fit
    /// fails, the frame is applied and no component moves.
    fn learn(&mut self, observation: &Input) -> Result<FrameOutcome, IndexError>;

    /// Trains again on the photograph of an earlier frame; the frame's points are not counted again.
    /// Does nothing if the model does not train on photographs.
    fn revisit_photograph(&mut self, _observation: &Input) -> FrameOutcome {
        FrameOutcome::default()
    }
}

/// Components changed by a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Changed<'a> {
    /// Only the listed components, each once, in any order.
    Listed(&'a [u32]),
    /// All components, including those that received no point.
    All,
}

/// Device that computes a part of training.
pub enum TrainingDevice {
    /// Compares photographs with renderings.
    Photographs(Box<dyn PhotometricComparer>),
    /// Computes the passes of a mixture over a frame.
    Passes(Box<dyn MixtureDevice>),
    /// Finds the seed (creation point of a component) of each point, and sums the points.
    Points(Box<dyn PointsDevice>),
}

/// Devices used for each part of training; `None` if the model has no such part.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct DeviceUse {
    /// Devices for the comparison of photographs.
    pub photographs: Option<ComparerUse>,
    /// Devices for the passes of a mixture over frames.
    pub passes: Option<PassUse>,
    /// Devices for the search of seeds and the sums of points.
    pub points: Option<PassUse>,
}
