//! The command that trains what is open as the window would, for scripts and other machines.

use super::state::{GivenCalibration, Opened};
use super::training::TrainSettings;
use crate::train::setting::Preset;
use crate::train::setting::table::{SettingLayer, Spelling};
use std::path::{Path, PathBuf, absolute};

/// Why there is no such command.
#[derive(Debug, PartialEq, Eq, thiserror::Error)]
pub enum NoCommandLine {
    /// Nothing on disk is open.
    #[error("the built-in scene lies in no folder that a command could name: open a dataset first")]
    BuiltIn,
    /// A path that no text can say.
    #[error("{0}: expected a path in UTF-8, so that a command can name it; rename it first")]
    Path(PathBuf),
    /// The cameras are corrected, but it is not known by which file.
    #[error(
        "the cameras are corrected by a calibration that came with a run, not from a file that a command could name: open its file here first"
    )]
    Calibration,
}

/// The command, quoted for the shell of this platform. It writes to a folder beside what is open.
///
/// # Errors
/// [`NoCommandLine`] where no command would do the same.
pub fn command_line(
    opened: &Opened,
    training: &TrainSettings,
    calibration: Option<&GivenCalibration>,
) -> Result<String, NoCommandLine> {
    let dataset = opened.dataset.as_ref().ok_or(NoCommandLine::BuiltIn)?;
    let folder = dataset.path.as_deref().ok_or(NoCommandLine::BuiltIn)?;
    let mut words = vec!["vbgs-studio".to_owned(), "train".to_owned(), path(folder)?];
    words.extend(["--out".to_owned(), path(&opened.files.path("run"))?]);
    match &opened.path {
        // A checkpoint brings its own settings.
        Some(run) if run != folder => words.extend(["--resume".to_owned(), path(run)?]),
        _ => {
            words.extend(settings(training));
            if let Some(given) = calibration {
                let file = given.file.as_deref().ok_or(NoCommandLine::Calibration)?;
                words.extend(["--calibration".to_owned(), path(file)?]);
            }
        }
    }
    if let Some(plan) = &opened.plan {
        let measured = dataset.evaluation(plan.split).new_views;
        if measured.split != plan.split {
            words.extend(["--eval".to_owned(), dataset.splits[measured.split].name.clone()]);
        }
    }
    Ok(words.iter().map(|word| quoted(word)).collect::<Vec<_>>().join(" "))
}

fn settings(training: &TrainSettings) -> Vec<String> {
    if training.preset == Preset::Paper {
        let preset = ["--preset", "paper"].map(str::to_owned);
        return preset.into_iter().chain(words(&training.paper)).collect();
    }
    words(&training.scene)
}

/// What is given of a preset's settings.
fn words<L: SettingLayer>(layer: &L) -> Vec<String> {
    let given = L::TABLE.iter().filter_map(|setting| {
        let value = (setting.given)(layer)?;
        match setting.about.spelling {
            Spelling::Option(option, _) => Some([option.to_owned(), value]),
            Spelling::Part(part) => {
                let option = if value == "true" { "--with" } else { "--without" };
                Some([option.to_owned(), part.to_owned()])
            }
            Spelling::File => None,
        }
    });
    given.flatten().collect()
}

/// From the root, since a shell may stand elsewhere than this window does.
fn path(path: &Path) -> Result<String, NoCommandLine> {
    let full = absolute(path).unwrap_or_else(|_| path.to_owned());
    full.to_str().map(str::to_owned).ok_or(NoCommandLine::Path(full))
}

/// A word as the shell takes it for one.
fn quoted(word: &str) -> String {
    let is_plain = |c: char| c.is_ascii_alphanumeric() || "_-./:=,+@%\\".contains(c);
    if !word.is_empty() && word.chars().all(is_plain) && (cfg!(windows) || !word.contains('\\')) {
        return word.to_owned();
    }
    if cfg!(windows) {
        // Names of files hold no quotes there.
        format!("\"{word}\"")
    } else {
        format!("'{}'", word.replace('\'', r"'\''"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pipeline::settings::scene::SceneOverrides;
    use crate::train::paper::config::Candidates;
    use crate::train::scene::config::BirthRule;
    use crate::train::scene::units::StructuralScale;

    #[test]
    #[cfg(unix)]
    fn words_with_anything_but_plain_letters_are_quoted() {
        for (word, expected) in [
            ("--scale", "--scale"),
            ("/a/b_c.1", "/a/b_c.1"),
            ("", "''"),
            ("a room", "'a room'"),
            ("it's $HOME", r"'it'\''s $HOME'"),
            (r"back\slash", r"'back\slash'"),
            ("Küche", "'Küche'"),
        ] {
            assert_eq!(quoted(word), expected);
        }
    }

    #[test]
    fn settings_are_said_as_the_command_line_says_them() {
        let mut training = TrainSettings::default();
        assert!(settings(&training).is_empty(), "defaults need no words");
        training.scene = SceneOverrides {
            scale: Some(StructuralScale::Pixels(1.5)),
            births: Some(BirthRule::BodyCentred),
            cosine: Some(false),
            ..SceneOverrides::default()
        };
        let words = "--scale 1.5px --births body-centred --without cosine";
        assert_eq!(settings(&training).join(" "), words);
        training.preset = Preset::Paper;
        assert_eq!(settings(&training), ["--preset", "paper"]);
        training.paper.components = Some(2000);
        training.paper.candidates = Some(Candidates::Dense);
        let words = "--preset paper --components 2000 --candidates dense";
        assert_eq!(settings(&training).join(" "), words);
    }
}
