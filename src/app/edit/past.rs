//! Copies of the scene as it was after earlier frames.
//!
//! The viewport already receives every splat that training changes, so a copy costs the trainer nothing. A
//! separate thread writes the copy to a file without a name, because the textures of a phone's recording take
//! tens of megabytes in each. Until it is written, the copy shares its memory with the current scene (copy on
//! write). The number and the total size of the copies are bounded: beyond either bound, the copy is dropped
//! whose neighbours are closest to each other. So as many remain as fit, at most a few dozen, and the intervals
//! between them differ by a factor of about two. Copies are exact and include appearance and textures.

use crate::app::splat_updates::RunMoment;
use crate::model::splat::appearance::{Appearance, Finishing, SplatSet};
use crate::model::splat::splats::Splat;
use crate::model::splat::texture::{Lattice, Texture, Textures};
use bytemuck::{Pod, Zeroable, cast_slice, cast_slice_mut, zeroed_vec};
use std::fs::File;
use std::io::{BufReader, BufWriter, Error, Read, Result as IoResult, Seek, Write};
use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::{Builder, JoinHandle};

/// Maximum number of stored scenes, which is enough for the slider that selects one.
const MAX_MOMENTS: usize = 32;

#[derive(Clone, Debug)]
pub struct PastScene {
    pub after: RunMoment,
    pub n_splats: usize,
    content: PastContent,
    serial: u64,
    /// Size of the copy, bytes.
    bytes: usize,
}

#[derive(Clone, Debug)]
enum PastContent {
    /// Not written yet.
    Shared(Arc<SplatSet>),
    Written(Arc<SceneFile>),
}

impl PartialEq for PastScene {
    fn eq(&self, other: &Self) -> bool {
        // Comparing splats would cost time in every pass.
        self.serial == other.serial
    }
}

impl PastScene {
    /// Returns the splats in their learned colours. Usually reads them from a file.
    pub fn splats(&self) -> IoResult<Arc<SplatSet>> {
        match &self.content {
            PastContent::Shared(splats) => Ok(splats.clone()),
            PastContent::Written(file) => file.read().map(Arc::new),
        }
    }
}

/// Stored earlier scenes of a run, in ascending order of frames.
#[derive(Debug, Default)]
pub struct PastScenes {
    moments: Vec<PastScene>,
    serial: u64,
    /// Threads that write a scene, each with the serial number of its copy.
    writers: Vec<(u64, JoinHandle<IoResult<SceneFile>>)>,
    /// Reason why no more copies are made in this run, once one could not be written.
    failure: Option<String>,
    is_failure_reported: bool,
}

impl PastScenes {
    /// Stores the scene of a moment if a copy is due and its size is within `budget` bytes. The copy is
    /// written to the first of the `folders` that takes it.
    pub fn record(
        &mut self,
        after: RunMoment,
        scene: &Arc<SplatSet>,
        folders: &Arc<[PathBuf]>,
        budget: usize,
    ) {
        let n_frames = after.n_seen;
        if self.moments.last().is_some_and(|last| n_frames < last.after.n_seen) {
            // The run was restarted.
            *self = Self { serial: self.serial, ..Self::default() };
        }
        if n_frames == 0 || self.failure.is_some() || !self.is_due(n_frames) {
            return;
        }
        let bytes = bytes_of(scene);
        // A copy larger than the budget would displace all others.
        if bytes > budget {
            return;
        }
        self.serial += 1;
        let (content, serial) = (PastContent::Shared(scene.clone()), self.serial);
        self.moments.push(PastScene { after, n_splats: scene.len(), content, serial, bytes });
        let (shared, folders) = (scene.clone(), folders.clone());
        // Without a thread the copy keeps sharing memory with the scene.
        if let Ok(writer) =
            Builder::new().name("past".into()).spawn(move || SceneFile::write(&shared, &folders))
        {
            self.writers.push((self.serial, writer));
        }
        self.thin(budget);
    }

    /// Releases the memory of copies that have been written. Must be called before the current scene changes;
    /// the change would otherwise copy the splats that a copy still shares.
    pub fn release_written(&mut self) {
        for (serial, writer) in self.writers.extract_if(.., |(_, writer)| writer.is_finished()) {
            let Some(at) = self.moments.iter().position(|moment| moment.serial == serial) else {
                continue; // dropped meanwhile
            };
            let panicked = || Err(Error::other("the writing thread panicked"));
            match writer.join().unwrap_or_else(|_| panicked()) {
                Ok(file) => self.moments[at].content = PastContent::Written(Arc::new(file)),
                Err(error) => {
                    let after = self.moments.remove(at).after.n_seen;
                    self.failure = Some(format!(
                        "The history of this run ends at frame {after}: a scene could not be stored: {error}; free disk space, or make the folder writable; the next run then has a history again"
                    ));
                }
            }
        }
    }

    /// Returns the reason why no more copies are made in this run, if any.
    pub fn failure(&self) -> Option<&str> {
        self.failure.as_deref()
    }

    /// Returns that reason once, for a notice.
    pub fn take_unreported_failure(&mut self) -> Option<String> {
        let is_reported = std::mem::replace(&mut self.is_failure_reported, self.failure.is_some());
        self.failure.clone().filter(|_| !is_reported)
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

    /// Returns the size of all copies, bytes.
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
        }
    }
}

/// Returns the size of a copy of a scene, bytes.
fn bytes_of(scene: &SplatSet) -> usize {
    let (_, of_textures) = scene.finishing().texture_size();
    of_textures
        + size_of_val::<[Splat]>(scene)
        + size_of_val::<[Appearance]>(scene.view().appearance())
}

/// Scene in a file without a name, which the system removes when it is closed.
#[derive(Debug)]
struct SceneFile {
    // Locked, because reading moves its position.
    file: Mutex<File>,
    n_splats: usize,
    n_appearance: usize,
    /// Length of the list of textures, if there is one.
    n_textures: Option<usize>,
    /// Parameters other than textures.
    finishing: Finishing,
}

/// Row of the file about the texture of a splat, before its texels. Of zeros if there is none.
#[derive(Clone, Copy, Default, Pod, Zeroable)]
#[repr(C)]
struct TextureRow {
    anchor: [f32; 3],
    axes: [[f32; 3]; 2],
    half: f32,
    level: u32,
    n_places: u32,
    n_patches: u32,
}

impl SceneFile {
    /// Writes a scene to a file in the first of the folders that takes it.
    ///
    /// # Errors
    /// If no folder takes it; the message names each with the reason.
    fn write(scene: &SplatSet, folders: &[PathBuf]) -> IoResult<Self> {
        let mut problems = Vec::new();
        for folder in folders {
            // Folders may be on different disks: one may be full, the other not.
            let file = std::fs::create_dir_all(folder).and_then(|()| tempfile::tempfile_in(folder));
            match file.and_then(|file| Self::write_to(file, scene)) {
                Ok(written) => return Ok(written),
                Err(error) => problems.push(format!("{}: {error}", folder.display())),
            }
        }
        Err(Error::other(problems.join("; ")))
    }

    fn write_to(file: File, scene: &SplatSet) -> IoResult<Self> {
        let (view, finishing) = (scene.view(), scene.finishing());
        let mut out = BufWriter::with_capacity(1 << 16, file);
        out.write_all(cast_slice(view.splats()))?;
        out.write_all(cast_slice(view.appearance()))?;
        for texture in finishing.textures.iter().flat_map(|textures| textures.iter()) {
            let Some(Texture { lattice, index, patches }) = texture.as_deref() else {
                out.write_all(bytemuck::bytes_of(&TextureRow::default()))?;
                continue;
            };
            let Lattice { anchor, axes, half, level } = *lattice;
            let level = level.into();
            let (n_places, n_patches) = (index.len() as u32, patches.len() as u32);
            let row = TextureRow { anchor, axes, half, level, n_places, n_patches };
            out.write_all(bytemuck::bytes_of(&row))?;
            out.write_all(cast_slice(index))?;
            out.write_all(cast_slice(patches))?;
        }
        Ok(Self {
            file: Mutex::new(out.into_inner().map_err(|error| error.into_error())?),
            n_splats: view.splats().len(),
            n_appearance: view.appearance().len(),
            n_textures: finishing.textures.as_ref().map(|textures| textures.len()),
            finishing: finishing.without_textures(),
        })
    }

    fn read(&self) -> IoResult<SplatSet> {
        // A panic while reading leaves nothing but a position, which every read sets.
        let mut file = self.file.lock().unwrap_or_else(PoisonError::into_inner);
        file.rewind()?;
        let mut input = BufReader::with_capacity(1 << 16, &mut *file);
        let splats: Vec<Splat> = read_rows(&mut input, self.n_splats)?;
        let appearance: Vec<Appearance> = read_rows(&mut input, self.n_appearance)?;
        let mut texture = || -> IoResult<Option<Arc<Texture>>> {
            let mut row = [TextureRow::default()];
            input.read_exact(cast_slice_mut(&mut row))?;
            let [TextureRow { anchor, axes, half, level, n_places, n_patches }] = row;
            if n_places == 0 {
                return Ok(None);
            }
            // Levels are written from eight bits.
            let lattice = Lattice { anchor, axes, half, level: level as u8 };
            let index = read_rows(&mut input, n_places as usize)?;
            let patches = read_rows(&mut input, n_patches as usize)?;
            Ok(Some(Arc::new(Texture { lattice, index, patches })))
        };
        let textures = self.n_textures.map(|n| (0..n).map(|_| texture()).collect());
        let textures = textures.transpose()?.map(|textures: Textures| Arc::new(textures));
        let set = match appearance.is_empty() {
            true => SplatSet::from(splats),
            false => SplatSet::new(splats, appearance),
        };
        Ok(set.finished(Finishing { textures, ..self.finishing.clone() }))
    }
}

fn read_rows<T: Pod>(input: &mut impl Read, n: usize) -> IoResult<Vec<T>> {
    let mut rows = zeroed_vec(n);
    input.read_exact(cast_slice_mut(&mut rows))?;
    Ok(rows)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::splat::texture::{TEXELS, Texel};

    fn at(n_seen: usize) -> RunMoment {
        RunMoment { n_seen, ..RunMoment::default() }
    }

    fn scene(n: usize) -> Arc<SplatSet> {
        Arc::new(vec![Splat::default(); n].into())
    }

    fn folders() -> Arc<[PathBuf]> {
        Arc::new([std::env::temp_dir()])
    }

    fn frames(past: &PastScenes) -> Vec<usize> {
        past.moments().iter().map(|moment| moment.after.n_seen).collect()
    }

    #[test]
    fn every_frame_is_kept_at_first_and_evenly_spread_ones_ever_after() {
        let mut past = PastScenes::default();
        assert!(past.latest_at(5).is_none());
        for n in 0..=32 {
            past.record(at(n), &scene(n), &folders(), usize::MAX);
        }
        assert_eq!(frames(&past), (1..=32).collect::<Vec<_>>());
        for n in 33..=10_000 {
            past.record(at(n), &scene(3), &folders(), usize::MAX);
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
        let budget = 10 * bytes_of(&scene(100));
        let mut past = PastScenes::default();
        for n in 1..200 {
            past.record(at(n), &scene(n.min(100)), &folders(), budget);
            assert!(past.bytes() <= budget, "{n}");
        }
        assert!(past.bytes() > 8 * budget / 10, "{:?}", frames(&past));
        let before = frames(&past);
        past.record(at(300), &scene(100_000), &folders(), budget);
        assert_eq!(frames(&past), before);
        past.set_budget(budget / 4);
        assert!(!past.moments().is_empty() && past.bytes() <= budget / 4);
        past.set_budget(0);
        assert!(past.moments().is_empty());
    }

    fn wait_until_written(past: &mut PastScenes) {
        while !past.writers.is_empty() {
            std::thread::yield_now();
            past.release_written();
        }
    }

    #[test]
    fn a_moment_stays_what_it_was_and_shares_nothing_once_it_is_written() {
        let (mut past, mut now) = (PastScenes::default(), scene(1000));
        let changed = Splat { opacity: 0.5, ..Splat::default() };
        for n_frames in 1..=4 {
            past.record(at(n_frames), &now, &folders(), usize::MAX);
            // Writing may finish before or after the next change; both must be correct.
            if n_frames % 2 == 0 {
                wait_until_written(&mut past);
                assert_eq!(Arc::strong_count(&now), 1);
            }
            Arc::make_mut(&mut now).replace(&[n_frames as u32], &vec![changed].into());
            past.release_written();
        }
        for moment in past.moments() {
            let splats = moment.splats().unwrap();
            let n_changed = splats.iter().filter(|splat| splat.opacity == 0.5).count();
            assert_eq!(n_changed, moment.after.n_seen - 1);
        }
        assert_ne!(past.moments()[0], past.moments()[1]);
    }

    #[test]
    fn a_written_scene_is_read_as_it_was() {
        let texture = |level: u8| {
            let axes = [[1.0, 0.0, 0.0], [0.0, 0.5, 0.5]];
            let lattice = Lattice { anchor: [1.0, 2.0, 3.0], axes, half: 0.25, level };
            let patches = vec![[Texel(7 + u32::from(level)); TEXELS]; level.into()];
            Some(Arc::new(Texture { lattice, index: vec![0; 1 << (2 * level)], patches }))
        };
        let textures = Some(Arc::new(vec![None, texture(2), texture(0)]));
        let finishing = Finishing { full_coverage: 0.5, textures, ..Finishing::default() };
        let look = Appearance { gradient: [[0.5; 3]; 3], ..Appearance::default() };
        let mut rich = SplatSet::from(vec![Splat::default(); 3]);
        rich.push(Splat { opacity: 0.7, ..Splat::default() }, look);
        for scene in [rich.clone().finished(finishing), rich, SplatSet::default()] {
            let file = SceneFile::write(&scene, &folders()).unwrap();
            for _ in 0..2 {
                assert_eq!(file.read().unwrap(), scene);
            }
        }
    }

    #[test]
    #[cfg(target_os = "linux")]
    fn another_folder_is_used_and_the_loss_of_all_is_reported_once_a_run() {
        let none = PathBuf::from("/dev/null/none");
        let both: Arc<[PathBuf]> = Arc::new([none.clone(), std::env::temp_dir()]);
        let none: Arc<[PathBuf]> = Arc::new([none]);
        let mut past = PastScenes::default();
        for n in [1, 2] {
            past.record(at(n), &scene(1), &both, usize::MAX);
        }
        wait_until_written(&mut past);
        assert!(past.moments()[1].splats().is_ok() && past.take_unreported_failure().is_none());
        past.record(at(3), &scene(1), &none, usize::MAX);
        wait_until_written(&mut past);
        let text = past.take_unreported_failure().unwrap_or_default();
        assert!(text.contains("frame 3") && text.contains("/dev/null/none: "), "{text}");
        assert_eq!((past.take_unreported_failure(), past.failure()), (None, Some(&*text)));
        past.record(at(4), &scene(1), &folders(), usize::MAX);
        assert_eq!(frames(&past), [1, 2], "a history with a gap");
        past.record(at(1), &scene(1), &folders(), usize::MAX);
        assert_eq!((frames(&past), past.failure()), (vec![1], None), "the next run");
    }

    #[test]
    fn a_full_disk_is_an_error() {
        let full = std::fs::OpenOptions::new().write(true).open("/dev/full");
        let Ok(full) = full else { return };
        let error = SceneFile::write_to(full, &scene(1)).unwrap_err();
        assert_eq!(error.kind(), std::io::ErrorKind::StorageFull);
    }

    #[test]
    fn a_run_that_begins_anew_forgets_what_was_before() {
        let mut past = PastScenes::default();
        for n in [1, 2, 3, 1] {
            past.record(at(n), &scene(1), &folders(), usize::MAX);
        }
        assert_eq!(frames(&past), [1]);
    }
}
