//! Failures of a command and their exit status.

use super::wording;
use std::path::Path;
use std::process::ExitCode;
use vbgs_studio::dataset::calibrated_size::AspectRatioMismatch;
use vbgs_studio::dataset::error::DatasetError;
use vbgs_studio::dataset::synthetic::ParamsError;
use vbgs_studio::pipeline::checkpoint::RunError;
use vbgs_studio::train::setting::ConfigError;

/// Exit status that shells report for a process ended by Ctrl-C: 128 plus the signal's number.
pub const INTERRUPTED: u8 = 130;

/// Reason why a command failed.
pub enum Failure {
    /// Exit status 1.
    Failed(anyhow::Error),
    /// Exit status 2.
    Usage(String),
    /// Ctrl-C or another signal; requested files were saved. Exit status 130.
    Interrupted,
}

impl Failure {
    pub fn failed(error: impl Into<anyhow::Error>) -> Self {
        Self::Failed(error.into())
    }

    /// Adds the calibration file to an error caused by it.
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

    /// Prints the error and returns the exit status.
    pub fn report(self) -> ExitCode {
        match self {
            Self::Failed(error) => {
                eprintln!("error: {}", wording::error(&error));
                ExitCode::FAILURE
            }
            Self::Usage(message) => {
                // In the form of clap's own usage errors.
                eprintln!("error: {message}\n\nFor more information, try '--help'.");
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
        if is_usage(&error) { Self::Usage(wording::error(&error)) } else { Self::Failed(error) }
    }
}

/// True if a setting is wrong. Searches the chain of causes, because sessions and benchmarks wrap errors
/// of their settings.
fn is_usage(error: &anyhow::Error) -> bool {
    error.chain().any(|cause| {
        cause.is::<ConfigError>()
            || cause.is::<ParamsError>()
            || matches!(cause.downcast_ref(), Some(DatasetError::Option { .. }))
            || matches!(cause.downcast_ref(), Some(RunError::Conflict { .. }))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use vbgs_studio::bench::findings::BenchError;
    use vbgs_studio::export::{ExportError, Fault};
    use vbgs_studio::pipeline::demo::DemoError;
    use vbgs_studio::pipeline::error::SessionError;
    use vbgs_studio::pipeline::settings::scene::SceneError;

    #[test]
    fn a_wrong_setting_is_wrong_usage_however_deep_it_lies() {
        let config = || ConfigError { setting: "budget", expected: "1".into(), found: "0".into() };
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
            assert!(matches!(&failure, Failure::Usage(text) if text.contains("--budget: ")));
        }
        let fault = ExportError { path: "a.ply".into(), fault: Fault::IsFolder };
        assert!(matches!(Failure::from(fault), Failure::Failed(_)));
        let noise = SceneError::BelowNoise { least: 1.0, found: 0.5, near: 1.0, far: 2.0 };
        assert!(matches!(Failure::from(noise), Failure::Failed(_)), "the files are to blame too");
    }
}
