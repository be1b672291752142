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

/// A trainable model. Components are numbered from 0 and keep their numbers.
pub trait Learner: Send + Sync {
    /// Size and state of the model.
    fn status(&self) -> Status;

    /// Effects of the last frame, or of the [`Self::settle`] after it.
    fn last_frame(&self) -> LastFrame<'_>;

    /// Posterior and surface of a component, for the inspector and attributes; the E-step does not use them.
    fn component(&self, component: usize) -> Component;

    /// Number of points received by a component, `N_k`; 0 if it is unused.
    fn evidence(&self, component: usize) -> f64;

    /// Splats of all components, in world units; slot `k` is component `k`, with opacity 0 if it draws
    /// nothing. Equal models give the same order, so equal files.
    fn splats(&self) -> SplatSet;

    /// Splats of the listed components, in world units and in the order of the list.
    fn splats_of(&self, components: &[u32]) -> SplatSet;

    /// Draws the scene as if all buffered photographs had been trained on, until the next frame.
    ///
    /// Does not affect later training. Returns true if this changes the drawn scene.
    fn settle(&mut self) -> bool {
        false
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

    /// Mutable access to [`LastFrame::component_elbo`], to enable or disable it.
    fn component_elbo_mut(&mut self) -> &mut ComponentElbo;

    /// Copy of the model for a checkpoint; a run resumed from it gives the same bits.
    fn checkpoint_model(&self) -> StoredModel;
}

/// Size and state of a model.
#[derive(Clone, Debug, PartialEq)]
pub struct Status {
    /// Number of frames trained on, including those before a resumed checkpoint.
    pub frames: u64,
    /// Number of components, used or not: one more than the highest id. Also the number of splat slots.
    pub components: usize,
    /// Number of components in use: with points in the `paper` preset, with seeds in the `scene` preset.
    pub used: usize,
    /// Bytes of the model, without training buffers.
    pub model_bytes: usize,
    /// True if the scene is drawn as described at [`Learner::settle`].
    pub is_settled: bool,
    /// Warnings shown when training ends; empty if every point found a component.
    pub warnings: Vec<TrainingWarning>,
}

/// Effects of a frame on a model.
#[derive(Clone, Copy)]
pub struct LastFrame<'a> {
    /// Components whose splats and attributes viewers must update.
    pub changed: Changed<'a>,
    /// Photographs compared with the scene.
    pub compared_photographs: &'a [ComparedPhotograph],
    /// Per-component ELBO of the frame's points, if enabled.
    pub component_elbo: &'a ComponentElbo,
}

/// Posterior and surface of a component.
pub struct Component {
    /// Posterior. Positions are normalised, or for a scene in world units relative to its origin.
    /// Colours are normalised.
    pub posterior: ComponentPosterior,
    /// Unit normal of the surface in world axes, towards the cameras that saw it; `None` if unknown.
    pub normal: Option<DVec3>,
    /// Uncertainty of the splat from photographs; `None` if the model does not train on them.
    pub photometric_deviations: Option<PhotometricDeviations>,
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
