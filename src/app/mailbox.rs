//! Latest value published from one thread to another.

use std::sync::{Mutex, PoisonError};

/// Latest value. Every access under its lock is short, so that neither a panic nor a slow reader on one side
/// affects the other.
#[derive(Debug, Default)]
pub struct Mailbox<T>(Mutex<T>);

impl<T> Mailbox<T> {
    pub fn set(&self, value: T) {
        self.with(|held| *held = value);
    }

    pub fn get(&self) -> T
    where
        T: Clone,
    {
        self.with(|held| held.clone())
    }

    /// Takes the value and leaves the default.
    pub fn take(&self) -> T
    where
        T: Default,
    {
        self.with(std::mem::take)
    }

    /// Applies `access` to the value under the lock. It must leave a valid value even if it panics.
    pub fn with<R>(&self, access: impl FnOnce(&mut T) -> R) -> R {
        // Every access leaves a valid value, so a poisoned lock is no reason to lose it.
        access(&mut self.0.lock().unwrap_or_else(PoisonError::into_inner))
    }
}
