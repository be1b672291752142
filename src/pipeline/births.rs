//! When components came into use.

use super::learner::Learner;

/// No points yet.
const UNBORN: u32 = u32::MAX;
/// Points from before this session began.
const UNKNOWN: u32 = u32::MAX - 1;

/// Per component the frame in which it first received points. Reassignment moves unused components
/// only, so a component is never older than its last move.
pub(super) struct Births(Vec<u32>);

impl Births {
    /// Of a model as it is when a session begins: what is in use came from elsewhere.
    pub fn new(engine: &Learner) -> Self {
        let is_used = |k| engine.used() > 0 && engine.posterior(k).count > 0.0;
        let birth = |k| if is_used(k) { UNKNOWN } else { UNBORN };
        Self((0..engine.components()).map(birth).collect())
    }

    /// Notes the components that the frame at a position of the run has touched.
    pub fn record(&mut self, touched: &[u32], position: usize) {
        for &id in touched {
            if id as usize >= self.0.len() {
                self.0.resize(id as usize + 1, UNBORN);
            }
            let birth = &mut self.0[id as usize];
            if *birth == UNBORN {
                *birth = position as u32;
            }
        }
    }

    /// Position of the frame; `None` if there was none, or none in this session.
    pub fn of(&self, component: usize) -> Option<u32> {
        self.0.get(component).copied().filter(|&birth| birth < UNKNOWN)
    }
}
