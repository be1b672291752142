//! Photographs, how well the scene reproduces them and what training makes of their pixels, found on
//! a thread of their own.

use super::fates::FatePainter;
use super::stops::Stop;
use crate::app::feed::SplatChange;
use crate::app::view_thread::{Announce, ViewThread};
use crate::app::worker::Waker;
use crate::dataset::Dataset;
use crate::dataset::calibration::ColorCamera;
use crate::dataset::surface::{SurfaceCounts, SurfaceSettings};
use crate::eval::metrics::psnr;
use crate::eval::views::{GroundTruth, ground_truth};
use crate::math::camera::Camera;
use crate::math::image::RgbImage;
use crate::model::splat::appearance::SplatSet;
use crate::render::RenderOptions;
use crate::render::cpu::CpuRenderer;
use eframe::egui::Ui;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Least time between two measurements while the scene changes.
const INTERVAL: Duration = Duration::from_millis(500);

/// A photograph to look at, and how the scene is drawn for the measurement.
#[derive(Clone, Debug)]
pub struct Wanted {
    /// The frame's dataset.
    pub dataset: Arc<Dataset>,
    /// The frame.
    pub stop: Stop,
    /// The camera that took the photographs, where it is not the one that measured depth.
    pub color_camera: Option<ColorCamera>,
    /// Paints what became of its pixels when it was prepared so.
    pub prepared: Option<Arc<SurfaceSettings>>,
    /// Settings of the measurement; its background shows through transparent photographs.
    pub options: RenderOptions,
}

impl Wanted {
    fn is_same_photo(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.dataset, &other.dataset)
            && self.stop == other.stop
            && self.prepared == other.prepared
            && self.options.background == other.options.background
    }
}

/// What is known of a photograph.
#[derive(Clone, Debug)]
pub struct Sight {
    /// The photograph, sRGB-encoded over the background; painted over if that was asked for.
    pub image: Arc<RgbImage>,
    /// What became of its pixels, if that was asked for.
    pub fates: Option<SurfaceCounts>,
    /// PSNR of the scene against it in dB, once measured.
    pub psnr: Option<f64>,
}

/// How much of a question to answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Question {
    /// The photograph only, which is there at once.
    Show,
    /// The PSNR, with one thread while a trainer needs the others.
    MeasureAside,
    /// The PSNR, with all threads.
    Measure,
}

struct Answer {
    wanted: Wanted,
    sight: Result<Sight, String>,
}

/// Where photographs are asked for.
pub struct PhotoDesk {
    thread: ViewThread<(Wanted, Question), Answer>,
    wanted: Option<Wanted>,
    sight: Option<Result<Sight, String>>,
    is_stale: bool,
    measured_at: Instant,
}

impl PhotoDesk {
    /// Starts the thread with the scene as it is.
    pub fn new(waker: Waker, splats: SplatSet) -> std::io::Result<Self> {
        let mut darkroom = Darkroom::new()?;
        let thread = ViewThread::start(
            "photographs",
            waker,
            move |splats: &SplatSet, (wanted, question)| {
                let sight = darkroom.look(splats, &wanted, question);
                Answer { wanted, sight }
            },
        )?;
        thread.change(SplatChange::All(splats));
        Ok(Self { thread, wanted: None, sight: None, is_stale: true, measured_at: Instant::now() })
    }

    /// Hands changed splats over.
    pub fn change(&mut self, change: SplatChange) {
        self.thread.change(change);
        self.is_stale = true;
    }

    /// What is known of the wanted photograph, or why nothing can be; asks for what is not known.
    pub fn look(
        &mut self,
        ui: &Ui,
        wanted: &Wanted,
        is_training: bool,
    ) -> Option<&Result<Sight, String>> {
        self.turn_to(wanted);
        self.take_answer();
        self.ask(ui, is_training);
        self.sight.as_ref()
    }

    fn turn_to(&mut self, wanted: &Wanted) {
        match &self.wanted {
            Some(now) if now.is_same_photo(wanted) => {
                if now.options != wanted.options {
                    self.is_stale = true;
                    if let Some(Ok(sight)) = &mut self.sight {
                        sight.psnr = None;
                    }
                }
            }
            _ => {
                self.sight = None;
                self.is_stale = true;
            }
        }
        self.wanted = Some(wanted.clone());
    }

    fn take_answer(&mut self) {
        let (Some(answer), Some(wanted)) = (self.thread.take(), &self.wanted) else { return };
        if answer.wanted.is_same_photo(wanted) && answer.wanted.options == wanted.options {
            self.sight = Some(answer.sight);
        }
    }

    fn ask(&mut self, ui: &Ui, is_training: bool) {
        let Some(wanted) = &self.wanted else { return };
        if self.thread.is_busy() {
            return; // the answer wakes the window, which asks again
        }
        match &self.sight {
            None => self.thread.ask((wanted.clone(), Question::Show), Announce::Wake),
            Some(Ok(sight)) if self.is_stale && sight.fates.is_none() => {
                let pause = INTERVAL.saturating_sub(self.measured_at.elapsed());
                if sight.psnr.is_some() && !pause.is_zero() {
                    ui.ctx().request_repaint_after(pause);
                    return;
                }
                let question = if is_training { Question::MeasureAside } else { Question::Measure };
                self.thread.ask((wanted.clone(), question), Announce::Wake);
                self.is_stale = false;
                self.measured_at = Instant::now();
            }
            _ => {}
        }
    }
}

/// The thread's own state.
struct Darkroom {
    renderer: CpuRenderer,
    alone: rayon::ThreadPool,
    painter: FatePainter,
    /// The photograph looked at last.
    latest: Option<(Wanted, Photo)>,
}

/// A photograph and the camera that took it.
#[derive(Clone)]
struct Photo {
    image: Arc<RgbImage>,
    fates: Option<SurfaceCounts>,
    camera: Camera,
}

impl Darkroom {
    fn new() -> std::io::Result<Self> {
        let alone = rayon::ThreadPoolBuilder::new().num_threads(1).build();
        let alone = alone.map_err(std::io::Error::other)?;
        Ok(Self { renderer: CpuRenderer::new(), alone, painter: FatePainter::new(), latest: None })
    }

    fn look(
        &mut self,
        splats: &SplatSet,
        wanted: &Wanted,
        question: Question,
    ) -> Result<Sight, String> {
        let Photo { image, fates, camera } = self.photo(wanted)?;
        let renderer = &mut self.renderer;
        let mut measure = || psnr(&renderer.render(splats, &camera, &wanted.options).color, &image);
        let measured = match question {
            Question::Show => None,
            Question::MeasureAside => Some(self.alone.install(measure)),
            Question::Measure => Some(measure()),
        };
        let psnr = measured.transpose().map_err(|error| error.to_string())?;
        Ok(Sight { image, fates, psnr })
    }

    fn photo(&mut self, wanted: &Wanted) -> Result<Photo, String> {
        if let Some((latest, photo)) = &self.latest
            && latest.is_same_photo(wanted)
        {
            return Ok(photo.clone());
        }
        let Stop { split, index } = wanted.stop;
        let frame = wanted.dataset.load(split, index).map_err(|error| error.to_string())?;
        let background = wanted.options.background;
        let (image, fates) = match &wanted.prepared {
            None => (ground_truth(&frame, GroundTruth::Composited, background), None),
            Some(settings) => {
                let painted = self.painter.paint(&frame, settings, background);
                let (image, fates) = painted.map_err(|error| error.to_string())?;
                (image, Some(fates))
            }
        };
        let camera = wanted.stop.photo_camera(&wanted.dataset, wanted.color_camera.as_ref());
        let photo = Photo { image: Arc::new(image), fates, camera };
        self.latest = Some((wanted.clone(), photo.clone()));
        Ok(photo)
    }
}
