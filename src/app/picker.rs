//! Picking of the splat under the pointer, on a separate thread.

use super::background_job::BackgroundJob;
use super::panic_report::PanicReport;
use super::worker::Waker;
use crate::math::camera::Camera;
use crate::model::splat::appearance::SplatSet;
use crate::render::RenderOptions;
use crate::render::pick::pick;
use glam::DVec2;
use std::sync::Arc;

/// Pick in progress, if any.
#[derive(Default)]
pub struct Picker(Option<BackgroundJob<Option<u32>>>);

impl Picker {
    /// Starts to pick the splat at a position of the viewport, pixels; replaces a pick in progress.
    pub fn start_pick(
        &mut self,
        splats: Arc<SplatSet>,
        camera: Camera,
        position: DVec2,
        options: RenderOptions,
        waker: Waker,
    ) -> std::io::Result<()> {
        // The job owns its reference to the splats and drops it before the result arrives, so that
        // their next change need not copy them.
        let find = move || pick(&splats, &camera, position, &options).map(|p| p.index as u32);
        self.0 = Some(BackgroundJob::start("picking", waker, find)?);
        Ok(())
    }

    /// Takes the result, once: the splat, or `None` if there is none at that position.
    pub fn take(&mut self) -> Option<Result<Option<u32>, PanicReport>> {
        let answer = self.0.as_ref()?.poll()?;
        self.0 = None;
        Some(answer)
    }
}
