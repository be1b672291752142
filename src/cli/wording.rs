//! Rewords the library's warnings and errors in terms of command-line options. The library names
//! settings, which the window rewords in terms of its panels.

use std::error::Error;
use vbgs_studio::bench::findings::BenchError;
use vbgs_studio::calibrate::CalibrateError;
use vbgs_studio::dataset::surface::sample::DepthAdvice;
use vbgs_studio::eval::views::EvalError;
use vbgs_studio::pipeline::checkpoint::RunError;
use vbgs_studio::pipeline::memory::MemoryError;
use vbgs_studio::pipeline::settings::scene::{SceneError, SceneOverrides};
use vbgs_studio::train::outcome::TrainingWarning;
use vbgs_studio::train::paper::config::PaperOverrides;
use vbgs_studio::train::setting::ConfigError;
use vbgs_studio::train::setting::table::{SettingLayer, Spelling};

/// Formats a warning about a trained model.
pub fn warning(warning: &TrainingWarning) -> String {
    match warning {
        TrainingWarning::OverBudget { points } => format!(
            "{points} points were dropped because the budget was exhausted; raise --budget, or increase --scale if depth is noisy"
        ),
        TrainingWarning::Coarsened { requested: asked, scale } => format!(
            "the budget is too small for a structural scale of {asked}, which was increased to {scale}; raise --budget, or start with --scale {scale}, which is faster"
        ),
        TrainingWarning::TooFarFromOrigin { points } => format!(
            "{points} points lie more than a million structural scales from the scene's origin and were dropped; correct outlier poses (listed by `info`) or the depth unit, or increase --scale"
        ),
        TrainingWarning::PrecisionReset { splats } => format!(
            "photometric precisions of {splats} splats were not positive definite and were reset; these splats again follow from points alone. --photometric off disables training on photographs"
        ),
    }
}

/// Formats an error with those of its causes that its text does not include.
pub fn error(error: &anyhow::Error) -> String {
    let mut text = error.to_string();
    for cause in error.chain() {
        let told = cause.to_string();
        let worded = reword_with_options(cause);
        if let Some(worded) = &worded
            && text.contains(&told)
        {
            text = text.replacen(&told, worded, 1);
            // Deeper causes are part of this text.
            break;
        }
        if !text.contains(&told) {
            text.push_str(": ");
            text.push_str(worded.as_ref().unwrap_or(&told));
        }
    }
    text
}

/// Rewords an error that refers to a setting with an option; `None` for other errors.
fn reword_with_options(error: &(dyn Error + 'static)) -> Option<String> {
    // The library's texts are edited rather than rewritten, because only they contain the numbers. A text
    // that no longer matches is shown unchanged, without its option.
    let text = || error.to_string();
    if let Some(config) = error.downcast_ref() {
        Some(wrong_setting(config))
    } else if let Some(scene) = error.downcast_ref() {
        scene_error(scene)
    } else if let Some(MemoryError::Components { .. }) = error.downcast_ref() {
        Some(match text() {
            budget if budget.starts_with("budget") => format!("--{budget}"),
            other => format!("--set {other}"),
        })
    } else if let Some(BenchError::Bound { .. }) = error.downcast_ref() {
        Some(format!("--{}", text()))
    } else if let Some(EvalError::NoViews { .. }) = error.downcast_ref() {
        Some(text().replace("choose another split", "choose another with --split"))
    } else if let Some(RunError::OtherDataset { .. }) = error.downcast_ref() {
        Some(format!("{}, or use --force to go on with this one", text()))
    } else if let Some(calibrate) = error.downcast_ref() {
        calibrate_error(calibrate)
    } else {
        None
    }
}

fn wrong_setting(error: &ConfigError) -> String {
    let ConfigError { setting, expected, found } = error;
    let option = option_of(setting);
    let expected = expected.replace("in a settings file", "in --config");
    format!("{option}: expected {expected}, found {found}")
}

/// Returns the option of a setting, given its name in files.
fn option_of(setting: &str) -> String {
    let of_scene = SceneOverrides::TABLE.iter().map(|row| &row.about);
    let of_paper = PaperOverrides::TABLE.iter().map(|row| &row.about);
    match of_scene.chain(of_paper).find(|about| about.field == setting).map(|about| about.spelling)
    {
        Some(Spelling::Option(option, _)) => option.to_owned(),
        Some(Spelling::Name) => format!("--set {setting}"),
        // Options of other commands, such as `--bound`.
        None => format!("--{}", setting.replace('_', "-")),
    }
}

fn scene_error(error: &SceneError) -> Option<String> {
    match error {
        SceneError::BelowNoise { .. } => {
            Some(error.to_string().replace("structural scale: ", "--scale: ").replace(
                "set the depth scale and range in it",
                "set --depth-scale and --depth-range",
            ))
        }
        SceneError::NoPoints(none) => Some(none.saying(&depth_advice(&none.advice))),
        SceneError::Config(_) | SceneError::Photographs(_) => None,
    }
}

fn depth_advice(advice: &DepthAdvice) -> String {
    match advice {
        DepthAdvice::CheckImages => advice.to_string(),
        DepthAdvice::CheckCameras => advice
            .to_string()
            .replace("the depth scale, the intrinsics", "--depth-scale, --intrinsics"),
        DepthAdvice::OtherUnit { unit, factor } => format!(
            "the depths appear to be {unit} read as metres: multiply --depth-scale by {factor}, or widen --depth-range"
        ),
        DepthAdvice::SetUnit => {
            "set the unit with --depth-scale, or widen --depth-range".to_owned()
        }
    }
}

fn calibrate_error(error: &CalibrateError) -> Option<String> {
    match error {
        CalibrateError::NothingInCommon { .. } => Some(error.to_string().replace(
            "ask for more of its frames or name another split",
            "use more with --max-frames or name another split with --split",
        )),
        CalibrateError::TooManyExposures { .. } => Some(format!(
            "--{}",
            error
                .to_string()
                .replace("exposures: expected", "exposure: expected")
                .replace("name a smaller one, ", "name a smaller one with --split, ")
                .replace("to training, which", "to `train`, which")
        )),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use vbgs_studio::dataset::surface::sample::NoUsableDepth;
    use vbgs_studio::pipeline::error::SessionError;

    fn said(found: impl Error + Send + Sync + 'static) -> String {
        error(&anyhow::Error::new(found))
    }

    #[test]
    fn settings_are_options_on_the_command_line() {
        let config = |setting, expected: &str| {
            said(ConfigError { setting, expected: expected.into(), found: "0".into() })
        };
        assert_eq!(config("scale_factor", "1"), "--set scale_factor: expected 1, found 0");
        assert_eq!(config("scale", "1"), "--scale: expected 1, found 0");
        assert_eq!(config("bound", "1"), "--bound: expected 1, found 0");
    }

    #[test]
    fn advice_names_options_through_every_layer() {
        let noise = SceneError::BelowNoise { least: 0.01, found: 0.001, near: 1.0, far: 2.0 };
        let neutral = noise.to_string();
        let text = said(SessionError::from(noise));
        assert!(text.starts_with("--scale: expected at least"), "{text}");
        assert!(text.ends_with("set --depth-scale and --depth-range"), "{text}");
        let points = |advice| {
            SceneError::from(NoUsableDepth {
                dataset: "room".into(),
                trusted: "range from 0.3 on".into(),
                found: "no depth at all".into(),
                frames: 3,
                advice,
            })
        };
        let unit = DepthAdvice::OtherUnit { unit: "millimetres", factor: 0.001 };
        let text = said(SessionError::from(points(unit)));
        assert!(
            text.ends_with("multiply --depth-scale by 0.001, or widen --depth-range"),
            "{text}"
        );
        let memory = |setting| MemoryError::Components {
            setting,
            most: 1,
            found: 2,
            available_mb: 3,
            needed_mb: 4,
        };
        let budget = said(SessionError::from(memory("budget")));
        assert!(budget.starts_with("--budget: expected at most 1 components"), "{budget}");
        let memory = memory("components");
        assert!(said(SessionError::from(memory.clone())).starts_with("--set components: expected"));
        for text in [neutral, points(unit).to_string(), memory.to_string()] {
            assert!(!text.contains("--"), "the library knows no options: {text}");
        }
        let told = anyhow::Error::new(SessionError::from(memory)).context("the run");
        assert!(error(&told).starts_with("the run: --set components"), "{}", error(&told));
    }

    #[test]
    fn warnings_name_options() {
        let text = warning(&TrainingWarning::OverBudget { points: 3 });
        assert!(text.starts_with("3 points") && text.contains("raise --budget"), "{text}");
        let text = warning(&TrainingWarning::Coarsened { requested: 0.01, scale: 0.0141421 });
        assert!(text.contains("raise --budget") && text.contains("--scale 0.0141421,"), "{text}");
        let text = warning(&TrainingWarning::TooFarFromOrigin { points: 4 });
        assert!(text.contains("listed by `info`") && text.contains("increase --scale"), "{text}");
    }
}
