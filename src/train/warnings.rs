//! Warnings about a trained model as values. Command line and window word them in terms of their own
//! settings.

/// A warning about a trained model.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum TrainingWarning {
    /// Points without a component were dropped because the budget was exhausted.
    OverBudget {
        /// Number of points since training began.
        points: u64,
    },
    /// The structural scale grew because merging could not meet the budget.
    Coarsened {
        /// Requested structural scale, world units.
        requested: f64,
        /// Current structural scale, world units.
        scale: f64,
    },
    /// Points were dropped: too many structural scales from the origin to distinguish neighbours.
    TooFarFromOrigin {
        /// Number of points since training began.
        points: u64,
    },
    /// A splat's photometric precision was not positive definite and was reset.
    PrecisionReset {
        /// Number of resets since training began or resumed.
        splats: u64,
    },
}
