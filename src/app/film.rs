//! Renders a camera path to files on a separate thread.
//!
//! Uses the same renderer as `render --path`, so that both produce the same film. While training runs, only
//! one thread renders.

use super::edit::marks::LeftOut;
use super::state::NoticeKind;
use super::view_thread::{one_thread, run_in, take_finished};
use super::worker::Waker;
use crate::export::camera_path::PacedPath;
use crate::export::video::{FilmError, FilmWriter, write_png};
use crate::math::camera::Camera;
use crate::model::splat::appearance::SplatSet;
use crate::pipeline::job::{Job, Progress};
use crate::render::RenderOptions;
use crate::render::cpu::CpuRenderer;
use std::path::{Path, PathBuf};
use std::sync::Arc;

pub struct FilmRequest {
    pub path: PacedPath,
    pub size: [u32; 2],
    /// Path of the video if the extension names a video format, otherwise path of a folder for pictures.
    pub output: PathBuf,
    pub options: RenderOptions,
    pub left_out: LeftOut,
    /// True if the film is rendered with one thread, because training needs the other cores.
    pub is_beside_training: bool,
}

/// Outcome of rendering a film without errors. Holds the number of pictures written.
enum FilmOutcome {
    Complete(usize),
    Cancelled(usize),
}

struct RunningFilm {
    output: PathBuf,
    drawing: Job<Result<FilmOutcome, FilmError>>,
}

#[derive(Default)]
pub struct FilmThread(Option<RunningFilm>);

impl FilmThread {
    /// Cancels the film in progress and starts rendering a film of `scene`.
    pub fn start(
        &mut self,
        scene: Arc<SplatSet>,
        order: FilmRequest,
        waker: Waker,
    ) -> std::io::Result<()> {
        // Cancels a running film, as every job does when it is dropped.
        self.0 = None;
        let output = order.output.clone();
        let pool = order.is_beside_training.then(one_thread).transpose()?;
        let drawn = waker.clone();
        let draw = move |progress: &Progress| {
            let scene = order.left_out.remaining(scene);
            run_in(pool.as_ref(), || render_film(scene, &order, progress, &drawn))
        };
        let drawing = Job::start_reporting("film", waker, draw)?;
        self.0 = Some(RunningFilm { output, drawing });
        Ok(())
    }

    pub fn share(&self) -> Option<f32> {
        // There is no share before the first picture.
        self.0.as_ref().map(|running| running.drawing.progress().share().unwrap_or(0.0))
    }

    pub fn output(&self) -> Option<&Path> {
        self.0.as_ref().map(|running| &*running.output)
    }

    pub fn cancel(&self) {
        if let Some(running) = &self.0 {
            running.drawing.progress().cancel();
        }
    }

    pub fn poll_notice(&mut self) -> Option<(NoticeKind, String)> {
        let running = self.0.as_ref()?;
        let answer = running.drawing.poll()?;
        let path = running.output.display();
        let said = match answer {
            Ok(Ok(FilmOutcome::Complete(n))) => {
                (NoticeKind::Info, format!("Wrote {n} pictures to {path}"))
            }
            Ok(Ok(FilmOutcome::Cancelled(n))) => {
                (NoticeKind::Info, format!("{path}: cancelled after {n} pictures"))
            }
            Ok(Err(error)) => (NoticeKind::Error, error.to_string()),
            Err(panic) => {
                (NoticeKind::Error, format!("{path}: {}", panic.failure_notice("the film")))
            }
        };
        self.0 = None;
        Some(said)
    }
}

fn render_film(
    scene: Arc<SplatSet>,
    order: &FilmRequest,
    progress: &Progress,
    waker: &Waker,
) -> Result<FilmOutcome, FilmError> {
    let mut film = FilmWriter::new(&order.output, order.size, order.path.fps)?;
    let mut renderer = CpuRenderer::new();
    let cameras = order.path.cameras(order.size);
    let n = cameras.len();
    for (i, camera) in cameras.enumerate() {
        if !progress.is_wanted() {
            film.abort();
            return Ok(FilmOutcome::Cancelled(i));
        }
        let picture = renderer.render(&*scene, &camera, &order.options).color;
        // The encoder has ended; `finish` returns the cause.
        if !film.push(&picture)? {
            break;
        }
        if progress.set_share((i + 1) as f64 / n as f64) {
            waker();
        }
    }
    film.finish()?;
    Ok(FilmOutcome::Complete(n))
}

pub struct Still {
    pub splats: Arc<SplatSet>,
    pub camera: Camera,
    pub options: RenderOptions,
    /// True if the picture is rendered with one thread, because training needs the other cores.
    pub is_beside_training: bool,
}

#[derive(Default)]
pub struct StillJob(Option<(PathBuf, Job<Result<(), String>>)>);

impl StillJob {
    /// Starts rendering a picture and writing it to `path`. A picture that is still in progress is
    /// completed, but no notice reports it.
    pub fn start(&mut self, still: Still, path: PathBuf, waker: Waker) -> std::io::Result<()> {
        let output = path.clone();
        let pool = still.is_beside_training.then(one_thread).transpose()?;
        let draw = move || {
            let Still { splats, camera, options, .. } = still;
            let render = || CpuRenderer::new().render(splats.view(), &camera, &options).color;
            write_png(&output, &run_in(pool.as_ref(), render)).map_err(|error| error.to_string())
        };
        self.0 = Some((path, Job::start_waking("picture", waker, draw)?));
        Ok(())
    }

    pub fn take(&mut self) -> Option<(NoticeKind, String)> {
        let (path, answer) = take_finished(&mut self.0)?;
        Some(match answer {
            Ok(Ok(())) => (NoticeKind::Info, format!("Wrote {}", path.display())),
            Ok(Err(error)) => (NoticeKind::Error, error),
            Err(panic) => {
                let text = panic.failure_notice("rendering the picture");
                (NoticeKind::Error, format!("{}: {text}", path.display()))
            }
        })
    }
}
