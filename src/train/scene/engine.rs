//! Construction, resumption and fusion of scenes.

use super::config::SceneConfig;
use super::fusion;
use super::merge::coarsened;
use super::trainer::SceneTrainer;
use crate::model::scene::splat_rule::SplatRule;
use crate::model::scene::state::SceneState;
use crate::observation::surface::Observation;
use crate::train::learner::Learns;
use glam::DVec3;
use std::borrow::Cow;

/// Creates an empty scene, whose positions are stored relative to `origin` (world units).
///
/// ```
/// use glam::DVec3;
/// use vbgs_studio::observation::surface::{Observation, SurfacePoint};
/// use vbgs_studio::train::scene::{config::SceneConfig, engine};
///
/// let at = |x| SurfacePoint {
///     position: [x, 0.0, 1.0],
///     normal: [0.0, 0.0, -1.0],
///     direction: [0.0, 0.0, 1.0],
///     ..SurfacePoint::default()
/// };
/// let frame = Observation { points: vec![at(0.0), at(0.05), at(0.5)], ..Observation::empty() };
/// let mut scene = engine::begin(&SceneConfig::fine(0.1), DVec3::ZERO);
/// assert_eq!(scene.learn(&frame)?.points, 3);
/// assert_eq!(scene.used(), 2, "one of them had a seed within 0.1");
/// assert_eq!(scene.posterior(0).count, 2.0);
/// # Ok::<(), vbgs_studio::train::candidates::IndexError>(())
/// ```
pub fn begin(config: &SceneConfig, origin: DVec3) -> Box<dyn SceneLearner> {
    Box::new(SceneTrainer::new(config, origin))
}

/// Resumes a scene with the same configuration after `frames` frames; `None` if seeds are too far from the
/// origin for their scale.
pub fn restore(
    config: &SceneConfig,
    state: SceneState,
    frames: u64,
) -> Option<Box<dyn SceneLearner>> {
    Some(Box::new(SceneTrainer::restore(config, state, frames)?))
}

/// Fuses scenes of equal configuration, which may have continued from a common `start`, into one within the
/// budget (`scene.md`, Fusion); `None` without scenes.
pub fn fuse(
    config: &SceneConfig,
    start: Option<&SceneState>,
    scenes: &[&SceneState],
) -> Option<SceneState> {
    // Converts all to the coarsest scale that a budget required.
    let steps = scenes.iter().map(|scene| scene.coarsening_steps).max()?;
    let start = match start {
        Some(start) => Some(at_scale(start, steps)?),
        None => None,
    };
    let scenes: Option<Vec<_>> = scenes.iter().map(|scene| at_scale(scene, steps)).collect();
    let scenes = scenes?;
    let scenes: Vec<&SceneState> = scenes.iter().map(AsRef::as_ref).collect();
    let state = fusion::fuse(config, start.as_deref(), &scenes)?;
    if state.visibility.len() <= config.max_components {
        return Some(state);
    }
    let mut over_budget = SceneTrainer::restore(config, state, 0)?;
    over_budget.merge_to(config.max_components);
    Some(over_budget.state())
}

/// Converts a scene to the scale after `steps` steps.
fn at_scale(scene: &SceneState, steps: u32) -> Option<Cow<'_, SceneState>> {
    match scene.coarsening_steps == steps {
        true => Some(Cow::Borrowed(scene)),
        false => coarsened(scene.clone(), steps).map(Cow::Owned),
    }
}

/// Scene trainer whose splat rule can be changed.
pub trait SceneLearner: Learns<Observation> {
    /// Sets the splat rule from now on.
    fn set_splat_rule(&mut self, rule: SplatRule);
}
