//! Failures of a command and their exit status.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::process::ExitCode;
use vbgs_studio::dataset::calibration::AspectRatioMismatch;
use vbgs_studio::dataset::error::DatasetError;
use vbgs_studio::dataset::synthetic::ParamsError;
use vbgs_studio::pipeline::checkpoint::RunError;
use vbgs_studio::pipeline::panic_report::PanicReport;
use vbgs_studio::pipeline::session::Session;
use vbgs_studio::train::setting::ConfigError;

/// Exit status that shells report for a process ended by Ctrl-C: 128 plus the signal's number.
pub const INTERRUPTED: u8 = 130;

/// Reason why a command failed.
pub enum Failure {
    /// Failure other than wrong usage, with exit status 1.
    Failed(anyhow::Error),
    /// Wrong usage of the command line, with exit status 2.
    Usage(String),
    /// Stopped by Ctrl-C or another signal, with exit status 130. Requested files were saved.
    Interrupted,
}

impl Failure {
    pub fn failed(error: impl Into<anyhow::Error>) -> Self {
        Self::Failed(error.into())
    }

    /// Adds the name of the calibration file to an error caused by the calibration.
    pub fn with_calibration_file(self, file: Option<&Path>) -> Self {
        match (self, file) {
            (Self::Failed(error), Some(file))
                if error.chain().any(|cause| cause.is::<AspectRatioMismatch>()) =>
            {
                Self::Failed(error.context(file.display().to_string()))
            }
            (failure, _) => failure,
        }
    }

    /// Returns one failure for all; `None` without any.
    pub fn joined(failures: Vec<Self>) -> Option<Self> {
        let mut failures = failures.into_iter();
        let first = failures.next()?;
        Some(failures.fold(first, |all, next| match (all, next) {
            (Self::Failed(all), Self::Failed(next)) => {
                Self::Failed(anyhow::anyhow!("{}\nerror: {}", message(&all), message(&next)))
            }
            (all, _) => all,
        }))
    }

    /// Prints the error and returns the exit status.
    pub fn report(self) -> ExitCode {
        match self {
            Self::Failed(error) => {
                note!("error: {}", message(&error));
                ExitCode::FAILURE
            }
            Self::Usage(message) => {
                // In the form of clap's own usage errors.
                note!("error: {message}\n\nFor more information, try '--help'.");
                ExitCode::from(2)
            }
            Self::Interrupted => ExitCode::from(INTERRUPTED),
        }
    }
}

// Permitted only because `Failure` is not an error itself; otherwise this would conflict with the
// standard library's `From<T> for T`.
impl<E: Into<anyhow::Error>> From<E> for Failure {
    fn from(error: E) -> Self {
        let error = error.into();
        if is_usage(&error) { Self::Usage(message(&error)) } else { Self::Failed(error) }
    }
}

/// Formats an error, followed by the causes that its text does not include.
fn message(error: &anyhow::Error) -> String {
    let mut text = error.to_string();
    // Wrappers often repeat the text of their cause.
    for cause in error.chain().map(ToString::to_string) {
        if !text.contains(&cause) {
            text = format!("{text}: {cause}");
        }
    }
    text
}

/// True if the error is a wrong setting. Searches the chain of causes, because sessions and benchmarks
/// wrap errors of their settings.
fn is_usage(error: &anyhow::Error) -> bool {
    error.chain().any(|cause| {
        cause.is::<ConfigError>()
            || cause.is::<ParamsError>()
            || matches!(cause.downcast_ref(), Some(DatasetError::Option { .. }))
            || matches!(cause.downcast_ref(), Some(RunError::Conflict { .. }))
    })
}

/// File for the scene of a run that panicked. Its name differs from that of regular checkpoints, because
/// the last frame may be incomplete in it.
const RESCUED: &str = "checkpoint-rescued.vbgs";

/// Runs a training and returns its result. If it panics, saves the scene.
///
/// # Errors
/// The error of the training, or a panic. The message of a panic states where the scene was saved.
pub fn save_on_panic<T>(
    session: &mut Session,
    out: &Path,
    train: impl FnOnce(&mut Session) -> T,
) -> Result<T, Failure> {
    // Safe to assert: after a panic, only `save_after_panic` reads the session.
    catch_unwind(AssertUnwindSafe(|| train(session))).map_err(|panic| {
        let said = PanicReport::of(&*panic);
        let (frames, path) = (session.learner().status().frames, out.join(RESCUED));
        let save = || match session.save_after_panic(&path) {
            Ok(()) => format!(
                "the scene with its {frames} frames is in {}: continue with --resume, or export it",
                path.display()
            ),
            Err(problem) => {
                format!("the scene with its {frames} frames cannot be saved: {problem}")
            }
        };
        let rescued = if frames > 0 { save() } else { "no frame was trained yet".to_owned() };
        failed!("training crashed because of a bug, please report it: {said}; {rescued}")
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use vbgs_studio::bench::findings::BenchError;
    use vbgs_studio::export::{ExportError, Fault};
    use vbgs_studio::pipeline::error::SessionError;
    use vbgs_studio::pipeline::session::DemoError;
    use vbgs_studio::pipeline::settings::scene::SceneError;

    #[test]
    fn a_wrong_setting_is_wrong_usage_however_deep_it_lies() {
        let config = || ConfigError {
            setting: "budget (`--budget`)",
            expected: "1".into(),
            found: "0".into(),
        };
        let scene = || SceneError::from(config());
        let session = || SessionError::from(scene());
        for failure in [
            Failure::from(config()),
            Failure::from(scene()),
            Failure::from(session()),
            Failure::from(DemoError::from(session())),
            Failure::from(BenchError::from(session())),
            Failure::from(RunError::from(session())),
            Failure::from(anyhow::Error::new(session()).context("the first run")),
        ] {
            assert!(
                matches!(&failure, Failure::Usage(text) if text.contains("budget (`--budget`): expected"))
            );
        }
        let error = anyhow::Error::new(session()).context("the first run");
        let expected = "the first run: budget (`--budget`): expected 1, found 0";
        assert_eq!(message(&error), expected, "every cause once");
        let fault = ExportError { path: "a.ply".into(), fault: Fault::IsFolder };
        assert!(matches!(Failure::from(fault), Failure::Failed(_)));
        let noise = SceneError::BelowNoise { least: 1.0, found: 0.5, near: 1.0, far: 2.0 };
        assert!(matches!(Failure::from(noise), Failure::Failed(_)), "the files are to blame too");
    }
}

#[cfg(test)]
mod crash_tests {
    use super::*;
    use std::sync::Arc;
    use vbgs_studio::dataset::synthetic::{SyntheticParams, dataset};
    use vbgs_studio::pipeline::checkpoint::SavedRun;
    use vbgs_studio::pipeline::plan::Selection;
    use vbgs_studio::pipeline::settings::scene::SceneOverrides;

    /// Runs a training that panics after `after` frames. Returns the error message and the number of
    /// saved frames.
    fn crashed(after: usize) -> (String, Option<u64>) {
        let small = SyntheticParams {
            width: 32,
            height: 24,
            n_train: 4,
            n_eval: 0,
            ..SyntheticParams::demo()
        };
        let room = Arc::new(dataset(&small).unwrap());
        let mut session =
            Session::new(room, SceneOverrides::default(), Selection::all_frames()).unwrap();
        let out = tempfile::tempdir().unwrap();
        let ended: Result<(), _> = save_on_panic(&mut session, out.path(), |session| {
            (0..after).for_each(|_| drop(session.step().unwrap()));
            panic!("injected behind {after}")
        });
        let Err(Failure::Failed(error)) = ended else { panic!("a failure") };
        let rescued = SavedRun::read(&out.path().join(RESCUED));
        (error.to_string(), rescued.ok().map(|run| run.content.cursor.frames))
    }

    #[test]
    fn a_panic_of_training_costs_no_frame_and_is_told() {
        let (said, frames) = crashed(3);
        assert_eq!(frames, Some(3));
        for part in ["injected behind 3", "its 3 frames", RESCUED, "--resume"] {
            assert!(said.contains(part), "{part:?} is missing in: {said}");
        }
        let (said, frames) = crashed(0);
        assert!(said.contains("no frame was trained") && frames.is_none(), "{said}");
    }
}
