//! The trainer of the scene preset: owns the components and applies frames to them.

use super::accumulate::{Matched, accumulate};
use super::assign::assign;
use super::births::{Births, assign_to_lattice, give_birth};
use super::config::{BirthRule, LookRule, SceneConfig};
use super::gain::gain;
use super::grid::{NONE, SeedGrid, squared_distance};
use super::ledger::{Ledger, Word};
use super::observe::observe;
use super::refine::shift;
use crate::math::observation::{Observation, SurfacePoint};
use crate::model::appearance::{Appearance, SplatSet};
use crate::model::posterior::ComponentPosterior;
use crate::model::prior::Hyper;
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

/// Components and buffers; sums are kept in words `W`.
pub struct SceneTrainer<W> {
    config: SceneConfig,
    origin: DVec3,
    hyper: Hyper,
    scoring: Scoring,
    grid: SeedGrid,
    ledger: Ledger<W>,
    owners: Vec<u32>,
    shifts: Vec<f32>,
    /// Squared distance of every point of the last frame from its seed.
    q: Vec<f64>,
    /// Kept only while somebody asks for it.
    ownership: Option<Ownership>,
    touched: Vec<u32>,
    frames: u64,
    births: Births,
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
            ledger: Ledger::default(),
            owners: Vec::new(),
            shifts: Vec::new(),
            q: Vec::new(),
            ownership: None,
            touched: Vec::new(),
            frames: 0,
            births: Births::default(),
        }
    }

    /// A scene that goes on where another, configured alike, stopped after `frames` frames; `None` if
    /// its sums have another form.
    pub fn restore(config: &SceneConfig, state: SceneState, frames: u64) -> Option<Self> {
        let mut trainer = Self::new(config, DVec3::from_array(state.origin));
        for seed in state.seeds {
            trainer.grid.insert(seed);
        }
        trainer.ledger = Ledger::restore(state.sums, state.looks)?;
        trainer.frames = frames;
        Some(trainer)
    }

    /// The scene as it stands, its components in their [`Self::stored_order`].
    pub fn state(&self) -> SceneState {
        let order = self.stored_order();
        let (sums, looks) = self.ledger.state(&order);
        let seeds = order.into_iter().map(|id| self.grid.position(id as usize)).collect();
        SceneState { origin: self.origin.to_array(), seeds, sums, looks }
    }

    /// Components in the order in which checkpoints hold them. Where components do not depend on the
    /// order of frames, their order does not either.
    pub fn stored_order(&self) -> Vec<u32> {
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
        self.assign(&frame.points);
        ms.candidates = clock.lap_ms();
        self.births = give_birth(
            self.config.births,
            self.config.h as f32,
            &mut self.grid,
            &frame.points,
            &mut self.owners,
            self.config.most,
        );
        ms.reassign = clock.lap_ms();
        let (points, elbo_mean) = self.explain(&frame.points);
        self.refine(frame);
        let gain = self.gain(&frame.points);
        ms.e_step = clock.lap_ms();
        self.ledger.grow(self.grid.len());
        let matched =
            Matched { points: &frame.points, owners: &self.owners, shifts: &self.shifts, gain };
        let (h, looks) = (self.config.h, self.config.looks);
        accumulate(&mut self.ledger, &self.grid, matched, h, looks, &mut self.touched);
        ms.stats = clock.lap_ms();
        self.ledger.carry_over(&self.touched);
        if looks == LookRule::Projected {
            observe(&mut self.ledger, &self.grid, frame, h);
        }
        ms.update = clock.lap_ms();
        self.frames += 1;
        ms.train = wall.elapsed_ms();
        FrameOutcome { points, elbo_mean, reassigned: self.births.born, ms }
    }

    /// Points that have a component, and the mean of their ELBO under the initial model; 0 without
    /// points.
    fn explain(&mut self, points: &[SurfacePoint]) -> (usize, f64) {
        let grid = &self.grid;
        let q = |(point, &owner): (&SurfacePoint, &u32)| match owner {
            NONE => f64::NAN,
            id => f64::from(squared_distance(point.position, grid.position(id as usize))),
        };
        points.par_iter().zip(&self.owners).with_min_len(1024).map(q).collect_into_vec(&mut self.q);
        if let Some(ownership) = &mut self.ownership {
            ownership.owners.clone_from(&self.owners);
            ownership.grow(grid.len());
            ownership.count(&self.q);
        }
        let (sum, n) =
            self.q.iter().filter(|q| !q.is_nan()).fold((0.0, 0), |(s, n), q| (s + q, n + 1));
        (n, if n == 0 { 0.0 } else { self.scoring.elbo(sum / n as f64) })
    }

    fn assign(&mut self, points: &[SurfacePoint]) {
        let (rule, h) = (self.config.births, self.config.h as f32);
        match rule {
            BirthRule::Seeds => assign(&self.grid, h, points, &mut self.owners),
            _ => assign_to_lattice(rule, h, &self.grid, points, &mut self.owners),
        }
    }

    fn refine(&mut self, frame: &Observation) {
        self.shifts.clear();
        self.shifts.resize(frame.points.len(), 0.0);
        if !self.config.refine {
            return;
        }
        let (ledger, grid, h) = (&self.ledger, &self.grid, self.config.h);
        let limit = f64::from(frame.tolerance.refinement);
        let shifts = self.shifts.par_iter_mut().zip(&self.owners).zip(&frame.points);
        shifts.with_min_len(512).for_each(|((moved, &owner), point)| {
            let id = owner as usize;
            if id < ledger.len() {
                *moved = shift(ledger, id, grid.position(id), h, point, limit) as f32;
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

    /// Components.
    pub fn components(&self) -> usize {
        self.ledger.len()
    }

    /// Bytes the model itself occupies.
    pub fn model_bytes(&self) -> usize {
        self.ledger.bytes() + self.grid.bytes()
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
        let seed = DVec3::from_array(self.grid.position(id).map(f64::from));
        let expected = self.ledger.row(id).expected();
        Anchor { seed: self.origin + seed, h: self.config.h, expected }
    }

    /// Draws components by another rule from now on.
    pub fn set_native(&mut self, rule: NativeRule) {
        self.config.native = rule;
    }

    /// What renderers draw of a component; an empty slot if nothing.
    pub fn splat(&self, id: usize) -> (Splat, Appearance) {
        self.config.native.splat(&self.sums(id), &self.anchor(id))
    }

    /// What renderers draw of all components; slot `k` is component `k`.
    pub fn splats(&self) -> SplatSet {
        let splats = (0..self.components()).into_par_iter().with_min_len(256);
        let (splats, appearance) = splats.map(|id| self.splat(id)).unzip();
        SplatSet::new(splats, appearance)
    }

    /// What renderers draw of the listed components, in their order.
    pub fn splats_of(&self, ids: &[u32]) -> SplatSet {
        let splats = ids.par_iter().with_min_len(256);
        let (splats, appearance) = splats.map(|&id| self.splat(id as usize)).unzip();
        SplatSet::new(splats, appearance)
    }

    /// Posterior of a component, world units relative to the scene's origin, colours normalised.
    /// Its prior mean is the seed (`model.md` 14, quirk 2).
    pub fn posterior(&self, id: usize) -> ComponentPosterior {
        let moments = self.sums(id).moments();
        let mut posterior = ComponentPosterior::new(&self.hyper, DVec3::ZERO, &moments);
        posterior.mean_space += DVec3::from_array(self.grid.position(id).map(f64::from));
        posterior
    }

    /// Sums the ELBO of the points of every frame to come by their component. Without it that costs
    /// neither time nor memory.
    pub fn start_component_elbo(&mut self) {
        self.ownership.get_or_insert_with(|| Ownership::new(self.grid.len()));
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
