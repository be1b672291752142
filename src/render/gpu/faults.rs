//! Asynchronous GPU errors, which no call returns: a lost device, or errors that wgpu reports later.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Maximum number of distinct messages; a broken driver can report the same fault in endless variants.
const MAX_FAULTS: usize = 32;

/// Category of a fault.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FaultKind {
    /// The device is lost with all its resources; rebuild them from the splats on the CPU.
    DeviceLost,
    /// An allocation failed.
    OutOfMemory,
    /// wgpu rejected an invalid call.
    Validation,
    /// The driver failed.
    Internal,
}

/// Fault with its message.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct GpuFault {
    /// Category reported by wgpu.
    pub kind: FaultKind,
    /// Message from wgpu or the driver.
    pub message: String,
    /// Number of occurrences when it was taken.
    pub n_occurrences: u64,
}

/// Collects device faults from any wgpu thread, to be polled by the application. A fault that repeats every
/// frame is reported once.
#[derive(Clone, Debug, Default)]
pub struct GpuFaults(Arc<Mutex<Log>>);

#[derive(Debug, Default)]
struct Log {
    faults: Vec<GpuFault>,
    n_taken: usize,
    is_lost: bool,
}

impl GpuFaults {
    /// Redirects a device's loss and uncaptured errors here, instead of panicking.
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

    /// New faults since the last call, oldest first.
    pub fn take_new(&self) -> Vec<GpuFault> {
        let mut log = self.lock();
        let fresh = log.faults[log.n_taken..].to_vec();
        log.n_taken = log.faults.len();
        fresh
    }

    /// True if a watched device was lost.
    pub fn is_lost(&self) -> bool {
        self.lock().is_lost
    }

    fn record(&self, kind: FaultKind, message: String) {
        let mut log = self.lock();
        // Before the limit on messages, so that a full log still records the loss.
        log.is_lost |= kind == FaultKind::DeviceLost;
        // A fault in every frame would flood log and window with one message.
        if let Some(known) = log.faults.iter_mut().find(|f| f.kind == kind && f.message == message)
        {
            known.n_occurrences += 1;
        } else if log.faults.len() < MAX_FAULTS {
            tracing::error!(?kind, "GPU: {message}");
            log.faults.push(GpuFault { kind, message, n_occurrences: 1 });
        }
    }

    /// Ignores poisoning: each write is a single push, so a panicking thread leaves the log consistent.
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
        let taken = faults.take_new();
        assert_eq!(taken.iter().map(|f| f.n_occurrences).collect::<Vec<_>>(), [3, 1]);
        faults.record(FaultKind::Validation, "bad bind group".into());
        assert!(faults.take_new().is_empty() && !faults.is_lost());

        for i in 0..100 {
            faults.record(FaultKind::Internal, format!("{i}"));
        }
        assert_eq!(faults.take_new().len(), MAX_FAULTS - 2);
        faults.record(FaultKind::DeviceLost, "gone".into());
        assert!(faults.is_lost(), "a full log still records the loss");
    }
}
