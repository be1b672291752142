//! What the window says of values of the library: by the names that its panels give the settings.

use crate::train::warnings::TrainingWarning;

/// A warning of the model being trained.
pub fn warning(warning: &TrainingWarning) -> String {
    match warning {
        TrainingWarning::OverBudget { points } => format!(
            "{points} points found no component within the budget and were left out; raise the Budget in Settings, or widen the Structural scale if depth is noisy"
        ),
        TrainingWarning::OutOfReach { points } => format!(
            "{points} points lie more than a million structural scales from the scene's origin and were left out; widen the Structural scale in Settings"
        ),
        TrainingWarning::Repaired { splats } => format!(
            "what photographs had taught of {splats} splats was numerically unsound and was forgotten; these are what points say again. Photometric in Settings turns learning from photographs off"
        ),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_window_speaks_of_no_options() {
        for value in [
            TrainingWarning::OverBudget { points: 3 },
            TrainingWarning::OutOfReach { points: 4 },
            TrainingWarning::Repaired { splats: 5 },
        ] {
            let text = warning(&value);
            assert!(!text.contains("--") && text.contains("Settings"), "{text}");
        }
    }
}
