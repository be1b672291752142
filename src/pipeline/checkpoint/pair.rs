//! A stored model and the settings it was trained with: they must be of one kind.

use super::{RunError, SavedRun};
use crate::export::checkpoint::StoredModel;
use crate::math::normalization::Normalization;
use crate::model::paper::state::{ModelState, Totals};
use crate::model::scene::state::{SceneState, StoredSums};
use crate::pipeline::learner::{Learner, PaperLearner};
use crate::pipeline::settings::method::Method;
use crate::pipeline::settings::scene::SceneRun;
use crate::train::paper::config::{PaperConfig, UpdateWidth};
use crate::train::paper::engine::PaperEngine;
use crate::train::scene::engine::SceneEngine;
use crate::train::scene::sum_form::SumForm;

/// Settings and a model that is theirs.
pub(super) enum Pair<'a> {
    Paper(&'a PaperConfig, &'a Normalization, &'a ModelState),
    Scene(&'a SceneRun, &'a SceneState),
}

impl SavedRun {
    /// The model, ready to go on.
    pub fn learner(&self) -> Result<Learner, RunError> {
        let frames = self.content.cursor.frames;
        match self.pair()? {
            Pair::Paper(config, normalization, state) => {
                let engine = PaperEngine::restore(config, state.clone(), frames)?;
                let (config, normalization) = (config.clone(), *normalization);
                Ok(Learner::Paper(Box::new(PaperLearner { engine, config, normalization })))
            }
            Pair::Scene(run, state) => {
                let engine = SceneEngine::restore(&run.engine, state.clone(), frames);
                Ok(Learner::Scene(engine.ok_or_else(|| self.other_sums(run.engine.sums))?))
            }
        }
    }

    /// World to model coordinates.
    pub fn normalization(&self) -> Result<Normalization, RunError> {
        Ok(match self.pair()? {
            Pair::Paper(_, normalization, _) => *normalization,
            Pair::Scene(run, _) => run.normalization(),
        })
    }

    /// Settings and model.
    ///
    /// # Errors
    /// [`RunError::Form`], [`RunError::Prior`] or [`RunError::Json`] unless they belong together.
    pub(super) fn pair(&self) -> Result<Pair<'_>, RunError> {
        match (&self.config.method, &self.content.model) {
            (Method::Paper(config), StoredModel::Mixture { normalization, hyper, state }) => {
                // Among them the number of components, for which the engine makes room.
                if config.hyper() != *hyper {
                    return Err(RunError::Prior { path: self.path.clone() });
                }
                let expected = config.operations.update;
                if !holds(expected, &state.totals) {
                    return Err(self.other(format!("totals of the form {expected:?}")));
                }
                Ok(Pair::Paper(config, normalization, state))
            }
            (Method::Scene(run), StoredModel::Scene(state)) => {
                run.engine.clone().check().map_err(|error| RunError::Json {
                    path: self.path.clone(),
                    section: "CONF",
                    problem: error.to_string(),
                })?;
                let origin = run.surface.origin.to_array();
                if state.origin != origin {
                    return Err(self.other(format!("the origin {origin:?}")));
                }
                if !holds_sums(run.engine.sums, &state.sums) {
                    return Err(self.other_sums(run.engine.sums));
                }
                Ok(Pair::Scene(run, state))
            }
            (Method::Paper(_), StoredModel::Scene(_)) => Err(self.other("a mixture".to_owned())),
            (Method::Scene(_), StoredModel::Mixture { .. }) => {
                Err(self.other("a scene".to_owned()))
            }
        }
    }

    fn other(&self, expected: String) -> RunError {
        RunError::Form { path: self.path.clone(), expected }
    }

    fn other_sums(&self, expected: SumForm) -> RunError {
        self.other(format!("sums of the form {expected:?}"))
    }
}

/// Whether an engine that keeps totals in one form can go on with these; 128 bits hold them all.
fn holds(update: UpdateWidth, totals: &Totals) -> bool {
    match totals {
        Totals::Fixed64 { .. } => update == UpdateWidth::Fixed64,
        Totals::Fixed128(_) => true,
        Totals::F32(_) => update == UpdateWidth::F32,
    }
}

fn holds_sums(form: SumForm, sums: &StoredSums) -> bool {
    form == match sums {
        StoredSums::Mixed { .. } => SumForm::Mixed,
        StoredSums::F32(_) => SumForm::F32,
        StoredSums::F64(_) => SumForm::F64,
    }
}
