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
        /// Size of the splats' records, MiB.
        needed_mib: u64,
        /// Largest buffer that a shader can bind completely, MiB.
        limit_mib: u64,
        /// Number of splats that would fit.
        max_splats: usize,
    },
    /// The driver refused an allocation that is within the adapter's limits.
    #[error(
        "{n_splats} splats: the GPU is out of memory ({mib} MiB requested); the previously uploaded splats are still drawn; close other GPU programs or train fewer components"
    )]
    OutOfMemory {
        /// Number of splats to upload.
        n_splats: usize,
        /// Total size of the requested buffers, MiB.
        mib: u64,
    },
    /// A training task needs a larger buffer than this adapter supports.
    #[error(
        "a buffer of {needed_mib} MiB is needed for {what}, but this adapter binds at most {limit_mib} MiB; the CPU is used instead"
    )]
    TaskTooLarge {
        /// Contents of the buffer.
        what: &'static str,
        /// Size of the buffer, MiB.
        needed_mib: u64,
        /// Largest buffer that a shader can bind completely, MiB.
        limit_mib: u64,
    },
    /// The driver refused to allocate a buffer for a training task.
    #[error(
        "the GPU is out of memory for {what} ({mib} MiB requested); the CPU is used instead; close other GPU programs to use the GPU"
    )]
    NoMemoryForTask {
        /// Contents of the buffer.
        what: &'static str,
        /// Size of the requested buffer, MiB.
        mib: u64,
    },
    /// A training task failed, or its result could not be read back.
    #[error("the GPU failed: {reason}; the CPU is used instead")]
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
    /// The textures do not fit in GPU memory.
    #[error(
        "{n_splats} splats are drawn without their texture, because GPU memory holds only {mib} MiB of textures; train with a smaller `texture_mb` or use the CPU renderer"
    )]
    TexturesLeftOut {
        /// Number of splats drawn without their texture.
        n_splats: usize,
        /// Size of the buffer of textures, MiB.
        mib: u64,
    },
    /// The shaders do not support an option that is intended for comparisons.
    #[error("{found} is not supported on the GPU; use the CPU renderer")]
    CpuOnly {
        /// The unsupported option.
        found: &'static str,
    },
    /// An image exceeds the adapter's maximum texture size.
    #[error(
        "{what} {width}x{height}: this adapter supports at most {limit} pixels per side; {remedy}"
    )]
    ImageTooLarge {
        /// Kind of image.
        what: &'static str,
        /// Width of the image, pixels.
        width: u32,
        /// Height of the image, pixels.
        height: u32,
        /// Maximum side of a texture, pixels.
        limit: u32,
        /// Remedy, shown at the end of the message.
        remedy: &'static str,
    },
}

// Maximum number of distinct messages; a broken driver can report the same fault in endless variants.
const MAX_FAULTS: usize = 32;

/// Collects device faults from any wgpu thread, to be polled by the application. A fault that repeats
/// every frame is reported once.
#[derive(Clone, Debug, Default)]
pub struct GpuFaults(Arc<Mutex<Log>>);

#[derive(Debug, Default)]
struct Log {
    /// Distinct messages from wgpu or the driver, oldest first.
    messages: Vec<String>,
    n_taken: usize,
    is_lost: bool,
}

impl GpuFaults {
    /// Records a device's loss and uncaptured errors in this log, instead of panicking.
    pub fn watch(&self, device: &wgpu::Device) {
        let lost = self.clone();
        device.set_device_lost_callback(move |reason, message| {
            lost.lock().is_lost = true;
            lost.record(format!("device lost ({reason:?}): {message}"));
        });
        let uncaptured = self.clone();
        device.on_uncaptured_error(Arc::new(move |error: wgpu::Error| {
            uncaptured.record(error.to_string());
        }));
    }

    /// Returns the messages of new faults since the last call, oldest first.
    pub fn take_new(&self) -> Vec<String> {
        let mut log = self.lock();
        let fresh = log.messages[log.n_taken..].to_vec();
        log.n_taken = log.messages.len();
        fresh
    }

    /// True if a watched device was lost.
    pub fn is_lost(&self) -> bool {
        self.lock().is_lost
    }

    fn record(&self, message: String) {
        let mut log = self.lock();
        // A fault in every frame would flood log and window with one message.
        if !log.messages.contains(&message) && log.messages.len() < MAX_FAULTS {
            tracing::error!("GPU: {message}");
            log.messages.push(message);
        }
    }

    /// Locks the log. Poisoning is ignored: each write is a single push, so a panicking thread leaves
    /// the log consistent.
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
        for message in ["bad bind group", "bad bind group", "no memory"] {
            faults.record(message.to_owned());
        }
        assert_eq!(faults.take_new(), ["bad bind group", "no memory"]);
        faults.record("no memory".to_owned());
        assert!(faults.take_new().is_empty());
        (0..100).for_each(|i| faults.record(i.to_string()));
        assert_eq!(faults.take_new().len(), MAX_FAULTS - 2);
    }
}
