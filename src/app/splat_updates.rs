//! Values passed from one thread to another: the latest value, and changed splats for the viewport.
//!
//! Neither side waits for the other: the trainer adds splats only after the previous ones were taken, and
//! the viewport takes what is available.

use crate::model::attributes::ComponentAttributes;
use crate::model::splat::appearance::SplatSet;
use std::sync::{Arc, Mutex, PoisonError};

/// Latest value, shared between threads. The lock is held only briefly, and a panic during an access leaves
/// a valid value. No thread therefore blocks another or makes the value unusable.
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

    /// Returns the value and replaces it by the default.
    pub fn take(&self) -> T
    where
        T: Default,
    {
        self.with(std::mem::take)
    }

    /// Applies `access` to the value under the lock. `access` must leave a valid value even if it
    /// panics.
    pub fn with<R>(&self, access: impl FnOnce(&mut T) -> R) -> R {
        // Every access leaves a valid value, so it remains usable after the lock is poisoned.
        access(&mut self.0.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

/// Change of the splats. The threads of the window share a change without copying it.
#[derive(Clone, Debug)]
pub enum SplatChange {
    All(Arc<SplatSet>),
    /// Replaces the splats in the listed slots. Slots beyond the end are added.
    Some {
        ids: Arc<[u32]>,
        splats: Arc<SplatSet>,
    },
}

impl SplatChange {
    pub fn all(splats: impl Into<SplatSet>) -> Self {
        Self::All(Arc::new(splats.into()))
    }

    pub fn some(ids: Vec<u32>, splats: impl Into<SplatSet>) -> Self {
        Self::Some { ids: ids.into(), splats: Arc::new(splats.into()) }
    }

    /// Adds a later change. Unlike a list of changes, the result retains only the latest textures.
    pub fn append(&mut self, later: Self) {
        match (&mut *self, later) {
            (Self::All(all), Self::Some { ids, splats: new }) => {
                Arc::make_mut(all).replace(&ids, &new);
            }
            (Self::Some { ids, splats }, Self::Some { ids: more, splats: new }) => {
                let end = ids.len() + more.len();
                let slots: Vec<u32> = (ids.len() as u32..end as u32).collect();
                Arc::make_mut(splats).replace(&slots, &new);
                // A slot may be listed twice; the later splat is applied last.
                *ids = ids.iter().chain(&*more).copied().collect();
            }
            (_, all @ Self::All(_)) => *self = all,
        }
    }
}

/// Change of splats, with the attributes of each changed component in the same order. `attributes` is
/// empty if none were requested (see [`super::worker::WorkerOrder::Watch`]).
#[derive(Clone, Debug)]
pub struct SplatUpdate {
    pub change: SplatChange,
    pub attributes: Vec<ComponentAttributes>,
    pub after: RunMoment,
}

/// Moment of a run.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RunMoment {
    /// Number of frames that were processed, including skipped ones.
    pub n_seen: usize,
    pub n_trained: usize,
    /// Training time until then, seconds.
    pub seconds: f64,
}

impl From<SplatChange> for SplatUpdate {
    fn from(change: SplatChange) -> Self {
        // With 0 frames no copy for the history is stored.
        Self { change, attributes: Vec::new(), after: RunMoment::default() }
    }
}

#[derive(Debug, Default)]
pub struct SplatUpdates(Mailbox<Vec<SplatUpdate>>);

impl SplatUpdates {
    pub fn is_empty(&self) -> bool {
        self.0.with(|waiting| waiting.is_empty())
    }

    /// Adds an update. A replacement of all splats drops the earlier updates.
    pub fn push(&self, update: SplatUpdate) {
        self.0.with(|waiting| {
            // Earlier updates would cost the viewport time without any effect.
            if matches!(update.change, SplatChange::All(_)) {
                waiting.clear();
            }
            waiting.push(update);
        });
    }

    pub fn take(&self) -> Vec<SplatUpdate> {
        self.0.take()
    }
}

/// Applies a change to `splats`, which may grow. Returns the changed slots, or `None` if all were
/// changed.
pub fn apply(splats: &mut Arc<SplatSet>, change: SplatChange) -> Option<Arc<[u32]>> {
    match change {
        SplatChange::All(all) => {
            *splats = all;
            None
        }
        SplatChange::Some { ids, splats: new } => {
            // Copies the splats only while another thread shares them.
            Arc::make_mut(splats).replace(&ids, &new);
            Some(ids)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::splat::appearance::{Appearance, Finishing};
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
    fn appended_changes_act_as_one_after_the_other_and_free_earlier_textures() {
        let textured = |splats: Vec<Splat>| {
            let textures = Arc::new(vec![None; splats.len()]);
            let weak = Arc::downgrade(&textures);
            let finishing = Finishing { textures: Some(textures), ..Finishing::default() };
            (SplatSet::from(splats).finished(finishing), weak)
        };
        for is_whole in [false, true] {
            let at = |x: f32| Splat { mean: [x; 3], ..VISIBLE };
            let (first, earlier) = textured(vec![at(1.0), at(2.0)]);
            let mut change = match is_whole {
                true => SplatChange::all(first),
                false => SplatChange::some(vec![0, 1], first),
            };
            // A thread that shares the earlier change keeps what it has.
            let shared = change.clone();
            let (second, latest) = textured(vec![at(3.0), at(4.0)]);
            change.append(SplatChange::some(vec![1, 2], second));
            let mut splats = Arc::default();
            apply(&mut splats, shared);
            assert_eq!(splats[..], [at(1.0), at(2.0)]);
            assert!(earlier.upgrade().is_some());
            apply(&mut splats, change);
            assert_eq!(splats[..], [at(1.0), at(3.0), at(4.0)]);
            assert!(earlier.upgrade().is_none() && latest.upgrade().is_some());
        }
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
