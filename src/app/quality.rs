//! Quality of held-out views, measured during training.
//!
//! A separate thread measures its own copy of the splats (as in `viewer/photo.rs`). During training it
//! measures a few views repeatedly; pauses of a multiple of the measuring time leave the cores to training.
//! While training is paused or finished, every view is measured once, then the views away from the camera
//! path, then the stored copies of earlier scenes, for which training left no time. The metrics are those of
//! `vbgs-studio eval`.

use super::edit::past::PastScene;
use super::retention::{Retention, positions, put};
use super::splat_updates::SplatChange;
use super::state::{Opened, RunState, Snapshot};
use super::view_thread::{Announce, REST, ViewThread, one_thread};
use super::worker::Waker;
use crate::dataset::Dataset;
use crate::dataset::splits::{Evaluation, HoldOut, ViewGroup};
use crate::eval::choices::{GroundTruth, ViewPoses};
use crate::eval::metrics::mean_std;
use crate::eval::near::{NearRule, near_plane};
use crate::eval::report::{Detail, QualityCurves, QualityPoint, ViewReport};
use crate::eval::views::{EvalOptions, evaluate};
use crate::math::camera::Camera;
use crate::model::splat::appearance::SplatSet;
use crate::pipeline::panic_report::PanicReport;
use crate::pipeline::plan::Plan;
use crate::pipeline::settings::method::Method;
use crate::render::{RenderMethod, RenderOptions};
use eframe::egui::Context;
use std::collections::BTreeSet;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Number of held-out views that are measured repeatedly during training.
const SAMPLED: usize = 3;
/// Maximum number of evenly spaced views that are measured while training is paused.
// As in the paper's protocol.
const MAX_VIEWS: usize = 100;
/// Minimum pause between two measurements during training.
const MIN_REST: Duration = Duration::from_millis(500);
/// Pause of measurements after a movement of the camera.
const HELD: Duration = Duration::from_millis(400);

pub struct QualityMonitor {
    waker: Waker,
    thread: Option<ViewThread<QualityQuery, QualityAnswer>>,
    /// Serial number of the open dataset or model, and options of its measurements.
    subject: Option<(u64, EvalOptions)>,
    /// Views to measure; `None` for models.
    pub evaluation: Option<Evaluation>,
    /// Mean metrics over the sampled views, oldest first.
    pub history: Vec<QualityPoint>,
    /// True if the curves differ from those taken last.
    has_new_curves: bool,
    /// True if the newest scene includes all photographs that wait in the shuffle buffer.
    settled: bool,
    /// Latest report of each view, worst first. A report of an earlier scene remains until the view is
    /// measured again.
    pub views: Vec<ViewReport>,
    measured_at: Option<usize>,
    n_measured: usize,
    /// Reports of views away from the camera path, for the scene after `side_at` frames.
    side: Vec<ViewReport>,
    side_at: Option<usize>,
    /// Number of trained frames if training is paused or finished.
    at_rest: Option<usize>,
    pub problem: Option<String>,
    pub retention: Retention,
    /// Numbers of frames of the earlier scenes that were measured, each for quality and for retention.
    past_measured: BTreeSet<(usize, QualityPurpose)>,
    rest_until: Instant,
    held_until: Instant,
}

impl QualityMonitor {
    pub fn new(waker: Waker) -> Self {
        Self {
            waker,
            thread: None,
            subject: None,
            evaluation: None,
            history: Vec::new(),
            has_new_curves: false,
            views: Vec::new(),
            settled: false,
            measured_at: None,
            n_measured: 0,
            side: Vec::new(),
            side_at: None,
            at_rest: None,
            problem: None,
            retention: Retention::default(),
            past_measured: BTreeSet::new(),
            rest_until: Instant::now(),
            held_until: Instant::now(),
        }
    }

    /// Starts no measurement for a moment, because the camera moves and its pictures need the cores.
    pub fn hold(&mut self, context: &Context) {
        self.held_until = Instant::now() + HELD;
        // An idle window draws no pass that would notice the end of the pause.
        context.request_repaint_after(HELD);
    }

    /// True if a measurement may start.
    fn is_ready(&self) -> bool {
        // A measurement that failed would fail again in every pass. The answer of a running one wakes the
        // window, which tries again.
        let is_busy = self.thread.as_ref().is_some_and(ViewThread::is_busy);
        !is_busy && self.problem.is_none() && Instant::now() >= self.held_until
    }

    /// Returns the number of measured views of the current scene, and the number of views to measure.
    pub fn progress(&self) -> (usize, usize) {
        (self.n_measured, self.chosen(MAX_VIEWS).len())
    }

    /// Returns the mean metrics over all views, once all are measured while training is paused or
    /// finished.
    pub fn result(&self) -> Option<QualityPoint> {
        let (done, all) = self.progress();
        let is_new = |at: &&QualityPoint| {
            self.at_rest == Some(at.frames) && Some(at.frames) == self.measured_at
        };
        let at = self.history.last().filter(is_new)?;
        (all > 0 && done == all)
            .then(|| mean_quality(&self.views, (at.frames, at.seconds, at.components)))?
    }

    /// Returns the number of views away from the camera path that were measured in the scene after `frames`
    /// frames, and the number of such views to measure.
    pub fn side_progress(&self, frames: usize) -> (usize, usize) {
        let n_measured = if self.side_at == Some(frames) { self.side.len() } else { 0 };
        (n_measured, self.chosen_side().len())
    }

    /// Returns the mean metrics over the views away from the camera path. `None` until all are measured
    /// while training is paused or finished.
    pub fn side_result(&self) -> Option<QualityPoint> {
        let frames = self.at_rest?;
        let (done, all) = self.side_progress(frames);
        let at =
            self.history.last().map_or((frames, 0.0, 0), |p| (frames, p.seconds, p.components));
        (done == all).then(|| mean_quality(&self.side, at))?
    }

    /// Returns the curves of the subject with this serial number, if they have changed since the last call.
    pub fn take_new_curves(&mut self) -> Option<(u64, QualityCurves)> {
        let (serial, options) = self.subject?;
        std::mem::take(&mut self.has_new_curves).then(|| {
            let renderer = Some(options.render.method.renderer());
            let (quality, retention) = (self.history.clone(), self.retention.frames.clone());
            (serial, QualityCurves { renderer, quality, retention })
        })
    }

    pub fn change(&self, change: &SplatChange) {
        if let Some(thread) = &self.thread {
            thread.change(change.clone());
        }
    }

    /// Starts a measurement if one is due. During training, one is due when `every` frames have been
    /// trained since the last one.
    pub fn update(
        &mut self,
        context: &Context,
        snapshot: &Snapshot,
        method: RenderMethod,
        every: Option<usize>,
        (splats, past): (&Arc<SplatSet>, &[PastScene]),
    ) {
        let Some(opened) = &snapshot.opened else { return };
        self.set_subject(opened, method, &snapshot.curves);
        // The scene differs after the same number of frames: pending photographs were included at rest,
        // or a frame could not be placed.
        let is_other =
            snapshot.includes_pending_photographs || self.measured_at == Some(snapshot.frames_done);
        if snapshot.includes_pending_photographs != self.settled && is_other {
            (self.measured_at, self.side_at) = (None, None);
            self.retention.invalidate();
        }
        self.settled = snapshot.includes_pending_photographs;
        self.take_answer();
        let rests = snapshot.state.is_at_rest();
        self.at_rest = rests.then_some(snapshot.frames_done);
        if let Some((purpose, views)) = self.next_measurement(context, snapshot, every) {
            self.request_measurement(opened, snapshot, (purpose, views, None), splats);
        } else if rests
            && let Some((purpose, views, scene)) = self.next_past(opened, snapshot, past)
        {
            self.past_measured.insert((scene.after.n_seen, purpose));
            self.request_measurement(opened, snapshot, (purpose, views, Some(scene)), splats);
        }
    }

    fn set_subject(&mut self, opened: &Opened, method: RenderMethod, known: &QualityCurves) {
        // The default background of `eval`, whose figures these must equal.
        let black = [0.0; 3];
        let render = RenderOptions::evaluation(method, black);
        let options = EvalOptions {
            color_camera: opened.color_camera(),
            // As in all comparisons with photographs; a frame without a correction has its recorded pose.
            poses: ViewPoses::Corrected,
            ..EvalOptions::plain(GroundTruth::Composited, render)
        };
        if self.subject != Some((opened.serial, options)) {
            // The thread retains its copy of the splats for other options of the same subject.
            let is_same = self.subject.is_some_and(|(serial, _)| serial == opened.serial);
            let thread = self.thread.take().filter(|_| is_same);
            let subject = Some((opened.serial, options));
            *self = Self { thread, subject, ..Self::new(self.waker.clone()) };
            if known.renderer == Some(method.renderer()) {
                for point in &known.quality {
                    put(&mut self.history, *point, |known| known.frames as f64);
                }
                self.retention = Retention::restored(&known.retention);
            }
        }
        let hold_out = opened.selection.as_ref().map_or_else(HoldOut::default, |s| s.hold_out);
        // In every pass, because a followed recording gains views; a held-out sector never changes.
        if hold_out == HoldOut::Every8th || self.evaluation.is_none() {
            let of = opened.dataset.as_ref().zip(opened.plan.as_ref());
            let found = of.map(|(dataset, plan)| dataset.evaluation_by(hold_out, plan.split));
            self.evaluation = found.and_then(Result::ok);
        }
    }

    /// Adds the mean metrics over `views` to the history, in place of an earlier measurement of the same
    /// scene. `at` is as of [`mean_quality`].
    fn add_point(&mut self, views: &[ViewReport], at: (usize, f64, usize)) {
        let Some(point) = mean_quality(views, at) else { return };
        put(&mut self.history, point, |known| known.frames as f64);
        self.has_new_curves = true;
    }

    fn take_answer(&mut self) {
        let Some(answer) = self.thread.as_ref().and_then(ViewThread::take) else { return };
        let (query, scores, took) = answer;
        // An answer that is discarded took cores from training too.
        self.rest_until = Instant::now() + (took * REST).max(MIN_REST);
        let is_current = self.subject.is_some_and(|(_, options)| options == query.options);
        // Otherwise it belongs to other settings, or to a scene without the pending photographs.
        if !is_current || self.settled != query.settled {
            return;
        }
        let scores = match scores {
            Ok(scores) => scores,
            Err(problem) => return self.problem = Some(problem),
        };
        self.problem = None;
        let frames = query.at.0;
        match query.purpose {
            QualityPurpose::HeldOut if query.scene.is_some() => self.add_point(&scores, query.at),
            QualityPurpose::Retention => {
                let psnr = |view| scores.iter().find(|s| s.index == view).map(|s| s.psnr);
                let followed = positions(query.at.0).into_iter().zip(query.views);
                let known = followed.filter_map(|(position, view)| Some((position, psnr(view)?)));
                self.has_new_curves = true;
                match query.scene {
                    Some(_) => self.retention.insert(frames, known),
                    None => self.retention.add_measurements(frames, known),
                }
            }
            QualityPurpose::FromTheSide => {
                if self.side_at != Some(query.at.0) {
                    self.side_at = Some(query.at.0);
                    self.side.clear();
                }
                self.side.extend(scores);
            }
            QualityPurpose::HeldOut => {
                if Some(query.at.0) != self.measured_at {
                    (self.measured_at, self.n_measured) = (Some(query.at.0), 0);
                }
                // The sampled views are measured first, so that all points compare the same views.
                if self.n_measured == 0 {
                    self.add_point(&scores, query.at);
                }
                self.n_measured += query.views.len();
                self.views.retain(|known| scores.iter().all(|new| new.index != known.index));
                self.views.extend(scores);
                self.views.sort_by(|a, b| a.psnr.total_cmp(&b.psnr));
            }
        }
    }

    /// Returns the purpose and the views of the next measurement, if one is due.
    fn next_measurement(
        &self,
        context: &Context,
        snapshot: &Snapshot,
        every: Option<usize>,
    ) -> Option<(QualityPurpose, Vec<usize>)> {
        let frames = snapshot.frames_done;
        if frames == 0 || !self.is_ready() {
            return None;
        }
        let is_new = self.history.is_empty() || Some(frames) != self.measured_at;
        let sample = self.chosen(SAMPLED);
        let due = match snapshot.state {
            RunState::Training => {
                let since = self.measured_at.map_or(usize::MAX, |at| frames.saturating_sub(at));
                let is_due = self.history.is_empty() || since >= every?;
                let retained = || self.retained(snapshot).filter(|_| !self.history.is_empty());
                // Alternately: the retention of earlier frames, then the quality again.
                let next = match is_due {
                    true => Some((QualityPurpose::HeldOut, sample)),
                    false => retained().map(|views| (QualityPurpose::Retention, views)),
                };
                let rest = self.rest_until.saturating_duration_since(Instant::now());
                // An idle window draws no pass that would notice the end of the rest.
                if next.is_some() && !rest.is_zero() {
                    context.request_repaint_after(rest);
                }
                next.filter(|_| rest.is_zero())
            }
            state if state.is_at_rest() && is_new => Some((QualityPurpose::HeldOut, sample)),
            state if state.is_at_rest() => {
                let mut others = self.chosen(MAX_VIEWS).into_iter().filter(|v| !sample.contains(v));
                let next = others.nth(self.n_measured.saturating_sub(sample.len()));
                let next = next.map(|view| (QualityPurpose::HeldOut, vec![view]));
                let retained = || Some((QualityPurpose::Retention, self.retained(snapshot)?));
                let (n_measured, _) = self.side_progress(frames);
                let side = || Some(vec![*self.chosen_side().get(n_measured)?]);
                let side = || side().map(|views| (QualityPurpose::FromTheSide, views));
                next.or_else(side).or_else(retained)
            }
            _ => None,
        };
        due.filter(|(_, views)| !views.is_empty())
    }

    /// Returns the next measurement of an earlier scene: the sampled views, or the trained frames of that
    /// time. Measured after everything else.
    fn next_past<'a>(
        &self,
        opened: &Opened,
        snapshot: &Snapshot,
        past: &'a [PastScene],
    ) -> Option<(QualityPurpose, Vec<usize>, &'a PastScene)> {
        let (done, all) = self.progress();
        if !self.is_ready() || done < all {
            return None;
        }
        let earlier = past.iter().filter(|scene| scene.after.n_seen < snapshot.n_seen());
        let both = earlier.flat_map(|scene| {
            [QualityPurpose::HeldOut, QualityPurpose::Retention].map(|purpose| (purpose, scene))
        });
        let plan = opened.plan.as_ref()?;
        let new = both.filter(|(purpose, scene)| {
            !self.past_measured.contains(&(scene.after.n_seen, *purpose))
        });
        let mut new = new.map(|(purpose, scene)| {
            let views = match purpose {
                QualityPurpose::Retention => trained_frames(plan, scene.after.n_trained),
                _ => self.chosen(SAMPLED),
            };
            (purpose, views, scene)
        });
        new.find(|(_, views, _)| !views.is_empty())
    }

    /// Returns the trained frames to measure again, if such a measurement is due. They are measured once
    /// while training is paused, and during training after every measurement of the held-out views.
    fn retained(&self, snapshot: &Snapshot) -> Option<Vec<usize>> {
        let plan = snapshot.opened.as_ref()?.plan.as_ref()?;
        let is_due = match snapshot.state {
            RunState::Training => self.retention.measured_before(self.measured_at?),
            _ => self.retention.measured_before(snapshot.frames_done),
        };
        is_due.then(|| trained_frames(plan, snapshot.frames_done))
    }

    fn chosen(&self, most: usize) -> Vec<usize> {
        evenly(self.evaluation.as_ref().map(|evaluation| &evaluation.new_views), most)
    }

    fn chosen_side(&self) -> Vec<usize> {
        evenly(self.side_group(), MAX_VIEWS)
    }

    fn side_group(&self) -> Option<&ViewGroup> {
        self.evaluation.as_ref()?.from_the_side.first()
    }

    fn request_measurement(
        &mut self,
        opened: &Opened,
        snapshot: &Snapshot,
        (purpose, views, past): (QualityPurpose, Vec<usize>, Option<&PastScene>),
        splats: &Arc<SplatSet>,
    ) {
        let (Some(dataset), Some(evaluation), Some((_, options))) =
            (&opened.dataset, &self.evaluation, self.subject)
        else {
            return;
        };
        let split = match (purpose, &opened.plan) {
            (QualityPurpose::Retention, Some(plan)) => plan.split,
            (QualityPurpose::FromTheSide, _) => self.side_group().map_or(0, |group| group.split),
            _ => evaluation.new_views.split,
        };
        let query = QualityQuery {
            dataset: dataset.clone(),
            split,
            all: match purpose {
                QualityPurpose::HeldOut => self.chosen(MAX_VIEWS),
                QualityPurpose::FromTheSide => self.chosen_side(),
                QualityPurpose::Retention => views.clone(),
            },
            purpose,
            views,
            options,
            near_rule: NearRule::of(opened.method.as_ref().map(Method::preset)),
            at: match past {
                Some(scene) => (scene.after.n_trained, scene.after.seconds, scene.n_splats),
                None => (snapshot.frames_done, snapshot.pace.trained_s, snapshot.model.used),
            },
            scene: past.cloned(),
            settled: snapshot.includes_pending_photographs,
        };
        if self.thread.is_none() {
            match start(self.waker.clone()) {
                Ok(thread) => {
                    thread.change(SplatChange::All(splats.clone()));
                    self.thread = Some(thread);
                }
                Err(error) => {
                    self.problem = Some(format!("starting the measuring thread failed: {error}"));
                }
            }
        }
        if let Some(thread) = &self.thread {
            thread.send_request(query, Announce::Wake);
        }
    }
}

/// Returns the frames that are measured for retention after `frames_done` frames.
fn trained_frames(plan: &Plan, frames_done: usize) -> Vec<usize> {
    let frame = |position: usize| plan.frames.get(position).copied();
    positions(frames_done).into_iter().map_while(frame).collect()
}

/// Returns at most `most` views of a group, evenly spaced.
fn evenly(group: Option<&ViewGroup>, most: usize) -> Vec<usize> {
    let all = group.map_or(&[][..], |group| &group.frames);
    let n = all.len().min(most);
    // The middle of each part, because the ends of a recording are seldom typical.
    (0..n).map(|i| all[(2 * i + 1) * all.len() / (2 * n)]).collect()
}

/// Returns the mean metrics over `views`; `None` if there are no views. `at` contains the number of frames,
/// the seconds of training and the number of components.
fn mean_quality(views: &[ViewReport], at: (usize, f64, usize)) -> Option<QualityPoint> {
    let mean = |value: &dyn Fn(&ViewReport) -> Option<f64>| {
        let values: Vec<f64> = views.iter().filter_map(value).collect();
        (!values.is_empty()).then(|| mean_std(&values).0)
    };
    let (frames, seconds, components) = at;
    Some(QualityPoint {
        frames,
        seconds,
        components,
        psnr: mean(&|view| Some(view.psnr))?,
        covered: mean(&|view| view.psnr_covered).zip(mean(&|view| Some(view.coverage))),
        ssim: mean(&|view| Some(view.ssim))?,
        detail: Detail::mean(views),
        depth_error: mean(&|view| view.depth_mae),
    })
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum QualityPurpose {
    HeldOut,
    /// Measures views away from the camera path.
    FromTheSide,
    Retention,
}

#[derive(Clone)]
struct QualityQuery {
    purpose: QualityPurpose,
    dataset: Arc<Dataset>,
    split: usize,
    views: Vec<usize>,
    /// All views that are measured with the same near plane, including those in `views`.
    all: Vec<usize>,
    options: EvalOptions,
    near_rule: NearRule,
    /// Number of frames, seconds of training and number of components at the time of the query.
    at: (usize, f64, usize),
    /// Earlier scene to measure; `None` is the newest one.
    scene: Option<PastScene>,
    settled: bool,
}

impl QualityQuery {
    fn options_for(&self, splats: &SplatSet) -> EvalOptions {
        let frames = &self.dataset.splits[self.split].frames;
        let cameras: Vec<Camera> = self.all.iter().map(|&view| frames[view].camera).collect();
        let near = near_plane(splats.view(), &cameras, self.near_rule);
        EvalOptions { render: RenderOptions { near, ..self.options.render }, ..self.options }
    }
}

/// Query, the metrics of its views or the reason why the measurement failed, and the measuring time.
type QualityAnswer = (QualityQuery, Result<Vec<ViewReport>, String>, Duration);

fn start(waker: Waker) -> std::io::Result<ViewThread<QualityQuery, QualityAnswer>> {
    // In rayon's global pool measuring would use every core, including those of training.
    let alone = one_thread()?;
    ViewThread::start("quality", waker, move |splats: &SplatSet, query: QualityQuery| {
        let started = Instant::now();
        let QualityQuery { dataset, split, views, scene, .. } = &query;
        let scores = catch_measurement(|| {
            let read = |scene: &PastScene| {
                scene.splats().map_err(|error| format!("a stored scene cannot be read: {error}"))
            };
            let past = scene.as_ref().map(read).transpose()?;
            let splats = past.as_deref().unwrap_or(splats);
            let options = query.options_for(splats);
            let measure = || evaluate(splats, dataset, *split, views, &options, |_| {});
            let (_, scores) = alone.install(measure).map_err(|error| error.to_string())?;
            Ok(scores)
        });
        (query, scores, started.elapsed())
    })
}

/// Runs `measure` and returns its metrics, or the reason why it failed. A panic is also treated as a
/// failure.
fn catch_measurement(
    measure: impl FnOnce() -> Result<Vec<ViewReport>, String>,
) -> Result<Vec<ViewReport>, String> {
    // Otherwise a panic would close the window. No state of the measurement outlives it.
    catch_unwind(AssertUnwindSafe(measure)).unwrap_or_else(|panic| {
        Err(PanicReport::of(&*panic).failure_notice("measuring the quality"))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn held_out(n: usize) -> QualityMonitor {
        let evaluation = Evaluation {
            new_views: ViewGroup { name: None, split: 0, frames: (100..100 + n).collect() },
            from_the_side: Vec::new(),
            training: None,
            why: "".into(),
        };
        QualityMonitor { evaluation: Some(evaluation), ..QualityMonitor::new(Arc::new(|| {})) }
    }

    #[test]
    fn views_are_chosen_evenly_and_once() {
        assert_eq!(held_out(1).chosen(3), [100]);
        assert_eq!(held_out(12).chosen(3), [102, 106, 110]);
        let all = held_out(250).chosen(MAX_VIEWS);
        assert_eq!(all.len(), MAX_VIEWS);
        assert!(all.windows(2).all(|pair| pair[0] < pair[1]));
        assert!(held_out(0).chosen(3).is_empty());
    }

    #[test]
    fn a_panic_of_measuring_is_a_problem_that_is_told() {
        let problem = catch_measurement(|| panic!("injected into measuring")).unwrap_err();
        for part in ["injected into measuring", "the quality", "report it"] {
            assert!(problem.contains(part), "{part:?} is missing in: {problem}");
        }
        assert_eq!(catch_measurement(|| Ok(Vec::new())).unwrap().len(), 0);
    }
}
