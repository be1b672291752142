//! Fusion of scenes that continued from a common start with different frames (`scene.md`, Fusion).
//!
//! Components of the start (the common initial scene) have the same seeds in all scenes. So the sums
//! accumulated since then can be added exactly, and photometric estimates refer to the same parameters.
//! Textures too are sums: those of the start count once, also where a lattice was laid anew since.
//!
//! Components created since then have no counterpart. They are matched against existing seeds, as points
//! are, so that no surface is covered twice.

use super::component_sums::{ComponentSums, whole_quanta};
use super::config::SceneConfig;
use super::gauge::moved;
use super::grid::SeedGrid;
use super::merge::{coarsened, factor};
use super::photometric::rule::PhotometricRule;
use super::photometric::{LEAST_OPACITY, is_trained, prior_precision};
use super::trainer::SceneTrainer;
use crate::math::cholesky::{Cholesky, at};
use crate::model::scene::photometric::{
    N_COLOR, N_COLOR_PRECISION, N_FORM, N_FORM_PRECISION, PhotometricState, merge_textures,
};
use crate::model::scene::state::{SceneState, VisibilityCounts, WHOLE};
use crate::model::scene::sums::{N_SUMS, SceneSums};
use crate::model::scene::texels::TextureSums;
use crate::model::splat::appearance::Appearance;
use crate::model::splat::pose_log::FramePose;
use crate::model::splat::splats::{Splat, rotation_array};
use crate::train::estep::squared_distance;
use glam::{DQuat, DVec3};
use rayon::prelude::*;
use std::borrow::Cow;
use std::sync::Arc;

/// Fuses scenes of equal configuration into one scene within the budget (`scene.md`, Fusion). The
/// scenes may have continued from a common `start`. `None` if there are no scenes, or if a state has
/// invalid component numbers or unknown recorded rotations.
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
    let state = fuse_at_one_scale(config, start.as_deref(), &scenes)?;
    if state.visibility.len() <= config.max_components {
        return Some(state);
    }
    let mut over_budget = SceneTrainer::restore(config, state, 0)?;
    over_budget.merge_to(config.max_components);
    Some(over_budget.state())
}

/// Returns the scene after training on all its buffered photographs; `None` if there are none.
pub fn settled(config: &SceneConfig, state: &SceneState) -> Option<SceneState> {
    let photographs = state.photometric.as_ref();
    let is_waiting = photographs.is_some_and(|photometric| !photometric.buffered.is_empty());
    let trainer = is_waiting.then(|| SceneTrainer::restore(config, state.clone(), 0)).flatten();
    trainer.map(SceneTrainer::into_settled_state)
}

/// Converts a scene to the structural scale after `steps` coarsening steps; `None` if that is
/// impossible.
fn at_scale(scene: &SceneState, steps: u32) -> Option<Cow<'_, SceneState>> {
    match scene.coarsening_steps == steps {
        true => Some(Cow::Borrowed(scene)),
        false => coarsened(scene.clone(), steps).map(Cow::Owned),
    }
}

/// Fuses scenes of one structural scale that may have continued from a common `start`. Where several
/// scenes have new components at one place, the component of the first scene absorbs the others.
/// Components of the start come first. The result may exceed the budget. `None` if there are no scenes.
fn fuse_at_one_scale(
    config: &SceneConfig,
    start: Option<&SceneState>,
    scenes: &[&SceneState],
) -> Option<SceneState> {
    // As the scenes continued it: a shard begins with the settled start.
    let start = start.map(|start| with_settled_photographs(config, start));
    let start = start.as_deref();
    let n_photographs = start.map_or(0, |start| photograph_poses(start).len());
    let scenes: Option<Vec<_>> = scenes
        .iter()
        .map(|scene| back_at(start, with_settled_photographs(config, scene)))
        .collect();
    let scenes = scenes?;
    let scenes: Vec<&SceneState> = scenes.iter().map(Cow::as_ref).collect();
    let first = scenes.first()?;
    let shared = start.map_or(Some(Vec::new()), components)?;
    let all: Option<Vec<Vec<Component>>> = scenes.iter().map(|s| components(s)).collect();
    let all = all?;
    let of_start = shared.par_iter().enumerate().map(|(id, start)| {
        let later: Vec<&Component> = all.iter().filter_map(|scene| scene.get(id)).collect();
        start.with_gains_of(&later, config.photometric_rule().as_ref())
    });
    let mut fused = Fused::new(config.h * factor(first.coarsening_steps), of_start.collect());
    for scene in all {
        fused.add_new_components(scene.into_iter().skip(shared.len()));
    }
    let mut state = fused.state(first);
    // Every scene's log begins with the entries of the start.
    let (n_exposures, n_poses) = start.map_or((0, 0), |s| (s.exposures.len(), s.poses.len()));
    state.exposures.extend(first.exposures.iter().take(n_exposures));
    state.poses.extend(first.poses.iter().take(n_poses));
    for scene in &scenes {
        state.exposures.extend(scene.exposures.iter().skip(n_exposures));
        state.poses.extend(scene.poses.iter().skip(n_poses));
    }
    state.photometric = state.photometric.filter(|_| config.photometric.is_some());
    if let Some(photometric) = &mut state.photometric {
        let of_scenes = scenes.iter().filter_map(|scene| scene.photometric.as_ref());
        average_residuals(photometric, of_scenes.clone());
        let steps = of_scenes.map(|photometric| photometric.texture_steps).max();
        photometric.texture_steps = steps.unwrap_or(0);
        photometric.coarsen_textures_to(config.texture_bytes());
        let poses = &mut photometric.photograph_poses;
        poses.extend(photograph_poses(first).iter().take(n_photographs));
        scenes
            .iter()
            .for_each(|scene| poses.extend(photograph_poses(scene).iter().skip(n_photographs)));
    }
    Some(state)
}

fn photograph_poses(scene: &SceneState) -> &[FramePose] {
    scene.photometric.as_ref().map_or(&[], |photometric| &photometric.photograph_poses)
}

fn with_settled_photographs<'a>(
    config: &SceneConfig,
    state: &'a SceneState,
) -> Cow<'a, SceneState> {
    settled(config, state).map_or(Cow::Borrowed(state), Cow::Owned)
}

/// Converts a scene to the coordinates of the start. Training on later frames may have moved the scene
/// as a whole. `None` if a recorded rotation is unknown.
fn back_at<'a>(
    start: Option<&SceneState>,
    scene: Cow<'a, SceneState>,
) -> Option<Cow<'a, SceneState>> {
    let of_first = |state: &SceneState| state.poses.first().and_then(FramePose::poses);
    let (Some([_, then]), Some([_, now])) = (start.and_then(of_first), of_first(&scene)) else {
        return Some(scene);
    };
    // Moving by nothing would still round every sum.
    if then == now {
        return Some(scene);
    }
    let (turn, place) = now.inverse();
    let motion = then.attached_camera(place, DQuat::from_mat3(&turn));
    moved(scene.into_owned(), &motion).map(Cow::Owned)
}

struct Component {
    seed: [f32; 3],
    /// Maximum distance of the component's points from its seed: share of the structural scale in units
    /// of 1/[`WHOLE`].
    share: u8,
    sums: [f64; N_SUMS],
    visibility: VisibilityCounts,
    estimate: Option<Estimate>,
    texture: Option<Arc<TextureSums>>,
}

/// Returns the components that have seeds, in ascending order of their numbers; `None` if a component
/// number is out of range.
fn components(state: &SceneState) -> Option<Vec<Component>> {
    let mut seeds = vec![None; state.visibility.len()];
    // In reverse, so that the oldest seed, to which sums refer, is the one retained.
    for (seed, &place) in state.seeds.iter().enumerate().rev() {
        let component = state.components.as_ref().map_or(seed, |of| of[seed] as usize);
        let share = state.shares.as_ref().map_or(WHOLE, |shares| shares[seed]);
        *seeds.get_mut(component)? = Some((place, share));
    }
    let sums = ComponentSums::restore(state.sums.clone(), state.visibility.clone());
    let component = |(id, seed): (usize, Option<([f32; 3], u8)>)| {
        let (seed, share) = seed?;
        let estimate = state.photometric.as_ref().and_then(|of| Estimate::of(of, id));
        let visibility = sums.row(id).visibility();
        let photometric = state.photometric.as_ref();
        let texture = photometric.and_then(|of| of.textures.get(id)?.clone());
        Some(Component { seed, share, sums: sums.sums(id), visibility, estimate, texture })
    };
    Some(seeds.into_iter().enumerate().filter_map(component).collect())
}

impl Component {
    /// Returns this component with all increments of its `later` versions added. Sums are whole
    /// multiples of one quantum, so they do not depend on the order of `later`.
    fn with_gains_of(&self, later: &[&Self], rule: Option<&PhotometricRule>) -> Self {
        let (mut sums, mut visibility) = (self.sums, self.visibility);
        let before = self.visibility;
        let has_more = |now: &&&Self| now.sums[0] > self.sums[0];
        // A splat restarts from its points while they are few or no photograph has trained it: such an
        // estimate contains nothing of the start.
        let is_estimate_trained =
            |rule: &_| self.estimate.is_none_or(|estimate| estimate.is_trained(rule));
        let begins =
            |rule: &PhotometricRule| self.sums[0] < rule.young || !is_estimate_trained(rule);
        let is_anew = rule.is_some_and(begins) && later.iter().any(|now| has_more(&now));
        let mut estimates = Vec::with_capacity(later.len());
        for now in later {
            for ((sum, now), before) in sums.iter_mut().zip(now.sums).zip(self.sums) {
                *sum += now - before;
            }
            let gained = VisibilityCounts {
                // Counts saturate, so that a later one may be no larger.
                expected: now.visibility.expected.saturating_sub(before.expected),
                hits: now.visibility.hits.saturating_sub(before.hits),
                misses: now.visibility.misses.saturating_sub(before.misses),
            };
            visibility = visibility.plus(gained);
            let estimate = now.estimate.filter(|_| !is_anew || has_more(&now));
            estimates.extend(estimate.map(|estimate| Later { estimate, frames: gained.hits }));
        }
        let start = self.estimate.filter(|_| !is_anew);
        let estimate = rule.and_then(|rule| fused(start, &estimates, rule));
        let texture = self.texture_with_gains_of(later);
        Self { seed: self.seed, share: self.share, sums, visibility, estimate, texture }
    }

    /// Returns the texture with all that its `later` versions have gained. If lattices were laid anew since, the
    /// result has the first of them.
    fn texture_with_gains_of(&self, later: &[&Self]) -> Option<Arc<TextureSums>> {
        let mut later: Vec<_> = later.iter().filter_map(|now| now.texture.clone()).collect();
        let start = self.texture.as_deref();
        let is_anew =
            |now: &Arc<TextureSums>| start.is_some_and(|start| now.is_laid_anew_since(start));
        // A texture that was laid anew holds the sums of the start as far as its lattice covers them.
        let anew = later.iter().position(is_anew).map(|first| later.remove(first));
        let mut all = anew.or_else(|| self.texture.clone());
        for now in later {
            let gained =
                start.map_or_else(|| now.clone(), |start| Arc::new(now.gained_since(start)));
            merge_textures(&mut all, gained);
        }
        all
    }

    /// Adds another component, after conversion of its sums to offsets from this component's seed. `h`
    /// is the structural scale, world units.
    fn add(&mut self, other: &Self, h: f64) {
        let way = (vector(other.seed) - vector(self.seed)) / h;
        let moved = SceneSums::new(&other.sums, 1.0).about_shifted_seed(way).to_array();
        for (sum, moved) in self.sums.iter_mut().zip(moved) {
            // Shifting leaves fractions of quanta, which would make later additions inexact.
            *sum += whole_quanta(moved);
        }
        self.visibility = self.visibility.plus(other.visibility);
        if let Some(texture) = &other.texture {
            merge_textures(&mut self.texture, texture.clone());
        }
    }

    /// Returns the mean of the component's points, world units from the scene's origin. `h` is the
    /// structural scale, world units.
    fn mean(&self, h: f64) -> [f32; 3] {
        let offset = SceneSums::new(&self.sums, h).mean_offset();
        (vector(self.seed) + offset).as_vec3().to_array()
    }
}

struct Fused {
    h: f64,
    components: Vec<Component>,
    /// Number of components of the common start scene.
    n_shared: usize,
    /// Seeds of all components that the start does not have, in the order of `components`.
    own: SeedGrid,
}

impl Fused {
    fn new(h: f64, shared: Vec<Component>) -> Self {
        Self { h, n_shared: shared.len(), components: shared, own: SeedGrid::new(h) }
    }

    /// Adds the components of one scene that the start does not have. A component whose mean is within
    /// reach of a seed added from another scene is merged into that seed's component. Its photometric
    /// estimate describes a different splat and is dropped. All others are appended: when created, they
    /// were too far from the start's components to belong to one.
    fn add_new_components(&mut self, own: impl Iterator<Item = Component>) {
        let n_before = self.own.len();
        // A component without points has no mean to match by.
        for component in own.filter(|component| component.sums[0] > 0.0) {
            let mean = component.mean(self.h);
            let reach = self.h as f32 * f32::from(component.share) / f32::from(WHOLE);
            let is_within = |&seed: &usize| {
                // Seeds of the same scene were born apart, so only those of other scenes count.
                squared_distance(self.own.position(seed), mean) <= reach * reach && seed < n_before
            };
            let near = self.own.nearest(mean).map(|seed| seed as usize);
            match near.filter(is_within) {
                Some(seed) => self.components[self.n_shared + seed].add(&component, self.h),
                None => {
                    self.own.insert(component.seed);
                    self.components.push(component);
                }
            }
        }
    }

    /// Returns the fused state, with the origin and structural scale of `like`. Its logs of exposures
    /// and poses are empty.
    fn state(self, like: &SceneState) -> SceneState {
        let mut sums = ComponentSums::default();
        let mut photometric = PhotometricState::default();
        photometric.grow(self.components.len());
        for (id, component) in self.components.iter().enumerate() {
            sums.push(&component.sums, component.visibility);
            if let Some(estimate) = &component.estimate {
                estimate.put(&mut photometric, id);
            }
            photometric.textures.push(component.texture.clone());
        }
        let photometric = photometric.stored(self.components.len());
        let (sums, visibility) = sums.state();
        let shares: Vec<u8> = self.components.iter().map(|component| component.share).collect();
        SceneState {
            origin: like.origin,
            coarsening_steps: like.coarsening_steps,
            seeds: self.components.iter().map(|component| component.seed).collect(),
            // A scene that never coarsened stores no shares, as in training.
            shares: shares.iter().any(|&share| share != WHOLE).then_some(shares),
            components: None,
            sums,
            visibility,
            exposures: Vec::new(),
            poses: Vec::new(),
            trajectory: Vec::new(),
            photometric: Some(photometric),
        }
    }
}

fn vector(place: [f32; 3]) -> DVec3 {
    DVec3::from_array(place.map(f64::from))
}

/// Maximum rotation between two estimates of one splat, radians. Beyond this angle their axes do not
/// correspond, and position, scales, rotation and opacity are not compared.
const MAX_TURN: f64 = 0.5;

/// Photometric estimate of one splat: parameters and precision matrices.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Estimate {
    splat: Splat,
    appearance: Appearance,
    form: [f32; N_FORM_PRECISION],
    color: [f32; N_COLOR_PRECISION],
}

#[derive(Clone, Copy)]
struct Later {
    estimate: Estimate,
    /// Number of frames since the start that showed the component.
    frames: u16,
}

impl Estimate {
    /// Reads the estimate of a component from a state; `None` if the component has no splat.
    fn of(state: &PhotometricState, component: usize) -> Option<Self> {
        state.has_splat(component).then(|| Self {
            splat: state.splats[component],
            appearance: state.appearance[component],
            form: state.form[component],
            color: state.color[component],
        })
    }

    /// True if at least one photograph has contributed to the estimate.
    fn is_trained(&self, rule: &PhotometricRule) -> bool {
        is_trained(&self.color, &rule.prior)
    }

    /// Writes the estimate to the entries of a component in `state`.
    fn put(&self, state: &mut PhotometricState, component: usize) {
        state.splats[component] = self.splat;
        state.appearance[component] = self.appearance;
        state.form[component] = self.form;
        state.color[component] = self.color;
    }

    /// Returns the step from `other` to this estimate in position, scales, rotation and opacity, in the
    /// parameters of `other`. `None` if the axes of the two splats do not correspond.
    fn form_difference(&self, other: &Self) -> Option<[f64; N_FORM]> {
        let (a, b) = (&self.splat, &other.splat);
        let turn = (rotation(b).conjugate() * rotation(a)).normalize();
        // A quaternion and its negative are the same rotation; this one has the smaller angle.
        let turn = if turn.w < 0.0 { -turn } else { turn }.to_scaled_axis();
        if turn.length() > MAX_TURN {
            return None;
        }
        let mut step = [0.0; N_FORM];
        for i in 0..3 {
            step[i] = f64::from(a.mean[i]) - f64::from(b.mean[i]);
            step[3 + i] = log_ratio(a.scale[i], b.scale[i]);
            step[6 + i] = turn[i];
        }
        step[9] = log_ratio(a.opacity, b.opacity);
        step.iter().all(|x| x.is_finite()).then_some(step)
    }

    /// Returns the step from `other` to this estimate in the colour coefficients of one channel.
    fn color_difference(&self, other: &Self, channel: usize) -> [f64; N_COLOR] {
        let (a, b) = (self.coefficients(channel), other.coefficients(channel));
        std::array::from_fn(|i| f64::from(a[i]) - f64::from(b[i]))
    }

    fn coefficients(&self, channel: usize) -> [f32; N_COLOR] {
        let ([a, b, c], [d, e, f]) =
            (self.appearance.directional[channel], self.appearance.gradient[channel]);
        [self.splat.color[channel], a, b, c, d, e, f]
    }

    fn apply_form_step(&mut self, step: &[f64], precision: &[f64], most_opacity: f64) {
        let splat = &mut self.splat;
        for i in 0..3 {
            splat.mean[i] = (f64::from(splat.mean[i]) + step[i]) as f32;
            // Steps of scales are logarithmic, so scales stay positive.
            splat.scale[i] = (f64::from(splat.scale[i]) * libm::exp(step[3 + i])) as f32;
        }
        let turn = DQuat::from_scaled_axis(DVec3::new(step[6], step[7], step[8]));
        splat.rotation = rotation_array((rotation(splat) * turn).normalize());
        let opacity = f64::from(splat.opacity) * libm::exp(step[9]);
        splat.opacity = opacity.clamp(LEAST_OPACITY, most_opacity) as f32;
        put_triangle::<N_FORM>(&mut self.form, precision);
    }

    fn apply_color_step(&mut self, steps: &[Vec<f64>; 3], precision: &[f64]) {
        for (channel, step) in steps.iter().enumerate() {
            let old = self.coefficients(channel);
            let new: [f32; N_COLOR] = std::array::from_fn(|i| (f64::from(old[i]) + step[i]) as f32);
            self.splat.color[channel] = new[0];
            self.appearance.directional[channel] = [new[1], new[2], new[3]];
            self.appearance.gradient[channel] = [new[4], new[5], new[6]];
        }
        put_triangle::<N_COLOR>(&mut self.color, precision);
    }
}

/// Combines `start` with the information that each of the `later` estimates has gained since. If there
/// is no start, the later estimates are combined as independent estimates under one prior. `None` if
/// there are no estimates.
fn fused(start: Option<Estimate>, later: &[Later], rule: &PhotometricRule) -> Option<Estimate> {
    let base = start.or(later.first().map(|later| later.estimate))?;
    let (form_prior, color_prior) = prior_precision(&base.splat, &rule.prior);
    // Without a start every estimate began with the prior alone.
    let known = if start.is_some() { 1.0 } else { 0.0 };
    let remembers = |later: &Later| known * (1.0 - rule.forgotten).powi(later.frames.into());
    let mut form = Joint::<N_FORM, 1>::new();
    let mut color = Joint::<N_COLOR, 3>::new();
    for one in later {
        let (estimate, remembered) = (&one.estimate, remembers(one));
        if let Some(step) = estimate.form_difference(&base) {
            form.add(&estimate.form, [step], &base.form, &form_prior, remembered);
        }
        let steps = std::array::from_fn(|channel| estimate.color_difference(&base, channel));
        color.add(&estimate.color, steps, &base.color, &color_prior, remembered);
    }
    let mut result = base;
    if let Some(([step], precision)) = form.solved(&base.form, &form_prior, known) {
        result.apply_form_step(&step, &precision, rule.most_opacity);
    }
    if let Some((steps, precision)) = color.solved(&base.color, &color_prior, known) {
        result.apply_color_step(&steps, &precision);
    }
    // Nearly singular sums of precisions can give values that no splat may have.
    let sound = result.splat.is_drawable() && result.appearance.is_valid();
    Some(if sound { result } else { base })
}

/// Normal equations of an estimate fused from several scenes: sums of precision and information, for `M`
/// right-hand sides.
struct Joint<const N: usize, const M: usize> {
    precision: Vec<f64>,
    information: [Vec<f64>; M],
    /// Share of the start's precision that all scenes together retain: the product of the shares of the
    /// scenes.
    remembered: f64,
}

impl<const N: usize, const M: usize> Joint<N, M> {
    fn new() -> Self {
        let information = std::array::from_fn(|_| vec![0.0; N]);
        Self { precision: vec![0.0; N * N], information, remembered: 1.0 }
    }

    /// Adds the information that the estimate of one scene has gained over the start. `own` and `start`
    /// are the precisions of that estimate and of the start, `steps` the differences of the parameters.
    /// `remembered` is the share of the start's precision that the scene retains.
    fn add(
        &mut self,
        own: &[f32],
        steps: [[f64; N]; M],
        start: &[f32],
        prior: &[f64; N],
        remembered: f64,
    ) {
        self.remembered *= remembered;
        for i in 0..N {
            for j in 0..N {
                let before = blended_precision(entry(start, i, j), prior, (i, j), remembered);
                self.precision[i * N + j] += entry(own, i, j) - before;
                for (sum, step) in self.information.iter_mut().zip(&steps) {
                    sum[i] += entry(own, i, j) * step[j];
                }
            }
        }
    }

    /// Returns the fused parameters as steps from the start, and the total precision. `None` if the
    /// precision is not positive definite or a step is not finite. `known` is 1 if there is a start,
    /// else 0.
    fn solved(
        mut self,
        start: &[f32],
        prior: &[f64; N],
        known: f64,
    ) -> Option<([Vec<f64>; M], Vec<f64>)> {
        for i in 0..N {
            for j in 0..N {
                let remembered = known * self.remembered;
                self.precision[i * N + j] +=
                    blended_precision(entry(start, i, j), prior, (i, j), remembered);
            }
        }
        let factor = Cholesky::new(N, &self.precision)?;
        let steps = self.information.map(|information| factor.solve(&information));
        steps.iter().flatten().all(|x| x.is_finite()).then_some((steps, self.precision))
    }
}

/// Blends `value`, the entry `(i, j)` of a precision matrix, with that of the prior. `remembered` is
/// the weight of `value`, from 0 to 1.
fn blended_precision<const N: usize>(
    value: f64,
    prior: &[f64; N],
    (i, j): (usize, usize),
    remembered: f64,
) -> f64 {
    let prior = if i == j { prior[i] } else { 0.0 };
    remembered * value + (1.0 - remembered) * prior
}

/// Returns an entry of a symmetric matrix stored as its lower triangle.
fn entry(triangle: &[f32], i: usize, j: usize) -> f64 {
    triangle[at(i.max(j), i.min(j))].into()
}

fn put_triangle<const N: usize>(triangle: &mut [f32], matrix: &[f64]) {
    for i in 0..N {
        for j in 0..=i {
            triangle[at(i, j)] = matrix[i * N + j] as f32;
        }
    }
}

fn log_ratio(a: f32, b: f32) -> f64 {
    libm::log(f64::from(a) / f64::from(b))
}

fn rotation(splat: &Splat) -> DQuat {
    splat.quaternion().normalize()
}

/// Sets the running means for outlier tests in `state` to the means over all scenes. Each scene is
/// weighted by its number of frames.
fn average_residuals<'a>(
    state: &mut PhotometricState,
    scenes: impl Iterator<Item = &'a PhotometricState>,
) {
    for scene in scenes {
        let pairs = [
            (&mut state.noise, scene.noise),
            (&mut state.points, scene.points),
            (&mut state.seen_through, scene.seen_through),
        ];
        for ([mean, weight], [value, more]) in pairs {
            *weight += more;
            if *weight > 0.0 {
                *mean += (value - *mean) * more / *weight;
            }
        }
    }
}
