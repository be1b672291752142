//! Publishes the run to the window: snapshots, changed splats, attributes of components.

use super::thread::WorkerThread;
use crate::app::opening::Content;
use crate::app::splat_updates::{SplatChange, SplatUpdate};
use crate::app::state::{HISTORY, Inspected};
use crate::eval::report::FrameReport;
use crate::model::attributes::ComponentAttributes;
use crate::model::splat::appearance::SplatSet;
use crate::render::attributes::Attribute;
use std::sync::Arc;
use std::time::Instant;

impl WorkerThread {
    /// Splats of the newest state, whatever the viewport shows.
    pub(super) fn splats(&self) -> SplatSet {
        match &self.content {
            Some(Content::Session(session)) => session.splats(),
            Some(Content::Model(splats)) => splats.clone(),
            None => SplatSet::default(),
        }
    }

    /// Splats as files store them.
    pub(super) fn stored_splats(&self) -> SplatSet {
        match &self.content {
            Some(Content::Session(session)) => session.stored_splats(),
            Some(Content::Model(_)) | None => self.splats(),
        }
    }

    /// Publishes to the window, at most once per interval unless `at_once`. Changed splats are
    /// converted only after the viewport has taken the last ones.
    pub(super) fn publish(&mut self, at_once: bool) {
        let due = self.published.elapsed() >= self.shared.interval();
        // A hidden window takes no splats, so pending ones must not wake it.
        let news = self.changed || !self.dirty.is_empty() && self.shared.updates.is_empty();
        if !(at_once || due && news) {
            return;
        }
        // Before the snapshot, so that a window that reads it finds its splats too.
        self.deliver_splats();
        self.snapshot.inspected = self.inspect();
        self.snapshot.includes_pending_photographs = self.is_settled();
        self.snapshot.recent = Arc::new(self.recent_frames().to_vec());
        self.shared.publish(self.snapshot.clone());
        self.published = Instant::now();
        self.changed = false;
        (self.waker)();
    }

    /// Reports of the latest frames. Those with pending photographs change once these are trained on.
    fn recent_frames(&self) -> &[FrameReport] {
        match &self.content {
            Some(Content::Session(session)) => {
                let frames = session.frames();
                &frames[frames.len().saturating_sub(HISTORY)..]
            }
            Some(Content::Model(_)) | None => &[],
        }
    }

    /// Adds reports older than [`Self::recent_frames`] whose photographs were just compared. Pending
    /// photographs are drawn at random, so that some wait for longer than any number of frames.
    pub(super) fn add_late_reports(&mut self) {
        let Some(Content::Session(session)) = &self.content else { return };
        // Only half of them: the others are still among the latest frames when these are published.
        let Some(newer) = self.recent_frames().iter().nth_back(HISTORY / 2) else { return };
        let late = session.compared_frames().filter(|report| report.index <= newer.index);
        let late: Vec<FrameReport> = late.cloned().collect();
        if late.is_empty() {
            return;
        }
        // At rest all pending photographs are compared at once, and none of these may be dropped.
        let most = HISTORY.max(late.len());
        // A new list, because published snapshots share the old one.
        let mut all = [&self.snapshot.late[..], &late].concat();
        all.drain(..all.len().saturating_sub(most));
        self.snapshot.late = Arc::new(all);
    }

    fn is_settled(&self) -> bool {
        matches!(&self.content, Some(Content::Session(session)) if session.is_settled())
    }

    fn deliver_splats(&mut self) {
        let Some(Content::Session(session)) = &self.content else { return };
        // While the window is slow or hidden, changes accumulate as a set, which is bounded by the
        // scene's size; a queue of updates would grow without bound.
        if !self.dirty.is_empty() && self.shared.updates.is_empty() {
            let ids = self.dirty.take();
            let splats = session.splats_of(&ids);
            let attributes = self.attributes_of(&ids);
            let change = SplatChange::some(ids, splats);
            let n_frames = self.snapshot.n_seen();
            self.shared.updates.push(SplatUpdate { change, attributes, n_frames });
        }
    }

    pub(super) fn deliver_all(&mut self) {
        self.dirty.take();
        let splats = self.splats();
        let ids: Vec<u32> = (0..splats.len() as u32).collect();
        let attributes = self.attributes_of(&ids);
        let (change, n_frames) = (SplatChange::all(splats), self.snapshot.n_seen());
        self.shared.updates.push(SplatUpdate { change, attributes, n_frames });
    }

    /// Attributes of components, if the viewport needs them.
    fn attributes_of(&self, ids: &[u32]) -> Vec<ComponentAttributes> {
        match &self.content {
            Some(Content::Session(session)) if self.watched.is_some() => session.attributes_of(ids),
            _ => Vec::new(),
        }
    }

    /// Sets the watched attribute. Everything is delivered again, because attributes of unchanged
    /// components have not been sent.
    pub(super) fn watch(&mut self, attribute: Option<Attribute>) {
        self.watched = attribute;
        let Some(Content::Session(session)) = &mut self.content else { return };
        match attribute {
            Some(Attribute::Elbo) => session.start_component_elbo(),
            _ => session.stop_component_elbo(),
        }
        if attribute.is_some() {
            self.dirty.mark_all(session.learner().components());
        }
    }

    fn inspect(&self) -> Option<Arc<Inspected>> {
        let id = self.inspecting?;
        let inspected = match self.content.as_ref()? {
            Content::Session(session) => Inspected::Component(Box::new(session.inspect(id)?)),
            Content::Model(splats) => Inspected::Splat {
                id,
                splat: *splats.get(id as usize)?,
                appearance: splats.appearance_of(id as usize),
            },
        };
        Some(Arc::new(inspected))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::app::frame_outcomes::{FrameOutcomes, FrameState};
    use crate::app::state::{RunState, Subject};
    use crate::app::training::TrainSettings;
    use crate::app::worker::{Worker, WorkerOrder};
    use crate::dataset::synthetic::SyntheticParams;
    use crate::dataset::synthetic::write::{SyntheticLayout, write};
    use std::time::Duration;

    /// Timeout of training all frames.
    const PATIENCE: Duration = Duration::from_secs(120);

    #[test]
    fn photographs_that_wait_longer_than_frames_are_shown_still_tell_how_they_compared() {
        let folder = tempfile::tempdir().unwrap();
        let params = SyntheticParams {
            width: 32,
            height: 24,
            n_train: HISTORY + 100,
            n_eval: 0,
            ..SyntheticParams::demo()
        };
        write(&params, folder.path(), SyntheticLayout::SevenScenes, &mut |_, _| {}).unwrap();
        let worker = Worker::start_with(Arc::new(|| {}), Vec::new()).unwrap();
        let mut settings = TrainSettings { autosave_s: None, ..TrainSettings::default() };
        settings.scene.shuffle_buffer = Some(150);
        worker.send(WorkerOrder::TrainBy(Box::new(settings)));
        worker.send(WorkerOrder::Open(Subject::Path(folder.path().to_owned())));
        worker.send(WorkerOrder::Train);
        let (started, mut outcomes) = (Instant::now(), FrameOutcomes::default());
        while worker.snapshot().state != RunState::Finished {
            assert!(started.elapsed() < PATIENCE, "{:?}", worker.snapshot().notices);
            outcomes.update(&worker.snapshot());
            std::thread::sleep(Duration::from_millis(5));
        }
        let snapshot = worker.snapshot();
        outcomes.update(&snapshot);
        let plan = snapshot.opened.as_ref().unwrap().plan.clone().unwrap();
        assert!(plan.frames.len() > HISTORY, "{}", plan.frames.len());
        let untold = plan.frames.iter().filter(|&&frame| {
            let state = outcomes.state_of((plan.split, frame), "");
            !matches!(state, FrameState::Trained(_, Some(outcome)) if outcome.psnr_before.is_some())
        });
        assert_eq!(untold.collect::<Vec<_>>(), [&0; 0]);
    }
}
