//! Benches measure speed, error and size. Most yield a table, JSON, CSV and a plot. This file has the choice
//! of frames and views that they share.
#![allow(missing_docs, reason = "no other crate uses this module")]

pub mod findings;
pub mod history;
pub mod paper;
mod plot;
pub mod protocol;
pub mod render;
pub mod report;
pub mod scene;

use crate::dataset::Dataset;
use crate::pipeline::plan::Plan;
use crate::pipeline::prefetch::{Prefetch, Prepare, PreparedFrame};
use findings::BenchError;
use std::sync::Arc;

/// Views of a dataset: index of the split and frame indices in it.
pub type ViewIndices = (usize, Vec<usize>);

/// Returns up to `n` evenly spaced items.
pub fn spaced<T: Copy>(items: &[T], n: usize) -> Vec<T> {
    let n = n.min(items.len());
    // Multiplied first: an integer division first would drop the items at the end.
    (0..n).map(|i| items[i * items.len() / n]).collect()
}

/// Returns up to `n` evenly spaced views that are held out when training on the given split.
pub fn held_out_views(dataset: &Dataset, training_split: usize, n: usize) -> ViewIndices {
    let held_out = dataset.evaluation(training_split).new_views;
    (held_out.split, spaced(&held_out.frames, n))
}

/// Prepares the frames of a plan in order and skips unusable ones. Each prepared frame is passed to
/// `work` with its position in the plan and its name.
///
/// # Errors
/// No frame is usable, or `work` fails.
pub fn each_frame<P: Prepare>(
    dataset: &Arc<Dataset>,
    plan: &Plan,
    preparation: P,
    mut work: impl FnMut(usize, String, &mut PreparedFrame<P::Observation>) -> Result<(), BenchError>,
) -> Result<(), BenchError> {
    let mut prefetch = Prefetch::start(dataset.clone(), plan, 0, preparation)?;
    let (mut n_usable, mut first_problem) = (0, None);
    while let Some(frame) = prefetch.next_frame() {
        match frame.result {
            Ok(mut prepared) => {
                n_usable += 1;
                work(frame.position, frame.name, &mut prepared)?;
                // A later frame reuses the memory, as in training.
                prefetch.recycle(prepared.observation);
            }
            // One damaged file must not end a bench of hours.
            Err(problem) => drop(first_problem.get_or_insert(problem)),
        }
    }
    if n_usable > 0 {
        return Ok(());
    }
    let first = first_problem.unwrap_or_else(|| "no frame is selected".to_owned());
    Err(BenchError::NoFrame { dataset: dataset.name.clone(), first })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn items_are_evenly_spaced_and_none_is_repeated() {
        assert_eq!(spaced(&[0, 1, 2, 3, 4, 5], 3), [0, 2, 4]);
        assert_eq!(spaced(&[1, 2, 3], 9), [1, 2, 3]);
    }
}
