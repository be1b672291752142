//! Finding the splat under the pointer, on a thread of its own.

use super::background_job::BackgroundJob;
use super::panic_report::PanicReport;
use super::worker::Waker;
use crate::math::camera::Camera;
use crate::model::splat::appearance::SplatSet;
use crate::render::RenderOptions;
use crate::render::pick::pick;
use glam::DVec2;
use std::sync::Arc;

/// A question that may be open.
#[derive(Default)]
pub struct Picker(Option<BackgroundJob<Option<u32>>>);

impl Picker {
    /// Asks which splat is seen at a position of the viewport, pixels. A question still open is
    /// forgotten.
    pub fn ask(
        &mut self,
        splats: Arc<SplatSet>,
        camera: Camera,
        position: DVec2,
        options: RenderOptions,
        waker: Waker,
    ) -> std::io::Result<()> {
        // The splats go with the work, before the answer is there: whoever changes them next need not copy
        // them then.
        let find = move || pick(&splats, &camera, position, &options).map(|p| p.index as u32);
        self.0 = Some(BackgroundJob::start("picking", waker, find)?);
        Ok(())
    }

    /// The answer, once: the splat, or `None` if there is none at that place.
    pub fn take(&mut self) -> Option<Result<Option<u32>, PanicReport>> {
        let answer = self.0.as_ref()?.take()?;
        self.0 = None;
        Some(answer)
    }
}
