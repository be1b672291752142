//! Errors of the GPU renderer, with the requested amount, the adapter's limit and a remedy.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Failure of a GPU operation.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum GpuError {
    /// The adapter cannot run the shaders.
    #[error(
        "{adapter}: {missing} required but not supported by this adapter; the CPU renderer draws instead"
    )]
    Unsupported {
        /// Name of the adapter.
        adapter: String,
        /// Missing feature.
        missing: &'static str,
    },
    /// The splats do not fit in one buffer of this adapter.
    #[error(
        "{n_splats} splats need {needed_mib} MiB, but this adapter binds at most {limit_mib} MiB: use at most {max_splats} splats or the CPU renderer"
    )]
    TooManySplats {
        /// Number of splats to upload.
        n_splats: usize,
        /// Size of their records, MiB.
        needed_mib: u64,
        /// Largest buffer that a shader can bind completely, MiB.
        limit_mib: u64,
        /// Number of splats that would fit.
        max_splats: usize,
    },
    /// The driver refused an allocation that is within its limits.
    #[error(
        "{n_splats} splats: the GPU is out of memory ({mib} MiB requested); the previously uploaded splats are still drawn; close other GPU programs or train fewer components"
    )]
    OutOfMemory {
        /// Number of splats to upload.
        n_splats: usize,
        /// Total size of the requested buffers, MiB.
        mib: u64,
    },
    /// A task of training needs a larger buffer than this adapter supports.
    #[error(
        "a buffer of {needed_mib} MiB is needed for {what}, but this adapter binds at most {limit_mib} MiB; the processor is used instead"
    )]
    TaskTooLarge {
        /// Contents of the buffer.
        what: &'static str,
        /// Size of the buffer, MiB.
        needed_mib: u64,
        /// Largest buffer that a shader can bind completely, MiB.
        limit_mib: u64,
    },
    /// The driver refused a buffer for a task of training.
    #[error(
        "the GPU is out of memory for {what} ({mib} MiB requested); the processor is used instead; close other GPU programs to use the GPU"
    )]
    NoMemoryForTask {
        /// Contents of the buffer.
        what: &'static str,
        /// Size of the requested buffer, MiB.
        mib: u64,
    },
    /// A task of training failed, or its result could not be read back.
    #[error("the GPU failed: {reason}; the processor is used instead")]
    TaskFailed {
        /// Message from wgpu or the driver.
        reason: String,
    },
    /// An image needs more splat-tile pairs than fit in GPU memory.
    #[error(
        "{needed} splat-tile pairs, but GPU memory holds {capacity}: the farthest splats are left out; make the window smaller or move the camera away"
    )]
    TooManyEntries {
        /// Number of splat-tile pairs in the image.
        needed: u64,
        /// Number of pairs drawn.
        capacity: u64,
    },
    /// An option, intended for comparisons, that the shaders do not support.
    #[error("{found} is not supported on the GPU; use the CPU renderer")]
    CpuOnly {
        /// The unsupported option.
        found: &'static str,
    },
    /// The viewport is larger than a texture may be.
    #[error(
        "viewport {width}x{height}: this adapter supports at most {limit} pixels per side; make the window smaller"
    )]
    ViewportTooLarge {
        /// Requested width, pixels.
        width: u32,
        /// Requested height, pixels.
        height: u32,
        /// Maximum side of a texture, pixels.
        limit: u32,
    },
    /// The photograph is larger than a texture may be.
    #[error(
        "photograph {width}x{height}: this adapter supports at most {limit} pixels per side; use smaller images"
    )]
    PhotoTooLarge {
        /// Width of the image, pixels.
        width: u32,
        /// Height of the image, pixels.
        height: u32,
        /// Maximum side of a texture, pixels.
        limit: u32,
    },
    /// An image could not be read back from the GPU.
    #[error("image of {width}x{height} could not be read back from the GPU: {reason}")]
    Readback {
        /// Width of the image, pixels.
        width: u32,
        /// Height of the image, pixels.
        height: u32,
        /// Message from wgpu.
        reason: String,
    },
}

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
mod faults_tests {
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
