//! Whether the poses of what was opened agree with its depth: found on a thread of its own, since it
//! decodes a dozen frames while the first ones are trained.

use super::thread::WorkerThread;
use crate::app::opening::Content;
use crate::app::state::NoticeKind;
use crate::app::wording;
use crate::dataset::pose_check;
use std::sync::Arc;
use std::thread;

impl WorkerThread {
    /// Begins to check what was just opened. The check of what was open before ends unheard.
    pub(super) fn check_poses(&mut self) {
        self.pose_check = None;
        let Some(Content::Session(session)) = &self.content else { return };
        // The built-in scene is right by construction.
        if session.dataset().path.is_none() {
            return;
        }
        let (dataset, split) = (session.dataset().clone(), session.plan().split);
        let check = move || pose_check::check(&dataset, split);
        match thread::Builder::new().name("pose check".into()).spawn(check) {
            Ok(thread) => self.pose_check = Some(thread),
            Err(error) => tracing::warn!("poses are not checked: {error}"),
        }
    }

    /// Tells what was found, once.
    pub(super) fn take_poses(&mut self) {
        let Some(thread) = self.pose_check.take_if(|thread| thread.is_finished()) else { return };
        // A panic of a decoder was reported where it happened.
        let Ok(Some(check)) = thread.join() else { return };
        self.changed = true;
        if let Some(warning) = wording::pose_warning(&check) {
            self.notify(NoticeKind::Warning, warning);
        }
        self.snapshot.poses = Some(Arc::new(check));
    }
}
