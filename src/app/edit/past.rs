//! What the scene was after earlier frames.
//!
//! The viewport is sent every splat that training changes anyway: a moment costs the trainer nothing but one copy
//! of what is in memory. It is made beside the window, whose passes it would make longer by some milliseconds:
//! until it is there, the moment shares the splats of now, which are copied by whoever changes them first.
//! Copies keep to a budget of bytes and to a number: where they would exceed either, every other one
//! is dropped and the next are taken twice as far apart. So after any number of frames some dozen moments are
//! there, evenly spread. They are exact, appearance and all: a quantised one would show what never was.

use crate::model::splat::appearance::{Appearance, SplatSet};
use crate::model::splat::splats::Splat;
use std::sync::Arc;
use std::thread::{Builder, JoinHandle};

/// Moments kept at most: a slider has no use for more.
const MAX_MOMENTS: usize = 32;

/// The scene at one moment.
#[derive(Clone, Debug)]
pub struct PastScene {
    /// Frames it had seen, skipped ones among them.
    pub n_frames: usize,
    /// What was drawn of it, in its own colours.
    pub splats: Arc<SplatSet>,
    /// Of all moments that were ever kept.
    serial: u64,
}

impl PartialEq for PastScene {
    /// Whether they are the same moment.
    fn eq(&self, other: &Self) -> bool {
        self.serial == other.serial
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
    /// Of the latest moment.
    serial: u64,
    /// Copies under way, of the moments with these serials.
    copies: Vec<(u64, JoinHandle<SplatSet>)>,
}

impl Default for PastScenes {
    fn default() -> Self {
        Self { moments: Vec::new(), apart: 1, serial: 0, copies: Vec::new() }
    }
}

impl PastScenes {
    /// Keeps the scene that has seen so many frames, if it is time to and `budget` bytes allow it.
    pub fn note(&mut self, n_frames: usize, scene: &Arc<SplatSet>, budget: usize) {
        if self.moments.last().is_some_and(|last| n_frames < last.n_frames) {
            // The run began anew.
            *self = Self { serial: self.serial, ..Self::default() };
        }
        let bytes = bytes_of(scene);
        if n_frames == 0 || bytes > budget || !self.is_due(n_frames) {
            return;
        }
        self.thin(MAX_MOMENTS - 1, budget - bytes);
        if self.is_due(n_frames) {
            self.serial += 1;
            self.moments.push(PastScene { n_frames, splats: scene.clone(), serial: self.serial });
            let shared = scene.clone();
            let copy = move || SplatSet::clone(&shared);
            // Without a thread the moment goes on sharing.
            if let Ok(copy) = Builder::new().name("past".into()).spawn(copy) {
                self.copies.push((self.serial, copy));
            }
        }
    }

    /// Lets moments have the copies that are made, so that they share nothing with the scene of now; before
    /// that changes.
    pub fn take_copies(&mut self) {
        for (serial, copy) in self.copies.extract_if(.., |(_, copy)| copy.is_finished()) {
            let moment = self.moments.iter_mut().find(|moment| moment.serial == serial);
            if let (Some(moment), Ok(splats)) = (moment, copy.join()) {
                moment.splats = Arc::new(splats);
            }
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

    fn scene(n: usize) -> Arc<SplatSet> {
        Arc::new(vec![Splat::default(); n].into())
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
    fn a_moment_stays_what_it_was_and_shares_nothing_once_it_is_copied() {
        let (mut past, mut now) = (PastScenes::default(), scene(1000));
        let changed = Splat { opacity: 0.5, ..Splat::default() };
        for n_frames in 1..=4 {
            past.note(n_frames, &now, usize::MAX);
            // As fast as a copy or faster: both are right.
            if n_frames % 2 == 0 {
                while Arc::strong_count(&now) > 1 {
                    std::thread::yield_now();
                    past.take_copies();
                }
            }
            Arc::make_mut(&mut now).replace(&[n_frames as u32], &vec![changed].into());
            past.take_copies();
        }
        for moment in past.moments() {
            let n_changed = moment.splats.iter().filter(|splat| splat.opacity == 0.5).count();
            assert_eq!(n_changed, moment.n_frames - 1);
        }
        assert_ne!(past.moments()[0], past.moments()[1]);
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
