//! State of each frame of a dataset: trained, excluded, skipped or pending.
//!
//! Collected from snapshots, which report only the latest frames. For frames trained while the window was
//! closed, only the fact that they were trained is known.

use super::state::{Opened, Snapshot};
use crate::eval::report::{FrameReport, SkippedFrame};
use crate::pipeline::plan::Plan;
use crate::train::outcome::{OutlierReason, PhotographOutcome};
use std::collections::HashMap;
use std::sync::Arc;

#[derive(Clone, Debug, PartialEq)]
pub enum FrameState {
    NotInRun,
    /// The frame is not yet trained; the number is its position in the training order.
    Pending(usize),
    /// The frame is trained. Holds its position in the training order, and its metrics if the window
    /// received them.
    Trained(usize, Option<TrainedFrame>),
    Skipped(String),
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrainedFrame {
    pub points: usize,
    /// Mean ELBO of the frame's points, nats.
    pub elbo_mean: f64,
    /// PSNR between the frame's photograph and the scene before training on the frame, dB. `None` if it was
    /// not measured.
    pub psnr_before: Option<f64>,
}

impl From<&FrameReport> for TrainedFrame {
    fn from(report: &FrameReport) -> Self {
        // If the frame's points contradict the scene, its difference does not measure the photograph.
        let is_of_photograph = |photo: &PhotographOutcome| {
            matches!(photo.contradiction, None | Some(OutlierReason::Picture))
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

#[derive(Default)]
pub struct FrameOutcomes {
    serial: u64,
    plan: Option<Arc<Plan>>,
    /// Position at which each frame first occurs in the training order, by the frame's index in the trained
    /// split.
    // Later passes over the data use the same frames again.
    positions: HashMap<usize, usize>,
    outcomes: HashMap<usize, TrainedFrame>,
    recent: Arc<Vec<FrameReport>>,
    late: Arc<Vec<FrameReport>>,
    /// Number of processed frames. Frames at lower positions in the training order are trained or skipped.
    n_processed: usize,
    skipped: Arc<Vec<SkippedFrame>>,
    /// Index into `skipped` of each skipped frame, by frame name.
    skipped_index: HashMap<String, usize>,
}

impl FrameOutcomes {
    pub fn update(&mut self, snapshot: &Snapshot) {
        let Some(opened) = &snapshot.opened else { return };
        if self.serial != opened.serial {
            *self = Self { serial: opened.serial, ..Self::default() };
        }
        self.update_plan(opened);
        let outcome = |report: &FrameReport| (report.index, TrainedFrame::from(report));
        let reports =
            [(&mut self.recent, &snapshot.frames.recent), (&mut self.late, &snapshot.frames.late)];
        for (known, new) in reports.into_iter().filter(|(known, new)| !Arc::ptr_eq(known, new)) {
            known.clone_from(new);
            // Known frames too: a photograph in the shuffle buffer is trained on some frames later.
            self.outcomes.extend(new.iter().map(outcome));
        }
        self.n_processed = self.recent.last().map_or(self.n_processed, |newest| newest.index + 1);
        if !Arc::ptr_eq(&self.skipped, &snapshot.frames.skipped) {
            self.skipped = snapshot.frames.skipped.clone();
            let named = self.skipped.iter().enumerate();
            self.skipped_index = named.map(|(i, skipped)| (skipped.frame.clone(), i)).collect();
        }
    }

    fn update_plan(&mut self, opened: &Opened) {
        // A followed recording gains frames and gets a new plan.
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

    /// Returns the state of the frame with index `index` in split number `split`. `name` is the frame's
    /// name.
    pub fn state_of(&self, (split, index): (usize, usize), name: &str) -> FrameState {
        let Some(position) = self.position_of((split, index)) else { return FrameState::NotInRun };
        match (self.outcomes.get(&position), self.skipped_index.get(name)) {
            (Some(&outcome), _) => FrameState::Trained(position, Some(outcome)),
            (None, Some(&at)) => FrameState::Skipped(self.skipped[at].message.clone()),
            (None, None) if position < self.n_processed => FrameState::Trained(position, None),
            (None, None) => FrameState::Pending(position),
        }
    }

    /// Returns the position of a frame in the training order; `None` if it is not part of the run.
    fn position_of(&self, (split, index): (usize, usize)) -> Option<usize> {
        let is_trained = self.plan.as_ref().is_some_and(|plan| plan.split == split);
        self.positions.get(&index).copied().filter(|_| is_trained)
    }

    /// Returns the number of frames that were processed when the frame was; `None` if it was not yet.
    pub fn n_seen_at(&self, frame: (usize, usize)) -> Option<usize> {
        self.position_of(frame).filter(|&at| at < self.n_processed).map(|at| at + 1)
    }

    /// Returns the position of the last processed frame in the training order; `None` if no frame was
    /// processed.
    pub fn latest_position(&self) -> Option<usize> {
        self.n_processed.checked_sub(1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::app::panels::latency::tests::frame;
    use crate::pipeline::plan::{Order, Selection};
    use crate::pipeline::session::{Session, demo_dataset};
    use crate::pipeline::settings::scene::SceneOverrides;

    fn snapshot(selection: Selection) -> Snapshot {
        let dataset = demo_dataset().unwrap();
        let session = Session::new(dataset, SceneOverrides::default(), selection).unwrap();
        let opened = crate::app::opening::session(session, 1, None).opened;
        Snapshot { opened: Some(Arc::new(opened)), ..Snapshot::default() }
    }

    fn report(index: usize) -> FrameReport {
        FrameReport { index, ..frame(1.0) }
    }

    #[test]
    fn frames_are_ahead_then_trained_or_skipped_and_others_are_not_taken() {
        let mut snapshot = snapshot(Selection { stride: 2, ..Selection::all_frames() });
        let opened = snapshot.opened.clone().unwrap();
        let split = opened.plan.as_ref().unwrap().split;
        let name = |index: usize| {
            opened.dataset.as_ref().unwrap().splits[split].frames[index].name.clone()
        };
        let mut known = FrameOutcomes::default();
        known.update(&snapshot);
        assert_eq!(known.state_of((split, 2), &name(2)), FrameState::Pending(1));
        assert_eq!(known.state_of((split, 1), &name(1)), FrameState::NotInRun);
        assert_eq!(known.state_of((split + 1, 2), "other"), FrameState::NotInRun);

        let photograph =
            |difference| Some(PhotographOutcome { difference, usual: 0.1, contradiction: None });
        let first = FrameReport { photograph: photograph(0.1), ..report(1) };
        snapshot.frames.recent = Arc::new(vec![first, report(3)]);
        let why = SkippedFrame { frame: name(4), message: "damaged".into() };
        snapshot.frames.skipped = Arc::new(vec![why]);
        known.update(&snapshot);
        assert_eq!(known.state_of((split, 4), &name(4)), FrameState::Skipped("damaged".into()));
        assert_eq!(known.state_of((split, 0), &name(0)), FrameState::Trained(0, None));
        let FrameState::Trained(1, Some(outcome)) = known.state_of((split, 2), &name(2)) else {
            panic!("trained");
        };
        assert!((outcome.psnr_before.unwrap() - 20.0).abs() < 1e-9);
        assert_eq!(known.latest_position(), Some(3));

        // Another run starts without any states.
        let mut again = Opened::clone(&opened);
        again.serial = 2;
        let again = Snapshot { opened: Some(Arc::new(again)), ..Snapshot::default() };
        known.update(&again);
        assert_eq!(known.state_of((split, 2), &name(2)), FrameState::Pending(1));
        assert_eq!(known.latest_position(), None);
    }

    #[test]
    fn a_shuffled_run_tells_the_place_of_a_frame_in_its_order() {
        let snapshot = snapshot(Selection { order: Order::Shuffled, ..Selection::all_frames() });
        let plan = snapshot.opened.as_ref().unwrap().plan.clone().unwrap();
        let mut known = FrameOutcomes::default();
        known.update(&snapshot);
        for (position, &frame) in plan.frames.iter().enumerate().step_by(7) {
            assert_eq!(known.state_of((plan.split, frame), ""), FrameState::Pending(position));
        }
    }
}
