//! Answers of wgpu that are futures, taken without an executor.

use std::future::Future;
use std::task::{Context, Poll, Waker};

/// Futures of native wgpu resolve at once; `None` from a backend whose do not.
pub(super) fn ready<T>(future: impl Future<Output = T>) -> Option<T> {
    match std::pin::pin!(future).poll(&mut Context::from_waker(Waker::noop())) {
        Poll::Ready(value) => Some(value),
        Poll::Pending => None,
    }
}
