//! Progress reports and cancellation of writing.

use super::error::Cancelled;
use std::fmt;
use std::io;

/// Callback between blocks of rows. Receives the completed fraction, 0 to 1, and returns false to cancel.
#[derive(Clone, Copy, Default)]
pub struct WriteProgress<'a>(Option<&'a dyn Fn(f64) -> bool>);

impl<'a> WriteProgress<'a> {
    /// No callback.
    pub const NONE: WriteProgress<'static> = WriteProgress(None);

    /// Reports progress to the callback; if it returns `false`, writing ends with
    /// [`super::Fault::Cancelled`].
    pub fn new(told: &'a dyn Fn(f64) -> bool) -> Self {
        Self(Some(told))
    }
}

impl fmt::Debug for WriteProgress<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(if self.0.is_some() { "WriteProgress(told)" } else { "WriteProgress(none)" })
    }
}

pub(super) struct ProgressCounter<'a> {
    progress: WriteProgress<'a>,
    done: usize,
    total: usize,
}

impl<'a> ProgressCounter<'a> {
    /// Starts a count of `total` rows. Rows written per column count once for each column.
    pub fn new(progress: WriteProgress<'a>, total: usize) -> Self {
        Self { progress, done: 0, total }
    }

    /// Counts `n` more rows and reports the progress.
    pub fn advance(&mut self, n: usize) -> io::Result<()> {
        self.done += n;
        let share = self.done as f64 / self.total.max(1) as f64;
        match self.progress.0 {
            Some(told) if !told(share.min(1.0)) => Err(io::Error::other(Cancelled)),
            _ => Ok(()),
        }
    }
}
