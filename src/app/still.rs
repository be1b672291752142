//! A picture of the view as a file, drawn beside the window.

use super::background_job::BackgroundJob;
use super::state::NoticeKind;
use super::unused_path::unused;
use super::worker::Waker;
use crate::export::film::write_png;
use crate::math::camera::Camera;
use crate::model::splat::appearance::SplatSet;
use crate::render::RenderOptions;
use crate::render::cpu::CpuRenderer;
use std::path::PathBuf;
use std::sync::Arc;

/// What is drawn.
pub struct Still {
    /// As they are shown.
    pub splats: Arc<SplatSet>,
    /// Of the view, in its pixels.
    pub camera: Camera,
    /// As the view is drawn at rest.
    pub options: RenderOptions,
}

/// A picture that is on its way.
#[derive(Default)]
pub struct StillJob(Option<(PathBuf, BackgroundJob<Result<PathBuf, String>>)>);

impl StillJob {
    /// Draws a picture and writes it to `path`, or beside a file that has this name. One that is still being
    /// drawn is finished unheard.
    ///
    /// # Errors
    /// No thread could be started.
    pub fn start(&mut self, still: Still, path: PathBuf, waker: Waker) -> std::io::Result<()> {
        let asked = path.clone();
        let draw = move || {
            let picture =
                CpuRenderer::new().render(still.splats.view(), &still.camera, &still.options).color;
            let path = unused(&asked);
            write_png(&path, &picture).map(|()| path).map_err(|error| error.to_string())
        };
        self.0 = Some((path, BackgroundJob::start("picture", waker, draw)?));
        Ok(())
    }

    /// What is to be said of a picture that is there, once.
    pub fn take(&mut self) -> Option<(NoticeKind, String)> {
        let (path, job) = self.0.as_ref()?;
        let said = match job.take()? {
            Ok(Ok(path)) => (NoticeKind::Info, format!("Wrote {}", path.display())),
            Ok(Err(error)) => (NoticeKind::Error, error),
            Err(panic) => {
                let text = format!("{}: {}", path.display(), panic.ended("the picture"));
                (NoticeKind::Error, text)
            }
        };
        self.0 = None;
        Some(said)
    }
}
