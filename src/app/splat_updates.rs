//! Changed splats on their way from the trainer to the viewport. Nobody waits: the trainer adds to
//! the updates only when the last update was taken, and the viewport takes what is there.

use crate::model::attributes::ComponentAttributes;
use crate::model::splat::appearance::SplatSet;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// One update. Many threads of the window are handed the same one, which its own thread copies for none of them.
#[derive(Clone, Debug)]
pub enum SplatChange {
    /// Everything is replaced.
    All(Arc<SplatSet>),
    /// The listed slots changed, or are new.
    Some {
        /// Slots.
        ids: Arc<[u32]>,
        /// Their new values.
        splats: Arc<SplatSet>,
    },
}

impl SplatChange {
    /// Everything is replaced by these.
    pub fn all(splats: impl Into<SplatSet>) -> Self {
        Self::All(Arc::new(splats.into()))
    }

    /// These are in the listed slots now.
    pub fn some(ids: Vec<u32>, splats: impl Into<SplatSet>) -> Self {
        Self::Some { ids: ids.into(), splats: Arc::new(splats.into()) }
    }
}

/// A change and what is known of its components, one each in the same order; nothing where nobody
/// asked (see [`super::worker::WorkerOrder::Watch`]).
#[derive(Clone, Debug)]
pub struct SplatUpdate {
    /// The change.
    pub change: SplatChange,
    /// What is known of its components.
    pub attributes: Vec<ComponentAttributes>,
    /// Frames that the scene has seen with it, skipped ones among them.
    pub n_frames: usize,
}

impl From<SplatChange> for SplatUpdate {
    fn from(change: SplatChange) -> Self {
        Self { change, attributes: Vec::new(), n_frames: 0 }
    }
}

/// The mailbox between the two.
#[derive(Debug, Default)]
pub struct SplatUpdates(Mutex<Vec<SplatUpdate>>);

impl SplatUpdates {
    fn lock(&self) -> MutexGuard<'_, Vec<SplatUpdate>> {
        // A panic while a list is pushed or taken leaves the list valid.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Whether everything delivered was taken.
    pub fn is_empty(&self) -> bool {
        self.lock().is_empty()
    }

    /// Adds a update; a replacement makes those before it pointless.
    pub fn push(&self, update: SplatUpdate) {
        let mut waiting = self.lock();
        if matches!(update.change, SplatChange::All(_)) {
            waiting.clear();
        }
        waiting.push(update);
    }

    /// Takes all deliveries, oldest first.
    pub fn take(&self) -> Vec<SplatUpdate> {
        std::mem::take(&mut *self.lock())
    }
}

/// Applies a change to splats, which may grow by it, and returns the slots that changed, or `None`
/// for all.
pub fn apply(splats: &mut Arc<SplatSet>, change: SplatChange) -> Option<Arc<[u32]>> {
    match change {
        SplatChange::All(all) => {
            *splats = all;
            None
        }
        SplatChange::Some { ids, splats: new } => {
            // Copies them only while another thread holds a share.
            Arc::make_mut(splats).replace(&ids, &new);
            Some(ids)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::splat::appearance::Appearance;
    use crate::model::splat::splats::Splat;

    const EMPTY: Splat = Splat { opacity: 0.0, ..VISIBLE };
    const VISIBLE: Splat = Splat {
        mean: [0.0; 3],
        opacity: 1.0,
        color: [0.0; 3],
        scale: [0.0; 3],
        rotation: [1.0, 0.0, 0.0, 0.0],
    };

    #[test]
    fn a_replacement_supersedes_what_waits_and_later_changes_may_add() {
        let updates = SplatUpdates::default();
        updates.push(SplatChange::some(vec![0], vec![VISIBLE]).into());
        updates.push(SplatChange::all(vec![EMPTY; 2]).into());
        updates.push(SplatChange::some(vec![1, 3], vec![VISIBLE; 2]).into());
        let mut splats = Arc::default();
        let changed: Vec<_> =
            updates.take().into_iter().map(|d| apply(&mut splats, d.change)).collect();
        assert_eq!(changed, [None, Some([1, 3].into())]);
        assert_eq!(splats[..], [EMPTY, VISIBLE, Splat::default(), VISIBLE]);
        assert!(updates.is_empty());
    }

    #[test]
    fn appearance_comes_with_the_splats_it_belongs_to() {
        let bent = Appearance { gradient: [[1.0; 3]; 3], ..Appearance::default() };
        let mut splats: Arc<SplatSet> = Arc::new(vec![VISIBLE; 2].into());
        let native = SplatSet::new(vec![VISIBLE], vec![bent]);
        apply(&mut splats, SplatChange::some(vec![2], native));
        let plain = Appearance::default();
        assert_eq!(splats.view().appearance(), [plain, plain, bent]);
        apply(&mut splats, SplatChange::some(vec![2], vec![EMPTY]));
        assert_eq!(splats.view().appearance(), [plain; 3]);
    }
}
