//! Sampling of frames after opening: agreement of poses with depth, pixel width and noise. On a
//! separate thread, because it decodes about twenty frames while the first ones are trained.

use super::thread::{FrameSampling, WorkerThread};
use crate::app::opening::Content;
use crate::app::panic_report::PanicReport;
use crate::app::state::NoticeKind;
use crate::app::wording;
use crate::dataset::pose_check;
use crate::dataset::surface::sample::FrameSample;
use std::any::Any;
use std::sync::Arc;
use std::thread::{self, JoinHandle};

impl WorkerThread {
    /// Starts sampling the opened dataset; drops a sampling of the previous one.
    pub(super) fn start_frame_sampling(&mut self) {
        self.first_look = None;
        let Some(Content::Session(session)) = &self.content else { return };
        let (dataset, split) = (session.dataset().clone(), session.plan().split);
        let surface = session.config().method.scene().map(|run| run.surface.clone());
        let frames = session.plan().first_pass();
        let look = move || FrameSampling {
            sample: surface
                .and_then(|surface| FrameSample::of(&dataset, split, &frames, &surface).ok()),
            // The poses of the built-in scene are exact.
            poses: dataset.path.as_ref().and_then(|_| pose_check::check(&dataset, split)),
        };
        match thread::Builder::new().name("first look".into()).spawn(look) {
            Ok(thread) => self.first_look = Some(thread),
            Err(error) => tracing::warn!("starting the thread that samples frames failed: {error}"),
        }
    }

    /// Publishes the result, once.
    pub(super) fn take_frame_sampling(&mut self) {
        let Some(thread) = self.first_look.take_if(|thread| thread.is_finished()) else { return };
        self.changed = true;
        let look = match join_sampling(thread) {
            Ok(look) => look,
            Err(text) => return self.notify(NoticeKind::Warning, text),
        };
        self.snapshot.sample = look.sample;
        let Some(check) = look.poses else { return };
        if let Some(warning) = wording::pose_warning(&check) {
            self.notify(NoticeKind::Warning, warning);
        }
        self.snapshot.poses = Some(Arc::new(check));
    }
}

/// Result of the thread, or the notice about its panic.
fn join_sampling(thread: JoinHandle<FrameSampling>) -> Result<FrameSampling, String> {
    let told = |panic: Box<dyn Any + Send>| {
        PanicReport::of(&*panic).failure_notice("checking the frames for doubtful poses")
    };
    thread.join().map_err(told)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_look_that_panics_is_told() {
        let told = join_sampling(thread::spawn(|| panic!("injected into sampling"))).err().unwrap();
        for part in ["injected into sampling", "doubtful poses", "report it"] {
            assert!(told.contains(part), "{part:?} is missing in: {told}");
        }
    }
}
