//! Autosave of the training run, which is also stored when the program ends unexpectedly.
//!
//! Nothing is written before training has lasted the interval, and nothing of the demo, which can be
//! recomputed. The autosave is removed once the user has saved the run to a file or discarded it.

use crate::app::rescue::{self, AbandonedRun, AutosaveSlot, Rescue};
use crate::pipeline::autosave::{Autosave, AutosaveInterval};
use crate::pipeline::session::Session;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

pub struct Files {
    /// Folders for slots; the further ones are only used when the program ends unexpectedly.
    folders: Vec<PathBuf>,
    saver: Saver,
    /// Number of trained frames that no checkpoint contains.
    n_unsaved: usize,
}

enum Saver {
    /// Nothing was saved yet. Holds the time of the first unsaved frame, if there is one.
    Waiting(Option<Instant>),
    On(Autosave, AutosaveSlot),
    /// Autosave failed, after a warning, or does not apply to the subject.
    Off,
    /// The run was stored because of a panic or a termination; its slot is released.
    Stored(Rescue),
}

impl Files {
    pub fn new(folders: Vec<PathBuf>) -> Self {
        Self { folders, saver: Saver::Off, n_unsaved: 0 }
    }

    pub fn record_frame(&mut self) {
        self.n_unsaved += 1;
    }

    pub fn record_save(&mut self) {
        // The slot was released, so that another window may hold it.
        if let Saver::Stored(Rescue::Stored { path, .. }) = &self.saver
            && let Ok(Some(slot)) = AutosaveSlot::lock_existing(path)
        {
            slot.delete_files();
        }
        self.discard();
    }

    /// Deletes the autosave of a run that the user has saved or discarded, and prepares for the next run.
    /// A stored run stays for the next start.
    pub fn discard(&mut self) {
        self.n_unsaved = 0;
        let saver = std::mem::replace(&mut self.saver, Saver::Waiting(None));
        if let Saver::On(autosave, slot) = saver {
            // Dropped first, because it may still write to the slot.
            drop(autosave);
            slot.delete_files();
        }
    }

    /// Starts an autosave if one is due; returns a warning if one has failed.
    pub fn poll(&mut self, session: &Session, time: Duration) -> Option<String> {
        match &mut self.saver {
            Saver::Off | Saver::Stored(_) => None,
            Saver::On(autosave, _) => {
                // The user may change the interval at any time.
                autosave.set_interval(AutosaveInterval { frames: None, time: Some(time) });
                autosave.poll(session)?.err().map(|error| error.to_string())
            }
            Saver::Waiting(_) if self.n_unsaved == 0 => None,
            Saver::Waiting(since) => {
                // Counted from the first unsaved frame: a short run leaves no file.
                let is_due = since.get_or_insert_with(Instant::now).elapsed() >= time;
                if is_due { self.start(session).err() } else { None }
            }
        }
    }

    /// True if an autosave may start or end without an order or a trained frame.
    pub fn is_pending(&self, session: &Session) -> bool {
        match &self.saver {
            Saver::Off | Saver::Stored(_) => false,
            Saver::Waiting(_) => self.n_unsaved > 0,
            Saver::On(autosave, _) => autosave.is_pending(session),
        }
    }

    fn start(&mut self, session: &Session) -> Result<(), String> {
        // Stays off if no slot can be claimed, so that the user is warned once.
        self.saver = Saver::Off;
        // The demo has no path; it can be recomputed and is not saved.
        let (Some(folder), Some(dataset)) = (self.folders.first(), &session.dataset().path) else {
            return Ok(());
        };
        let slot = AutosaveSlot::claim(folder, dataset).map_err(|error| {
            format!(
                "{}: autosave is off for this run: {error}; use Save to write it to a folder of your choice",
                folder.display()
            )
        })?;
        let path = slot.path().to_owned();
        let mut autosave = Autosave::new(path, AutosaveInterval::default(), session);
        let begun = autosave.start_save(session).map_err(|error| error.to_string());
        self.saver = Saver::On(autosave, slot);
        begun
    }

    /// Continues the autosave in the slot of a resumed run.
    pub fn adopt(&mut self, slot: AutosaveSlot, session: &Session) {
        let path = slot.path().to_owned();
        let autosave = Autosave::new(path, AutosaveInterval::default(), session);
        self.saver = Saver::On(autosave, slot);
        // None of these frames are in a file of the user's.
        self.n_unsaved = session.learner().status().frames as usize;
    }

    /// Finds the newest run that an earlier window left behind, of one dataset or of any.
    pub fn find_abandoned(&self, dataset: Option<&Path>) -> Option<AbandonedRun> {
        rescue::find_newest(&self.folders, dataset)
    }

    /// Stores training that no checkpoint holds for the next start, once, even if autosave is off. The
    /// demo is not stored.
    pub fn store(&mut self, session: Option<&Session>) -> Rescue {
        // A panic and the end of the program may both store the same state.
        if let Saver::Stored(known) = &self.saver {
            return known.clone();
        }
        let frames = self.n_unsaved;
        let Some(session) = session.filter(|_| frames > 0) else { return Rescue::Nothing };
        let Some(dataset) = &session.dataset().path else { return Rescue::Nothing };
        let used = match std::mem::replace(&mut self.saver, Saver::Off) {
            Saver::On(autosave, slot) => {
                // Dropped first, because it may still write to the slot.
                drop(autosave);
                Some(slot)
            }
            _ => None,
        };
        let others = self.folders.iter().map(|folder| {
            AutosaveSlot::claim(folder, dataset)
                .map_err(|error| format!("{}: {error}", folder.display()))
        });
        let mut problems = Vec::new();
        let mut rescue = None;
        // The slot in use comes first: it holds an older state of the same run.
        for slot in used.map(Ok).into_iter().chain(others) {
            let stored = slot.and_then(|slot| {
                let path = slot.path().to_owned();
                session.save_after_panic(&path).map(|()| path)
            });
            match stored {
                Ok(path) => {
                    rescue = Some(Rescue::Stored { path, frames });
                    break;
                }
                Err(problem) => problems.push(problem),
            }
        }
        let rescue = rescue.unwrap_or(Rescue::Lost { frames, problems });
        self.saver = Saver::Stored(rescue.clone());
        rescue
    }
}

#[cfg(test)]
mod tests {
    use crate::app::edit::marks::LeftOut;
    use crate::app::rescue::{CrashedThread, Rescue};
    use crate::app::state::{RunState, Subject};
    use crate::app::worker::{Waker, Worker, WorkerOrder};
    use crate::dataset::synthetic::SyntheticParams;
    use crate::dataset::synthetic::write::{DepthBits, SyntheticLayout, write};
    use crate::export::mapping::Mapping;
    use crate::pipeline::checkpoint::SavedRun;
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
    fn worker(room: PathBuf, folders: &[&Path], armed: &Arc<AtomicBool>) -> Arc<Worker> {
        let trigger = armed.clone();
        let waker: Waker = Arc::new(move || {
            assert!(!trigger.load(Ordering::SeqCst), "injected");
        });
        let folders = folders.iter().map(|folder| folder.to_path_buf()).collect();
        let worker = Worker::start_with(waker, folders).unwrap();
        worker.send(WorkerOrder::Open(Subject::Path(room)));
        worker.send(WorkerOrder::Step);
        wait("a frame", || worker.snapshot().frames_done == 1);
        Arc::new(worker)
    }

    /// Checks that a run of one frame is stored below `folder`; returns its path.
    fn stored(rescue: &Rescue, folder: &Path) -> PathBuf {
        let Rescue::Stored { path, frames: 1 } = rescue else { panic!("{rescue}") };
        assert!(path.starts_with(folder.join("autosave")), "{rescue}");
        assert_eq!(SavedRun::read(path).unwrap().content.cursor.frames, 1);
        path.clone()
    }

    #[test]
    fn a_run_is_stored_once_in_the_first_folder_that_takes_it() {
        let folder = tempfile::tempdir().unwrap();
        let (file, state) = (folder.path().join("file"), folder.path().join("state"));
        std::fs::write(&file, "").unwrap();
        let worker = worker(room(folder.path()), &[&file, &state], &Arc::default());
        let rescue = worker.store();
        let path = stored(&rescue, &state);
        assert_eq!(worker.store(), rescue, "the same state is stored once");
        assert!(worker.snapshot().is_terminated);

        let run = folder.path().join("run.vbgs");
        worker.send(WorkerOrder::Save(1, run.clone()));
        wait("the file", || worker.snapshot().files.latest_write.is_some_and(|w| w.is_written));
        assert!(run.is_file() && !path.exists(), "the user's file replaces the stored run");
    }

    #[test]
    fn a_run_that_no_folder_takes_is_lost_and_every_reason_is_given() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("file");
        std::fs::write(&file, "").unwrap();
        let worker = worker(room(folder.path()), &[&file, &file.join("more")], &Arc::default());
        let Rescue::Lost { frames: 1, problems } = worker.store() else { panic!("lost") };
        assert_eq!(problems.len(), 2, "{problems:?}");
    }

    #[test]
    fn a_second_panic_ends_the_thread_and_the_run_stays_stored() {
        let folder = tempfile::tempdir().unwrap();
        let armed = Arc::new(AtomicBool::new(false));
        let worker = worker(room(folder.path()), &[folder.path()], &armed);
        armed.store(true, Ordering::SeqCst);
        worker.send(WorkerOrder::Inspect(None));
        wait("the end", || !worker.is_alive());
        let crash = worker.crash().unwrap();
        assert_eq!(crash.thread, CrashedThread::Training);
        assert!(crash.panic.place.as_ref().is_some_and(|place| place.contains("autosave.rs")));
        assert_eq!(worker.store(), crash.rescue, "known although the thread has ended");
        drop(worker);
        stored(&crash.rescue, folder.path());
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
        let crash = started.crash().unwrap();
        stored(&crash.rescue, folder.path());
        assert!(crash.panic.message.contains("injected into a file"), "{crash}");
        assert_eq!(std::fs::read(&file).unwrap(), b"older");
        assert!(started.file_progress().is_none(), "nothing is being written any more");

        started.send(export(2));
        wait("the file", || started.snapshot().files.latest_write.is_some_and(|w| w.is_written));
        assert!(crate::export::read(&file).is_ok(), "the scene is still there to be exported");
        let is_temporary = |name: &std::ffi::OsStr| name.to_string_lossy().ends_with(".tmp");
        let left = std::fs::read_dir(folder.path()).unwrap();
        assert_eq!(left.filter(|f| is_temporary(&f.as_ref().unwrap().file_name())).count(), 0);
    }

    #[test]
    fn nothing_is_written_where_nothing_was_unsaved() {
        let folder = tempfile::tempdir().unwrap();
        let worker = worker(room(folder.path()), &[folder.path()], &Arc::default());
        worker.send(WorkerOrder::Save(1, folder.path().join("run.vbgs")));
        assert_eq!(worker.store(), Rescue::Nothing);
        assert_eq!(worker.snapshot().state, RunState::Paused);
        assert!(!folder.path().join("autosave").exists());
    }
}
