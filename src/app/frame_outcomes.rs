//! State of each frame of a dataset: trained, excluded, skipped or pending.
//!
//! Collected from snapshots, which report only the latest frames. For frames trained while the window was
//! closed, only the fact that they were trained is known.

use super::state::{Opened, Snapshot};
use crate::eval::report::{FrameReport, SkippedFrame};
use crate::pipeline::plan::Plan;
use crate::train::outcome::{Contradiction, PhotographOutcome};
use std::collections::HashMap;
use std::sync::Arc;

/// State of a frame.
#[derive(Clone, Debug, PartialEq)]
pub enum FrameState {
    /// Not part of the run.
    NotTaken,
    /// Pending, at this position of the training order.
    Ahead(usize),
    /// Trained, at this position of the order, with its figures if the window received them.
    Trained(usize, Option<TrainedFrame>),
    /// Unusable, with the reason.
    Skipped(String),
}

/// Figures of a trained frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrainedFrame {
    /// Points trained on.
    pub points: usize,
    /// Mean ELBO of its points, nats.
    pub elbo_mean: f64,
    /// PSNR of its photograph against the scene before training on it, dB; `None` without photometric
    /// training or without a scene at that time.
    pub psnr_before: Option<f64>,
}

impl From<&FrameReport> for TrainedFrame {
    fn from(report: &FrameReport) -> Self {
        // If the frame's points contradict the scene, the difference is not that of its photograph.
        let is_of_photograph = |photo: &PhotographOutcome| {
            matches!(photo.contradiction, None | Some(Contradiction::Picture))
        };
        let photograph = report.photograph.filter(is_of_photograph);
        let difference = photograph.map(|photo| photo.difference).filter(|&d| d > 0.0);
        Self {
            points: report.points,
            elbo_mean: report.elbo_mean,
            psnr_before: difference.map(|difference| -20.0 * difference.log10()),
        }
    }
}

/// States of all frames of the open dataset.
#[derive(Default)]
pub struct FrameOutcomes {
    serial: u64,
    plan: Option<Arc<Plan>>,
    /// First position in the training order, by index of the frame in the trained split.
    positions: HashMap<usize, usize>,
    outcomes: HashMap<usize, TrainedFrame>,
    recent: Arc<Vec<FrameReport>>,
    late: Arc<Vec<FrameReport>>,
    /// Frames before this position are trained or skipped.
    n_reached: usize,
    skipped: Arc<Vec<SkippedFrame>>,
    /// Indices into `skipped`, by frame name.
    skipped_at: HashMap<String, usize>,
}

impl FrameOutcomes {
    /// Adds the news of a snapshot.
    pub fn take(&mut self, snapshot: &Snapshot) {
        let Some(opened) = &snapshot.opened else { return };
        if self.serial != opened.serial {
            *self = Self { serial: opened.serial, ..Self::default() };
        }
        self.take_plan(opened);
        let outcome = |report: &FrameReport| (report.index, TrainedFrame::from(report));
        if !Arc::ptr_eq(&self.recent, &snapshot.recent) {
            self.recent = snapshot.recent.clone();
            // Known frames too: a photograph in the shuffle buffer is trained on some frames later.
            self.outcomes.extend(self.recent.iter().map(outcome));
            self.n_reached = self.recent.last().map_or(self.n_reached, |newest| newest.index + 1);
        }
        if !Arc::ptr_eq(&self.late, &snapshot.late) {
            self.late = snapshot.late.clone();
            self.outcomes.extend(self.late.iter().map(outcome));
        }
        if !Arc::ptr_eq(&self.skipped, &snapshot.skipped) {
            self.skipped = snapshot.skipped.clone();
            let named = self.skipped.iter().enumerate();
            self.skipped_at = named.map(|(i, skipped)| (skipped.frame.clone(), i)).collect();
        }
    }

    /// A followed recording gains frames and gets a new plan.
    fn take_plan(&mut self, opened: &Opened) {
        let is_known = match (&self.plan, &opened.plan) {
            (Some(known), Some(plan)) => Arc::ptr_eq(known, plan),
            (known, plan) => known.is_none() && plan.is_none(),
        };
        if !is_known {
            self.plan = opened.plan.clone();
            self.positions.clear();
            let frames = self.plan.iter().flat_map(|plan| plan.frames.iter().enumerate());
            for (position, &frame) in frames {
                self.positions.entry(frame).or_insert(position);
            }
        }
    }

    /// State of a frame given by its split, its index there and its name.
    pub fn of(&self, (split, index): (usize, usize), name: &str) -> FrameState {
        let is_trained = self.plan.as_ref().is_some_and(|plan| plan.split == split);
        let position = self.positions.get(&index).filter(|_| is_trained);
        let Some(&position) = position else { return FrameState::NotTaken };
        match (self.outcomes.get(&position), self.skipped_at.get(name)) {
            (Some(&outcome), _) => FrameState::Trained(position, Some(outcome)),
            (None, Some(&at)) => FrameState::Skipped(self.skipped[at].message.clone()),
            (None, None) if position < self.n_reached => FrameState::Trained(position, None),
            (None, None) => FrameState::Ahead(position),
        }
    }

    /// Position of the last trained frame in the training order.
    pub fn latest(&self) -> Option<usize> {
        self.n_reached.checked_sub(1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::app::panels::timings::tests::frame;
    use crate::pipeline::demo;
    use crate::pipeline::plan::{Order, Selection};
    use crate::pipeline::session::Session;
    use crate::pipeline::settings::scene::SceneOverrides;

    fn snapshot(selection: Selection) -> Snapshot {
        let dataset = demo::dataset().unwrap();
        let session = Session::new(dataset, SceneOverrides::default(), selection).unwrap();
        let opened = crate::app::opening::session(session, 1, None).opened;
        Snapshot { opened: Some(Arc::new(opened)), ..Snapshot::default() }
    }

    fn report(index: usize) -> FrameReport {
        FrameReport { index, ..frame(1.0) }
    }

    #[test]
    fn frames_are_ahead_then_trained_or_skipped_and_others_are_not_taken() {
        let mut snapshot = snapshot(Selection { stride: 2, ..Selection::everything() });
        let opened = snapshot.opened.clone().unwrap();
        let split = opened.plan.as_ref().unwrap().split;
        let name = |index: usize| {
            opened.dataset.as_ref().unwrap().splits[split].frames[index].name.clone()
        };
        let mut known = FrameOutcomes::default();
        known.take(&snapshot);
        assert_eq!(known.of((split, 2), &name(2)), FrameState::Ahead(1));
        assert_eq!(known.of((split, 1), &name(1)), FrameState::NotTaken);
        assert_eq!(known.of((split + 1, 2), "other"), FrameState::NotTaken);

        let photograph =
            |difference| Some(PhotographOutcome { difference, usual: 0.1, contradiction: None });
        let first = FrameReport { photograph: photograph(0.1), ..report(1) };
        snapshot.recent = Arc::new(vec![first, report(3)]);
        let why = SkippedFrame { frame: name(4), message: "damaged".into() };
        snapshot.skipped = Arc::new(vec![why]);
        known.take(&snapshot);
        assert_eq!(known.of((split, 4), &name(4)), FrameState::Skipped("damaged".into()));
        assert_eq!(known.of((split, 0), &name(0)), FrameState::Trained(0, None));
        let FrameState::Trained(1, Some(outcome)) = known.of((split, 2), &name(2)) else {
            panic!("trained");
        };
        assert!((outcome.psnr_before.unwrap() - 20.0).abs() < 1e-9);
        assert_eq!(known.latest(), Some(3));

        // Another run starts without any states.
        let mut again = Opened::clone(&opened);
        again.serial = 2;
        let again = Snapshot { opened: Some(Arc::new(again)), ..Snapshot::default() };
        known.take(&again);
        assert_eq!(known.of((split, 2), &name(2)), FrameState::Ahead(1));
        assert_eq!(known.latest(), None);
    }

    #[test]
    fn a_shuffled_run_tells_the_place_of_a_frame_in_its_order() {
        let snapshot = snapshot(Selection { order: Order::Shuffled, ..Selection::everything() });
        let plan = snapshot.opened.as_ref().unwrap().plan.clone().unwrap();
        let mut known = FrameOutcomes::default();
        known.take(&snapshot);
        for (position, &frame) in plan.frames.iter().enumerate().step_by(7) {
            assert_eq!(known.of((plan.split, frame), ""), FrameState::Ahead(position));
        }
    }
}
