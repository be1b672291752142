//! Preview of an export: the scene as the file would reproduce it.
//!
//! The exporter's own writer and reader write the file to memory and read it back, on a separate thread.
//! So the preview shows exactly what the file holds. The loss is measured as PSNR between renders of
//! scene and file at the current view.

use super::comparison::ComparedModel;
use super::frame_refs::fit;
use super::photo::PictureRequest;
use crate::app::edit::marks::LeftOut;
use crate::app::export_options::losses;
use crate::app::view_thread::{one_thread, run_in, take_finished};
use crate::app::worker::Waker;
use crate::eval::metrics::psnr;
use crate::export::mapping::Mapping;
use crate::export::{Fault, ModelFormat, SpzVersion, WriteOptions, WriteProgress, read_back};
use crate::math::camera::Camera;
use crate::model::splat::appearance::SplatSet;
use crate::model::splat::framing::framing;
use crate::pipeline::job::{Job, Progress};
use crate::render::cpu::CpuRenderer;
use crate::render::{DisplayStyle, Paint, RenderOptions};
use glam::DVec3;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Maximum width of the two renders compared by PSNR, pixels.
// Small, because both are rendered on the CPU whenever the view rests.
const MEASURED_WIDTH: u32 = 480;
/// Minimum time between two conversions during training.
const INTERVAL: Duration = Duration::from_secs(3);

#[derive(Clone, Debug, PartialEq)]
pub struct ExportChoice {
    pub format: ModelFormat,
    pub mapping: Mapping,
    pub spz_version: SpzVersion,
    pub left_out: LeftOut,
}

#[derive(Clone, Debug, PartialEq)]
pub enum PreviewReport {
    Converting,
    Refused(String),
    Shown {
        n_splats: usize,
        /// Size of the file without comments, bytes.
        bytes: u64,
        /// PSNR between renders of file and scene from the current camera, dB; `None` until measured.
        psnr: Option<f64>,
        losses: Vec<String>,
    },
}

struct Converted {
    /// Scene that was converted, without the splats that edits exclude.
    scene: Arc<SplatSet>,
    model: Arc<ComparedModel>,
    bytes: u64,
    losses: Vec<String>,
}

type Measure = (Arc<ComparedModel>, Camera, RenderOptions);

#[derive(Default)]
pub(super) struct ExportPreview {
    choice: Option<ExportChoice>,
    converting: Option<Job<Result<Converted, String>>>,
    converted: Option<Result<Converted, String>>,
    pub is_stale: bool,
    begun_at: Option<Instant>,
    measuring: Option<(Measure, Job<f64>)>,
    measured: Option<(Measure, f64)>,
}

impl ExportPreview {
    /// Returns the model read from the converted file; `None` until converted.
    pub fn model(&self) -> Option<&Arc<ComparedModel>> {
        self.converted.as_ref()?.as_ref().ok().map(|converted| &converted.model)
    }

    pub fn report(&self) -> Option<PreviewReport> {
        self.choice.as_ref()?;
        Some(match &self.converted {
            None => PreviewReport::Converting,
            Some(Err(problem)) => PreviewReport::Refused(problem.clone()),
            Some(Ok(converted)) => PreviewReport::Shown {
                n_splats: converted.model.splats.len(),
                bytes: converted.bytes,
                psnr: self.current_psnr(),
                losses: converted.losses.clone(),
            },
        })
    }

    /// Starts the conversion of the scene, unless it is completed or in progress. `frame` contains the
    /// scene's up direction and local origin.
    pub fn request_conversion(
        &mut self,
        choice: ExportChoice,
        scene: &Arc<SplatSet>,
        frame: (DVec3, DVec3),
        is_training: bool,
        waker: &Waker,
    ) -> std::io::Result<()> {
        let is_new = self.choice.as_ref() != Some(&choice);
        if is_new {
            // Dropping a job cancels it: its file would be of another format or mapping.
            (self.choice, self.converting) = (Some(choice.clone()), None);
            self.is_stale = true;
        }
        // Only then do conversions take cores from training.
        let is_early = self.begun_at.is_some_and(|begun| begun.elapsed() < INTERVAL);
        let waits = self.converting.is_some() || is_training && is_early;
        if !self.is_stale || waits && !is_new {
            return Ok(());
        }
        let aside = is_training.then(one_thread).transpose()?;
        let scene = scene.clone();
        let convert = move |progress: &Progress| {
            let converted = run_in(aside.as_ref(), || convert(scene, &choice, frame, progress));
            converted.map_err(|fault| fault.to_string())
        };
        let job = Job::start_reporting("export preview", waker.clone(), convert)?;
        self.converting = Some(job);
        (self.is_stale, self.begun_at) = (false, Some(Instant::now()));
        Ok(())
    }

    fn current_psnr(&self) -> Option<f64> {
        let (measure, psnr) = self.measured.as_ref()?;
        self.model().filter(|model| Arc::ptr_eq(model, &measure.0)).map(|_| *psnr)
    }

    /// Stores the results of finished conversions and measurements. Returns true if a file is shown for
    /// the first time.
    pub fn take_finished_jobs(&mut self) -> bool {
        let mut is_first = false;
        if let Some(answer) = self.converting.as_ref().and_then(Job::poll) {
            self.converting = None;
            let converted = answer.unwrap_or_else(|panic| Err(panic.failure_notice("the preview")));
            is_first = self.model().is_none() && converted.is_ok();
            self.converted = Some(converted);
        }
        if let Some((measure, figure)) = take_finished(&mut self.measuring) {
            // NaN after a panic, which is logged, so that the measurement is not repeated.
            self.measured = Some((measure, figure.unwrap_or(f64::NAN)));
        }
        is_first
    }

    /// Starts measuring the PSNR of the converted file in a view, unless it is known or being measured.
    pub fn measure(
        &mut self,
        request: &PictureRequest,
        is_training: bool,
        waker: &Waker,
    ) -> std::io::Result<()> {
        let Some(Ok(converted)) = &self.converted else { return Ok(()) };
        let k = &request.camera.intrinsics;
        let width = k.width.clamp(1, MEASURED_WIDTH);
        // In 64 bits, because the product of two sides may exceed 32 bits.
        let height = (u64::from(k.height) * u64::from(width) / u64::from(k.width.max(1))).max(1);
        let (camera, _) = fit(&request.camera, [width, height as u32]);
        // With learned colours, whatever colours are displayed.
        let look = DisplayStyle { paint: Paint::Stored, ..request.options.style };
        let options = RenderOptions { style: look, ..request.options };
        let measure = (converted.model.clone(), camera, options);
        let is_known = |known: &Measure| {
            Arc::ptr_eq(&known.0, &measure.0) && (known.1, &known.2) == (measure.1, &measure.2)
        };
        let is_done = self.measured.as_ref().is_some_and(|(known, _)| is_known(known));
        if is_done || self.measuring.is_some() {
            return Ok(());
        }
        let aside = is_training.then(one_thread).transpose()?;
        let (scene, of) = (converted.scene.clone(), measure.clone());
        // The job owns its reference to the scene and drops it before the result arrives, so that the
        // next change of the splats need not copy them.
        let figure = move || run_in(aside.as_ref(), || psnr_between(&scene, &of));
        let job = Job::start_waking("export figure", waker.clone(), figure)?;
        self.measuring = Some((measure, job));
        Ok(())
    }
}

fn psnr_between(scene: &SplatSet, (model, camera, options): &Measure) -> f64 {
    let mut renderer = CpuRenderer::new();
    let [whole, plain] =
        [scene, &model.splats].map(|splats| renderer.render(splats, camera, options).color);
    // Both renders have the same size, so this cannot fail.
    psnr(&plain, &whole).unwrap_or(f64::NAN)
}

fn convert(
    scene: Arc<SplatSet>,
    choice: &ExportChoice,
    (up, local_origin): (DVec3, DVec3),
    progress: &Progress,
) -> Result<Converted, Fault> {
    let scene = choice.left_out.remaining(scene);
    let is_wanted = |_| progress.is_wanted();
    let options = WriteOptions {
        up,
        local_origin,
        mapping: choice.mapping,
        spz_version: choice.spz_version,
        progress: WriteProgress::new(&is_wanted),
        ..WriteOptions::new(choice.format)
    };
    let file = read_back(scene.view(), &options)?;
    let model = ComparedModel {
        name: format!("As .{} file", choice.format.extension()),
        // A file without splats has no extent, and any near plane draws it.
        radius: framing(file.splats.iter()).map_or(1.0, |framing| framing.radius),
        splats: file.splats,
        local_origin,
        // Already in the axes of the scene.
        defined_up: None,
        is_in_file: true,
    };
    let losses = losses(scene.view(), choice);
    Ok(Converted { scene, model: Arc::new(model), bytes: file.bytes, losses })
}
