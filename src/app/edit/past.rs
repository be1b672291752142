//! What the scene was after earlier frames.
//!
//! The viewport is sent every splat that training changes anyway: a moment costs it one copy and the trainer
//! nothing. Copies keep to a budget of bytes and to a number: where they would exceed either, every other one
//! is dropped and the next are taken twice as far apart. So after any number of frames some dozen moments are
//! there, evenly spread. They are exact, appearance and all: a quantised one would show what never was.

use crate::model::splat::appearance::{Appearance, SplatSet};
use crate::model::splat::splats::Splat;
use std::sync::Arc;

/// Moments kept at most: a slider has no use for more.
const MAX_MOMENTS: usize = 32;

/// The scene at one moment.
#[derive(Clone, Debug)]
pub struct PastScene {
    /// Frames it had seen, skipped ones among them.
    pub n_frames: usize,
    /// What was drawn of it, in its own colours.
    pub splats: Arc<SplatSet>,
}

impl PartialEq for PastScene {
    /// Whether they are the same copy.
    fn eq(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.splats, &other.splats)
    }
}

impl PastScene {
    fn bytes(&self) -> usize {
        bytes_of(&self.splats)
    }
}

/// The moments of a run, by ascending frames.
#[derive(Debug)]
pub struct PastScenes {
    moments: Vec<PastScene>,
    /// Least number of frames between two.
    apart: usize,
}

impl Default for PastScenes {
    fn default() -> Self {
        Self { moments: Vec::new(), apart: 1 }
    }
}

impl PastScenes {
    /// Keeps the scene that has seen so many frames, if it is time to and `budget` bytes allow it.
    pub fn note(&mut self, n_frames: usize, scene: &SplatSet, budget: usize) {
        if self.moments.last().is_some_and(|last| n_frames < last.n_frames) {
            // The run began anew.
            *self = Self::default();
        }
        let bytes = bytes_of(scene);
        if n_frames == 0 || bytes > budget || !self.is_due(n_frames) {
            return;
        }
        self.thin(MAX_MOMENTS - 1, budget - bytes);
        if self.is_due(n_frames) {
            self.moments.push(PastScene { n_frames, splats: Arc::new(scene.clone()) });
        }
    }

    /// Keeps to another budget of bytes.
    pub fn keep_to(&mut self, budget: usize) {
        self.thin(MAX_MOMENTS, budget);
    }

    /// What the scene was when it had seen so many frames: the latest moment that is kept of then or before.
    pub fn at(&self, n_frames: usize) -> Option<&PastScene> {
        self.moments.iter().rev().find(|moment| moment.n_frames <= n_frames)
    }

    /// Every moment.
    pub fn moments(&self) -> &[PastScene] {
        &self.moments
    }

    /// Bytes of all of them.
    pub fn bytes(&self) -> usize {
        self.moments.iter().map(PastScene::bytes).sum()
    }

    fn is_due(&self, n_frames: usize) -> bool {
        self.moments.last().is_none_or(|last| n_frames >= last.n_frames + self.apart)
    }

    fn thin(&mut self, most: usize, budget: usize) {
        while self.moments.len() > most || self.bytes() > budget {
            if self.moments.len() == 1 {
                self.moments.clear();
                return;
            }
            let mut is_kept = false;
            self.moments.retain(|_| {
                is_kept = !is_kept;
                is_kept
            });
            self.apart *= 2;
        }
    }
}

fn bytes_of(scene: &SplatSet) -> usize {
    size_of_val::<[Splat]>(scene) + size_of_val::<[Appearance]>(scene.view().appearance())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scene(n: usize) -> SplatSet {
        vec![Splat::default(); n].into()
    }

    fn frames(past: &PastScenes) -> Vec<usize> {
        past.moments().iter().map(|moment| moment.n_frames).collect()
    }

    #[test]
    fn every_frame_is_kept_at_first_and_evenly_spread_ones_ever_after() {
        let mut past = PastScenes::default();
        assert!(past.at(5).is_none());
        for n in 0..=32 {
            past.note(n, &scene(n), usize::MAX);
        }
        assert_eq!(frames(&past), (1..=32).collect::<Vec<_>>());
        for n in 33..=10_000 {
            past.note(n, &scene(3), usize::MAX);
            assert!(past.moments().len() <= MAX_MOMENTS);
        }
        let kept = frames(&past);
        assert!(kept.len() > MAX_MOMENTS / 2 && kept[0] == 1, "{kept:?}");
        let gaps: Vec<usize> = kept.windows(2).map(|pair| pair[1] - pair[0]).collect();
        assert!(gaps.iter().all(|gap| *gap == gaps[0]), "{kept:?}");
        assert_eq!(past.at(kept[4] + 1).unwrap().n_frames, kept[4]);
    }

    #[test]
    fn moments_keep_to_the_budget_and_none_is_kept_that_exceeds_it_alone() {
        let budget = 10 * bytes_of(&scene(100));
        let mut past = PastScenes::default();
        for n in 1..200 {
            past.note(n, &scene(n.min(100)), budget);
            assert!(past.bytes() <= budget, "{n}");
        }
        assert!(past.bytes() > budget / 3, "{:?}", frames(&past));
        let before = frames(&past);
        past.note(300, &scene(100_000), budget);
        assert_eq!(frames(&past), before);
        past.keep_to(budget / 4);
        assert!(!past.moments().is_empty() && past.bytes() <= budget / 4);
        past.keep_to(0);
        assert!(past.moments().is_empty());
    }

    #[test]
    fn a_run_that_begins_anew_forgets_what_was_before() {
        let mut past = PastScenes::default();
        for n in [1, 2, 3, 1] {
            past.note(n, &scene(1), usize::MAX);
        }
        assert_eq!(frames(&past), [1]);
    }
}
