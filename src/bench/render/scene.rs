//! Scenes with any number of splats and constant coverage of the image.
//!
//! Splats shrink as their number grows, so that the cost follows the number of splats rather than
//! their overlap. Shapes and opacities of the synthetic scene match those of a trained scene.

use crate::math::rng::{Purpose, Rng};
use crate::model::splat::splats::Splat;
use glam::{DQuat, DVec3};
use std::borrow::Cow;
use std::f64::consts::{PI, TAU};

#[derive(Clone, Debug)]
pub struct BenchScene {
    name: String,
    up: DVec3,
    /// Splats of a loaded model; empty for the synthetic scene.
    model: Vec<Splat>,
}

/// Radius of the ball, world units. The next constant is the radius of the disc below the ball.
const BALL: f64 = 0.6;
const DISC: f64 = 1.2;
/// Standard deviation of a splat along the surface, relative to the square root of the area per splat.
/// This constant and the next two were measured on Lego, trained with the `paper` preset.
const SPREAD: f64 = 0.5;
/// Standard deviation of a splat across the surface, relative to that along the surface.
const FLATNESS: f64 = 0.6;
/// Standard deviation of the logarithm of a splat's size.
const UNEVENNESS: f64 = 0.3;
/// Opacity that training assigns to every splat.
const OPACITY: f32 = 0.95;

impl BenchScene {
    pub fn synthetic() -> Self {
        Self { name: "synthetic ball on a disc".to_owned(), up: DVec3::Z, model: Vec::new() }
    }

    /// Creates a scene from a model. `name` appears in reports, `up` is the up direction. Returns `None`
    /// if the model has no drawable splat.
    pub fn model(name: String, up: DVec3, mut splats: Vec<Splat>) -> Option<Self> {
        // Splats that no renderer draws would lower the cost per splat.
        splats.retain(Splat::is_drawable);
        (!splats.is_empty()).then_some(Self { name, up, model: splats })
    }

    pub fn name(&self) -> &str {
        &self.name
    }

    pub fn up(&self) -> DVec3 {
        self.up
    }

    pub fn own_count(&self) -> Option<usize> {
        (!self.model.is_empty()).then_some(self.model.len())
    }

    /// Returns the scene with `n` splats. The size of a splat decreases with `n`, so that coverage is
    /// constant.
    pub fn splats(&self, n: usize, seed: u64) -> Cow<'_, [Splat]> {
        match self.own_count() {
            None => Cow::Owned(synthetic(n, seed)),
            // Unchanged, so that the cost is that of the model itself.
            Some(own) if own == n => Cow::Borrowed(&self.model),
            Some(_) => Cow::Owned(resampled(&self.model, n, seed)),
        }
    }
}

/// Returns `n` copies of the splats, equally many (±1) of each, at random positions within the
/// originals. If `n` is smaller than the number of splats, returns an enlarged subset without
/// displacement.
fn resampled(splats: &[Splat], n: usize, seed: u64) -> Vec<Splat> {
    let mut rng = Rng::new(seed, Purpose::Synthetic, 1);
    let share = n as f64 / splats.len() as f64;
    // Surfaces are two-dimensional: scaling sides by the square root preserves the total area.
    let shrink = share.powf(-0.5) as f32;
    let mut copy = |i: usize| {
        let original = &splats[(i as f64 / share) as usize];
        let scale = original.scale.map(|s| s * shrink);
        // Fewer splats than the model has: an enlarged subset, without displacement.
        if n <= splats.len() {
            return Splat { scale, ..*original };
        }
        let [w, x, y, z] = original.rotation.map(f64::from);
        let within = DVec3::from_array(original.scale.map(|s| f64::from(s) * rng.normal()));
        let shift = (DQuat::from_xyzw(x, y, z, w) * within).to_array();
        let mean = std::array::from_fn(|axis| original.mean[axis] + shift[axis] as f32);
        Splat { mean, scale, ..*original }
    };
    (0..n).map(&mut copy).collect()
}

/// Returns `n` flat splats on a ball above a disc.
fn synthetic(n: usize, seed: u64) -> Vec<Splat> {
    let mut rng = Rng::new(seed, Purpose::Synthetic, 0);
    let ball = 4.0 * PI * BALL * BALL;
    let area = ball + PI * DISC * DISC;
    let size = SPREAD * (area / n as f64).sqrt();
    let splat = |_| {
        let on_ball = rng.uniform() < ball / area;
        // Uniform z gives uniform area on a sphere (Archimedes).
        let (z, angle) = (rng.range(-1.0, 1.0), TAU * rng.uniform());
        // On the disc, the square root makes points uniform by area.
        let ring = if on_ball { (1.0 - z * z).sqrt() } else { z.abs().sqrt() };
        let around = DVec3::new(ring * angle.cos(), ring * angle.sin(), 0.0);
        let (at, normal) = match on_ball {
            true => ((around + z * DVec3::Z + DVec3::Z) * BALL, around + z * DVec3::Z),
            false => (DISC * around, DVec3::Z),
        };
        on_surface(at, normal, size, &mut rng)
    };
    (0..n).map(splat).collect()
}

/// Returns a flat splat at a point of a surface, aligned with it. The standard deviation along the
/// surface is about `size`.
fn on_surface(at: DVec3, normal: DVec3, size: f64, rng: &mut Rng) -> Splat {
    let turn =
        DQuat::from_rotation_arc(DVec3::Z, normal) * DQuat::from_rotation_z(TAU * rng.uniform());
    let mut along = || size * (UNEVENNESS * rng.normal()).exp();
    let scale = [along(), along(), FLATNESS * size].map(|s| s as f32);
    let wave = |phase: f64| 0.5 + 0.4 * (5.0 * at.dot(DVec3::ONE) + 3.0 * normal.x + phase).sin();
    Splat {
        mean: at.as_vec3().to_array(),
        opacity: OPACITY,
        color: [0.0, 2.0, 4.0].map(|phase| (wave(phase) + rng.range(-0.1, 0.1)) as f32),
        scale,
        rotation: [turn.w, turn.x, turn.y, turn.z].map(|q| q as f32),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn area(splats: &[Splat]) -> f64 {
        splats.iter().map(|s| f64::from(s.scale[0] * s.scale[1])).sum()
    }

    #[test]
    fn any_number_of_splats_covers_as_much() {
        let few = BenchScene::synthetic().splats(2000, 7).into_owned();
        let model = BenchScene::model("model".to_owned(), DVec3::Z, few.clone()).unwrap();
        for scene in [&BenchScene::synthetic(), &model] {
            for n in [500, 2000, 9000] {
                let splats = scene.splats(n, 7);
                assert_eq!(splats.len(), n);
                assert!(splats.iter().all(Splat::is_drawable));
                let ratio = area(&splats) / area(&few);
                assert!((0.9..1.1).contains(&ratio), "{}: {n}: {ratio}", scene.name());
            }
        }
        assert_eq!(*model.splats(2000, 9), few, "its own number leaves a model as it is");
    }

    #[test]
    fn a_model_without_splats_is_no_scene() {
        assert!(BenchScene::model("empty".to_owned(), DVec3::Z, vec![Splat::default()]).is_none());
    }
}
