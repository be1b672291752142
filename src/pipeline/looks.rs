//! Scans of a recording in progress, each on its own thread: a drive that does not respond never blocks
//! saving.

use crate::dataset::error::DatasetError;
use crate::dataset::growing::GrowingRecording;
use crate::dataset::{Dataset, FrameMarks};
use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel, sync_channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::{Builder, JoinHandle};
use std::time::{Duration, Instant};
use std::{io, thread};

/// Result of a scan.
pub(super) enum ScanFindings {
    /// No complete new frame.
    Nothing,
    Frames(Dataset),
    /// The recording has ended; with the frames found before the end.
    End(Option<Dataset>),
}

pub(super) struct ScanResult {
    pub found: Result<ScanFindings, DatasetError>,
    /// True if the recorder has written its last file.
    pub has_ended: bool,
    /// Time spent reading; `None` if there was nothing to read.
    pub took: Option<Duration>,
}

/// Recording, and its scan in progress, if any.
pub(super) struct Scans {
    // Locked by the scan thread for as long as the drive takes.
    recording: Arc<Mutex<GrowingRecording>>,
    under_way: Option<UnderWay>,
    /// Frames given back during a scan.
    returned: Vec<(String, FrameMarks)>,
}

struct UnderWay {
    since: Instant,
    answer: Receiver<ScanResult>,
    thread: JoinHandle<()>,
}

impl Scans {
    pub fn new(recording: GrowingRecording) -> Self {
        let recording = Arc::new(Mutex::new(recording));
        Self { recording, under_way: None, returned: Vec::new() }
    }

    /// Returns the recording; `None` during a scan.
    pub fn recording(&self) -> Option<MutexGuard<'_, GrowingRecording>> {
        match self.under_way {
            Some(_) => None,
            None => Some(lock(&self.recording)),
        }
    }

    pub fn scan_elapsed(&self) -> Option<Duration> {
        self.under_way.as_ref().map(|look| look.since.elapsed())
    }

    /// Starts a scan, `now_s` seconds after the first one. With `retries`, it also scans if unresolved frames
    /// exist although no folder or list has changed.
    ///
    /// # Errors
    /// The system cannot start a thread.
    pub fn start_scan(&mut self, retries: bool, now_s: f64) -> std::io::Result<()> {
        for (frame, marks) in self.returned.drain(..) {
            lock(&self.recording).return_frame(frame, marks);
        }
        let (tell, answer) = channel();
        let recording = Arc::clone(&self.recording);
        let thread = Builder::new().name("look".into()).spawn(move || {
            // The receiver may be gone.
            let _ = tell.send(scan(&mut lock(&recording), retries, now_s));
        })?;
        self.under_way = Some(UnderWay { since: Instant::now(), answer, thread });
        Ok(())
    }

    /// Waits up to `patience` for the scan in progress and returns its result.
    ///
    /// # Panics
    /// If the scan panicked.
    pub fn wait(&mut self, patience: Duration) -> Option<ScanResult> {
        let look = self.under_way.take()?;
        match look.answer.recv_timeout(patience) {
            Ok(looked) => {
                // The thread releases the recording when it ends.
                let _ = look.thread.join();
                Some(looked)
            }
            Err(RecvTimeoutError::Timeout) => {
                self.under_way = Some(look);
                None
            }
            Err(RecvTimeoutError::Disconnected) => {
                look.thread.join().unwrap_or_else(|panic| resume_unwind(panic));
                None
            }
        }
    }

    /// Allows an unreadable frame to be found again once its files have changed.
    pub fn give_back(&mut self, frame: String, marks: FrameMarks) {
        match self.under_way {
            Some(_) => self.returned.push((frame, marks)),
            None => lock(&self.recording).return_frame(frame, marks),
        }
    }
}

fn lock(recording: &Mutex<GrowingRecording>) -> MutexGuard<'_, GrowingRecording> {
    recording.lock().unwrap_or_else(PoisonError::into_inner)
}

fn scan(recording: &mut GrowingRecording, retries: bool, now_s: f64) -> ScanResult {
    // Checked before the scan: once the recorder has ended, the scan is complete.
    let has_ended = recording.has_ended();
    let retries = retries && recording.is_unresolved();
    if !(has_ended || retries || recording.has_changed()) {
        return ScanResult { found: Ok(ScanFindings::Nothing), has_ended, took: None };
    }
    let begun = Instant::now();
    let found = recording.poll(!has_ended, now_s);
    let found = match (found, has_ended) {
        (Err(error), _) => Err(error),
        (Ok(found), true) => Ok(ScanFindings::End(Some(found))),
        (Ok(found), false) => match recording.mark_taken(&found) {
            0 if !recording.has_begun() => Err(recording.empty_poll_error(found)),
            0 => Ok(ScanFindings::Nothing),
            _ => Ok(ScanFindings::Frames(found)),
        },
    };
    ScanResult { found, has_ended, took: Some(begun.elapsed()) }
}

/// Work in progress; dropping it abandons the work.
pub struct DriveWork<T> {
    since: Instant,
    answers: Receiver<thread::Result<T>>,
}

impl<T: Send + 'static> DriveWork<T> {
    /// Starts the work on a thread with this name.
    ///
    /// # Errors
    /// The system cannot start a thread.
    pub fn start(name: &str, work: impl FnOnce() -> T + Send + 'static) -> io::Result<Self> {
        let (answer, answers) = sync_channel(1);
        Builder::new().name(name.to_owned()).spawn(move || {
            // Unwind-safe, because only the result is used afterwards. Sending fails if the work was
            // abandoned.
            let _ = answer.send(catch_unwind(AssertUnwindSafe(work)));
        })?;
        Ok(Self { since: Instant::now(), answers })
    }

    /// Waits up to `patience` for the result or the panic that ended the work; available once.
    pub fn wait(&self, patience: Duration) -> Option<thread::Result<T>> {
        match self.answers.recv_timeout(patience) {
            Ok(ended) => Some(ended),
            Err(RecvTimeoutError::Timeout) => None,
            Err(RecvTimeoutError::Disconnected) => {
                let ended: Box<dyn Any + Send> = Box::new("the thread ended without a result");
                Some(Err(ended))
            }
        }
    }

    /// Time since the start.
    pub fn elapsed(&self) -> Duration {
        self.since.elapsed()
    }
}

#[cfg(test)]
mod drive_work_tests {
    use super::*;
    use crate::pipeline::panic_report::PanicReport;
    use std::sync::mpsc::channel;

    const PATIENCE: Duration = Duration::from_secs(60);

    #[test]
    fn answers_and_panics_come_and_silence_is_not_waited_for() {
        let (speak, silence) = channel::<u32>();
        let work = DriveWork::start("test", move || silence.recv().unwrap()).unwrap();
        assert!(work.wait(Duration::from_millis(1)).is_none());
        speak.send(7).unwrap();
        assert_eq!(work.wait(PATIENCE).unwrap().unwrap(), 7);
        let work = DriveWork::start("test", || panic!("injected into work: {}", 3)).unwrap();
        let ended: thread::Result<()> = work.wait(PATIENCE).unwrap();
        let report = PanicReport::of(&*ended.unwrap_err());
        assert_eq!(report.message, "injected into work: 3");
    }
}
