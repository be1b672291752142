//! Allocations whose out-of-memory errors may arrive later.

use super::error::GpuError;
use super::poll::poll_once;
use std::fmt;
use std::future::Future;
use std::pin::Pin;

type Answer = Pin<Box<dyn Future<Output = Option<wgpu::Error>> + Send>>;

/// Outcome of an allocation.
pub(super) struct Allocation {
    /// `None` once the driver has responded.
    pending_error: Option<Answer>,
    out_of_memory_error: GpuError,
}

impl Allocation {
    /// Runs `allocate`. If the driver reports that it is out of memory, `refused` is returned, either here or
    /// by a later [`Self::check`].
    pub(super) fn new<T>(
        device: &wgpu::Device,
        refused: GpuError,
        allocate: impl FnOnce() -> T,
    ) -> Result<(T, Self), GpuError> {
        // A separate error scope delivers the error here rather than to the fault handler.
        let scope = device.push_error_scope(wgpu::ErrorFilter::OutOfMemory);
        let made = allocate();
        let mut allocation =
            Self { pending_error: Some(Box::pin(scope.pop())), out_of_memory_error: refused };
        // Native backends respond immediately; then nothing is built on an invalid buffer.
        allocation.check()?;
        Ok((made, allocation))
    }

    /// Returns the error once if the driver has reported one since the last check.
    pub(super) fn check(&mut self) -> Result<(), GpuError> {
        let Some(said) = self.pending_error.as_mut().and_then(poll_once) else { return Ok(()) };
        // Reported once; later frames continue with the existing buffers.
        self.pending_error = None;
        said.map_or(Ok(()), |_| Err(self.out_of_memory_error.clone()))
    }
}

impl fmt::Debug for Allocation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Allocation").field("is_pending", &self.pending_error.is_some()).finish()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::{Arc, Mutex};
    use std::task::Poll;

    #[test]
    fn an_answer_that_comes_late_is_an_error_once() {
        let answer: Arc<Mutex<Option<Option<wgpu::Error>>>> = Arc::default();
        let told = answer.clone();
        let refused = GpuError::OutOfMemory { n_splats: 7, mib: 3 };
        let mut allocation = Allocation {
            pending_error: Some(Box::pin(std::future::poll_fn(move |_| {
                told.lock().unwrap().take().map_or(Poll::Pending, Poll::Ready)
            }))),
            out_of_memory_error: refused.clone(),
        };
        assert_eq!(allocation.check(), Ok(()));
        *answer.lock().unwrap() =
            Some(Some(wgpu::Error::OutOfMemory { source: "none left".into() }));
        assert_eq!(allocation.check(), Err(refused));
        assert_eq!(allocation.check(), Ok(()));
    }
}
