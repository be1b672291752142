//! `train --follow`: waits for frames that are still being recorded.

use super::failure::Failure;
use super::interrupt::Interrupt;
use std::sync::Arc;
use std::time::{Duration, Instant};
use vbgs_studio::dataset::Dataset;
use vbgs_studio::dataset::growing::END_MARKER;
use vbgs_studio::pipeline::checkpoint::RunError;
use vbgs_studio::pipeline::follow::Follow;
use vbgs_studio::pipeline::session::Session;

/// A problem is reported after this time; most disappear with the next write.
const LASTING: Duration = Duration::from_secs(2);

/// Creates a session on the first complete frames, waiting for them as long as needed. Reading them may
/// block on an unresponsive drive, so it remains interruptible.
pub fn begin(
    mut follow: Follow,
    interrupt: &Interrupt,
    session: impl Fn(Arc<Dataset>) -> Result<Session, RunError> + Send + Sync + 'static,
) -> Result<Session, Failure> {
    let path = follow.path().display();
    eprintln!("note: following {path}, until {END_MARKER} is in it or Ctrl-C");
    let mut told = ReportedProblem::default();
    let session = Arc::new(session);
    while !interrupt.is_requested() {
        if let Some(dataset) = follow.poll_dataset()? {
            let session = session.clone();
            match interrupt.run_interruptibly(move || session(dataset))? {
                Ok(mut session) => {
                    session.follow(Some(follow));
                    return Ok(session);
                }
                Err(RunError::Session(error)) if follow.may_succeed_later(&error) => {}
                Err(error) => return Err(error.into()),
            }
        }
        told.wait_for_frames(&follow, interrupt);
    }
    Err(Failure::Interrupted)
}

/// The problem that currently delays frames.
#[derive(Default)]
pub struct ReportedProblem {
    /// The problem, its start, and true if it was reported.
    latest: Option<(String, Instant, bool)>,
}

impl ReportedProblem {
    /// Waits for more frames or an interrupt; reports a lasting problem once.
    pub fn wait_for_frames(&mut self, follow: &Follow, interrupt: &Interrupt) {
        match (follow.problem(), &mut self.latest) {
            (None, latest) => *latest = None,
            (Some(problem), Some((known, since, is_told))) if *known == problem => {
                if !*is_told && since.elapsed() > LASTING {
                    eprintln!("note: waiting: {problem}");
                    *is_told = true;
                }
            }
            (Some(problem), latest) => *latest = Some((problem.to_owned(), Instant::now(), false)),
        }
        // Never without a pause, however late the next poll is.
        interrupt.wait_for_request(follow.time_to_next_scan().max(Duration::from_millis(1)));
    }
}
