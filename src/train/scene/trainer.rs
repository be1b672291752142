//! The trainer of the scene preset: owns the components and applies frames to them.

use super::accumulate::{Matched, accumulate};
use super::assign::assign;
use super::births::{Births, assign_to_lattice, give_birth};
use super::config::{BirthRule, LookRule, SceneConfig};
use super::gain::gain;
use super::grid::{NONE, SeedGrid};
use super::ledger::{Ledger, Word};
use super::observe::observe;
use super::refine::shift;
use crate::math::observation::{Observation, SurfacePoint};
use crate::model::appearance::Appearance;
use crate::model::scene::native::Anchor;
use crate::model::scene::sums::SceneSums;
use crate::model::splats::Splat;
use crate::train::timing::{StageMs, Stopwatch};
use crate::train::trainer::FrameOutcome;
use glam::DVec3;
use rayon::prelude::*;

/// Components and buffers; sums are kept in words `W`.
pub struct SceneTrainer<W> {
    config: SceneConfig,
    origin: DVec3,
    most: usize,
    grid: SeedGrid,
    ledger: Ledger<W>,
    owners: Vec<u32>,
    shifts: Vec<f32>,
    touched: Vec<u32>,
    frames: u64,
    births: Births,
}

impl<W: Word> SceneTrainer<W> {
    /// A scene without components, whose positions are kept relative to `origin` (world units);
    /// at most `most` components will be born.
    pub fn new(config: &SceneConfig, origin: DVec3, most: usize) -> Self {
        Self {
            config: config.clone(),
            origin,
            most,
            grid: SeedGrid::new(config.h),
            ledger: Ledger::default(),
            owners: Vec::new(),
            shifts: Vec::new(),
            touched: Vec::new(),
            frames: 0,
            births: Births::default(),
        }
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
            self.most,
        );
        ms.reassign = clock.lap_ms();
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
        let points = self.owners.iter().filter(|&&owner| owner != NONE).count();
        FrameOutcome { points, elbo_mean: 0.0, reassigned: self.births.born, ms }
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

    /// Components that received points from the last frame, ascending.
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

    /// What renderers draw of a component; an empty slot if nothing.
    pub fn splat(&self, id: usize) -> (Splat, Appearance) {
        self.config.native.splat(&self.sums(id), &self.anchor(id))
    }

    /// What renderers draw of all components.
    pub fn splats(&self) -> (Vec<Splat>, Vec<Appearance>) {
        (0..self.components()).into_par_iter().with_min_len(256).map(|id| self.splat(id)).unzip()
    }
}
