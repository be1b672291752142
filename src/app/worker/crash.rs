//! What the training thread does about panics, the window's and its own.

use super::thread::WorkerThread;
use crate::app::file_proposal::FileProposal;
use crate::app::opening::Content;
use crate::app::panic_report::PanicReport;
use crate::app::rescue::{self, Crash, CrashedThread, Rescue};
use crate::pipeline::checkpoint::SavedRun;
use crate::pipeline::session::Session;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

impl WorkerThread {
    /// After a panic of this thread: saves the scene and tells the window, which stays to show it.
    pub(super) fn crashed(&mut self, panic: PanicReport) {
        // It may have been writing one.
        self.shared.file.end();
        let crash = Crash { thread: CrashedThread::Training, panic, rescue: self.rescue() };
        // Noted first: whatever fails from here on, the program ends by telling of it.
        self.shared.crashed(crash.clone());
        self.fail(crash.to_string());
        self.publish(true);
    }

    /// Saves what no checkpoint holds, once for one state of the scene.
    pub(super) fn rescue(&mut self) -> Rescue {
        if let Some(known) = &self.rescued {
            return known.clone();
        }
        let frames = self.frames_since_checkpoint;
        let session = match &self.content {
            Some(Content::Session(session)) if frames > 0 => session,
            _ => return Rescue::Nothing,
        };
        let dataset = session.dataset().path.as_deref();
        let FileProposal { folder, stem } = FileProposal::beside(dataset);
        // Not for the demo: its proposal is the current folder, into which
        // nothing is written unasked.
        let beside = dataset.map(|_| folder.as_path());
        let saved = rescue::save(beside, &self.rescue_folders, &stem, |path| save(session, path));
        let rescue = match saved {
            Ok(path) => Rescue::Saved { path, frames },
            Err(problems) => Rescue::Lost { frames, problems },
        };
        self.rescued = Some(rescue.clone());
        rescue
    }
}

/// Saves a session that a panic may have left in the middle of a frame: only a file that can be read
/// again counts.
fn save(session: &Session, path: &Path) -> Result<(), String> {
    let attempt = || -> Result<(), String> {
        session.save(path).map_err(|error| error.to_string())?;
        let read = SavedRun::read(path).map(drop).map_err(|error| error.to_string());
        // A file that cannot be read again must not be found later and taken for the scene.
        read.inspect_err(|_| drop(std::fs::remove_file(path)))
    };
    catch_unwind(AssertUnwindSafe(attempt))
        .unwrap_or_else(|payload| Err(PanicReport::of(&*payload).to_string()))
}

#[cfg(test)]
mod tests {
    use crate::app::rescue::{CrashedThread, Rescue};
    use crate::app::state::{NoticeKind, RunState, Subject};
    use crate::app::unattended::Unattended;
    use crate::app::worker::{Waker, Worker, WorkerOrder};
    use crate::dataset::synthetic::SyntheticParams;
    use crate::dataset::synthetic::write::{DepthBits, SyntheticLayout, write};
    use std::path::{Path, PathBuf};
    use std::sync::Arc;
    use std::sync::atomic::{AtomicBool, Ordering};
    use std::time::{Duration, Instant};

    /// Longest any condition may take on a loaded machine.
    const PATIENCE: Duration = Duration::from_secs(60);

    fn wait(what: &str, condition: impl Fn() -> bool) {
        let started = Instant::now();
        while !condition() {
            assert!(started.elapsed() < PATIENCE, "waited for {what}");
            std::thread::sleep(Duration::from_millis(5));
        }
    }

    fn room(folder: &Path) -> PathBuf {
        let params = SyntheticParams {
            width: 64,
            height: 48,
            n_train: 3,
            n_eval: 0,
            seed: 1,
            depth_noise: 0.0,
        };
        let room = folder.join("room");
        std::fs::create_dir_all(folder).unwrap();
        write(&params, &room, SyntheticLayout::Blender(DepthBits::Sixteen), &mut |_, _| {})
            .unwrap();
        room
    }

    /// A worker that has trained one frame of a room; `armed` makes it panic until it is let go.
    fn worker(room: PathBuf, rescue_folder: &Path, armed: &Arc<AtomicBool>) -> Arc<Worker> {
        let trigger = armed.clone();
        let waker: Waker = Arc::new(move || {
            assert!(!trigger.load(Ordering::SeqCst), "injected");
        });
        let worker = Worker::start_with(waker, vec![rescue_folder.to_owned()]).unwrap();
        worker.send(WorkerOrder::Open(Subject::Path(room)));
        worker.send(WorkerOrder::Step);
        wait("a frame", || worker.snapshot().frames_done == 1);
        Arc::new(worker)
    }

    #[test]
    fn a_scene_whose_folder_is_gone_is_saved_elsewhere_and_once() {
        let folder = tempfile::tempdir().unwrap();
        let (disk, state) = (folder.path().join("disk"), folder.path().join("state/vbgs"));
        let worker = worker(room(&disk), &state, &Arc::default());
        std::fs::rename(&disk, folder.path().join("unplugged")).unwrap();
        let saved = Rescue::Saved { path: state.join("room-rescued.vbgs"), frames: 1 };
        assert_eq!(worker.rescue(), saved);
        assert_eq!(worker.rescue(), saved, "the same state is saved once");
        assert_eq!(std::fs::read_dir(&state).unwrap().count(), 1);
        assert!(!disk.exists());

        let file = folder.path().join("run.vbgs");
        worker.send(WorkerOrder::Save(1, file.clone()));
        wait("the file", || worker.snapshot().latest_write.is_some());
        assert!(file.is_file());
        assert_eq!(worker.rescue(), saved, "known already");
    }

    #[test]
    fn what_no_folder_takes_is_lost_and_every_reason_told() {
        let folder = tempfile::tempdir().unwrap();
        let disk = folder.path().join("disk");
        let file = folder.path().join("file");
        std::fs::write(&file, "").unwrap();
        let worker = worker(room(&disk), &file, &Arc::default());
        std::fs::rename(&disk, folder.path().join("unplugged")).unwrap();
        let Rescue::Lost { frames: 1, problems } = worker.rescue() else { panic!("lost") };
        assert_eq!(problems.len(), 2, "{problems:?}");
    }

    #[test]
    fn a_second_panic_ends_the_thread_and_not_the_scene() {
        let folder = tempfile::tempdir().unwrap();
        let armed = Arc::new(AtomicBool::new(false));
        let worker = worker(room(folder.path()), folder.path(), &armed);
        armed.store(true, Ordering::SeqCst);
        worker.send(WorkerOrder::Inspect(None));
        wait("the end", || !worker.is_alive());
        let crash = worker.crash().unwrap();
        let path = folder.path().join("room-rescued.vbgs");
        assert_eq!(crash.thread, CrashedThread::Training);
        assert_eq!(crash.rescue, Rescue::Saved { path, frames: 1 });
        assert!(crash.panic.place.as_ref().is_some_and(|place| place.contains("crash.rs")));
        assert_eq!(worker.rescue(), crash.rescue, "known although nobody takes orders");

        let notices = Unattended::new(worker).finish(folder.path());
        assert_eq!(notices, [(NoticeKind::Error, crash.to_string())]);
    }

    #[test]
    fn nothing_is_written_where_nothing_was_unsaved() {
        let folder = tempfile::tempdir().unwrap();
        let armed = Arc::new(AtomicBool::new(false));
        let worker = worker(room(folder.path()), folder.path(), &armed);
        worker.send(WorkerOrder::Save(1, folder.path().join("run.vbgs")));
        assert_eq!(worker.rescue(), Rescue::Nothing);
        assert_eq!(worker.snapshot().state, RunState::Paused);
        assert!(!folder.path().join("room-rescued.vbgs").exists());
    }
}
