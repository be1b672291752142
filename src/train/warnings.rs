//! What a user should know of a model although nothing went wrong, as values: the command line and
//! the window each say it by the settings that they have.

use super::scene::trainer::Lost;

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

impl Lost {
    /// What there is to say of these points.
    pub fn warnings(self) -> Vec<TrainingWarning> {
        let Self { budget, reach } = self;
        let budget = (budget > 0).then_some(TrainingWarning::OverBudget { points: budget });
        let reach = (reach > 0).then_some(TrainingWarning::OutOfReach { points: reach });
        budget.into_iter().chain(reach).collect()
    }
}
