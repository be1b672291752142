//! How fine a scene is trained, and what a finer or coarser run would be.
//!
//! The structural scale is a number of pixels or world units; it becomes a length, below which depth
//! noise hides what a finer scene could show (`scene.md`, Settings by sensor).

use super::state::{Opened, Snapshot};
use crate::dataset::surface::sample::FrameSample;
use crate::eval::report::quantile;
use crate::pipeline::settings::scene::SceneRun;
use crate::train::scene::config::SceneConfig;
use crate::train::scene::units::StructuralScale;

/// Share of a frame's time that goes with the number of components; the rest goes with its points. Twice
/// as many components took 7.6 instead of 6.8 ms a frame of Lego.
const COMPONENT_SHARE: f64 = 0.2;
/// Coarsest structural scale that the slider reaches, pixels.
pub const COARSEST_PX: f64 = 20.0;
/// Finest structural scale that the slider reaches where noise allows it, pixels.
pub const FINEST_PX: f64 = 0.5;

/// What a run would be that is otherwise like the one that is open.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DetailForecast {
    /// Components after as many frames.
    pub components: f64,
    /// Bytes of the model.
    pub model_bytes: f64,
    /// Milliseconds of training a frame.
    pub frame_ms: f64,
}

/// A structural scale as the trainer takes it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EffectiveScale {
    /// World units.
    pub length: f64,
    /// Whether noise holds it above what was asked for.
    pub is_held: bool,
}

/// The length of a structural scale by these settings, on a dataset whose frames look so.
pub fn effective(
    engine: &SceneConfig,
    scale: StructuralScale,
    sample: &FrameSample,
) -> EffectiveScale {
    let asked = match scale {
        StructuralScale::Pixels(n) => n * sample.footprint,
        StructuralScale::World(length) => length,
    };
    let least = scale.least(sample.tolerance, engine.ray_search > 0.0);
    EffectiveScale { length: asked.max(least), is_held: asked < least }
}

/// The settings of a run that other ones can follow: a dataset trained by the scene preset. A
/// checkpoint brings its own settings, so that beginning anew would bring them back.
pub fn trained_by(opened: &Opened) -> Option<&SceneRun> {
    let dataset = opened.dataset.as_ref()?;
    opened.scene().filter(|_| dataset.path == opened.path)
}

/// What a run of another structural scale, world units, would be; `None` before the first frame.
pub fn forecast(snapshot: &Snapshot, length: f64) -> Option<DetailForecast> {
    let run = snapshot.opened.as_deref()?.scene()?;
    let mut ms: Vec<f64> = snapshot.recent.iter().map(|frame| frame.ms.stages.train).collect();
    if snapshot.used == 0 || ms.is_empty() {
        return None;
    }
    ms.sort_by(f64::total_cmp);
    let used = snapshot.used as f64;
    // Components cover surfaces: their number goes with the square.
    let components = (used * (run.engine.h / length).powi(2)).min(run.engine.max_components as f64);
    let factor = components / used;
    Some(DetailForecast {
        components,
        model_bytes: snapshot.model_bytes as f64 * factor,
        frame_ms: quantile(&ms, 0.5) * (1.0 + COMPONENT_SHARE * (factor - 1.0)),
    })
}

/// The structural scale of components twice as many; `None` where noise hides what they would show.
pub fn finer(snapshot: &Snapshot) -> Option<StructuralScale> {
    /// Their number goes with the square.
    const FINER: f64 = std::f64::consts::FRAC_1_SQRT_2;
    let run = trained_by(snapshot.opened.as_deref()?)?;
    let in_world = StructuralScale::World(FINER * run.engine.h);
    let is_shown = |scale, sample: &FrameSample| !effective(&run.engine, scale, sample).is_held;
    match (run.scale, &snapshot.sample) {
        (StructuralScale::Pixels(n), None) => Some(StructuralScale::Pixels(FINER * n)),
        (StructuralScale::Pixels(n), Some(sample))
            if is_shown(StructuralScale::Pixels(FINER * n), sample) =>
        {
            Some(StructuralScale::Pixels(FINER * n))
        }
        // Where pixels are narrower than noise, world units still go to half of it.
        (_, Some(sample)) => Some(in_world).filter(|&scale| is_shown(scale, sample)),
        (StructuralScale::World(_), None) => Some(in_world),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_holds_scales_and_world_units_go_to_half_of_it() {
        let sample = FrameSample { footprint: 0.002, tolerance: 0.01, depths: [1.0, 3.0] };
        let of = |scale| effective(&SceneConfig::fine(0.01), scale, &sample);
        let free = |length| EffectiveScale { length, is_held: false };
        let held = |length| EffectiveScale { length, is_held: true };
        assert_eq!(of(StructuralScale::Pixels(10.0)), free(0.02));
        assert_eq!(of(StructuralScale::Pixels(2.5)), held(0.01));
        assert_eq!(of(StructuralScale::World(0.006)), free(0.006));
        assert_eq!(of(StructuralScale::World(0.001)), held(0.005));
    }
}
