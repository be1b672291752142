//! Construction of scenes with the configured form of sums.

use super::component_sums::SumScalar;
use super::config::{SceneConfig, SumForm};
use super::fusion;
use super::merge::coarsened;
use super::trainer::SceneTrainer;
use crate::model::scene::splat_rule::SplatRule;
use crate::model::scene::state::SceneState;
use crate::observation::surface::Observation;
use crate::train::learner::Learns;
use glam::DVec3;
use std::borrow::Cow;

/// Creates an empty scene, whose positions are stored relative to `origin` (world units), with sums of the
/// form set in `config`.
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
    match config.sums {
        SumForm::Mixed => Box::new(SceneTrainer::<i32>::new(config, origin)),
        SumForm::F32 => Box::new(SceneTrainer::<f32>::new(config, origin)),
        SumForm::F64 => Box::new(SceneTrainer::<f64>::new(config, origin)),
    }
}

/// Resumes a scene with the same configuration after `frames` frames; `None` if its sums have another form,
/// or seeds are too far from the origin for their scale.
pub fn restore(
    config: &SceneConfig,
    state: SceneState,
    frames: u64,
) -> Option<Box<dyn SceneLearner>> {
    match config.sums {
        SumForm::Mixed => restored::<i32>(config, state, frames),
        SumForm::F32 => restored::<f32>(config, state, frames),
        SumForm::F64 => restored::<f64>(config, state, frames),
    }
}

/// Fuses scenes of equal configuration, which may have continued from a common `start`, into one within the
/// budget (`scene.md`, Fusion); `None` without scenes or if sums have another form.
pub fn fuse(
    config: &SceneConfig,
    start: Option<&SceneState>,
    scenes: &[&SceneState],
) -> Option<SceneState> {
    match config.sums {
        SumForm::Mixed => fused::<i32>(config, start, scenes),
        SumForm::F32 => fused::<f32>(config, start, scenes),
        SumForm::F64 => fused::<f64>(config, start, scenes),
    }
}

fn fused<W: SumScalar>(
    config: &SceneConfig,
    start: Option<&SceneState>,
    scenes: &[&SceneState],
) -> Option<SceneState> {
    // Converts all to the coarsest scale that a budget required.
    let steps = scenes.iter().map(|scene| scene.coarsening_steps).max()?;
    let start = match start {
        Some(start) => Some(at_scale::<W>(start, steps)?),
        None => None,
    };
    let scenes: Option<Vec<_>> = scenes.iter().map(|scene| at_scale::<W>(scene, steps)).collect();
    let scenes = scenes?;
    let scenes: Vec<&SceneState> = scenes.iter().map(AsRef::as_ref).collect();
    let state = fusion::fuse::<W>(config, start.as_deref(), &scenes)?;
    if state.visibility.len() <= config.max_components {
        return Some(state);
    }
    let mut over_budget = SceneTrainer::<W>::restore(config, state, 0)?;
    over_budget.merge_to(config.max_components);
    Some(over_budget.state())
}

/// Converts a scene to the scale after `steps` steps.
fn at_scale<W: SumScalar>(scene: &SceneState, steps: u32) -> Option<Cow<'_, SceneState>> {
    match scene.coarsening_steps == steps {
        true => Some(Cow::Borrowed(scene)),
        false => coarsened::<W>(scene.clone(), steps).map(Cow::Owned),
    }
}

fn restored<W: SumScalar + 'static>(
    config: &SceneConfig,
    state: SceneState,
    frames: u64,
) -> Option<Box<dyn SceneLearner>> {
    let trainer = SceneTrainer::<W>::restore(config, state, frames)?;
    Some(Box::new(trainer))
}

/// Scene trainer whose form of sums was chosen at run time.
pub trait SceneLearner: Learns<Observation> {
    /// Sets the splat rule from now on.
    fn set_splat_rule(&mut self, rule: SplatRule);
}
