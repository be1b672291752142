//! Why a window ends, told by whatever ends it to whoever opened it.

use crate::render::gpu::adapters::AdapterChoice;
use std::sync::{Arc, Mutex, PoisonError};

/// Why a window ended.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum Leave {
    /// The user closed it.
    #[default]
    Closed,
    /// Its graphics device is gone.
    DeviceLost,
    /// The user chose another adapter.
    Adapter(AdapterChoice),
}

/// Where a window leaves word why it ends. It outlives the window, whose own state is gone after a
/// panic.
#[derive(Clone, Default)]
pub struct Exit(Arc<Mutex<Leave>>);

impl Exit {
    /// Leaves word.
    pub fn leave(&self, why: Leave) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = why;
    }

    /// The word left.
    pub fn why(&self) -> Leave {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }
}
