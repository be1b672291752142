//! Size of checkpoints and time to save and load one, for every form of totals and for scenes.
//!
//! `cargo bench --bench checkpoint` prints the table for 100,000 components, `-- N` for another number.

#![allow(clippy::print_stdout)]

mod common;

use common::times_ms;
use vbgs_studio::export::checkpoint::{Checkpoint, Cursor, StoredModel, read, to_bytes, write};
use vbgs_studio::math::measured_pixel::Normalization;
use vbgs_studio::math::rng::{Purpose, Rng};
use vbgs_studio::model::conjugate::prior::Hyper;
use vbgs_studio::model::paper::state::{InitialMeans, ModelState, Totals};
use vbgs_studio::model::scene::state::{QUANTUM, SceneState, StoredSums, VisibilityCounts};
use vbgs_studio::model::scene::sums as scene;

/// Repetitions per row of the table.
const REPETITIONS: usize = 15;

fn main() {
    // Parsing skips the `--bench` that cargo adds.
    let n = std::env::args().skip(1).find_map(|a| a.parse().ok()).unwrap_or(100_000);
    println!("{n} components; milliseconds, best / median of {REPETITIONS}");
    let row = |rng: &mut Rng| {
        let noise: [f64; 13] = std::array::from_fn(|_| rng.range(-0.1, 0.1));
        std::array::from_fn(|i| noise[i] + if [0, 4, 7, 9].contains(&i) { 1.0 } else { 0.0 })
    };
    let mut rng = Rng::new(0, Purpose::Synthetic, 0);
    let rows: Vec<[f64; 13]> = (0..n).map(|_| row(&mut rng)).collect();
    let means = || {
        let points = rows.iter().map(|r| [r[1], r[2], r[3]].map(|v| v as f32));
        InitialMeans::F32 { space: points.clone().collect(), color: points.collect() }
    };
    let fixed64 = rows.iter().map(|row| row.map(|v| (v * 2f64.powi(40)) as i64)).collect();
    let fixed128 = rows.iter().map(|row| row.map(|v| (v * 2f64.powi(80)) as i128)).collect();
    let mixture = |totals| StoredModel::Mixture {
        normalization: Normalization { offset: [0.0; 3], scale: [1.0; 3] },
        hyper: Hyper::paper(n, n as f64),
        state: ModelState { alpha_init: vec![1.0; n], means: means(), totals },
    };
    time("fixed64", n, mixture(Totals::Fixed64 { rows: fixed64, carries: Vec::new() }));
    time("fixed128", n, mixture(Totals::Fixed128(fixed128)));
    let direction = [0.6, 0.0, 0.8];
    let quanta = |sums: [f32; scene::N_SUMS]| sums.map(|sum| (f64::from(sum) / QUANTUM) as i32);
    let scene = SceneState {
        origin: [0.0; 3],
        coarsening_steps: 0,
        seeds: rows.iter().map(|r| [r[1], r[2], r[3]].map(|v| v as f32)).collect(),
        shares: None,
        components: None,
        sums: StoredSums {
            rows: vec![quanta(scene::terms([0.1; 3], [0.5; 3], [0.0; 3], direction)); n],
            wide: Vec::new(),
        },
        visibility: vec![VisibilityCounts { expected: 640, hits: 1, misses: 0 }; n],
        exposures: Vec::new(),
        trajectory: Vec::new(),
        poses: Vec::new(),
        photometric: None,
    };
    time("scene", n, StoredModel::Scene(scene));
}

fn time(name: &str, n: usize, model: StoredModel) {
    let checkpoint = Checkpoint {
        config: "{}".into(),
        meta: "{}".into(),
        numerics: "{}".into(),
        history: None,
        cursor: Cursor { frames: 200, points: 1, visited: (0..200).collect() },
        model,
    };
    let folder = tempfile::tempdir().expect("a folder for temporary files");
    let path = folder.path().join("checkpoint.vbgs");
    let save = times_ms(REPETITIONS, || {
        write(&path, &checkpoint).expect("room on the disk");
    });
    let encode = times_ms(REPETITIONS, || drop(std::hint::black_box(to_bytes(&checkpoint))));
    let load = times_ms(REPETITIONS, || drop(read(&path).expect("the file just written")));
    let bytes = path.metadata().expect("the file just written").len();
    let middle = REPETITIONS / 2;
    println!(
        "{name}: {:.1} bytes per component; save {:.1} / {:.1} (of it in memory {:.1} / {:.1}); load {:.1} / {:.1}",
        bytes as f64 / n as f64,
        save[0],
        save[middle],
        encode[0],
        encode[middle],
        load[0],
        load[middle]
    );
}
