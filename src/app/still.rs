//! Rendering of the view to an image file, on a separate thread.

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

pub struct Still {
    /// Splats as displayed.
    pub splats: Arc<SplatSet>,
    /// Camera of the view, in its pixels.
    pub camera: Camera,
    /// Render options of the view at rest.
    pub options: RenderOptions,
}

/// Picture in progress, if any.
#[derive(Default)]
pub struct StillJob(Option<(PathBuf, BackgroundJob<Result<PathBuf, String>>)>);

impl StillJob {
    /// Renders a picture and writes it to `path`, or to an unused name if that exists. A picture in
    /// progress is finished without a notice.
    ///
    /// # Errors
    /// If no thread can be started.
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

    /// Takes the notice about a finished picture, once.
    pub fn take(&mut self) -> Option<(NoticeKind, String)> {
        let (path, job) = self.0.as_ref()?;
        let said = match job.poll()? {
            Ok(Ok(path)) => (NoticeKind::Info, format!("Wrote {}", path.display())),
            Ok(Err(error)) => (NoticeKind::Error, error),
            Err(panic) => {
                let text = format!(
                    "{}: {}",
                    path.display(),
                    panic.failure_notice("rendering the picture")
                );
                (NoticeKind::Error, text)
            }
        };
        self.0 = None;
        Some(said)
    }
}
