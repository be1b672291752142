//! Run without a window: it continues to its end and is written to files.

use super::edit::marks::LeftOut;
use super::state::{NoticeKind, RunState};
use super::worker::{Worker, WorkerOrder};
use crate::export::mapping::Mapping;
use std::fmt;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

/// Poll interval.
const POLL_INTERVAL: Duration = Duration::from_millis(100);

/// Run without a window.
pub struct Unattended(Arc<Worker>);

impl fmt::Debug for Unattended {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("Unattended").field(&self.0.snapshot().state).finish()
    }
}

impl Unattended {
    pub(super) fn new(worker: Arc<Worker>) -> Self {
        Self(worker)
    }

    /// Waits for the end of training and writes checkpoint and scene to an existing folder. Returns the
    /// notices since the call, including errors of training.
    pub fn finish(self, folder: &Path) -> Vec<(NoticeKind, String)> {
        let before = self.0.snapshot().notices.last().map_or(0, |notice| notice.serial);
        // Otherwise a recording without an end would never finish.
        self.0.send(WorkerOrder::Follow(false));
        // Polled, because the waker belongs to windows and there is none.
        while self.0.is_alive() && self.0.snapshot().state == RunState::Training {
            std::thread::sleep(POLL_INTERVAL);
        }
        // Number 0 is free: windows count from 1.
        self.0.send(WorkerOrder::Save(0, folder.join("checkpoint.vbgs")));
        // The edits were lost with the window, so all splats are written.
        for name in ["scene.ply", "scene.glb"] {
            let (all, mapping) = (LeftOut::default(), Mapping::default());
            self.0.send(WorkerOrder::Export(0, folder.join(name), mapping, all));
        }
        // Orders are executed in sequence: once this notice appears, the files were written or have
        // failed.
        let done = WorkerOrder::Report(NoticeKind::Info, DONE.to_owned());
        self.0.send(done);
        while self.0.is_alive() && self.0.snapshot().notices.last().is_none_or(|n| n.text != DONE) {
            std::thread::sleep(POLL_INTERVAL);
        }
        let snapshot = self.0.snapshot();
        let fresh = snapshot.notices.iter().filter(|n| n.serial > before && n.text != DONE);
        let mut notices: Vec<_> = fresh.map(|n| (n.kind, n.text.clone())).collect();
        // A crash that the thread survived is among its notices; one that ended it is not.
        if let Some(crash) = self.0.crash().filter(|_| !self.0.is_alive()) {
            notices.push((NoticeKind::Error, crash.to_string()));
        }
        notices
    }
}

/// Marks the end of the orders.
const DONE: &str = "Training ended without a window";

#[cfg(test)]
mod tests {
    use super::*;
    use crate::app::state::Subject;
    use crate::dataset::synthetic::SyntheticParams;
    use crate::dataset::synthetic::write::{DepthBits, SyntheticLayout, write};

    #[test]
    fn a_run_goes_on_to_its_end_and_is_written() {
        let folder = tempfile::tempdir().unwrap();
        let room = folder.path().join("room");
        let params = SyntheticParams {
            width: 64,
            height: 48,
            n_train: 3,
            n_eval: 1,
            seed: 1,
            depth_noise: 0.0,
            ..SyntheticParams::demo()
        };
        let layout = SyntheticLayout::Blender(DepthBits::Sixteen);
        write(&params, &room, layout, &mut |_, _| {}).unwrap();
        let worker = Arc::new(Worker::start(Arc::new(|| {})).unwrap());
        worker.send(WorkerOrder::Open(Subject::Path(room)));
        worker.send(WorkerOrder::Train);
        while worker.snapshot().frames_done == 0 {
            std::thread::sleep(POLL_INTERVAL);
        }
        let notices = Unattended::new(worker.clone()).finish(folder.path());
        assert_eq!(worker.snapshot().frames_done, 3);
        assert!(notices.iter().all(|(kind, _)| *kind == NoticeKind::Info), "{notices:?}");
        for name in ["checkpoint.vbgs", "scene.ply", "scene.glb"] {
            assert!(folder.path().join(name).is_file(), "{name}: {notices:?}");
        }
    }
}
