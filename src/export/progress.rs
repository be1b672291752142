//! How far writing is, told to whoever waits and may want it to end.

use super::error::Cancelled;
use std::fmt;
use std::io;

/// Told the share that is done, from 0 to 1, between blocks of rows; answers whether to go on.
#[derive(Clone, Copy, Default)]
pub struct WriteProgress<'a>(Option<&'a dyn Fn(f64) -> bool>);

impl<'a> WriteProgress<'a> {
    /// Asks and tells nobody.
    pub const NONE: WriteProgress<'static> = WriteProgress(None);

    /// Tells `told`, and ends the work with [`super::Fault::Cancelled`] where it answers `false`.
    pub fn new(told: &'a dyn Fn(f64) -> bool) -> Self {
        Self(Some(told))
    }
}

impl fmt::Debug for WriteProgress<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(if self.0.is_some() { "WriteProgress(told)" } else { "WriteProgress(none)" })
    }
}

/// Counts the rows of one file.
pub(super) struct Steps<'a> {
    progress: WriteProgress<'a>,
    done: usize,
    total: usize,
}

impl<'a> Steps<'a> {
    /// Before the first of `total` rows, each column's counted by itself.
    pub fn new(progress: WriteProgress<'a>, total: usize) -> Self {
        Self { progress, done: 0, total }
    }

    /// After `n` more rows.
    pub fn advance(&mut self, n: usize) -> io::Result<()> {
        self.done += n;
        let share = self.done as f64 / self.total.max(1) as f64;
        match self.progress.0 {
            Some(told) if !told(share.min(1.0)) => Err(io::Error::other(Cancelled)),
            _ => Ok(()),
        }
    }
}
