//! Learning from the photograph: after the points, one Gauss-Newton step on the picture, with a
//! precision per splat that accumulates.
#![doc = include_str!("photometric.md")]

pub mod rule;
mod step;

use crate::math::camera::Camera;
use crate::math::image::Image;
use crate::model::scene::photometric::PhotometricState;
use crate::model::splat::appearance::{Appearance, SplatView};
use crate::model::splat::splats::Splat;
use crate::render::cpu::photometric::{ParameterSums, PhotometricWalk, PixelRule};
use rayon::prelude::*;
use rule::PhotometricRule;
use step::SplatSlot;

/// Weight of the newest frame in the running noise.
const NOISE_SHARE: f64 = 0.05;
/// Noise before any frame was seen, colour units: what the first frames of a scene differ by.
const FIRST_NOISE: f64 = 0.1;
/// Least noise, colour units: half a level of 8 bits.
const MIN_NOISE: f64 = 0.002;
/// Weight of a splat over the pixels from which on a photograph says anything of it, px.
const MIN_SEEN: f64 = 0.5;
/// Splats per parallel task.
const MIN_TASK: usize = 256;

/// Splats that learn from photographs, and the memory for it.
#[derive(Default)]
pub struct PhotometricLearner {
    state: PhotometricState,
    walk: PhotometricWalk,
    /// Precisions that were no longer positive definite and were taken back to the prior's.
    repaired: u64,
}

impl PhotometricLearner {
    /// One that goes on.
    pub fn restore(state: PhotometricState) -> Self {
        Self { state, ..Self::default() }
    }

    /// What it has learnt.
    pub fn state(&self) -> &PhotometricState {
        &self.state
    }

    /// Splat and appearance of a component, if it has any.
    pub fn splat(&self, component: usize) -> Option<(Splat, Appearance)> {
        let has = self.state.has(component);
        has.then(|| (self.state.splats[component], self.state.appearance[component]))
    }

    /// Gives components that have none the splats that points make, as far as these can be drawn.
    pub fn begin(
        &mut self,
        n_components: usize,
        touched: &[u32],
        rule: &PhotometricRule,
        splat: impl Fn(usize) -> (Splat, Appearance) + Sync,
    ) {
        self.state.grow(n_components);
        let new = touched.par_iter().filter(|&&id| !self.state.has(id as usize));
        let new: Vec<(u32, (Splat, Appearance))> =
            new.map(|&id| (id, splat(id as usize))).filter(|(_, s)| s.0.is_drawable()).collect();
        for (id, (splat, appearance)) in new {
            self.slot(id as usize).begin(splat, appearance, &rule.prior);
        }
    }

    /// Forgets a component's splat.
    pub fn forget(&mut self, component: usize) {
        if let Some(splat) = self.state.splats.get_mut(component) {
            *splat = Splat::default();
        }
    }

    /// Learns from a photograph taken by `camera`; which splats it changed.
    pub fn learn(
        &mut self,
        camera: &Camera,
        photograph: &Image<[f32; 4]>,
        full_coverage: f32,
        rule: &PhotometricRule,
    ) -> Vec<u32> {
        let view = SplatView::new(&self.state.splats, &self.state.appearance);
        let Some(view) = view else { return Vec::new() };
        let (tau, coverage) = (rule.tau as f32, rule.coverage as f32);
        let pixels = PixelRule { full_coverage, tau, coverage };
        let found = self.walk.compare(view, camera, photograph, pixels);
        let deviation = rule.noise * self.noise_after(found.squared_error, found.pixels);
        let variance = deviation * deviation;
        let seen: Vec<(u32, ParameterSums)> =
            found.splats.into_iter().filter(|(_, sums)| sums.weight > MIN_SEEN).collect();
        self.repaired += self.step(&seen, variance, rule);
        seen.into_iter().map(|(id, _)| id).collect()
    }

    /// Takes this frame's difference into the running noise; its root.
    fn noise_after(&mut self, squared_error: f64, pixels: f64) -> f64 {
        let [mean, weight] = &mut self.state.noise;
        if pixels > 0.0 {
            let of_frame = squared_error / (3.0 * pixels);
            let share = (1.0 / (*weight + 1.0)).max(NOISE_SHARE);
            *mean += share * (of_frame - *mean);
            *weight += 1.0;
        }
        let root = if *weight > 0.0 { mean.sqrt() } else { FIRST_NOISE };
        root.max(MIN_NOISE)
    }

    /// Steps of all splats; how many had to be repaired.
    fn step(
        &mut self,
        seen: &[(u32, ParameterSums)],
        variance: f64,
        rule: &PhotometricRule,
    ) -> u64 {
        let PhotometricState { splats, appearance, form, color, .. } = &self.state;
        let stepped: Vec<_> = seen
            .par_iter()
            .with_min_len(MIN_TASK)
            .map(|(id, sums)| {
                let id = *id as usize;
                let mut own = (splats[id], appearance[id], form[id], color[id]);
                let mut slot = SplatSlot {
                    splat: &mut own.0,
                    appearance: &mut own.1,
                    form: &mut own.2,
                    color: &mut own.3,
                };
                let repaired = slot.learn(sums, variance, rule);
                (own, repaired)
            })
            .collect();
        let mut n_repaired = 0;
        for ((id, _), (own, repaired)) in seen.iter().zip(stepped) {
            let slot = self.slot(*id as usize);
            (*slot.splat, *slot.appearance, *slot.form, *slot.color) = own;
            n_repaired += u64::from(repaired);
        }
        n_repaired
    }

    fn slot(&mut self, id: usize) -> SplatSlot<'_> {
        let PhotometricState { splats, appearance, form, color, .. } = &mut self.state;
        SplatSlot {
            splat: &mut splats[id],
            appearance: &mut appearance[id],
            form: &mut form[id],
            color: &mut color[id],
        }
    }
}
