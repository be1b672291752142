//! Compute devices of a session besides the CPU.

use super::session::Session;
use crate::model::device_error::DeviceError;
use crate::model::paper::mixture_device::MixtureDevice;
use crate::model::scene::points_device::PointsDevice;
use crate::render::cpu::photometric::PhotometricComparer;
use crate::train::device_trial::DevicePolicy;

impl Session {
    /// Compares photographs on a device from now on, if they are trained on.
    pub fn compare_on(&mut self, comparer: Box<dyn PhotometricComparer>, policy: DevicePolicy) {
        self.learner_mut().compare_on(comparer, policy);
    }

    /// Assigns points to seeds and sums them on a device from now on, if the learner supports it.
    pub fn fit_on(&mut self, device: Box<dyn PointsDevice>, policy: DevicePolicy) {
        self.learner_mut().fit_on(device, policy);
    }

    /// Computes mixture passes over frames on a device from now on, if the learner supports it.
    ///
    /// # Errors
    /// [`DeviceError`] if the device has too little memory for the model; it is then not used.
    pub fn compute_on(
        &mut self,
        device: Box<dyn MixtureDevice>,
        policy: DevicePolicy,
    ) -> Result<(), DeviceError> {
        self.learner_mut().compute_on(device, policy)
    }
}
