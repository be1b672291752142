//! Polls wgpu futures without an executor.

use std::future::Future;
use std::task::{Context, Poll, Waker};

/// Polls a future once. Native wgpu futures resolve immediately; `None` if this one does not.
pub(super) fn poll_once<T>(future: impl Future<Output = T>) -> Option<T> {
    match std::pin::pin!(future).poll(&mut Context::from_waker(Waker::noop())) {
        Poll::Ready(value) => Some(value),
        Poll::Pending => None,
    }
}
