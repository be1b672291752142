//! Publishes the run to the window: snapshots with notices, and changed splats.

use super::Shared;
use super::run::Run;
use crate::app::splat_updates::{RunMoment, SplatChange, SplatUpdate};
use crate::app::state::{
    FileState, FollowState, HISTORY, Notice, NoticeKind, NoticeOffer, NoticeTopic, RunState,
    Snapshot,
};
use crate::pipeline::job::Waker;
use crate::train::learner::{Changed, Learner};
use std::collections::VecDeque;
use std::sync::Arc;
use std::time::Instant;

/// Number of frames over which the frame rate is averaged.
const RATE_FRAMES: usize = 30;

/// Least number of scenes of a run that a slow window receives, evenly spaced by frames. Of these it measures
/// curves after the end, for which a short run leaves no time.
const LEAST_MOMENTS: usize = 12;

/// Maximum number of notices in a snapshot. The list is copied for every new notice.
const MAX_NOTICES: usize = 50;

pub struct Outbox {
    pub snapshot: Snapshot,
    shared: Arc<Shared>,
    waker: Waker,
    published: Instant,
    dirty: Dirty,
    /// Number of frames processed before the latest delivery of splats.
    delivered_after: usize,
    /// True if the snapshot differs from the one published last.
    pub is_changed: bool,
    /// Serial number of the next notice, or of the next opened dataset or model.
    pub next_serial: u64,
    /// Times at which the latest frames were completed, for the frame rate.
    ends: VecDeque<Instant>,
}

impl Outbox {
    pub fn new(shared: Arc<Shared>, waker: Waker) -> Self {
        Self {
            snapshot: Snapshot::default(),
            shared,
            waker,
            published: Instant::now(),
            dirty: Dirty::default(),
            delivered_after: 0,
            is_changed: true,
            next_serial: 1,
            ends: VecDeque::new(),
        }
    }

    pub fn wake(&self) {
        (self.waker)();
    }

    /// True if there are changes that are not yet published.
    pub fn has_news(&self) -> bool {
        self.is_changed || !self.dirty.is_empty()
    }

    pub fn notify(&mut self, kind: NoticeKind, text: String) {
        self.notify_of(NoticeTopic::Event, kind, text);
    }

    pub fn notify_of(&mut self, topic: NoticeTopic, kind: NoticeKind, text: String) {
        self.notify_with(topic, kind, text, None);
    }

    /// Adds a notice that may offer to open something.
    pub fn notify_with(
        &mut self,
        topic: NoticeTopic,
        kind: NoticeKind,
        text: String,
        offer: Option<NoticeOffer>,
    ) {
        match kind {
            NoticeKind::Error => tracing::error!("{text}"),
            NoticeKind::Warning => tracing::warn!("{text}"),
            NoticeKind::Info => tracing::info!("{text}"),
        }
        // A new list, because published snapshots share the old one.
        let mut notices = self.snapshot.notices.to_vec();
        if notices.len() == MAX_NOTICES {
            notices.remove(0);
        }
        // Opened subjects use the same counter: both numbers only have to increase.
        notices.push(Notice { serial: self.next_serial, topic, kind, text, offer });
        self.next_serial += 1;
        self.snapshot.notices = Arc::new(notices);
        self.is_changed = true;
    }

    /// Removes the notices about a topic that is no longer current.
    pub fn forget_notices(&mut self, topic: NoticeTopic) {
        let kept = self.snapshot.notices.iter().filter(|notice| notice.topic != topic);
        self.snapshot.notices = Arc::new(kept.cloned().collect());
    }

    /// Resets the snapshot for another dataset or model. Notices, outcomes of files and the setting to
    /// follow recordings are kept.
    pub fn reset_snapshot(&mut self) {
        self.ends.clear();
        self.delivered_after = 0;
        let Snapshot { notices, files, following, .. } = std::mem::take(&mut self.snapshot);
        self.snapshot = Snapshot {
            notices,
            // The window may not have read yet that its file was written.
            files: FileState { unsaved_frames: 0, is_registration_unsaved: false, ..files },
            following: FollowState { recording: None, ..following },
            ..Snapshot::default()
        };
        self.is_changed = true;
    }

    /// Updates the frame rate after a frame is completed.
    pub fn record_frame(&mut self) {
        if self.ends.len() == RATE_FRAMES {
            self.ends.pop_front();
        }
        let now = Instant::now();
        self.ends.push_back(now);
        let span_s = self.ends.front().map_or(0.0, |first| (now - *first).as_secs_f64());
        // Ends are one more than the intervals between them.
        let n_intervals = (self.ends.len() - 1) as f64;
        self.snapshot.pace.frames_per_s = if span_s > 0.0 { n_intervals / span_s } else { 0.0 };
    }

    pub fn reset_frame_rate(&mut self) {
        self.ends.clear();
        self.snapshot.pace.frames_per_s = 0.0;
    }

    pub fn set_state(&mut self, state: RunState) {
        self.snapshot.state = state;
        self.is_changed = true;
    }

    /// Records whether training waits for a frame that has not been read.
    pub fn set_unread(&mut self, is_unread: bool) {
        if is_unread != self.snapshot.pace.unread_since.is_some() {
            self.snapshot.pace.unread_since = is_unread.then(Instant::now);
            self.is_changed = true;
        }
    }

    /// Publishes the snapshot to the window, at most once per interval unless `at_once` is true. Changed
    /// splats are delivered only after the viewport has received the previous ones.
    pub fn publish(&mut self, run: &Run, at_once: bool) {
        let due = self.published.elapsed() >= self.shared.interval();
        // A hidden window takes no splats, so pending ones must not wake it.
        let news = self.is_changed || !self.dirty.is_empty() && self.shared.updates.is_empty();
        if !(at_once || due && news) {
            if self.is_moment_due() {
                self.deliver_changes(run);
            }
            return;
        }
        // Delivered before the snapshot, so that a window that reads the snapshot finds its splats too.
        self.deliver_changes(run);
        self.snapshot.inspected = run.inspect();
        self.snapshot.registration = run.registration().cloned().map(Arc::new);
        self.snapshot.includes_pending_photographs =
            run.session().is_some_and(|session| session.is_settled());
        self.snapshot.frames.recent = Arc::new(run.recent_frames().to_vec());
        self.shared.snapshot.set(Arc::new(self.snapshot.clone()));
        self.published = Instant::now();
        self.is_changed = false;
        (self.waker)();
    }

    /// Adds new reports of older frames whose photographs were just compared with the scene. Buffered
    /// photographs are taken from the buffer at random, so some are compared many frames later.
    pub fn add_late_reports(&mut self, run: &Run) {
        let Some(session) = run.session() else { return };
        // Only half of them: the others are still among the latest frames when these are published.
        let Some(newer) = run.recent_frames().iter().nth_back(HISTORY / 2) else { return };
        let late = session.compared_frames().filter(|report| report.index <= newer.index);
        let late: Vec<_> = late.cloned().collect();
        if late.is_empty() {
            return;
        }
        // At rest all pending photographs are compared at once, and none of these may be dropped.
        let most = HISTORY.max(late.len());
        // A new list, because published snapshots share the old one.
        let mut all = [&self.snapshot.frames.late[..], &late].concat();
        all.drain(..all.len().saturating_sub(most));
        self.snapshot.frames.late = Arc::new(all);
    }

    pub fn mark_trained(&mut self, learner: &dyn Learner) {
        match learner.last_frame().changed {
            Changed::Listed(ids) => self.dirty.mark(ids),
            Changed::All => self.dirty.mark_all(learner.status().components),
        }
    }

    pub fn mark(&mut self, ids: &[u32]) {
        self.dirty.mark(ids);
    }

    pub fn mark_all(&mut self, run: &Run) {
        if let Some(session) = run.session() {
            self.dirty.mark_all(session.learner().status().components);
        }
    }

    /// Marks all components as changed, because rays of trained frames may change components without
    /// assigning points to them. Called only while training is idle, because delivering all components
    /// after every frame would slow training down.
    pub fn mark_visibility(&mut self, run: &Run) {
        if run.session().is_some_and(|session| session.config().method.scene().is_some()) {
            self.mark_all(run);
        }
    }

    /// Replaces the splats in the viewport by those of another dataset or model.
    pub fn replace_splats(&mut self, change: SplatChange) {
        self.dirty = Dirty::default();
        // Also drops pending updates of the previous scene.
        self.shared.updates.push(change.into());
    }

    pub fn deliver_all(&mut self, run: &Run) {
        // Contained in the whole scene.
        self.dirty.take();
        let splats = run.splats();
        let ids: Vec<u32> = (0..splats.len() as u32).collect();
        self.deliver(SplatChange::all(splats), &ids, run);
    }

    fn deliver_changes(&mut self, run: &Run) {
        let Some(session) = run.session() else { return };
        // While the window is slow or hidden, changes accumulate as a set, which is bounded by the
        // scene's size; a queue of all updates would grow without bound.
        let is_wanted = self.is_moment_due() || self.shared.updates.is_empty();
        if !self.dirty.is_empty() && is_wanted {
            let ids = self.dirty.take();
            self.deliver(SplatChange::some(ids.clone(), session.splats_of(&ids)), &ids, run);
        }
    }

    fn is_moment_due(&self) -> bool {
        let spacing = (self.snapshot.n_frames / LEAST_MOMENTS).max(1);
        self.snapshot.n_seen() >= self.delivered_after + spacing
    }

    fn deliver(&mut self, change: SplatChange, ids: &[u32], run: &Run) {
        let Snapshot { frames_done: n_trained, pace, .. } = &self.snapshot;
        let after = RunMoment {
            n_seen: self.snapshot.n_seen(),
            n_trained: *n_trained,
            seconds: pace.trained_s,
        };
        self.delivered_after = after.n_seen;
        self.shared.updates.push(SplatUpdate { change, attributes: run.attributes_of(ids), after });
    }
}

/// Set of components that changed since the last update of the viewport.
#[derive(Default)]
struct Dirty {
    // The list, because most frames change few components; the flags, because a frame may list a
    // component that is already in the list.
    ids: Vec<u32>,
    is_dirty: Vec<bool>,
}

impl Dirty {
    fn is_empty(&self) -> bool {
        self.ids.is_empty()
    }

    /// Adds components to the set. Their indices may be new.
    fn mark(&mut self, ids: &[u32]) {
        for &id in ids {
            let n = self.is_dirty.len().max(id as usize + 1);
            self.is_dirty.resize(n, false);
            if !std::mem::replace(&mut self.is_dirty[id as usize], true) {
                self.ids.push(id);
            }
        }
    }

    fn mark_all(&mut self, components: usize) {
        self.ids = (0..components as u32).collect();
        self.is_dirty = vec![true; components];
    }

    /// Returns each component once and empties the set.
    fn take(&mut self) -> Vec<u32> {
        // One by one: clearing all flags would cost time in proportion to the scene at every update.
        for &id in &self.ids {
            self.is_dirty[id as usize] = false;
        }
        std::mem::take(&mut self.ids)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn changed_components_are_taken_once_and_may_be_new() {
        let mut dirty = Dirty::default();
        dirty.mark(&[2, 0, 2]);
        dirty.mark(&[7, 0]);
        assert_eq!(dirty.take(), [2, 0, 7]);
        assert!(dirty.is_empty());
        dirty.mark(&[1]);
        dirty.mark_all(3);
        dirty.mark(&[2, 3]);
        assert_eq!(dirty.take(), [0, 1, 2, 3]);
    }
}
