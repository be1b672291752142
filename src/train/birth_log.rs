//! When components came into use.

use super::learner::{Changed, Learner};

/// No points yet.
const UNBORN: u32 = u32::MAX;
/// Points from before this session began.
const UNKNOWN: u32 = u32::MAX - 1;

/// Per component the frame in which it first received points. Reassignment moves unused components
/// only, so a component is never older than its last move.
#[derive(Clone, Debug)]
pub struct BirthLog(Vec<u32>);

impl BirthLog {
    /// Of a model as it is when a session begins: what is in use came from elsewhere.
    pub fn new(engine: &dyn Learner) -> Self {
        let is_used = |k| engine.used() > 0 && engine.posterior(k).count > 0.0;
        let birth = |k| if is_used(k) { UNKNOWN } else { UNBORN };
        Self((0..engine.components()).map(birth).collect())
    }

    /// Notes what the frame at a position of the run has changed, of so many components.
    pub fn record(&mut self, changed: Changed<'_>, components: usize, position: usize) {
        self.0.resize(components.max(self.0.len()), UNBORN);
        match changed {
            Changed::All => self.0.iter_mut().for_each(|birth| note(birth, position)),
            Changed::Listed(ids) => {
                ids.iter().for_each(|&id| note(&mut self.0[id as usize], position));
            }
        }
    }

    /// Position of the frame; `None` if there was none, or none in this session.
    pub fn of(&self, component: usize) -> Option<u32> {
        self.0.get(component).copied().filter(|&birth| birth < UNKNOWN)
    }
}

fn note(birth: &mut u32, position: usize) {
    if *birth == UNBORN {
        *birth = position as u32;
    }
}
