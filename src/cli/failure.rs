//! How a command ends when it does not end well.

use std::process::ExitCode;
use vbgs_studio::train::config::ConfigError;

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
                eprintln!("error: {error:#}");
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
        match error.downcast_ref::<ConfigError>() {
            Some(config) => Self::Usage(config.to_string()),
            None => Self::Failed(error),
        }
    }
}
