//! How a command ends when it does not end well.

use std::process::ExitCode;
use vbgs_studio::dataset::error::DatasetError;
use vbgs_studio::dataset::synthetic::write::WriteError;
use vbgs_studio::pipeline::checkpoint::RunError;
use vbgs_studio::train::setting::ConfigError;

/// Why a command did not do its work.
pub enum Failure {
    /// Exit status 1.
    Failed(anyhow::Error),
    /// Exit status 2.
    Usage(String),
    /// Ctrl-C; what was asked to be saved is saved. Exit status 130.
    Interrupted,
}

impl Failure {
    /// The work failed.
    pub fn failed(error: impl Into<anyhow::Error>) -> Self {
        Self::Failed(error.into())
    }

    /// Prints the one message, returns the exit status.
    pub fn report(self) -> ExitCode {
        match self {
            Self::Failed(error) => {
                eprintln!("error: {}", message(&error));
                ExitCode::FAILURE
            }
            Self::Usage(message) => {
                eprintln!("error: {message}\n\nFor more information, try '--help'.");
                ExitCode::from(2)
            }
            Self::Interrupted => ExitCode::from(130),
        }
    }
}

impl<E: Into<anyhow::Error>> From<E> for Failure {
    fn from(error: E) -> Self {
        let error = error.into();
        if is_usage(&error) { Self::Usage(message(&error)) } else { Self::Failed(error) }
    }
}

/// Whether a setting is to blame, whatever the files hold.
fn is_usage(error: &anyhow::Error) -> bool {
    error.is::<ConfigError>()
        || matches!(error.downcast_ref(), Some(DatasetError::Option { .. }))
        || matches!(error.downcast_ref(), Some(WriteError::Params(_)))
        || matches!(error.downcast_ref(), Some(RunError::Conflict { .. }))
}

/// An error with those of its causes that its own text does not already tell.
fn message(error: &anyhow::Error) -> String {
    let mut text = error.to_string();
    for cause in error.chain().skip(1).map(ToString::to_string) {
        if !text.contains(&cause) {
            text.push_str(": ");
            text.push_str(&cause);
        }
    }
    text
}
