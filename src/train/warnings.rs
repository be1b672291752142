//! What a user should know of a model although nothing went wrong, as values: the command line and
//! the window each say it by the settings that they have.

/// Points that a model had to leave out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TrainingWarning {
    /// They found no component, and the budget allowed no more.
    OverBudget {
        /// How many, since training began.
        points: u64,
    },
    /// They lay too far from the origin, in structural scales, to be told from their neighbours.
    OutOfReach {
        /// How many, since training began.
        points: u64,
    },
}
