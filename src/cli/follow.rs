//! `train --follow`: waiting for frames that are still recorded.

use super::failure::Failure;
use super::interrupt::Interrupt;
use std::sync::Arc;
use std::time::{Duration, Instant};
use vbgs_studio::dataset::Dataset;
use vbgs_studio::dataset::growing::END_MARKER;
use vbgs_studio::pipeline::checkpoint::RunError;
use vbgs_studio::pipeline::follow::Follow;
use vbgs_studio::pipeline::session::Session;

/// A problem that is still there after so long is told: most are over with the next write.
const LASTING: Duration = Duration::from_secs(2);

/// A session on the first frames that are whole, however long they take to come. It looks at some of them,
/// which a drive that has fallen silent does not give.
pub fn begin(
    mut follow: Follow,
    interrupt: &Interrupt,
    session: impl Fn(Arc<Dataset>) -> Result<Session, RunError> + Send + Sync + 'static,
) -> Result<Session, Failure> {
    let path = follow.path().display();
    eprintln!("note: following {path}, until {END_MARKER} is in it or Ctrl-C");
    let mut told = ToldProblem::default();
    let session = Arc::new(session);
    while !interrupt.is_asked() {
        if let Some(dataset) = follow.more()? {
            let session = session.clone();
            match interrupt.unless_asked(move || session(dataset))? {
                Ok(mut session) => {
                    session.follow(Some(follow));
                    return Ok(session);
                }
                Err(RunError::Session(error)) if follow.forgives(&error) => {}
                Err(error) => return Err(error.into()),
            }
        }
        told.wait(&follow, interrupt);
    }
    Err(Failure::Interrupted)
}

/// What was told of why nothing comes.
#[derive(Default)]
pub struct ToldProblem {
    /// The problem there is, since when, and whether it was told.
    latest: Option<(String, Instant, bool)>,
}

impl ToldProblem {
    /// Rests until there may be more, or the user asks to stop; tells what keeps it from coming, once.
    pub fn wait(&mut self, follow: &Follow, interrupt: &Interrupt) {
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
        // Never without a rest, however late it is.
        interrupt.is_asked_within(follow.rest().max(Duration::from_millis(1)));
    }
}
