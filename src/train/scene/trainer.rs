//! The trainer of the scene preset: owns the components and applies frames to them.

use super::accumulate::{Matched, accumulate};
use super::align::{Alignment, EVERY, Motion};
use super::assign::assign;
use super::births::{Limits, assign_to_lattice, give_birth};
use super::components::Components;
use super::config::{BirthRule, LookRule, SceneConfig};
use super::gain::gain;
use super::grid::{NONE, SeedGrid, squared_distance};
use super::ledger::{Ledger, Word};
use super::merge::merge_down;
use super::observe::observe;
use super::places::Places;
use super::refine::shift;
use crate::math::camera::Camera;
use crate::math::observation::{DepthTolerance, Observation, SurfacePoint};
use crate::model::appearance::{Appearance, Finishing, SplatSet};
use crate::model::posterior::ComponentPosterior;
use crate::model::prior::Hyper;
use crate::model::scene::exposure::{Exposure, ExposureLog};
use crate::model::scene::native::{Anchor, NativeRule};
use crate::model::scene::state::{SceneState, seed_order};
use crate::model::scene::sums::SceneSums;
use crate::model::splats::Splat;
use crate::train::estep::Scoring;
use crate::train::ownership::Ownership;
use crate::train::timing::{StageMs, Stopwatch};
use crate::train::trainer::FrameOutcome;
use glam::DVec3;
use rayon::prelude::*;
use std::sync::Arc;

/// Every so many frames all components are told to have changed.
const EVERYTHING_EVERY: u64 = 16;
/// Components beyond the budget that a frame may bring in any case.
const LEAST_EXCESS: usize = 64;

/// Points that found no component.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Lost {
    /// The budget was used up.
    pub budget: u64,
    /// They lay too far from the origin to be told from their neighbours.
    pub reach: u64,
}

/// Components and buffers; sums are kept in words `W`.
pub struct SceneTrainer<W> {
    config: SceneConfig,
    origin: DVec3,
    hyper: Hyper,
    scoring: Scoring,
    grid: SeedGrid,
    components: Components,
    ledger: Ledger<W>,
    owners: Vec<u32>,
    shifts: Vec<f32>,
    /// Squared distance of every point of the last frame from its seed.
    q: Vec<f64>,
    /// Kept only while somebody asks for it.
    ownership: Option<Ownership>,
    touched: Vec<u32>,
    frames: u64,
    /// Points that found no component so far.
    lost: Lost,
    /// How the frames were exposed, while gains are fitted.
    exposures: Vec<Exposure>,
    /// Points of the frame being learnt as its corrected pose has them.
    moved: Vec<SurfacePoint>,
}

impl<W: Word> SceneTrainer<W> {
    /// A scene without components, whose positions are kept relative to `origin` (world units).
    pub fn new(config: &SceneConfig, origin: DVec3) -> Self {
        let hyper = Hyper::scene(config.h);
        Self {
            config: config.clone(),
            origin,
            hyper,
            scoring: Scoring::new(&hyper),
            grid: SeedGrid::new(config.h),
            components: Components::default(),
            ledger: Ledger::default(),
            owners: Vec::new(),
            shifts: Vec::new(),
            q: Vec::new(),
            ownership: None,
            touched: Vec::new(),
            frames: 0,
            lost: Lost::default(),
            exposures: Vec::new(),
            moved: Vec::new(),
        }
    }

    /// A scene that goes on where another, configured alike, stopped after `frames` frames; `None` if
    /// its sums have another form.
    pub fn restore(config: &SceneConfig, state: SceneState, frames: u64) -> Option<Self> {
        let mut trainer = Self::new(config, DVec3::from_array(state.origin));
        trainer.ledger = Ledger::restore(state.sums, state.looks)?;
        for seed in state.seeds {
            let seed = trainer.grid.insert(seed);
            trainer.components.born(seed);
        }
        if let Some(components) = state.components {
            trainer.components = Components::restore(components, trainer.ledger.len())?;
        }
        trainer.exposures = state.exposures;
        trainer.frames = frames;
        Some(trainer)
    }

    /// The scene as it stands, its components in their stored order.
    pub fn state(&self) -> SceneState {
        let order = self.stored_order();
        let (sums, looks) = self.ledger.state(&order);
        let components = self.components.shared().map(<[u32]>::to_vec);
        let seeds = match components {
            Some(_) => (0..self.grid.len()).map(|seed| self.grid.position(seed)).collect(),
            None => order.into_iter().map(|id| self.grid.position(id as usize)).collect(),
        };
        let exposures = self.exposures.clone();
        SceneState { origin: self.origin.to_array(), seeds, components, sums, looks, exposures }
    }

    /// Components in the order in which checkpoints hold them. Where components do not depend on the
    /// order of frames, their order does not either.
    fn stored_order(&self) -> Vec<u32> {
        let mut order: Vec<u32> = (0..self.components() as u32).collect();
        if self.config.births.is_order_invariant() {
            let seed = |id: &u32| self.grid.position(*id as usize);
            order.sort_unstable_by(|a, b| seed_order(&seed(a), &seed(b)));
        }
        order
    }

    /// Learns from one frame, whole: nothing in it can fail.
    pub fn train(&mut self, frame: &Observation) -> FrameOutcome {
        let wall = Stopwatch::start();
        let mut ms = StageMs::default();
        let mut clock = Stopwatch::start();
        let (moved, camera) = self.moved(frame);
        let points = moved.as_deref().unwrap_or(&frame.points);
        ms.e_step = clock.lap_ms();
        self.assign(points);
        ms.candidates = clock.lap_ms();
        let births = self.give_birth(points);
        ms.reassign = clock.lap_ms();
        let (n_points, elbo_mean) = self.explain(points);
        self.refine(points, frame.tolerance);
        let gain = self.gain(points);
        ms.e_step += clock.lap_ms();
        self.ledger.grow(self.components.n_rows());
        let matched = Matched { points, owners: &self.owners, shifts: &self.shifts, gain };
        let (h, looks) = (self.config.h, self.config.looks);
        let places = Places { grid: &self.grid, components: &self.components };
        accumulate(&mut self.ledger, places, matched, h, looks, &mut self.touched);
        ms.stats = clock.lap_ms();
        self.ledger.carry_over(&self.touched);
        if looks == LookRule::Projected {
            observe(&mut self.ledger, places, frame, &camera, h);
        }
        ms.update = clock.lap_ms();
        if self.config.gain {
            self.exposures.push(Exposure::new(&camera.pose, gain));
        }
        self.moved = moved.unwrap_or_default();
        self.frames += 1;
        let has_merged = self.merge();
        if has_merged || self.frames.is_multiple_of(EVERYTHING_EVERY) {
            // Looks and merging change components without points as well.
            self.touched.clear();
            self.touched.extend(0..self.components.n_rows() as u32);
        }
        ms.reassign += clock.lap_ms();
        ms.train = wall.elapsed_ms();
        FrameOutcome { points: n_points, elbo_mean, reassigned: births, ms }
    }

    /// The frame's points and camera as they stood, if the scene tells better than the recorded pose.
    fn moved(&mut self, frame: &Observation) -> (Option<Vec<SurfacePoint>>, Camera) {
        match self.config.align.then(|| self.motion(frame)).flatten() {
            None => (None, frame.camera),
            Some(motion) => {
                let mut points = std::mem::take(&mut self.moved);
                let camera = motion.apply(frame, &mut points);
                (Some(points), camera)
            }
        }
    }

    /// See [`Alignment::motion`].
    pub(super) fn motion(&mut self, frame: &Observation) -> Option<Motion> {
        let points: Vec<SurfacePoint> = frame.points.iter().step_by(EVERY).copied().collect();
        self.assign(&points);
        let alignment = Alignment {
            ledger: &self.ledger,
            places: Places { grid: &self.grid, components: &self.components },
            h: self.config.h,
            ridge: self.config.native.gradient_ridge * self.config.h * self.config.h,
            frame,
            points: &points,
            owners: &self.owners,
            gain: self.gain(&points),
        };
        alignment.motion()
    }

    /// Gives points without a component one of their own, as far as the budget allows: a frame may
    /// exceed it by an eighth, until its components are merged. How many were born.
    fn give_birth(&mut self, points: &[SurfacePoint]) -> usize {
        let (rule, h, most) = (self.config.births, self.config.h as f32, self.config.most);
        let seeds = self.config.most_seeds();
        let limits = match rule.is_order_invariant() {
            true => Limits { components: seeds, seeds },
            false => Limits { components: most + (most / 8).max(LEAST_EXCESS), seeds },
        };
        let Self { grid, components, owners, .. } = self;
        let births = give_birth(rule, h, grid, components, points, owners, limits);
        self.lost.budget += births.refused as u64;
        self.lost.reach += births.out_of_reach as u64;
        births.born
    }

    /// Merges components until the budget holds; whether any were. Components of a lattice may not
    /// depend on when the budget was reached: they are merged when they are drawn.
    fn merge(&mut self) -> bool {
        let most = self.config.most;
        let is_over = self.components.used() > most;
        if is_over && !self.config.births.is_order_invariant() {
            // Some less than allowed: merging takes longer than a frame.
            let target = most - most / 16;
            let Self { ledger, components, grid, .. } = self;
            merge_down(ledger, components, grid, self.config.h, target);
            return true;
        }
        false
    }

    /// Points that have a component, and the mean of their ELBO under the initial model; 0 without
    /// points.
    fn explain(&mut self, points: &[SurfacePoint]) -> (usize, f64) {
        let places = Places { grid: &self.grid, components: &self.components };
        let q = |(point, &owner): (&SurfacePoint, &u32)| match owner {
            NONE => f64::NAN,
            id => f64::from(squared_distance(point.position, places.of(id as usize))),
        };
        points.par_iter().zip(&self.owners).with_min_len(1024).map(q).collect_into_vec(&mut self.q);
        if let Some(ownership) = &mut self.ownership {
            ownership.owners.clone_from(&self.owners);
            ownership.grow(self.components.n_rows());
            ownership.count(&self.q);
        }
        let (sum, n) =
            self.q.iter().filter(|q| !q.is_nan()).fold((0.0, 0), |(s, n), q| (s + q, n + 1));
        (n, if n == 0 { 0.0 } else { self.scoring.elbo(sum / n as f64) })
    }

    fn assign(&mut self, points: &[SurfacePoint]) {
        let (rule, h) = (self.config.births, self.config.h as f32);
        match rule {
            BirthRule::Seeds => {
                assign(&self.grid, &self.components, h, points, &mut self.owners);
            }
            BirthRule::Lattice | BirthRule::BodyCentred => {
                assign_to_lattice(rule, h, &self.grid, &self.components, points, &mut self.owners);
            }
        }
    }

    fn refine(&mut self, points: &[SurfacePoint], tolerance: DepthTolerance) {
        self.shifts.clear();
        self.shifts.resize(points.len(), 0.0);
        if !self.config.refine {
            return;
        }
        let (ledger, h) = (&self.ledger, self.config.h);
        let places = Places { grid: &self.grid, components: &self.components };
        let limit = f64::from(tolerance.refinement);
        let shifts = self.shifts.par_iter_mut().zip(&self.owners).zip(points);
        shifts.with_min_len(512).for_each(|((moved, &owner), point)| {
            let id = owner as usize;
            if id < ledger.len() {
                *moved = shift(ledger, id, places.of(id), h, point, limit) as f32;
            }
        });
    }

    fn gain(&self, points: &[SurfacePoint]) -> [f32; 3] {
        if self.config.gain { gain(&self.ledger, points, &self.owners) } else { [1.0; 3] }
    }

    /// Frames learnt.
    pub fn frames(&self) -> u64 {
        self.frames
    }

    /// Slots of components, in use or free.
    pub fn components(&self) -> usize {
        self.ledger.len()
    }

    /// Components in use.
    pub fn used(&self) -> usize {
        self.components.used()
    }

    /// Points that found no component so far.
    pub fn lost(&self) -> Lost {
        self.lost
    }

    /// Bytes the model itself occupies.
    pub fn model_bytes(&self) -> usize {
        self.ledger.bytes() + self.grid.bytes() + self.components.bytes()
    }

    /// Components that the last frame changed, ascending.
    pub fn touched(&self) -> &[u32] {
        &self.touched
    }

    /// Everything a component has received, world units about its seed.
    pub fn sums(&self, id: usize) -> SceneSums {
        SceneSums::new(&self.ledger.sums(id), self.config.h)
    }

    /// Where a component's sums are about, world units, and the returns expected of it.
    pub fn anchor(&self, id: usize) -> Anchor {
        let seed = self.seed(id);
        let expected = self.ledger.row(id).expected();
        Anchor { seed: self.origin + seed, h: self.config.h, expected, frames: self.frames }
    }

    /// Where a component's sums are about, world units from the origin.
    fn seed(&self, id: usize) -> DVec3 {
        let places = Places { grid: &self.grid, components: &self.components };
        DVec3::from_array(places.of(id).map(f64::from))
    }

    /// Draws components by another rule from now on.
    pub fn set_native(&mut self, rule: NativeRule) {
        self.config.native = rule;
    }

    /// What renderers draw of a component; an empty slot if nothing.
    pub fn splat(&self, id: usize) -> (Splat, Appearance) {
        self.config.native.splat(&self.sums(id), &self.anchor(id))
    }

    /// What renderers draw of all components; slot `k` is component `k`. Of a lattice that exceeds its
    /// budget, see [`Self::stored_splats`].
    pub fn splats(&self) -> SplatSet {
        self.within_budget().map_or_else(|| self.every_splat(), |merged| merged.every_splat())
    }

    /// The same in the order in which checkpoints hold the components; components of a lattice that
    /// exceeds its budget are merged in that order until they hold it.
    pub fn stored_splats(&self) -> SplatSet {
        match self.within_budget() {
            Some(merged) => merged.every_splat(),
            None => self.splats_of(&self.stored_order()),
        }
    }

    /// The scene of a lattice that exceeds its budget, merged until it holds it.
    fn within_budget(&self) -> Option<Self> {
        let most = self.config.most;
        if !self.config.births.is_order_invariant() || self.used() <= most {
            return None;
        }
        let mut merged = Self::restore(&self.config, self.state(), self.frames)?;
        let Self { ledger, components, grid, .. } = &mut merged;
        merge_down(ledger, components, grid, self.config.h, most);
        Some(merged)
    }

    fn every_splat(&self) -> SplatSet {
        let splats = (0..self.components()).into_par_iter().with_min_len(256);
        let (splats, appearance) = splats.map(|id| self.splat(id)).unzip();
        self.set_of(splats, appearance)
    }

    /// What renderers draw of the listed components, in their order.
    pub fn splats_of(&self, ids: &[u32]) -> SplatSet {
        let splats = ids.par_iter().with_min_len(256);
        let (splats, appearance) = splats.map(|&id| self.splat(id as usize)).unzip();
        self.set_of(splats, appearance)
    }

    fn set_of(&self, splats: Vec<Splat>, appearance: Vec<Appearance>) -> SplatSet {
        let exposures = ExposureLog::new(self.exposures.clone(), self.config.h);
        let exposures = (!self.exposures.is_empty()).then(|| Arc::new(exposures));
        let closing = self.config.native.closing as f32;
        SplatSet::new(splats, appearance).finished(Finishing { closing, exposures })
    }

    /// Posterior of a component, world units relative to the scene's origin, colours normalised.
    /// Its prior mean is the seed (`model.md`, Scene posterior).
    pub fn posterior(&self, id: usize) -> ComponentPosterior {
        let moments = self.sums(id).moments();
        let mut posterior = ComponentPosterior::new(&self.hyper, DVec3::ZERO, &moments);
        posterior.mean_space += self.seed(id);
        posterior
    }

    /// Sums the ELBO of the points of every frame to come by their component. Without it that costs
    /// neither time nor memory.
    pub fn start_component_elbo(&mut self) {
        self.ownership.get_or_insert_with(|| Ownership::new(self.components.n_rows()));
    }

    /// Ends what [`Self::start_component_elbo`] began.
    pub fn stop_component_elbo(&mut self) {
        self.ownership = None;
    }

    /// Mean ELBO and number of a component's points of the last frame; `None` if it has none, or if
    /// nobody asked before that frame.
    pub fn component_elbo(&self, component: usize) -> Option<(f64, u32)> {
        let (q, n) = self.ownership.as_ref()?.of(component)?;
        Some((self.scoring.elbo(q), n))
    }

    /// Components that [`Self::component_elbo`] knows of, each once.
    pub fn components_with_elbo(&self) -> &[u32] {
        self.ownership.as_ref().map_or(&[], Ownership::ids)
    }
}
