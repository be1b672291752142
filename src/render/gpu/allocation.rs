//! Out of memory, which WebGPU may report long after the allocation.

use super::error::GpuError;
use super::poll::ready;
use std::fmt;
use std::future::Future;
use std::pin::Pin;

type Answer = Pin<Box<dyn Future<Output = Option<wgpu::Error>> + Send>>;

/// What became of an allocation.
pub(super) struct Allocation {
    /// While the driver has not said.
    answer: Option<Answer>,
    refused: GpuError,
}

impl Allocation {
    /// Allocates; `refused` is the error if the driver says no, at once or in a later
    /// [`Self::check`].
    pub(super) fn new<T>(
        device: &wgpu::Device,
        refused: GpuError,
        allocate: impl FnOnce() -> T,
    ) -> Result<(T, Self), GpuError> {
        // A scope of its own, so that the refusal comes here and not to whoever hears of faults.
        let scope = device.push_error_scope(wgpu::ErrorFilter::OutOfMemory);
        let made = allocate();
        let mut allocation = Self { answer: Some(Box::pin(scope.pop())), refused };
        // Native backends answer at once, and then nothing is built on a buffer that is not there.
        allocation.check()?;
        Ok((made, allocation))
    }

    /// The error, once, if the driver has said no since the last check.
    pub(super) fn check(&mut self) -> Result<(), GpuError> {
        let Some(said) = self.answer.as_mut().and_then(ready) else { return Ok(()) };
        // An error is reported once; later frames go on with what there is.
        self.answer = None;
        said.map_or(Ok(()), |_| Err(self.refused.clone()))
    }
}

impl fmt::Debug for Allocation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Allocation").field("is_pending", &self.answer.is_some()).finish()
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
            answer: Some(Box::pin(std::future::poll_fn(move |_| {
                told.lock().unwrap().take().map_or(Poll::Pending, Poll::Ready)
            }))),
            refused: refused.clone(),
        };
        assert_eq!(allocation.check(), Ok(()));
        *answer.lock().unwrap() =
            Some(Some(wgpu::Error::OutOfMemory { source: "none left".into() }));
        assert_eq!(allocation.check(), Err(refused));
        assert_eq!(allocation.check(), Ok(()));
    }
}
