//! What a user should know of a model although nothing went wrong, as values: the command line and
//! the window each say it by the settings that they have.

/// What a model had to leave out or take back.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum TrainingWarning {
    /// They found no component, and the budget allowed no more.
    OverBudget {
        /// How many, since training began.
        points: u64,
    },
    /// Merging could not keep the scene within its budget, so the structural scale grew.
    Coarsened {
        /// The structural scale that was asked for, world units.
        asked: f64,
        /// What it has become.
        scale: f64,
    },
    /// They lay too far from the origin, in structural scales, to be told from their neighbours.
    OutOfReach {
        /// How many, since training began.
        points: u64,
    },
    /// What photographs had taught of a splat was no precision any more and was forgotten.
    Repaired {
        /// How often, since training began or went on.
        splats: u64,
    },
}
