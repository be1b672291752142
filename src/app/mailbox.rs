//! Latest value published from one thread to another.

use std::sync::{Mutex, MutexGuard, PoisonError};

/// Holds the latest value. The lock is held for one assignment or clone only, so that neither a panic nor
/// a slow reader on one side affects the other.
#[derive(Debug, Default)]
pub struct Mailbox<T>(Mutex<T>);

impl<T> Mailbox<T> {
    pub fn set(&self, value: T) {
        *self.lock() = value;
    }

    pub fn get(&self) -> T
    where
        T: Clone,
    {
        self.lock().clone()
    }

    /// Takes the value and leaves the default.
    pub fn take(&self) -> T
    where
        T: Default,
    {
        std::mem::take(&mut *self.lock())
    }

    fn lock(&self) -> MutexGuard<'_, T> {
        // Every write is one assignment, so the value is valid even after a panic.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
