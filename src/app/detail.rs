//! Level of detail of a run (structural scale), and forecasts for finer or coarser runs.
//!
//! The structural scale is given in pixels or world units and converted to a length. Depth noise bounds
//! that length from below, since it hides finer detail (`scene.md`, Settings by sensor).

use super::state::{Opened, RunState, Snapshot};
use crate::dataset::surface::sample::FrameSample;
use crate::pipeline::settings::scene::SceneRun;
use crate::train::scene::config::SceneConfig;
use crate::train::scene::units::StructuralScale;

/// Fraction of the training time per frame that is proportional to the number of components. The rest is
/// proportional to the number of points.
// Measured on Lego: twice the components took 7.6 instead of 6.8 ms a frame.
const COMPONENT_SHARE: f64 = 0.2;
pub const COARSEST_PX: f64 = 20.0;
/// Finest structural scale of the slider, pixels. Noise may limit the scale to a larger value.
pub const FINEST_PX: f64 = 0.5;

/// Forecast for a run that differs from the open run only in the structural scale.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DetailForecast {
    pub components: f64,
    pub model_bytes: f64,
    /// Memory of textures, part of `model_bytes`.
    pub texture_bytes: f64,
    pub frame_ms: f64,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EffectiveScale {
    pub length: f64,
    /// True if depth noise limits the scale to a larger value than the requested one.
    pub is_noise_limited: bool,
}

pub fn effective_scale(
    engine: &SceneConfig,
    scale: StructuralScale,
    sample: &FrameSample,
) -> EffectiveScale {
    let asked = match scale {
        StructuralScale::Pixels(n) => n * sample.footprint,
        StructuralScale::World(length) => length,
    };
    let least = scale.min_length(sample.tolerance, engine.ray_search > 0.0);
    EffectiveScale { length: asked.max(least), is_noise_limited: asked < least }
}

/// Returns the settings of the open run if the run can be repeated with other settings. This requires a
/// dataset and the scene preset.
pub fn retrainable_run(opened: &Opened) -> Option<&SceneRun> {
    let dataset = opened.dataset.as_ref()?;
    // Not an opened checkpoint, whose own settings would return on a restart.
    opened.scene().filter(|_| dataset.path == opened.path)
}

/// Returns the structural scale of runs of the open dataset for which none is chosen.
pub fn default_scale(opened: &Opened) -> Option<StructuralScale> {
    let (dataset, plan) = opened.dataset.as_deref().zip(opened.plan.as_deref())?;
    Some(SceneRun::default_scale(dataset, plan))
}

/// Returns the label of the button that trains the open run again with the chosen structural scale; `None` if
/// that would change nothing. `None` as scale is the default one.
pub fn retrain_label(chosen: Option<StructuralScale>, snapshot: &Snapshot) -> Option<&'static str> {
    let opened = snapshot.opened.as_deref()?;
    let run = retrainable_run(opened)?;
    let asked = chosen.or_else(|| default_scale(opened))?;
    let sample = snapshot.sampling.sample.as_ref();
    let next = sample.map(|sample| effective_scale(&run.engine, asked, sample));
    let is_same = next.map_or(asked == run.scale, |n| (n.length / run.engine.h - 1.0).abs() < 1e-3);
    let is_trained = snapshot.frames_done > 0 && snapshot.state != RunState::Loading;
    let is_finer = next.is_none_or(|next| next.length < run.engine.h);
    (!is_same && is_trained).then_some(if is_finer { "Retrain finer" } else { "Retrain coarser" })
}

/// Forecasts the model size and the training time per frame at structural scale `length` (world units).
/// `None` before the first frame is trained.
pub fn forecast(snapshot: &Snapshot, length: f64) -> Option<DetailForecast> {
    let run = snapshot.opened.as_deref()?.scene()?;
    let ms = snapshot.median_frame_ms().filter(|_| snapshot.model.used > 0)?;
    let used = snapshot.model.used as f64;
    // Components cover surfaces, so their number is inversely proportional to the squared scale.
    let components = (used * (run.engine.h / length).powi(2)).min(run.engine.max_components as f64);
    let factor = components / used;
    let texture_bytes = snapshot.model.texture_bytes as f64;
    Some(DetailForecast {
        components,
        // Textures have the resolution of the photographs at any scale.
        model_bytes: (snapshot.model.bytes as f64 - texture_bytes) * factor + texture_bytes,
        texture_bytes,
        frame_ms: ms * (1.0 + COMPONENT_SHARE * (factor - 1.0)),
    })
}

/// Returns the structural scale that doubles the number of components. `None` if the run cannot be repeated
/// or if depth noise hides the finer detail.
pub fn finer(snapshot: &Snapshot) -> Option<StructuralScale> {
    /// Factor by which the scale is multiplied. The number of components is inversely proportional to
    /// the squared scale.
    const FINER: f64 = std::f64::consts::FRAC_1_SQRT_2;
    let run = retrainable_run(snapshot.opened.as_deref()?)?;
    let in_pixels = match run.scale {
        StructuralScale::Pixels(n) => Some(StructuralScale::Pixels(FINER * n)),
        StructuralScale::World(_) => None,
    };
    let in_world = StructuralScale::World(FINER * run.engine.h);
    // Without a sampled frame the noise is unknown and limits nothing.
    let is_shown = |scale: &StructuralScale| {
        let sample = snapshot.sampling.sample.as_ref();
        sample.is_none_or(|s| !effective_scale(&run.engine, *scale, s).is_noise_limited)
    };
    // If pixels are narrower than the noise, a scale in world units may still be half the noise.
    in_pixels.into_iter().chain([in_world]).find(is_shown)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_holds_scales_and_world_units_go_to_half_of_it() {
        let sample = FrameSample { footprint: 0.002, tolerance: 0.01, depths: [1.0, 3.0] };
        let of = |scale| effective_scale(&SceneConfig::fine(0.01), scale, &sample);
        let free = |length| EffectiveScale { length, is_noise_limited: false };
        let held = |length| EffectiveScale { length, is_noise_limited: true };
        assert_eq!(of(StructuralScale::Pixels(10.0)), free(0.02));
        assert_eq!(of(StructuralScale::Pixels(2.5)), held(0.01));
        assert_eq!(of(StructuralScale::World(0.006)), free(0.006));
        assert_eq!(of(StructuralScale::World(0.001)), held(0.005));
    }
}
