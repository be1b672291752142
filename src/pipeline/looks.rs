//! Looks at a recording that is under way, each in a thread of its own: a drive that does not answer keeps
//! nobody from saving what was learnt.

use crate::dataset::error::DatasetError;
use crate::dataset::growing::GrowingRecording;
use crate::dataset::{Dataset, FrameMarks};
use std::panic::resume_unwind;
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::{Builder, JoinHandle};
use std::time::{Duration, Instant};

/// What a look found.
pub(super) enum Found {
    /// No frame that is whole.
    Nothing,
    /// Frames.
    Frames(Dataset),
    /// The end of the recording, and what was there before it.
    End(Option<Dataset>),
}

/// What came of a look.
pub(super) struct Looked {
    pub found: Result<Found, DatasetError>,
    /// Whether the recorder wrote its last file.
    pub has_ended: bool,
    /// How long reading took; `None` where there was nothing to read.
    pub took: Option<Duration>,
}

/// A recording and the look at it that is under way, if one is.
pub(super) struct Looks {
    // Whoever looks holds it for as long as the drive takes.
    recording: Arc<Mutex<GrowingRecording>>,
    under_way: Option<UnderWay>,
    /// Given back during a look.
    returned: Vec<(String, FrameMarks)>,
}

struct UnderWay {
    since: Instant,
    answer: Receiver<Looked>,
    thread: JoinHandle<()>,
}

impl Looks {
    pub fn new(recording: GrowingRecording) -> Self {
        let recording = Arc::new(Mutex::new(recording));
        Self { recording, under_way: None, returned: Vec::new() }
    }

    /// The recording; `None` while it is looked at.
    pub fn recording(&self) -> Option<MutexGuard<'_, GrowingRecording>> {
        match self.under_way {
            Some(_) => None,
            None => Some(lock(&self.recording)),
        }
    }

    /// How long a look has been under way, if one is.
    pub fn under_way(&self) -> Option<Duration> {
        self.under_way.as_ref().map(|look| look.since.elapsed())
    }

    /// Begins a look, `now_s` seconds after the first; `retries` where one is worth it although no folder and no
    /// list has changed.
    ///
    /// # Errors
    /// What the system says where it has no thread to spare.
    pub fn begin(&mut self, retries: bool, now_s: f64) -> std::io::Result<()> {
        for (frame, marks) in self.returned.drain(..) {
            lock(&self.recording).give_back(frame, marks);
        }
        let (tell, answer) = channel();
        let recording = Arc::clone(&self.recording);
        let thread = Builder::new().name("look".into()).spawn(move || {
            // Nobody may be waiting any more.
            let _ = tell.send(look(&mut lock(&recording), retries, now_s));
        })?;
        self.under_way = Some(UnderWay { since: Instant::now(), answer, thread });
        Ok(())
    }

    /// What came of the look that is under way, if it ends within that time.
    ///
    /// # Panics
    /// Where the look did.
    pub fn wait(&mut self, patience: Duration) -> Option<Looked> {
        let look = self.under_way.take()?;
        match look.answer.recv_timeout(patience) {
            Ok(looked) => {
                // It has let go of the recording once it is gone.
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

    /// Lets a frame that could not be read be found again when its files no longer look so.
    pub fn give_back(&mut self, frame: String, marks: FrameMarks) {
        match self.under_way {
            Some(_) => self.returned.push((frame, marks)),
            None => lock(&self.recording).give_back(frame, marks),
        }
    }
}

fn lock(recording: &Mutex<GrowingRecording>) -> MutexGuard<'_, GrowingRecording> {
    recording.lock().unwrap_or_else(PoisonError::into_inner)
}

fn look(recording: &mut GrowingRecording, retries: bool, now_s: f64) -> Looked {
    // Asked first: what is there when the recorder has ended is all.
    let has_ended = recording.has_ended();
    let retries = retries && recording.is_unresolved();
    if !(has_ended || retries || recording.has_changed()) {
        return Looked { found: Ok(Found::Nothing), has_ended, took: None };
    }
    let begun = Instant::now();
    let found = recording.look(!has_ended, now_s);
    let found = match (found, has_ended) {
        (Err(error), _) => Err(error),
        (Ok(found), true) => Ok(Found::End(Some(found))),
        (Ok(found), false) => match recording.take(&found) {
            0 if !recording.has_begun() => Err(recording.why_empty(found)),
            0 => Ok(Found::Nothing),
            _ => Ok(Found::Frames(found)),
        },
    };
    Looked { found, has_ended, took: Some(begun.elapsed()) }
}
