//! Timing of configurations in turns (A B C A B C), so that other load on the machine slows all of
//! them alike.

use crate::bench::findings::BenchError;
use crate::eval::metrics::Spread;
use crate::math::measured_pixel::Normalization;
use crate::observation::points::Points;
use crate::train::paper::config::PaperConfig;
use crate::train::paper::init::InitialDraw;
use crate::train::paper::learner;
use crate::train::paper::learner::PaperLearner;
use crate::train::timing::{PAPER_STAGES, StageMs};
use rayon::ThreadPoolBuilder;

pub struct TimedConfiguration<'a> {
    pub config: PaperConfig,
    pub threads: usize,
    pub draw: &'a InitialDraw,
    pub frames: &'a [Points<f32>],
}

pub struct Runs {
    /// Time per frame of each run: the median of each stage over the frames.
    pub runs: Vec<StageMs>,
    /// Model after the last run.
    pub engine: Box<dyn PaperLearner>,
}

impl Runs {
    pub fn spread(&self, of: impl Fn(&StageMs) -> f64) -> Spread {
        Spread::of(self.runs.iter().map(of).collect())
    }

    /// Returns the median of each stage over the runs in milliseconds, in the order of [`PAPER_STAGES`].
    pub fn stages(&self) -> [f64; PAPER_STAGES.len()] {
        std::array::from_fn(|i| self.spread(|ms| ms.values()[i]).median)
    }
}

/// Trains each variant from its initial draw on all its frames, `repeats` times, taking turns with the
/// other variants. The first frame of a run warms up buffers and is excluded unless it is the only one.
/// Calls `done` after every run.
pub fn in_turns(
    variants: &[TimedConfiguration],
    repeats: usize,
    done: &mut dyn FnMut(),
) -> Result<Vec<Runs>, BenchError> {
    let mut found: Vec<Option<Runs>> = variants.iter().map(|_| None).collect();
    for _ in 0..repeats.max(1) {
        for (variant, slot) in variants.iter().zip(&mut found) {
            // Drop the model of the previous turn first, so that each variant has at most one in
            // memory.
            let mut runs = slot.take().map_or_else(Vec::new, |earlier| earlier.runs);
            let (engine, ms) = with_threads(variant.threads, || run(variant))??;
            runs.push(ms);
            *slot = Some(Runs { runs, engine });
            done();
        }
    }
    Ok(found.into_iter().flatten().collect())
}

/// Runs `work` on a new pool of `threads` threads.
pub fn with_threads<T: Send>(
    threads: usize,
    work: impl FnOnce() -> T + Send,
) -> Result<T, BenchError> {
    // The number of threads of the global pool cannot change between turns.
    let pool = ThreadPoolBuilder::new().num_threads(threads).build();
    Ok(pool.map_err(|e| BenchError::Threads { threads, reason: e.to_string() })?.install(work))
}

fn run(variant: &TimedConfiguration) -> Result<(Box<dyn PaperLearner>, StageMs), BenchError> {
    let TimedConfiguration { config, draw, frames, .. } = variant;
    let mut engine = learner::begin(config, draw, Normalization::IDENTITY)?;
    let mut times = Vec::with_capacity(frames.len());
    for frame in *frames {
        times.push(engine.learn(frame)?.ms);
    }
    // A single frame counts although it is cold: otherwise there would be no time.
    let counted = &times[usize::from(times.len() > 1)..];
    Ok((engine, StageMs::combine(counted, |values| Spread::of(values).median)))
}
