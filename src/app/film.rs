//! Drawing a camera path into files, on a thread of its own.
//!
//! By the renderer of `render --path`, so that the window's film is the command line's. While frames are
//! trained it draws with one thread.

use super::background_job::BackgroundJob;
use super::edit::left_out::LeftOut;
use super::state::NoticeKind;
use super::worker::{FileProgress, Waker};
use crate::export::camera_path::PacedPath;
use crate::export::film::{FilmError, FilmWriter};
use crate::model::splat::appearance::SplatSet;
use crate::render::RenderOptions;
use crate::render::cpu::CpuRenderer;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// A film to be drawn.
pub struct FilmOrder {
    /// The way and its pace.
    pub path: PacedPath,
    /// Size of its pictures, pixels.
    pub size: [u32; 2],
    /// A video by its ending, else a folder of pictures.
    pub output: PathBuf,
    /// How the scene is drawn.
    pub options: RenderOptions,
    /// What is left out of the scene.
    pub left_out: LeftOut,
    /// Whether a trainer needs the other cores.
    pub is_aside: bool,
}

/// How a film ended that nothing went wrong with.
enum Ended {
    Whole(usize),
    Cancelled(usize),
}

struct Running {
    output: PathBuf,
    progress: Arc<FileProgress>,
    drawing: BackgroundJob<Result<Ended, FilmError>>,
}

/// The film that is being drawn, if one is.
#[derive(Default)]
pub struct FilmThread(Option<Running>);

impl Drop for FilmThread {
    fn drop(&mut self) {
        self.cancel();
    }
}

impl FilmThread {
    /// Draws a film of the scene as it is; one that is under way is given up.
    ///
    /// # Errors
    /// No thread could be started.
    pub fn start(
        &mut self,
        scene: Arc<SplatSet>,
        order: FilmOrder,
        waker: Waker,
    ) -> std::io::Result<()> {
        self.cancel();
        let progress = Arc::new(FileProgress::default());
        progress.begin();
        let (told, output) = (progress.clone(), order.output.clone());
        let n_threads = if order.is_aside { 1 } else { 0 };
        let pool = rayon::ThreadPoolBuilder::new().num_threads(n_threads).build();
        let pool = pool.map_err(std::io::Error::other)?;
        let drawn = waker.clone();
        let draw = move || pool.install(|| draw(order.left_out.kept(scene), &order, &told, &drawn));
        let drawing = BackgroundJob::start("film", waker, draw)?;
        self.0 = Some(Running { output, progress, drawing });
        Ok(())
    }

    /// The share that is drawn; `None` while no film is.
    pub fn share(&self) -> Option<f32> {
        self.0.as_ref().map(|running| running.progress.share().unwrap_or(0.0))
    }

    /// Where it goes; `None` while no film is drawn.
    pub fn output(&self) -> Option<&Path> {
        self.0.as_ref().map(|running| &*running.output)
    }

    /// The user wants it no more.
    pub fn cancel(&self) {
        if let Some(running) = &self.0 {
            running.progress.cancel();
        }
    }

    /// What is to be said of a film that has ended, once.
    pub fn take(&mut self) -> Option<(NoticeKind, String)> {
        let running = self.0.as_ref()?;
        let answer = running.drawing.take()?;
        let path = running.output.display();
        let said = match answer {
            Ok(Ok(Ended::Whole(n))) => (NoticeKind::Info, format!("Wrote {n} pictures to {path}")),
            Ok(Ok(Ended::Cancelled(n))) => {
                (NoticeKind::Info, format!("{path}: cancelled after {n} pictures"))
            }
            Ok(Err(error)) => (NoticeKind::Error, error.to_string()),
            Err(panic) => (NoticeKind::Error, format!("{path}: {}", panic.ended("the film"))),
        };
        self.0 = None;
        Some(said)
    }
}

fn draw(
    scene: Arc<SplatSet>,
    order: &FilmOrder,
    progress: &FileProgress,
    waker: &Waker,
) -> Result<Ended, FilmError> {
    let mut film = FilmWriter::new(&order.output, order.size, order.path.fps)?;
    let mut renderer = CpuRenderer::new();
    let cameras = order.path.cameras(order.size);
    let n = cameras.len();
    for (i, camera) in cameras.enumerate() {
        if !progress.is_wanted() {
            film.give_up();
            return Ok(Ended::Cancelled(i));
        }
        let picture = renderer.render(&*scene, &camera, &order.options).color;
        if !film.push(&picture)? {
            break;
        }
        if progress.tell((i + 1) as f64 / n as f64) {
            waker();
        }
    }
    film.finish()?;
    Ok(Ended::Whole(n))
}
