//! Handling of panics of the window and of the training thread.

use super::thread::WorkerThread;
use crate::app::opening::{Content, FileProposal};
use crate::app::panic_report::PanicReport;
use crate::app::rescue;
use crate::app::rescue::{Crash, CrashedThread, Rescue};

impl WorkerThread {
    /// After a panic of this thread: rescues the scene and reports the crash to the window, which stays
    /// open.
    pub(super) fn handle_panic(&mut self, panic: PanicReport) {
        // The panic may have occurred while a file was written.
        self.shared.file.end();
        let crash = Crash { thread: CrashedThread::Training, panic, rescue: self.rescue() };
        // Recorded first, so that the program reports the crash at its end even if the next steps fail.
        self.shared.crashed(crash.clone());
        self.fail(crash.to_string());
        self.publish(true);
    }

    /// Rescues training that no checkpoint holds, once per state of the scene.
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
        // Not for the demo: its proposed folder is the current one, where nothing is written without a
        // request.
        let beside = dataset.map(|_| folder.as_path());
        let saved = rescue::save(beside, &self.rescue_folders, &stem, |path| {
            session.save_after_panic(path)
        });
        let rescue = match saved {
            Ok(path) => Rescue::Saved { path, frames },
            Err(problems) => Rescue::Lost { frames, problems },
        };
        self.rescued = Some(rescue.clone());
        rescue
    }
}

#[cfg(test)]
mod tests {
    use crate::app::edit::marks::LeftOut;
    use crate::app::rescue::{CrashedThread, Rescue};
    use crate::app::state::{NoticeKind, RunState, Subject};
    use crate::app::unattended::Unattended;
    use crate::app::worker::{Waker, Worker, WorkerOrder};
    use crate::dataset::synthetic::SyntheticParams;
    use crate::dataset::synthetic::write::{DepthBits, SyntheticLayout, write};
    use crate::export::mapping::Mapping;
    use std::path::{Path, PathBuf};
    use std::sync::atomic::{AtomicBool, Ordering};
    use std::sync::{Arc, OnceLock, Weak};
    use std::time::{Duration, Instant};

    /// Longest wait for a condition, enough for a loaded machine.
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
            ..SyntheticParams::demo()
        };
        let room = folder.join("room");
        std::fs::create_dir_all(folder).unwrap();
        write(&params, &room, SyntheticLayout::Blender(DepthBits::Sixteen), &mut |_, _| {})
            .unwrap();
        room
    }

    /// Starts a worker that has trained one frame of a room; it panics while `armed` is set.
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
    fn a_panic_while_a_file_is_written_keeps_the_older_file_and_the_run() {
        let folder = tempfile::tempdir().unwrap();
        let worker: Arc<OnceLock<Weak<Worker>>> = Arc::default();
        let (writer, told) = (worker.clone(), AtomicBool::new(false));
        // Panics in the trainer while it writes a file, after the older one exists.
        let waker: Waker = Arc::new(move || {
            let writer = writer.get().and_then(Weak::upgrade);
            let writes = writer.is_some_and(|writer| writer.file_progress().is_some());
            assert!(!writes || told.swap(true, Ordering::SeqCst), "injected into a file");
        });
        let started = Worker::start_with(waker, vec![folder.path().to_owned()]).unwrap();
        let started = Arc::new(started);
        started.send(WorkerOrder::Open(Subject::Path(room(folder.path()))));
        started.send(WorkerOrder::Step);
        let file = folder.path().join("scene.ply");
        std::fs::write(&file, "older").unwrap();
        wait("a frame", || started.snapshot().frames_done == 1);
        worker.set(Arc::downgrade(&started)).unwrap();
        let export = |number| {
            let left_out = LeftOut::default();
            WorkerOrder::Export(number, file.clone(), Mapping::default(), left_out)
        };
        started.send(export(1));
        wait("the crash", || started.crash().is_some());
        let path = folder.path().join("room-rescued.vbgs");
        let crash = started.crash().unwrap();
        assert_eq!(crash.rescue, Rescue::Saved { path, frames: 1 });
        assert!(crash.panic.message.contains("injected into a file"), "{crash}");
        assert_eq!(std::fs::read(&file).unwrap(), b"older");
        assert!(started.file_progress().is_none(), "nothing is being written any more");

        started.send(export(2));
        wait("the file", || started.snapshot().latest_write.is_some_and(|w| w.is_written));
        assert!(crate::export::read(&file).is_ok(), "the scene is still there to be exported");
        let is_temporary = |name: &std::ffi::OsStr| name.to_string_lossy().ends_with(".tmp");
        let left = std::fs::read_dir(folder.path()).unwrap();
        assert_eq!(left.filter(|f| is_temporary(&f.as_ref().unwrap().file_name())).count(), 0);
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
