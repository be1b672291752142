//! Finding the splat under the pointer, on a thread of its own.

use super::worker::Waker;
use crate::math::camera::Camera;
use crate::model::splat::appearance::SplatSet;
use crate::render::RenderOptions;
use crate::render::pick::pick;
use glam::DVec2;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, TryRecvError, sync_channel};

/// A question that may be open.
#[derive(Default)]
pub struct Picker(Option<Receiver<Option<u32>>>);

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
        let (answer, answers) = sync_channel(1);
        std::thread::Builder::new().name("picking".into()).spawn(move || {
            let found = pick(&splats, &camera, position, &options).map(|p| p.index as u32);
            // Let go first: whoever changes the splats next need not copy them then.
            drop(splats);
            // Nobody listens any more if something else was asked meanwhile.
            let _ = answer.send(found);
            waker();
        })?;
        self.0 = Some(answers);
        Ok(())
    }

    /// The answer, once: the splat, or `Some(None)` if there is none at that place.
    pub fn take(&mut self) -> Option<Option<u32>> {
        match self.0.as_ref()?.try_recv() {
            Err(TryRecvError::Empty) => None,
            // A thread that panicked hangs up: then nothing is found, and the next click asks anew.
            answer => {
                self.0 = None;
                Some(answer.ok().flatten())
            }
        }
    }
}
