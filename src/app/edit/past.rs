//! Copies of the scene as it was after earlier frames.
//!
//! The viewport already receives every splat that training changes, so a copy costs the trainer nothing. A
//! separate thread makes the copy, which would otherwise delay the window by some milliseconds. Until the
//! copy is finished, the stored state shares its memory with the current scene (copy on write). The number
//! and the total size of the copies are bounded: beyond either bound, every other copy is dropped and the
//! interval between copies doubles. At most a few dozen remain, evenly spaced over any number of frames.
//! Copies are exact and include the appearance of the splats.

use crate::model::splat::appearance::{Appearance, SplatSet};
use crate::model::splat::splats::Splat;
use std::sync::Arc;
use std::thread::{Builder, JoinHandle};

/// Maximum number of stored scenes, which is enough for the slider that selects one.
const MAX_MOMENTS: usize = 32;

#[derive(Clone, Debug)]
pub struct PastScene {
    /// Number of frames processed before the copy, skipped ones included.
    pub n_frames: usize,
    /// Training time until then, seconds.
    pub seconds: f64,
    /// Splats in their learned colours.
    pub splats: Arc<SplatSet>,
    serial: u64,
    bytes: usize,
}

impl PartialEq for PastScene {
    fn eq(&self, other: &Self) -> bool {
        // Comparing splats would cost time in every pass.
        self.serial == other.serial
    }
}

/// Stored earlier scenes of a run, in ascending order of frames.
#[derive(Debug)]
pub struct PastScenes {
    moments: Vec<PastScene>,
    /// Minimum number of frames between two copies.
    interval: usize,
    serial: u64,
    /// Threads that copy a scene, each with the serial number of its copy.
    copies: Vec<(u64, JoinHandle<SplatSet>)>,
}

impl Default for PastScenes {
    fn default() -> Self {
        Self { moments: Vec::new(), interval: 1, serial: 0, copies: Vec::new() }
    }
}

impl PastScenes {
    /// Stores the scene after `n_frames` frames if a copy is due and its size is within `budget` bytes.
    pub fn record(
        &mut self,
        (n_frames, seconds): (usize, f64),
        scene: &Arc<SplatSet>,
        budget: usize,
    ) {
        if self.moments.last().is_some_and(|last| n_frames < last.n_frames) {
            // The run was restarted.
            *self = Self { serial: self.serial, ..Self::default() };
        }
        if n_frames == 0 || !self.is_due(n_frames) {
            return;
        }
        let bytes = bytes_of(scene);
        // A copy larger than the budget would displace all others.
        if bytes > budget {
            return;
        }
        // Thinned before the check below, because thinning doubles the interval.
        self.thin(MAX_MOMENTS - 1, budget - bytes);
        if self.is_due(n_frames) {
            self.serial += 1;
            let (splats, serial) = (scene.clone(), self.serial);
            self.moments.push(PastScene { n_frames, seconds, splats, serial, bytes });
            let shared = scene.clone();
            let copy = move || SplatSet::clone(&shared);
            // Without a thread the copy keeps sharing memory with the scene.
            if let Ok(copy) = Builder::new().name("past".into()).spawn(copy) {
                self.copies.push((self.serial, copy));
            }
        }
    }

    /// Replaces stored scenes that share memory with the current scene by their finished copies. Must be
    /// called before the current scene changes; the change would otherwise copy the whole scene.
    pub fn install_finished_copies(&mut self) {
        for (serial, copy) in self.copies.extract_if(.., |(_, copy)| copy.is_finished()) {
            let moment = self.moments.iter_mut().find(|moment| moment.serial == serial);
            if let (Some(moment), Ok(splats)) = (moment, copy.join()) {
                moment.splats = Arc::new(splats);
            }
        }
    }

    pub fn set_budget(&mut self, budget: usize) {
        self.thin(MAX_MOMENTS, budget);
    }

    /// Returns the latest copy made after at most `n_frames` frames.
    pub fn latest_at(&self, n_frames: usize) -> Option<&PastScene> {
        self.moments.iter().rev().find(|moment| moment.n_frames <= n_frames)
    }

    pub fn moments(&self) -> &[PastScene] {
        &self.moments
    }

    /// Returns the memory of all copies, bytes.
    pub fn bytes(&self) -> usize {
        self.moments.iter().map(|moment| moment.bytes).sum()
    }

    fn is_due(&self, n_frames: usize) -> bool {
        self.moments.last().is_none_or(|last| n_frames >= last.n_frames + self.interval)
    }

    fn thin(&mut self, most: usize, budget: usize) {
        while self.moments.len() > most || self.bytes() > budget {
            // The thinning below always retains the first copy.
            if self.moments.len() == 1 {
                self.moments.clear();
                return;
            }
            let mut is_kept = false;
            self.moments.retain(|_| {
                is_kept = !is_kept;
                is_kept
            });
            // Or new copies would be denser than the remaining ones.
            self.interval *= 2;
        }
    }
}

/// Returns the memory of a scene, bytes. Textures count as if no other scene shared them.
fn bytes_of(scene: &SplatSet) -> usize {
    // Copies share textures that have not changed in between; at worst all have.
    let (_, of_textures) = scene.finishing().texture_size();
    of_textures
        + size_of_val::<[Splat]>(scene)
        + size_of_val::<[Appearance]>(scene.view().appearance())
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
        assert!(past.latest_at(5).is_none());
        for n in 0..=32 {
            past.record((n, 0.0), &scene(n), usize::MAX);
        }
        assert_eq!(frames(&past), (1..=32).collect::<Vec<_>>());
        for n in 33..=10_000 {
            past.record((n, 0.0), &scene(3), usize::MAX);
            assert!(past.moments().len() <= MAX_MOMENTS);
        }
        let kept = frames(&past);
        assert!(kept.len() > MAX_MOMENTS / 2 && kept[0] == 1, "{kept:?}");
        let gaps: Vec<usize> = kept.windows(2).map(|pair| pair[1] - pair[0]).collect();
        assert!(gaps.iter().all(|gap| *gap == gaps[0]), "{kept:?}");
        assert_eq!(past.latest_at(kept[4] + 1).unwrap().n_frames, kept[4]);
    }

    #[test]
    fn moments_keep_to_the_budget_and_none_is_kept_that_exceeds_it_alone() {
        let budget = 10 * bytes_of(&scene(100));
        let mut past = PastScenes::default();
        for n in 1..200 {
            past.record((n, 0.0), &scene(n.min(100)), budget);
            assert!(past.bytes() <= budget, "{n}");
        }
        assert!(past.bytes() > budget / 3, "{:?}", frames(&past));
        let before = frames(&past);
        past.record((300, 0.0), &scene(100_000), budget);
        assert_eq!(frames(&past), before);
        past.set_budget(budget / 4);
        assert!(!past.moments().is_empty() && past.bytes() <= budget / 4);
        past.set_budget(0);
        assert!(past.moments().is_empty());
    }

    #[test]
    fn a_moment_stays_what_it_was_and_shares_nothing_once_it_is_copied() {
        let (mut past, mut now) = (PastScenes::default(), scene(1000));
        let changed = Splat { opacity: 0.5, ..Splat::default() };
        for n_frames in 1..=4 {
            past.record((n_frames, 0.0), &now, usize::MAX);
            // Copying may finish before or after the next change; both must be correct.
            if n_frames % 2 == 0 {
                while Arc::strong_count(&now) > 1 {
                    std::thread::yield_now();
                    past.install_finished_copies();
                }
            }
            Arc::make_mut(&mut now).replace(&[n_frames as u32], &vec![changed].into());
            past.install_finished_copies();
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
            past.record((n, 0.0), &scene(1), usize::MAX);
        }
        assert_eq!(frames(&past), [1]);
    }
}
