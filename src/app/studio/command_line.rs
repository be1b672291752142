//! The command line that trains the open dataset with the settings of the window.

use crate::app::opening::absolute_or_same;
use crate::app::state::Opened;
use crate::app::training::TrainSettings;
use crate::dataset::LoadOptions;
use crate::train::setting::Preset;
use crate::train::setting::table::{SettingLayer, Spelling};
use std::path::{Path, PathBuf};

#[derive(Debug, PartialEq, Eq, thiserror::Error)]
pub enum NoCommandLine {
    #[error("the built-in scene has no folder that a command could name: open a dataset first")]
    BuiltIn,
    #[error("{0}: expected a path in UTF-8 for use in a command; rename it first")]
    Path(PathBuf),
    #[error(
        "the calibration in use came with a run, not from a file that a command could name: open its calibration file here first"
    )]
    Calibration,
}

/// Returns the `train` command with the same dataset and settings, quoted for this platform's shell. Its
/// output folder is next to the open dataset.
pub fn command_line(opened: &Opened, training: &TrainSettings) -> Result<String, NoCommandLine> {
    let dataset = opened.dataset.as_ref().ok_or(NoCommandLine::BuiltIn)?;
    let folder = dataset.path.as_deref().ok_or(NoCommandLine::BuiltIn)?;
    let mut words = vec!["vbgs-studio".to_owned(), "train".to_owned(), path(folder)?];
    words.extend(["--out".to_owned(), path(&opened.files.path("run"))?]);
    match &opened.path {
        // A checkpoint stores its own settings.
        Some(run) if run != folder => words.extend(["--resume".to_owned(), path(run)?]),
        _ => {
            words.extend(settings(training));
            words.extend(reading(&dataset.options));
            if let Some(given) = &opened.calibration {
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
    Ok(words.iter().map(|word| shell_quoted(word)).collect::<Vec<_>>().join(" "))
}

/// Returns the options with which the dataset was read.
fn reading(options: &LoadOptions) -> Vec<String> {
    let mut words = Vec::new();
    let mut give = |option: &str, values: &[String]| {
        words.push(option.to_owned());
        words.extend_from_slice(values);
    };
    let texts = |values: &[f64]| values.iter().map(f64::to_string).collect::<Vec<_>>();
    if options.track {
        give("--poses", &["track".to_owned()]);
    }
    if let Some(axes) = options.poses {
        give("--pose-axes", &[axes.name().to_owned()]);
    }
    if let Some(scale) = options.depth_scale {
        give("--depth-scale", &texts(&[scale]));
    }
    if let Some(range) = options.depth_range {
        give("--depth-range", &texts(&range));
    }
    if let Some(intrinsics) = options.intrinsics {
        give("--intrinsics", &texts(&intrinsics));
    }
    if let Some(confidence) = options.confidence {
        give("--confidence", &[confidence.to_string()]);
    }
    if options.geometry_only {
        give("--geometry-only", &[]);
    }
    words
}

fn settings(training: &TrainSettings) -> Vec<String> {
    if training.preset == Preset::Paper {
        let preset = ["--preset", "paper"].map(str::to_owned);
        return preset.into_iter().chain(layer_options(&training.paper)).collect();
    }
    layer_options(&training.scene)
}

fn layer_options<L: SettingLayer>(layer: &L) -> Vec<String> {
    let given = L::TABLE.iter().filter_map(|setting| {
        let value = (setting.given)(layer)?;
        match setting.about.spelling {
            Spelling::Option(option, _) => Some([option.to_owned(), value]),
            Spelling::Name => {
                Some(["--set".to_owned(), format!("{}={value}", setting.about.field)])
            }
        }
    });
    given.flatten().collect()
}

/// Returns the absolute path as text, because the current folders of shell and window may differ.
fn path(path: &Path) -> Result<String, NoCommandLine> {
    let full = absolute_or_same(path);
    full.to_str().map(str::to_owned).ok_or(NoCommandLine::Path(full))
}

fn shell_quoted(word: &str) -> String {
    // Any other character may have a meaning in some shell.
    let is_plain = |c: char| c.is_ascii_alphanumeric() || "_-./:=,+@%\\".contains(c);
    if !word.is_empty() && word.chars().all(is_plain) && (cfg!(windows) || !word.contains('\\')) {
        return word.to_owned();
    }
    if cfg!(windows) {
        // File names contain no quotes on Windows.
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
            assert_eq!(shell_quoted(word), expected);
        }
    }

    #[test]
    fn settings_are_said_as_the_command_line_says_them() {
        let mut training = TrainSettings::default();
        assert!(settings(&training).is_empty(), "defaults need no options");
        training.scene = SceneOverrides {
            scale: Some(StructuralScale::Pixels(1.5)),
            cosine: Some(false),
            refine: Some(false),
            ..SceneOverrides::default()
        };
        let words = "--scale 1.5px --set cosine=false --set refine=false";
        assert_eq!(settings(&training).join(" "), words);
        training.preset = Preset::Paper;
        assert_eq!(settings(&training), ["--preset", "paper"]);
        training.paper.components = Some(2000);
        training.paper.candidates = Some(Candidates::Dense);
        let words = "--preset paper --set components=2000 --set candidates=dense";
        assert_eq!(settings(&training).join(" "), words);
    }
}
