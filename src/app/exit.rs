//! Why a window ends, told by whatever ends it to whoever opened it.

use super::device::WindowDevice;
use crate::render::gpu::adapters::AdapterChoice;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

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
pub struct Exit(Arc<Mutex<Word>>);

#[derive(Default)]
struct Word {
    why: Leave,
    device: Option<WindowDevice>,
}

impl Exit {
    /// Leaves word.
    pub fn leave(&self, why: Leave) {
        self.lock().why = why;
    }

    /// The word left.
    pub fn why(&self) -> Leave {
        self.lock().why.clone()
    }

    /// Notes the device that the window is drawn with.
    pub(super) fn watch(&self, device: Option<WindowDevice>) {
        self.lock().device = device;
    }

    /// Whether the window's device is gone, asked of the device itself.
    pub(super) fn device_is_lost(&self) -> bool {
        self.lock().device.as_ref().is_some_and(WindowDevice::is_lost)
    }

    fn lock(&self) -> MutexGuard<'_, Word> {
        // Every write is one assignment: a panic elsewhere leaves the word whole.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
