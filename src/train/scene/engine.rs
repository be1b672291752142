//! Fusion of scenes of any scale, within the budget.

use super::config::SceneConfig;
use super::fusion;
use super::merge::coarsened;
use super::trainer::SceneTrainer;
use crate::model::scene::state::SceneState;
use std::borrow::Cow;

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
