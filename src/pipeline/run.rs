//! Settings of a run.

use super::plan::Selection;
use super::session::Session;
use super::settings::method::Method;
use crate::dataset::range::PositionRange;
use crate::dataset::unproject::{CameraConvention, EdgeFilter};
use crate::dataset::{Dataset, LoadOptions};
use crate::eval::report;
use crate::eval::report::{
    DatasetReport, EvalReport, FrameReport, QualityCurves, REPORT_FORMAT, Report, SkippedFrame,
    Summary,
};
use crate::export::registration::Registration;
use crate::model::attributes::ComponentAttributes;
use crate::model::inspection::Inspection;
use crate::train::learner::{Component, Status};
use crate::train::outcome::ComparedPhotograph;
use serde::{Deserialize, Serialize};

/// Every setting that affects a run, for reports and checkpoints.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RunConfig {
    /// Settings of the model.
    #[serde(flatten)]
    pub method: Method,
    /// Selection and order of the frames.
    #[serde(flatten)]
    pub selection: Selection,
    /// Options for reading depth files.
    #[serde(flatten)]
    pub load: LoadOptions,
    /// Convention by which pixels become viewing rays.
    pub camera_convention: CameraConvention,
    /// Treatment of mixed pixels, which average foreground and background.
    pub edge_filter: EdgeFilter,
    /// Low and high corner of the range of positions used for normalisation, in world units.
    pub position_range: [[f64; 3]; 2],
    /// Description of the source of `position_range`.
    pub position_range_source: String,
}

impl RunConfig {
    /// Returns the settings of a run on a dataset with positions in `range`.
    pub fn new(
        dataset: &Dataset,
        method: Method,
        selection: Selection,
        range: &PositionRange,
    ) -> Self {
        Self {
            load: dataset.options,
            camera_convention: method.as_any().camera_convention(dataset.layout),
            edge_filter: EdgeFilter::DropMixed,
            position_range: [range.lo().to_array(), range.hi().to_array()],
            position_range_source: range.source.clone(),
            method,
            selection,
        }
    }

    /// Returns the settings of the run over all shards.
    pub fn without_shard(&self) -> Self {
        Self { selection: self.selection.without_shard(), ..self.clone() }
    }
}

impl Session {
    /// Returns the attributes of the listed components, for false-colour views.
    pub fn attributes_of(&self, ids: &[u32]) -> Vec<ComponentAttributes> {
        ids.iter().map(|&id| self.attributes(id as usize)).collect()
    }

    fn attributes(&self, component: usize) -> ComponentAttributes {
        let engine = self.learner();
        let elbo = engine.last_frame().component_elbo.mean_elbo_of(component);
        let Component { posterior, photometric_deviations, .. } = engine.component(component);
        let birth = self.birth_of(component);
        let elbo = elbo.map(|(mean, _)| mean);
        ComponentAttributes::new(&posterior, self.normalization(), elbo, birth)
            .with_photometric_uncertainty(photometric_deviations)
    }

    /// Returns the data of a component for inspection; `None` if `id` is out of range.
    pub fn inspect(&self, id: u32) -> Option<Inspection> {
        let component = id as usize;
        let components = self.learner().status().components;
        if component >= components {
            return None;
        }
        let Component { posterior, photometric_deviations, .. } =
            self.learner().component(component);
        // The responsibilities of a point sum to 1, so the counts sum to the number of points.
        let alpha0 = posterior.alpha - posterior.count;
        let total = alpha0 * components as f64 + self.points() as f64;
        let (attributes, splats) = (self.attributes(component), self.splats_of(&[id]));
        let splat = (splats[0], splats.appearance_of(0));
        let inspection =
            Inspection::new(id, posterior, total, attributes, splat, self.normalization());
        Some(Inspection { photometric_deviations, ..inspection })
    }

    /// Returns the reports of the frames whose photographs the last step compared with the scene. Frames
    /// without a report, for example those before a resume, are omitted.
    pub fn compared_frames(&self) -> impl Iterator<Item = &FrameReport> {
        let (past, n_learned) = (self.past(), self.learner().status().frames);
        let compared = self.learner().last_frame().compared_photographs.iter();
        compared
            .filter_map(move |compared| past.frames.get(past.report_index(n_learned, compared)?))
    }

    /// Returns the report of the run so far. `adapter` is the name of the graphics adapter used for
    /// rendering, if any.
    pub fn report(&self, adapter: Option<String>, eval: Vec<EvalReport>) -> Report<RunConfig> {
        let (dataset, plan, past) = (self.dataset(), self.plan(), self.past());
        let split = &dataset.splits[plan.split];
        let first = plan.frames.first().map(|&i| split.frames[i].camera.intrinsics);
        let path = dataset.path.as_ref();
        let devices = self.learner().device_use();
        let Status { components, used, .. } = self.learner().status();
        Report {
            format: REPORT_FORMAT,
            dataset: DatasetReport {
                path: path.map_or_else(|| dataset.name.clone(), |p| p.display().to_string()),
                layout: dataset.layout.name().to_owned(),
                split: split.name.clone(),
                frames: plan.frames.len(),
                width: first.map_or(0, |k| k.width),
                height: first.map_or(0, |k| k.height),
            },
            config: self.config().clone(),
            machine: report::describe(adapter),
            frames: past.frames.clone(),
            skipped: past.skipped.clone(),
            summary: Summary {
                components,
                used,
                drawn: self.splats().iter().filter(|splat| splat.opacity > 0.0).count(),
                model_bytes: self.learner().memory().bytes,
                peak_rss_bytes: report::peak_rss_bytes(),
                ..Summary::of_frames(&past.frames, past.wall_s)
            },
            eval,
            seen: Vec::new(),
            tracking: None,
            comparer: devices.photographs,
            passes: devices.passes,
            points: devices.points,
        }
    }
}

/// Progress and frame reports of a run so far.
#[derive(Clone)]
pub(super) struct RunProgress {
    /// Number of visited positions of the plan.
    pub visited: usize,
    /// Number of points trained on; each counts as often as the pixels that it represents.
    pub points: u64,
    /// Reports of the trained frames. Those before a resume are missing if the checkpoint has no history.
    pub frames: Vec<FrameReport>,
    pub skipped: Vec<SkippedFrame>,
    pub curves: QualityCurves,
    /// Registration of the run's world.
    pub registration: Option<Registration>,
    /// Training time in seconds.
    pub wall_s: f64,
}

impl RunProgress {
    /// Returns the progress of a new run. Frames rejected when the dataset was opened count as skipped.
    pub fn at_start(dataset: &Dataset, split: usize) -> Self {
        let name = &dataset.splits[split].name;
        let refused = dataset.warnings.iter().filter(|w| w.split == *name);
        Self {
            visited: 0,
            points: 0,
            frames: Vec::new(),
            skipped: refused.map(|w| SkippedFrame::from(&*w.error)).collect(),
            curves: QualityCurves::default(),
            registration: None,
            wall_s: 0.0,
        }
    }

    /// Stores the comparison of a photograph with the scene in its frame's report. `n_learned` is the
    /// number of trained frames. Returns a warning if the frame is a new outlier.
    pub fn record_comparison(
        &mut self,
        n_learned: u64,
        compared: &ComparedPhotograph,
    ) -> Option<String> {
        let at = self.report_index(n_learned, compared)?;
        let report = self.frames.get_mut(at)?;
        // A photograph may be compared repeatedly, but an outlier is reported once.
        let is_reported = report.outlier_warning().is_some();
        report.photograph = Some(compared.outcome);
        report.outlier_warning().filter(|_| !is_reported)
    }

    fn report_index(&self, n_learned: u64, compared: &ComparedPhotograph) -> Option<usize> {
        // The reports of the first frames of a resumed run may be unknown.
        let n_before = n_learned.checked_sub(self.frames.len() as u64)?;
        usize::try_from(compared.frame.checked_sub(n_before)?).ok()
    }
}
