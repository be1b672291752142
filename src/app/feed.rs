//! Changed splats on their way from the trainer to the viewport. Nobody waits: the trainer adds to
//! the feed only when the last delivery was taken, and the viewport takes what is there.

use crate::model::attributes::Attributes;
use crate::model::splats::Splat;
use std::sync::{Mutex, MutexGuard, PoisonError};

/// One delivery.
#[derive(Clone, Debug)]
pub enum SplatChange {
    /// Everything is replaced.
    All(Vec<Splat>),
    /// The listed slots changed.
    Some {
        /// Slots, below the number of splats of the last [`SplatChange::All`].
        ids: Vec<u32>,
        /// Their new values.
        splats: Vec<Splat>,
    },
}

/// A change and what is known of its components, one each in the same order; nothing where nobody
/// asked (see [`super::worker::Order::Watch`]).
#[derive(Clone, Debug)]
pub struct Delivery {
    /// The change.
    pub change: SplatChange,
    /// What is known of its components.
    pub attributes: Vec<Attributes>,
}

impl From<SplatChange> for Delivery {
    fn from(change: SplatChange) -> Self {
        Self { change, attributes: Vec::new() }
    }
}

/// The mailbox between the two.
#[derive(Debug, Default)]
pub struct SplatFeed(Mutex<Vec<Delivery>>);

impl SplatFeed {
    fn lock(&self) -> MutexGuard<'_, Vec<Delivery>> {
        // A panic while a list is pushed or taken leaves the list valid.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Whether everything delivered was taken.
    pub fn is_empty(&self) -> bool {
        self.lock().is_empty()
    }

    /// Adds a delivery; a replacement makes those before it pointless.
    pub fn push(&self, delivery: Delivery) {
        let mut waiting = self.lock();
        if matches!(delivery.change, SplatChange::All(_)) {
            waiting.clear();
        }
        waiting.push(delivery);
    }

    /// Takes all deliveries, oldest first.
    pub fn take(&self) -> Vec<Delivery> {
        std::mem::take(&mut *self.lock())
    }
}

/// Applies a delivery to a list of splats and returns the slots that changed, or `None` for all.
pub fn apply(splats: &mut Vec<Splat>, change: SplatChange) -> Option<Vec<u32>> {
    match change {
        SplatChange::All(all) => {
            *splats = all;
            None
        }
        SplatChange::Some { ids, splats: new } => {
            for (&id, splat) in ids.iter().zip(new) {
                if let Some(slot) = splats.get_mut(id as usize) {
                    *slot = splat;
                }
            }
            Some(ids)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_replacement_supersedes_what_waits() {
        let feed = SplatFeed::default();
        feed.push(SplatChange::Some { ids: vec![0], splats: vec![Splat::default()] }.into());
        feed.push(SplatChange::All(vec![Splat::default(); 2]).into());
        let visible = Splat { opacity: 1.0, ..Splat::default() };
        feed.push(SplatChange::Some { ids: vec![1, 9], splats: vec![visible; 2] }.into());
        let mut splats = Vec::new();
        let changed: Vec<_> =
            feed.take().into_iter().map(|d| apply(&mut splats, d.change)).collect();
        assert_eq!(changed, [None, Some(vec![1, 9])]);
        assert_eq!(splats, [Splat::default(), visible]);
        assert!(feed.is_empty());
    }
}
