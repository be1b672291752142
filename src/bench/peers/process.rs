//! Another program that learns the same frames, asked frame by frame.
//!
//! It is started with the folder of the frames as its last argument, prints `"ready"` when it has read
//! them, then reads numbers of frames, one a line, and answers each by `{"ms": …}`; `{"error": "…"}`
//! says why it cannot go on. Lines that are nothing of this are not for us.

use serde::Deserialize;
use std::ffi::OsString;
use std::io::{BufRead, BufReader, Lines, Write};
use std::path::Path;
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};

/// A program to compare with.
#[derive(Clone, Debug)]
pub struct PeerCommand {
    /// What tables call it.
    pub name: String,
    /// The program.
    pub program: OsString,
    /// Its arguments before the folder of the frames.
    pub arguments: Vec<OsString>,
}

impl PeerCommand {
    /// Open3D's fusion into a truncated signed distance, by a Python that has Open3D.
    pub fn open3d(python: &Path) -> Self {
        let arguments = vec!["-c".into(), include_str!("open3d.py").into()];
        Self { name: "Open3D TSDF".to_owned(), program: python.into(), arguments }
    }

    /// The published implementation in a checkout of its repository, by a Python that has what it needs.
    pub fn published(python: &Path, checkout: &Path) -> Self {
        let script = include_str!("published.py");
        let arguments = vec!["-c".into(), script.into(), checkout.into()];
        Self { name: "published, dense".to_owned(), program: python.into(), arguments }
    }
}

/// Why a program gives no times.
#[derive(Debug, thiserror::Error)]
pub enum PeerError {
    /// It is not there.
    #[error(
        "{name}: `{program}` does not start: {source}; install it, or leave the comparison with it out"
    )]
    Start {
        /// What tables call it.
        name: String,
        /// The program.
        program: String,
        /// What the system said.
        source: std::io::Error,
    },
    /// It says so itself.
    #[error("{name}: {reason}")]
    Refused {
        /// What tables call it.
        name: String,
        /// In its own words.
        reason: String,
    },
    /// It ended, or answered what nobody understands.
    #[error("{name}: expected a line such as {expected}, found {found}")]
    Answer {
        /// What tables call it.
        name: String,
        /// Such a line.
        expected: &'static str,
        /// What came instead.
        found: String,
    },
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum Answer {
    Ready,
    Ms(f64),
    Error(String),
}

/// The program while it runs; ends with its handle.
pub(super) struct PeerProcess {
    name: String,
    child: Child,
    asks: Option<ChildStdin>,
    answers: Option<Lines<BufReader<ChildStdout>>>,
}

impl PeerProcess {
    /// Starts it on a folder of frames and waits until it is ready.
    pub fn start(command: &PeerCommand, frames: &Path) -> Result<Self, PeerError> {
        let PeerCommand { name, program, arguments } = command;
        let started = Command::new(program)
            .args(arguments)
            .arg(frames)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn();
        let mut child = started.map_err(|source| PeerError::Start {
            name: name.clone(),
            program: program.to_string_lossy().into_owned(),
            source,
        })?;
        let (asks, out) = (child.stdin.take(), child.stdout.take());
        let answers = out.map(|out| BufReader::new(out).lines());
        let mut process = Self { name: name.clone(), child, asks, answers };
        match process.answer()? {
            Some(Answer::Ready) => Ok(process),
            other => Err(process.unexpected("\"ready\"", other)),
        }
    }

    /// Milliseconds that it takes to learn a frame.
    pub fn learn(&mut self, frame: usize) -> Result<f64, PeerError> {
        // One that has ended is told from what it does not answer.
        let asked = self.asks.as_mut().map(|asks| writeln!(asks, "{frame}"));
        drop(asked);
        match self.answer()? {
            Some(Answer::Ms(ms)) if ms > 0.0 && ms.is_finite() => Ok(ms),
            other => Err(self.unexpected("{\"ms\": 12.5}", other)),
        }
    }

    /// The next line that is for us; `None` after the last.
    fn answer(&mut self) -> Result<Option<Answer>, PeerError> {
        let lines = self.answers.iter_mut().flatten().map_while(Result::ok);
        match lines.filter_map(|line| serde_json::from_str(&line).ok()).next() {
            Some(Answer::Error(reason)) => {
                Err(PeerError::Refused { name: self.name.clone(), reason })
            }
            answer => Ok(answer),
        }
    }

    fn unexpected(&mut self, expected: &'static str, found: Option<Answer>) -> PeerError {
        let found = found.map_or_else(
            || match self.child.wait() {
                Ok(status) => format!("its end ({status})"),
                Err(error) => error.to_string(),
            },
            |answer| format!("{answer:?}"),
        );
        PeerError::Answer { name: self.name.clone(), expected, found }
    }
}

impl Drop for PeerProcess {
    fn drop(&mut self) {
        // It may have ended already; nobody is left to tell.
        drop(self.child.kill());
        drop(self.child.wait());
    }
}
