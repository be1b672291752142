//! Checkpoints: every form of both models reads back, damage of every kind is refused.

mod damage;
mod files;
mod forms;
mod raw;
mod scene;
mod values;

use vbgs_studio::export::checkpoint::{Checkpoint, Cursor, Defect, StoredModel, parse};
use vbgs_studio::math::measured_pixel::Normalization;
use vbgs_studio::math::rng::{Purpose, Rng};
use vbgs_studio::model::conjugate::prior::Hyper;
use vbgs_studio::model::paper::state::{Carry, InitialMeans, ModelState, Totals};

/// Number of components of the samples.
const N: usize = 20;

fn means_f32() -> InitialMeans {
    let mut rng = Rng::new(7, Purpose::Synthetic, 0);
    let mut rows = || (0..N).map(|_| [0; 3].map(|_| rng.range(-2.0, 2.0) as f32)).collect();
    InitialMeans::F32 { space: rows(), color: rows() }
}

fn means_f64() -> InitialMeans {
    let mut rng = Rng::new(8, Purpose::Synthetic, 0);
    let mut rows = || (0..N).map(|_| [0; 3].map(|_| rng.range(-2.0, 2.0))).collect();
    InitialMeans::F64 { space: rows(), color: rows() }
}

/// Sums over a few points per component; the first component is unused.
fn sums() -> Vec<[f64; 13]> {
    let mut rng = Rng::new(9, Purpose::Synthetic, 0);
    let mut row = |k: usize| {
        let mut row = [0.0; 13];
        for _ in 0..k {
            let (r, d, c) = (
                rng.uniform(),
                [0; 3].map(|_| rng.range(-1.0, 1.0)),
                [0; 3].map(|_| rng.range(-1.0, 1.0)),
            );
            let terms = [
                1.0,
                d[0],
                d[1],
                d[2],
                d[0] * d[0],
                d[0] * d[1],
                d[0] * d[2],
                d[1] * d[1],
                d[1] * d[2],
                d[2] * d[2],
                c[0],
                c[1],
                c[2],
            ];
            row.iter_mut().zip(terms).for_each(|(sum, term)| *sum += r * term);
        }
        row
    };
    (0..N).map(&mut row).collect()
}

fn fixed64() -> Totals {
    let mut rows: Vec<_> = sums().iter().map(|r| r.map(|v| (v * 2f64.powi(40)) as i64)).collect();
    // Counts and second moments of two components exceed 64 bits.
    let mut limbs = [0; 13];
    for i in [0, 4, 7, 9] {
        limbs[i] = 3;
        rows[5][i] = -1;
    }
    let carries = [5, 11].map(|id| Carry { id, limbs }).to_vec();
    Totals::Fixed64 { rows, carries }
}

fn fixed128() -> Totals {
    Totals::Fixed128(sums().iter().map(|r| r.map(|v| (v * 2f64.powi(80)) as i128)).collect())
}

fn sample(means: InitialMeans, totals: Totals) -> Checkpoint {
    let alpha_init = (0..N).map(|k| 0.05 + 1e-3 * k as f64).collect();
    checkpoint(StoredModel::Mixture {
        normalization: Normalization { offset: [0.5, -1.0, 0.1], scale: [0.7, 0.7, 1.0 / 3.0] },
        hyper: Hyper::paper(N, N as f64),
        state: ModelState { alpha_init, means, totals },
    })
}

fn checkpoint(model: StoredModel) -> Checkpoint {
    Checkpoint {
        config: r#"{"preset":"paper"}"#.into(),
        meta: r#"{"program":"test"}"#.into(),
        numerics: "{}".into(),
        history: Some("[]".into()),
        cursor: Cursor { frames: 3, points: 1234, visited: vec![4, 0, 9, 2] },
        model,
    }
}

/// The parts of a checkpoint that only mixtures have.
fn mixture(checkpoint: &mut Checkpoint) -> (&mut Normalization, &mut Hyper, &mut ModelState) {
    let StoredModel::Mixture { normalization, hyper, state } = &mut checkpoint.model else {
        unreachable!()
    };
    (normalization, hyper, state)
}

/// One checkpoint of every form.
pub fn samples() -> [Checkpoint; 5] {
    [
        sample(means_f32(), fixed64()),
        sample(means_f64(), fixed128()),
        Checkpoint { history: None, ..sample(means_f32(), fixed128()) },
        scene::sample(scene::mixed()),
        checkpoint(StoredModel::Scene(scene::nothing())),
    ]
}

/// Panics unless parsing fails with a message that contains all `parts`.
#[track_caller]
fn assert_refused(bytes: &[u8], parts: &[&str]) -> Defect {
    let defect = parse(bytes).expect_err("expected a refusal");
    let message = defect.to_string();
    for part in parts {
        assert!(message.contains(part), "{part:?} is missing in: {message}");
    }
    defect
}
