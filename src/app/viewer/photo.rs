//! Photographs for comparison, their PSNR and the status of their pixels, computed on a separate
//! thread.

use super::comparison::ComparedModel;
use super::frame_refs::FrameRef;
use super::measure::PixelStatusPainter;
use crate::app::splat_updates::SplatChange;
use crate::app::view_thread::{Announce, ViewThread, one_thread, run_in};
use crate::app::worker::Waker;
use crate::dataset::calibration::ColorCamera;
use crate::dataset::surface::{SurfaceCounts, SurfaceSettings};
use crate::eval::choices::GroundTruth;
use crate::eval::metrics::{MetricError, psnr};
use crate::eval::views::ground_truth;
use crate::math::camera::Camera;
use crate::math::image::RgbImage;
use crate::model::splat::appearance::SplatSet;
use crate::render::RenderOptions;
use crate::render::compare::{Area, Combination};
use crate::render::cpu::CpuRenderer;
use eframe::egui::Ui;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Minimum time between two measurements while the scene changes.
// A measurement renders the whole photograph on the CPU.
const INTERVAL: Duration = Duration::from_millis(500);

#[derive(Clone, Debug)]
pub struct PhotoQuery {
    pub frame: FrameRef,
    /// Camera that took the photographs, if it differs from the depth camera.
    pub color_camera: Option<ColorCamera>,
    /// Settings of frame preparation. If present, the status of each pixel after preparation is painted
    /// over the photograph.
    pub prepared: Option<Arc<SurfaceSettings>>,
    /// Render settings. Their background is visible through transparent parts of photographs.
    pub options: RenderOptions,
    pub compared: Option<Arc<ComparedModel>>,
}

impl PhotoQuery {
    fn is_same_photo(&self, other: &Self) -> bool {
        // The colour camera is not compared: it follows from the frame's dataset and from `prepared`.
        self.frame == other.frame
            && self.prepared == other.prepared
            && self.options.background == other.options.background
    }

    fn is_same_model(&self, other: &Self) -> bool {
        match (&self.compared, &other.compared) {
            (Some(a), Some(b)) => Arc::ptr_eq(a, b),
            (a, b) => a.is_none() && b.is_none(),
        }
    }

    fn is_same_measurement(&self, other: &Self) -> bool {
        self.is_same_photo(other) && self.options == other.options && self.is_same_model(other)
    }
}

#[derive(Clone, Debug)]
pub struct PhotoResult {
    /// Photograph over the background, sRGB-encoded. Includes the pixel status if requested.
    pub image: Arc<RgbImage>,
    pub pixel_counts: Option<SurfaceCounts>,
    /// PSNR between scene and photograph, dB, once measured.
    pub psnr: Option<f64>,
    pub compared_psnr: Option<f64>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum PhotoTask {
    /// Decodes the photograph without metrics, so that it is available at once.
    Show,
    /// Measures the PSNR with one thread, because training needs the others.
    MeasureAside,
    Measure,
}

pub struct PhotoRequests {
    thread: ViewThread<(PhotoQuery, PhotoTask), (PhotoQuery, Result<PhotoResult, String>)>,
    query: Option<PhotoQuery>,
    result: Option<Result<PhotoResult, String>>,
    is_stale: bool,
    measured_at: Instant,
}

impl PhotoRequests {
    pub fn new(waker: Waker, splats: Arc<SplatSet>) -> std::io::Result<Self> {
        let mut worker = PhotoWorker::new()?;
        let thread = ViewThread::start(
            "photographs",
            waker,
            move |splats: &SplatSet, (query, question)| {
                let result = worker.compute_result(splats, &query, question);
                (query, result)
            },
        )?;
        thread.change(SplatChange::All(splats));
        Ok(Self { thread, query: None, result: None, is_stale: true, measured_at: Instant::now() })
    }

    pub fn change(&mut self, change: SplatChange) {
        self.thread.change(change);
        self.is_stale = true;
    }

    pub fn request_result(
        &mut self,
        ui: &Ui,
        query: &PhotoQuery,
        is_training: bool,
    ) -> Option<&Result<PhotoResult, String>> {
        self.set_query(query);
        self.take_answer();
        self.send_request(ui, is_training);
        self.result.as_ref()
    }

    fn set_query(&mut self, query: &PhotoQuery) {
        match &self.query {
            Some(now) if now.is_same_photo(query) => {
                if !now.is_same_measurement(query) {
                    self.is_stale = true;
                    // The photograph stays on screen; only its metrics belong to other settings.
                    if let Some(Ok(result)) = &mut self.result {
                        (result.psnr, result.compared_psnr) = (None, None);
                    }
                }
            }
            // Another photograph must not be shown under this camera.
            _ => {
                self.result = None;
                self.is_stale = true;
            }
        }
        self.query = Some(query.clone());
    }

    fn take_answer(&mut self) {
        let (Some((of, result)), Some(query)) = (self.thread.take(), &self.query) else { return };
        // The user may have moved on meanwhile.
        if of.is_same_measurement(query) {
            if let Ok(PhotoResult { psnr: Some(psnr), .. }) = &result {
                tracing::debug!("photograph met with {psnr:.2} dB");
            }
            self.result = Some(result);
        }
    }

    fn send_request(&mut self, ui: &Ui, is_training: bool) {
        let Some(query) = &self.query else { return };
        if self.thread.is_busy() {
            return; // the answer wakes the window, which repeats the request
        }
        match &self.result {
            None => self.thread.send_request((query.clone(), PhotoTask::Show), Announce::Wake),
            // A photograph painted with pixel status cannot be compared with the scene.
            Some(Ok(result)) if self.is_stale && result.pixel_counts.is_none() => {
                let pause = INTERVAL.saturating_sub(self.measured_at.elapsed());
                // The first measurement starts at once; pauses lie between two measurements.
                if result.psnr.is_some() && !pause.is_zero() {
                    ui.ctx().request_repaint_after(pause);
                    return;
                }
                let question =
                    if is_training { PhotoTask::MeasureAside } else { PhotoTask::Measure };
                self.thread.send_request((query.clone(), question), Announce::Wake);
                // Reset before the answer arrives, so that a change during the measurement makes it
                // stale again.
                self.is_stale = false;
                self.measured_at = Instant::now();
            }
            _ => {}
        }
    }
}

struct PhotoWorker {
    renderer: CpuRenderer,
    /// Pool of one thread, used during training.
    alone: rayon::ThreadPool,
    painter: PixelStatusPainter,
    /// Latest decoded photograph, without metrics.
    latest: Option<(PhotoQuery, PhotoResult)>,
    /// PSNR between the second model and the photograph, dB.
    latest_compared: Option<(PhotoQuery, f64)>,
}

impl PhotoWorker {
    fn new() -> std::io::Result<Self> {
        Ok(Self {
            renderer: CpuRenderer::new(),
            alone: one_thread()?,
            painter: PixelStatusPainter::new(),
            latest: None,
            latest_compared: None,
        })
    }

    fn compute_result(
        &mut self,
        splats: &SplatSet,
        query: &PhotoQuery,
        question: PhotoTask,
    ) -> Result<PhotoResult, String> {
        let photo = self.photo(query)?;
        if question == PhotoTask::Show {
            return Ok(photo);
        }
        let known = self.latest_compared.take();
        // The second model does not change, so its figure stays valid for these settings.
        let known = known.filter(|(measured, _)| measured.is_same_measurement(query));
        let renderer = &mut self.renderer;
        let mut measure = |splats: &SplatSet| {
            let color_camera = query.color_camera.as_ref();
            // With the model's own pose corrections, which differ between models.
            let camera = query.frame.photo_camera(color_camera, splats.finishing());
            psnr(&renderer.render(splats, &camera, &query.options).color, &photo.image)
        };
        let both = || {
            let scene = measure(splats)?;
            let compared = match (known, &query.compared) {
                (Some((_, psnr)), _) => Some(psnr),
                (None, Some(model)) => Some(measure(&model.splats)?),
                (None, None) => None,
            };
            Ok((scene, compared))
        };
        let pool = (question == PhotoTask::MeasureAside).then_some(&self.alone);
        let measured = run_in(pool, both);
        let (scene, compared_psnr) = measured.map_err(|error: MetricError| error.to_string())?;
        self.latest_compared = compared_psnr.map(|psnr| (query.clone(), psnr));
        Ok(PhotoResult { psnr: Some(scene), compared_psnr, ..photo })
    }

    fn photo(&mut self, query: &PhotoQuery) -> Result<PhotoResult, String> {
        // Decoded once: during training the same photograph is measured twice a second.
        if let Some((latest, photo)) = &self.latest
            && latest.is_same_photo(query)
        {
            return Ok(photo.clone());
        }
        let (split, index) = query.frame.position();
        let frame = query.frame.dataset().load(split, index).map_err(|error| error.to_string())?;
        let background = query.options.background;
        let (image, pixel_counts) = match &query.prepared {
            None => (ground_truth(&frame, GroundTruth::Composited, background), None),
            Some(settings) => {
                let painted = self.painter.paint(&frame, settings, background);
                let (image, pixel_counts) = painted.map_err(|error| error.to_string())?;
                (image, Some(pixel_counts))
            }
        };
        let image = Arc::new(image);
        let photo = PhotoResult { image, pixel_counts, psnr: None, compared_psnr: None };
        self.latest = Some((query.clone(), photo.clone()));
        Ok(photo)
    }
}

#[derive(Clone, Debug, PartialEq)]
pub struct PictureRequest {
    /// Camera of the whole viewport, in screen pixels.
    pub camera: Camera,
    pub options: RenderOptions,
    pub second: Option<ComparedPicture>,
}

#[derive(Clone, Debug, PartialEq)]
pub struct ComparedPicture {
    pub partner: Partner,
    /// Part of the viewport that the second picture fills.
    pub area: Area,
    pub how: Combination,
}

#[derive(Clone, Debug)]
pub enum Partner {
    /// The splats of the scene, rendered with other options.
    Splats(RenderOptions),
    Model(Arc<ComparedModel>, RenderOptions),
    Photo(Arc<RgbImage>),
}

impl PartialEq for Partner {
    // By address: comparing millions of pixels or splats in every pass would be slow.
    fn eq(&self, other: &Self) -> bool {
        match (self, other) {
            (Self::Splats(a), Self::Splats(b)) => a == b,
            (Self::Model(a, drawn), Self::Model(b, other)) => Arc::ptr_eq(a, b) && drawn == other,
            (Self::Photo(a), Self::Photo(b)) => Arc::ptr_eq(a, b),
            _ => false,
        }
    }
}
