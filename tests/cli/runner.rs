//! Runs the binary in a temporary folder and checks how it ended.

use crate::common::layouts::{TestLayout, write};
use crate::common::scratch::Files;
use serde_json::Value;
use std::fs;
use std::path::PathBuf;
use std::process::{Child, Command, Output, Stdio};
use std::sync::OnceLock;
use std::time::{Duration, Instant};
use tempfile::TempDir;
use vbgs_studio::dataset::synthetic::SyntheticParams;
use vbgs_studio::export::Imported;

/// Longest wait for a program to begin or to end.
pub const PATIENCE: Duration = Duration::from_secs(120);

/// A temporary folder, removed after the test.
pub struct Scratch(TempDir);

/// Exit code and output of a run.
pub struct Run {
    pub code: i32,
    pub stdout: String,
    pub stderr: String,
}

impl Scratch {
    pub fn empty() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    /// Creates a dataset `room` of 8 training and 3 evaluation frames of 64×48 with `synth`.
    pub fn with_room() -> Self {
        static ROOM: OnceLock<Files> = OnceLock::new();
        Self::copy_of(&ROOM, || {
            let scratch = Self::empty();
            scratch.run("synth room --size 64x48 --frames 8 --eval-frames 3").succeeds();
            scratch
        })
    }

    /// Writes a recording of 64×48 pixels in any layout, also those that `synth` does not write.
    pub fn record(&self, name: &str, layout: TestLayout, n_train: usize, n_eval: usize) {
        let params =
            SyntheticParams { width: 64, height: 48, n_train, n_eval, ..SyntheticParams::demo() };
        write(&params, &self.path(name), layout, &mut |_, _| ()).unwrap();
    }

    /// Creates the room and a small scene `out/scene.ply` trained on it.
    pub fn with_scene() -> Self {
        static SCENE: OnceLock<Files> = OnceLock::new();
        Self::copy_of(&SCENE, || {
            let scratch = Self::with_room();
            scratch.run("train room --out out --preset paper --set components=2000").succeeds();
            scratch
        })
    }

    /// Makes files once and gives each test a copy.
    fn copy_of(kept: &OnceLock<Files>, make: impl FnOnce() -> Self) -> Self {
        let files = kept.get_or_init(|| Files::read(make().0.path()));
        let scratch = Self::empty();
        files.write(scratch.0.path());
        scratch
    }

    pub fn path(&self, relative: &str) -> PathBuf {
        self.0.path().join(relative)
    }

    pub fn bytes(&self, relative: &str) -> Vec<u8> {
        fs::read(self.path(relative)).unwrap_or_else(|e| panic!("{relative}: {e}"))
    }

    pub fn json(&self, relative: &str) -> Value {
        serde_json::from_slice(&self.bytes(relative)).unwrap()
    }

    pub fn model(&self, relative: &str) -> Imported {
        vbgs_studio::export::read(&self.path(relative)).unwrap()
    }

    /// Command of the binary in this folder.
    pub fn command(&self, arguments: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_vbgs-studio"));
        command.args(arguments).current_dir(self.0.path()).stdin(Stdio::null());
        command
    }

    /// Runs with arguments that contain no spaces.
    pub fn run(&self, arguments: &str) -> Run {
        self.run_args(&arguments.split_whitespace().collect::<Vec<_>>())
    }

    /// Starts the binary with arguments that contain no spaces, and captures its output.
    pub fn start(&self, arguments: &str) -> Child {
        let arguments: Vec<&str> = arguments.split_whitespace().collect();
        let mut command = self.command(&arguments);
        command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap()
    }

    /// Waits until a started program has written a file.
    pub fn wait_for(&self, relative: &str) {
        let started = Instant::now();
        while !self.path(relative).exists() {
            assert!(started.elapsed() < PATIENCE, "{relative} was not written in time");
            std::thread::sleep(Duration::from_millis(1));
        }
    }

    pub fn run_args(&self, arguments: &[&str]) -> Run {
        Run::from(self.command(arguments).output().unwrap())
    }
}

/// Sends a signal such as `INT`.
pub fn signal(name: &str, child: &Child) {
    // `kill` is a builtin of every shell, but not every system has it as a program.
    let kill = format!("kill -{name} {}", child.id());
    assert!(Command::new("sh").args(["-c", &kill]).status().unwrap().success());
}

/// Waits for the end of a started program.
pub fn end(child: Child) -> Run {
    Run::from(child.wait_with_output().unwrap())
}

impl From<Output> for Run {
    fn from(output: Output) -> Self {
        // A signal has no exit status: another process ended this one.
        let code = output.status.code().unwrap_or_else(|| panic!("ended by {}", output.status));
        Self {
            code,
            stdout: String::from_utf8(output.stdout).unwrap(),
            stderr: String::from_utf8(output.stderr).unwrap(),
        }
    }
}

impl Run {
    #[track_caller]
    pub fn succeeds(self) -> Self {
        assert_eq!(self.code, 0, "{}{}", self.stdout, self.stderr);
        self
    }

    /// Asserts this exit code, an empty stdout, and exactly one error on stderr that contains all parts.
    #[track_caller]
    pub fn fails(self, code: i32, parts: &[&str]) -> Self {
        assert_eq!(self.code, code, "{}{}", self.stdout, self.stderr);
        assert_eq!(self.stdout, "", "nothing on stdout");
        let errors: Vec<&str> =
            self.stderr.lines().filter(|line| line.starts_with("error: ")).collect();
        assert_eq!(errors.len(), 1, "one message: {}", self.stderr);
        for part in parts {
            assert!(errors[0].contains(part), "`{part}` is missing from: {}", errors[0]);
        }
        assert!(!self.stderr.contains("panicked"), "{}", self.stderr);
        self
    }

    /// Parses stdout as one JSON document.
    #[track_caller]
    pub fn json(&self) -> Value {
        serde_json::from_str(&self.stdout).unwrap_or_else(|e| panic!("{e}: {}", self.stdout))
    }
}
