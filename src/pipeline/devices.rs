//! What a session computes on beside the processor.

use super::session::Session;
use crate::model::device_error::DeviceError;
use crate::model::paper::mixture_device::MixtureDevice;
use crate::model::scene::points_device::PointsDevice;
use crate::render::cpu::photometric::PhotometricComparer;
use crate::train::device_trial::DevicePolicy;

impl Session {
    /// Compares photographs on a device beside the processor from now on, where they are learnt from.
    pub fn compare_on(&mut self, comparer: Box<dyn PhotometricComparer>, policy: DevicePolicy) {
        self.learner_mut().compare_on(comparer, policy);
    }

    /// Finds the seeds of points, and sums points, on a device beside the processor from now on, where one
    /// can.
    pub fn fit_on(&mut self, device: Box<dyn PointsDevice>, policy: DevicePolicy) {
        self.learner_mut().fit_on(device, policy);
    }

    /// Computes passes over frames on a device beside the processor from now on, where one can.
    ///
    /// # Errors
    /// [`DeviceError`] if it has no room for the model; then it is not used.
    pub fn compute_on(
        &mut self,
        device: Box<dyn MixtureDevice>,
        policy: DevicePolicy,
    ) -> Result<(), DeviceError> {
        self.learner_mut().compute_on(device, policy)
    }
}
