//! Log of the frame in which each component was first used.

use super::learner::{Changed, Learner};

const UNBORN: u32 = u32::MAX;
/// In use before this session began.
const UNKNOWN: u32 = u32::MAX - 1;

/// Frame in which each component first received points. Reassignment moves only unused components,
/// so a component's age is the age at its present place.
#[derive(Clone, Debug)]
pub struct BirthLog(Vec<u32>);

impl BirthLog {
    /// Creates the log at the start of a session; components already in use have no known birth.
    pub fn new(engine: &dyn Learner) -> Self {
        let is_used = |k| engine.used() > 0 && engine.posterior(k).count > 0.0;
        let birth = |k| if is_used(k) { UNKNOWN } else { UNBORN };
        Self((0..engine.components()).map(birth).collect())
    }

    /// Records the components changed by the frame at `position` of the run.
    pub fn record(&mut self, changed: Changed<'_>, components: usize, position: usize) {
        self.0.resize(components.max(self.0.len()), UNBORN);
        match changed {
            Changed::All => self.0.iter_mut().for_each(|birth| note(birth, position)),
            Changed::Listed(ids) => {
                ids.iter().for_each(|&id| note(&mut self.0[id as usize], position));
            }
        }
    }

    /// Returns the position of a component's first frame; `None` if unused or born before this session.
    pub fn first_frame_of(&self, component: usize) -> Option<u32> {
        self.0.get(component).copied().filter(|&birth| birth < UNKNOWN)
    }
}

fn note(birth: &mut u32, position: usize) {
    if *birth == UNBORN {
        *birth = position as u32;
    }
}
