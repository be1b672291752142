//! What a photograph says of where its camera stood (`photometric.md`, Poses): the image sums of all
//! splats, as one block for the motion of the camera.

use crate::math::lane_cholesky::at;
use crate::math::simd::{Isa, Kernel, LANES, Vector};
use crate::model::scene::photometric::PhotometricState;
use crate::render::cpu::photometric::{Compared, SeenSplat};
use crate::train::scene::pose_equations::PoseEquations;
use glam::{DMat3, DVec3};
use rayon::prelude::*;

/// Splats of one partial sum: sums do not depend on the number of threads.
const CHUNK: usize = 1024;

/// Normal equations of the motion that brings pictures drawn from a camera at `centre` (world units)
/// closest to the photograph compared, whose pixels have the variance `variance`: a turn about the
/// camera's centre, then a shift, both along the world's axes.
pub fn equations(
    compared: &Compared<'_>,
    seen: &[SeenSplat],
    state: &PhotometricState,
    centre: DVec3,
    variance: f64,
) -> PoseEquations {
    let isa = Isa::best();
    let parts: Vec<PoseEquations> = seen
        .par_chunks(CHUNK)
        .map(|seen| isa.run(PoseRun { compared, seen, state, centre, weight: 1.0 / variance }))
        .collect();
    parts.iter().fold(PoseEquations::NOTHING, |mut total, part| {
        total.add(part);
        total
    })
}

/// The part of some splats.
struct PoseRun<'a> {
    compared: &'a Compared<'a>,
    seen: &'a [SeenSplat],
    state: &'a PhotometricState,
    centre: DVec3,
    weight: f64,
}

impl Kernel for PoseRun<'_> {
    type Output = PoseEquations;

    #[inline(always)]
    fn run<V: Vector>(self) -> PoseEquations {
        let Self { compared, seen, state, centre, weight } = self;
        let mut found = PoseEquations::NOTHING;
        let mut group = Vec::with_capacity(LANES);
        for seen in seen.chunks(LANES) {
            group.clear();
            group.extend(seen.iter().map(|&seen| {
                let id = seen.id as usize;
                (seen, state.splats[id], state.appearance[id])
            }));
            let sums = compared.lift::<V>(&group);
            let gradient = [0, 1, 2].map(|i| lanes(sums.gradient[i]));
            let block = |i: usize, j: usize| lanes(sums.curvature[at(i.max(j), i.min(j))]);
            let block = [0, 1, 2].map(|i| [0, 1, 2].map(|j| block(i, j)));
            for (lane, (_, splat, _)) in group.iter().enumerate() {
                let pull = DVec3::from_array(gradient.map(|axis| f64::from(axis[lane])));
                let column =
                    |j: usize| DVec3::from_array([0, 1, 2].map(|i| f64::from(block[i][j][lane])));
                let curvature = DMat3::from_cols(column(0), column(1), column(2));
                let arm = DVec3::from_array(splat.mean.map(f64::from)) - centre;
                found.add_camera_motion(arm, pull * weight, curvature * weight);
            }
        }
        found
    }
}

#[inline(always)]
fn lanes<V: Vector>(value: V) -> [f32; LANES] {
    let mut lanes = [0.0; LANES];
    value.store(&mut lanes);
    lanes
}
