//! Copies of the scene as it was after earlier frames.
//!
//! The viewport already receives every splat that training changes, so a copy costs the trainer nothing. A
//! separate thread makes the copy, which would otherwise delay the window by some milliseconds. Until the
//! copy is finished, the stored state shares its memory with the current scene (copy on write). Copies share
//! the textures that did not change in between. The number and the total size of the copies are bounded:
//! beyond either bound, the copy is dropped whose neighbours are closest to each other. So as many remain as
//! fit, at most a few dozen, and the intervals between them differ by a factor of about two. Copies are exact
//! and include the appearance of the splats.

use crate::app::splat_updates::RunMoment;
use crate::model::splat::appearance::{Appearance, SplatSet};
use crate::model::splat::splats::Splat;
use crate::model::splat::texture::Texture;
use std::sync::Arc;
use std::thread::{Builder, JoinHandle};

/// Maximum number of stored scenes, which is enough for the slider that selects one.
const MAX_MOMENTS: usize = 32;

#[derive(Clone, Debug)]
pub struct PastScene {
    pub after: RunMoment,
    /// Splats in their learned colours.
    pub splats: Arc<SplatSet>,
    serial: u64,
    /// Memory that the copy before does not share, bytes.
    bytes: usize,
}

impl PartialEq for PastScene {
    fn eq(&self, other: &Self) -> bool {
        // Comparing splats would cost time in every pass.
        self.serial == other.serial
    }
}

/// Stored earlier scenes of a run, in ascending order of frames.
#[derive(Debug, Default)]
pub struct PastScenes {
    moments: Vec<PastScene>,
    serial: u64,
    /// Threads that copy a scene, each with the serial number of its copy.
    copies: Vec<(u64, JoinHandle<SplatSet>)>,
}

impl PastScenes {
    /// Stores the scene of a moment if a copy is due and its size is within `budget` bytes.
    pub fn record(&mut self, after: RunMoment, scene: &Arc<SplatSet>, budget: usize) {
        let n_frames = after.n_seen;
        if self.moments.last().is_some_and(|last| n_frames < last.after.n_seen) {
            // The run was restarted.
            *self = Self { serial: self.serial, ..Self::default() };
        }
        if n_frames == 0 || !self.is_due(n_frames) {
            return;
        }
        // A copy larger than the budget would displace all others.
        if bytes_beyond(None, scene) > budget {
            return;
        }
        self.serial += 1;
        let (splats, serial) = (scene.clone(), self.serial);
        let bytes = bytes_beyond(self.moments.last(), scene);
        self.moments.push(PastScene { after, splats, serial, bytes });
        let shared = scene.clone();
        let copy = move || SplatSet::clone(&shared);
        // Without a thread the copy keeps sharing memory with the scene.
        if let Ok(copy) = Builder::new().name("past".into()).spawn(copy) {
            self.copies.push((self.serial, copy));
        }
        self.thin(budget);
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
        self.thin(budget);
    }

    /// Returns the latest copy made after at most `n_frames` frames.
    pub fn latest_at(&self, n_frames: usize) -> Option<&PastScene> {
        self.moments.iter().rev().find(|moment| moment.after.n_seen <= n_frames)
    }

    pub fn moments(&self) -> &[PastScene] {
        &self.moments
    }

    /// Returns the memory of all copies, bytes.
    pub fn bytes(&self) -> usize {
        self.moments.iter().map(|moment| moment.bytes).sum()
    }

    fn is_due(&self, n_frames: usize) -> bool {
        // As the closest two copies, or new ones would be denser than those that remain.
        let interval =
            self.moments.array_windows().map(|[a, b]| b.after.n_seen - a.after.n_seen).min();
        self.moments.last().is_none_or(|last| n_frames >= last.after.n_seen + interval.unwrap_or(1))
    }

    fn thin(&mut self, budget: usize) {
        while self.moments.len() > MAX_MOMENTS || self.bytes() > budget {
            let gaps =
                self.moments.array_windows().map(|[a, _, b]| b.after.n_seen - a.after.n_seen);
            // The first and the last one are dropped only if no other is left.
            let densest = gaps.enumerate().min_by_key(|(_, gap)| *gap).map_or(0, |(i, _)| i + 1);
            self.moments.remove(densest);
            let (before, after) = self.moments.split_at_mut(densest);
            if let Some(next) = after.first_mut() {
                next.bytes = bytes_beyond(before.last(), &next.splats);
            }
        }
    }
}

/// Returns the memory of a scene, bytes, without textures that the scene before shares.
fn bytes_beyond(before: Option<&PastScene>, scene: &SplatSet) -> usize {
    let textures_of = |scene: &SplatSet| scene.finishing().textures.clone().unwrap_or_default();
    let before = before.map(|before| textures_of(&before.splats)).unwrap_or_default();
    let own = |(slot, texture): (usize, &Option<Arc<Texture>>)| {
        let texture = texture.as_ref()?;
        let former = before.get(slot).and_then(Option::as_ref);
        let is_shared = former.is_some_and(|former| Arc::ptr_eq(former, texture));
        (!is_shared).then(|| texture.bytes())
    };
    textures_of(scene).iter().enumerate().filter_map(own).sum::<usize>()
        + size_of_val::<[Splat]>(scene)
        + size_of_val::<[Appearance]>(scene.view().appearance())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::splat::appearance::Finishing;
    use crate::model::splat::texture::Lattice;

    fn at(n_seen: usize) -> RunMoment {
        RunMoment { n_seen, ..RunMoment::default() }
    }

    fn scene(n: usize) -> Arc<SplatSet> {
        Arc::new(vec![Splat::default(); n].into())
    }

    fn frames(past: &PastScenes) -> Vec<usize> {
        past.moments().iter().map(|moment| moment.after.n_seen).collect()
    }

    #[test]
    fn every_frame_is_kept_at_first_and_evenly_spread_ones_ever_after() {
        let mut past = PastScenes::default();
        assert!(past.latest_at(5).is_none());
        for n in 0..=32 {
            past.record(at(n), &scene(n), usize::MAX);
        }
        assert_eq!(frames(&past), (1..=32).collect::<Vec<_>>());
        for n in 33..=10_000 {
            past.record(at(n), &scene(3), usize::MAX);
            assert!(past.moments().len() <= MAX_MOMENTS);
        }
        let kept = frames(&past);
        assert!(kept.len() == MAX_MOMENTS && kept[0] == 1, "{kept:?}");
        let gaps = || kept.windows(2).map(|pair| pair[1] - pair[0]);
        assert!(gaps().max() <= gaps().min().map(|least| 2 * least), "{kept:?}");
        assert_eq!(past.latest_at(kept[4] + 1).unwrap().after.n_seen, kept[4]);
    }

    #[test]
    fn moments_keep_to_the_budget_and_none_is_kept_that_exceeds_it_alone() {
        let budget = 10 * bytes_beyond(None, &scene(100));
        let mut past = PastScenes::default();
        for n in 1..200 {
            past.record(at(n), &scene(n.min(100)), budget);
            assert!(past.bytes() <= budget, "{n}");
        }
        assert!(past.bytes() > 8 * budget / 10, "{:?}", frames(&past));
        let before = frames(&past);
        past.record(at(300), &scene(100_000), budget);
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
            past.record(at(n_frames), &now, usize::MAX);
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
            assert_eq!(n_changed, moment.after.n_seen - 1);
        }
        assert_ne!(past.moments()[0], past.moments()[1]);
    }

    #[test]
    fn a_texture_that_several_moments_share_counts_once() {
        let texture = |n_patches| {
            let axes = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
            let lattice = Lattice { anchor: [0.0; 3], axes, half: 1.0, level: 0 };
            Arc::new(Texture {
                lattice,
                index: vec![0],
                patches: vec![Default::default(); n_patches],
            })
        };
        let (large, small) = (texture(1000), texture(1));
        let with = |textures: [&Arc<Texture>; 2]| {
            let textures = textures.map(|texture| Some(texture.clone()));
            let textures = Some(Arc::new(textures.to_vec()));
            Arc::new(
                SplatSet::from(vec![Splat::default(); 2])
                    .finished(Finishing { textures, ..Finishing::default() }),
            )
        };
        let plain = bytes_beyond(None, &scene(2));
        let mut past = PastScenes::default();
        for n in 1..=3 {
            past.record(at(n), &with([&large, &texture(1)]), usize::MAX);
        }
        let expected = |n: usize| n * (plain + small.bytes()) + large.bytes();
        assert_eq!(past.bytes(), expected(3));
        for kept in [vec![1, 3], vec![3]] {
            past.set_budget(past.bytes() - 1);
            assert_eq!((past.bytes(), frames(&past)), (expected(kept.len()), kept));
        }
    }

    #[test]
    fn a_run_that_begins_anew_forgets_what_was_before() {
        let mut past = PastScenes::default();
        for n in [1, 2, 3, 1] {
            past.record(at(n), &scene(1), usize::MAX);
        }
        assert_eq!(frames(&past), [1]);
    }
}
