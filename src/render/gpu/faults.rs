//! Errors that no call returns: a lost device, errors wgpu reports after the fact.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Different messages kept; a broken driver can word the same trouble in endless ways.
const MAX_FAULTS: usize = 32;

/// What kind of trouble.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FaultKind {
    /// The device is gone with everything on it; rebuild from the CPU's splats.
    DeviceLost,
    /// An allocation failed.
    OutOfMemory,
    /// wgpu refused a call of ours.
    Validation,
    /// The driver failed.
    Internal,
}

/// One kind of trouble with one message.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct GpuFault {
    /// Which of the kinds of trouble, by what wgpu called it.
    pub kind: FaultKind,
    /// wgpu's or the driver's words.
    pub message: String,
    /// Times seen when it was taken.
    pub n_seen: u64,
}

/// Collects the faults of devices from whatever thread wgpu calls on; the app polls it. The same
/// fault every frame is reported once.
#[derive(Clone, Debug, Default)]
pub struct GpuFaults(Arc<Mutex<Log>>);

#[derive(Debug, Default)]
struct Log {
    faults: Vec<GpuFault>,
    n_taken: usize,
    is_lost: bool,
}

impl GpuFaults {
    /// Sends a device's loss and its uncaptured errors here instead of to a panic.
    pub fn watch(&self, device: &wgpu::Device) {
        let lost = self.clone();
        device.set_device_lost_callback(move |reason, message| {
            lost.record(FaultKind::DeviceLost, format!("{reason:?}: {message}"));
        });
        let uncaptured = self.clone();
        device.on_uncaptured_error(Arc::new(move |error: wgpu::Error| {
            let kind = match &error {
                wgpu::Error::OutOfMemory { .. } => FaultKind::OutOfMemory,
                wgpu::Error::Validation { .. } => FaultKind::Validation,
                wgpu::Error::Internal { .. } => FaultKind::Internal,
            };
            uncaptured.record(kind, error.to_string());
        }));
    }

    /// Faults not taken before, oldest first.
    pub fn take(&self) -> Vec<GpuFault> {
        let mut log = self.lock();
        let fresh = log.faults[log.n_taken..].to_vec();
        log.n_taken = log.faults.len();
        fresh
    }

    /// Whether a watched device was lost.
    pub fn is_lost(&self) -> bool {
        self.lock().is_lost
    }

    fn record(&self, kind: FaultKind, message: String) {
        let mut log = self.lock();
        // Before the bound on messages: a full log must still notice the loss.
        log.is_lost |= kind == FaultKind::DeviceLost;
        // A fault in every frame would fill log and window with one sentence.
        if let Some(known) = log.faults.iter_mut().find(|f| f.kind == kind && f.message == message)
        {
            known.n_seen += 1;
        } else if log.faults.len() < MAX_FAULTS {
            tracing::error!(?kind, "GPU: {message}");
            log.faults.push(GpuFault { kind, message, n_seen: 1 });
        }
    }

    /// A thread that panicked while it held the log left it whole: every write is one push.
    fn lock(&self) -> MutexGuard<'_, Log> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_same_fault_is_taken_once_and_the_log_stays_bounded() {
        let faults = GpuFaults::default();
        for _ in 0..3 {
            faults.record(FaultKind::Validation, "bad bind group".into());
        }
        faults.record(FaultKind::Internal, "bad bind group".into());
        let taken = faults.take();
        assert_eq!(taken.iter().map(|f| f.n_seen).collect::<Vec<_>>(), [3, 1]);
        faults.record(FaultKind::Validation, "bad bind group".into());
        assert!(faults.take().is_empty() && !faults.is_lost());

        for i in 0..100 {
            faults.record(FaultKind::Internal, format!("{i}"));
        }
        assert_eq!(faults.take().len(), MAX_FAULTS - 2);
        faults.record(FaultKind::DeviceLost, "gone".into());
        assert!(faults.is_lost(), "a full log still notices the loss");
    }
}
