//! Textures of splats in GPU memory: one buffer of words (`textures.md`).
//!
//! The first word is the number of slots in a list of regions. A slot holds the first word of a splat's
//! region, or 0 if the splat has no texture. A region holds the lattice, then the first word of each patch
//! relative to the region, or 0 without texels, then the texels.
//!
//! Only changed textures are uploaded. A texture that outgrew its region moves to the end of the buffer. All
//! are packed anew if the buffer is full or more than half of it is unused.

use super::adapters::max_buffer_bytes;
use super::error::GpuError;
use super::growing::{MIB, allocate, filled_buffer};
use super::task::{IN, WORD};
use crate::model::splat::texture::{TEXELS, Texture, Textures};
use std::sync::Arc;

/// Words of a lattice: anchor, two axes, texels per world unit, texels per side.
pub(super) const LATTICE_WORDS: usize = 11;
// Number of words from which staged words are sent, so that large scenes need little memory at a time.
const MOST_STAGED: usize = 1 << 22;

/// Textures of a scene in GPU memory.
#[derive(Debug, Default)]
pub(super) struct GpuTextures {
    /// `None` for a scene without textures.
    pub(super) buffer: Option<wgpu::Buffer>,
    /// Error if some textures do not fit.
    pub(super) shortage: Option<GpuError>,
    /// Textures of the last upload.
    uploaded: Arc<Textures>,
    regions: Regions,
    /// Size in words that the driver refused to exceed, if it did.
    refused_above: Option<usize>,
}

impl GpuTextures {
    /// Uploads the textures that differ from those of the last call. Returns the number of bytes
    /// uploaded.
    pub(super) fn update(
        &mut self,
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        textures: Option<&Arc<Textures>>,
    ) -> u64 {
        let Some(textures) = textures else {
            // Frees the memory of a scene that no longer has textures.
            *self = Self::default();
            return 0;
        };
        let old = std::mem::replace(&mut self.uploaded, textures.clone());
        let n = old.len().max(textures.len());
        let changed: Vec<usize> = if Arc::ptr_eq(&old, textures) {
            Vec::new()
        } else {
            (0..n).filter(|&i| !is_same(of(&old, i), of(textures, i))).collect()
        };
        if changed.is_empty() && (self.buffer.is_some() || textures.is_empty()) {
            return 0;
        }
        let limit = (max_buffer_bytes(&device.limits()) / WORD).min(u32::MAX.into()) as usize;
        let most = self.refused_above.map_or(limit, |words| words.min(limit));
        let staged = match self.regions.assign(&changed, textures, most) {
            Some(slots) if self.buffer.is_some() => {
                let mut staged = Staged::new(device, queue, self.buffer.as_ref());
                self.regions.stage_list(&mut staged, slots);
                self.regions.stage_textures(&mut staged, textures, changed);
                staged
            }
            _ => {
                self.pack_all(device, textures, most);
                let mut staged = Staged::new(device, queue, self.buffer.as_ref());
                staged.put(0, |words| words.push(self.regions.n_slots as u32));
                self.regions.stage_list(&mut staged, 0..self.regions.n_slots);
                self.regions.stage_textures(&mut staged, textures, (0..textures.len()).collect());
                staged
            }
        };
        let n_bytes = staged.finish();
        self.report(textures);
        n_bytes
    }

    /// Assigns all regions anew, in a larger buffer if necessary.
    fn pack_all(&mut self, device: &wgpu::Device, textures: &Textures, most: usize) {
        self.regions.pack(textures, most);
        let bytes = self.regions.capacity as u64 * WORD;
        if self.buffer.as_ref().is_some_and(|buffer| buffer.size() >= bytes) {
            return;
        }
        let mib = bytes.div_ceil(MIB);
        let refused = GpuError::NoMemoryForTask { what: "textures", mib };
        let create = || {
            device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("textures"),
                // A binding cannot be empty.
                size: bytes.max(WORD),
                usage: IN,
                mapped_at_creation: false,
            })
        };
        match allocate(device, refused, create) {
            Ok(buffer) => self.buffer = Some(buffer),
            Err(_) => {
                // The previous buffer holds what fits.
                let words = self.buffer.as_ref().map_or(0, |buffer| buffer.size() / WORD) as usize;
                self.refused_above = Some(words);
                self.regions = Regions { capacity: words, ..Regions::default() };
                self.regions.pack(textures, words);
            }
        }
    }

    fn report(&mut self, textures: &Textures) {
        let has_region = |i: usize| self.regions.of.get(i).is_some_and(|region| region.size > 0);
        let is_left_out = |(i, texture): (usize, &Option<_>)| texture.is_some() && !has_region(i);
        let n_splats = textures.iter().enumerate().filter(|&texture| is_left_out(texture)).count();
        let mib = (self.regions.capacity as u64 * WORD) / MIB;
        let shortage = (n_splats > 0).then_some(GpuError::TexturesLeftOut { n_splats, mib });
        // Once per shortage, because the number differs from frame to frame.
        if let (Some(error), None) = (&shortage, &self.shortage) {
            tracing::warn!("{error}");
        }
        self.shortage = shortage;
    }
}

fn of(textures: &Textures, i: usize) -> Option<&Arc<Texture>> {
    textures.get(i).and_then(Option::as_ref)
}

fn is_same(a: Option<&Arc<Texture>>, b: Option<&Arc<Texture>>) -> bool {
    match (a, b) {
        (Some(a), Some(b)) => Arc::ptr_eq(a, b),
        _ => a.is_none() && b.is_none(),
    }
}

/// Words of the buffer reserved for one texture; size 0 for none.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Region {
    at: usize,
    size: usize,
}

/// Division of the buffer into regions.
#[derive(Debug, Default)]
struct Regions {
    /// Regions by splat.
    of: Vec<Region>,
    /// Number of slots in the list at the start of the buffer.
    n_slots: usize,
    /// One past the last assigned word.
    end: usize,
    /// Assigned words that no texture uses.
    wasted: usize,
    /// Size of the buffer in words.
    capacity: usize,
}

impl Regions {
    /// Assigns regions to changed textures. Returns the range of splats whose region differs, or `None`
    /// if all textures must be packed anew. `most` is the largest possible capacity.
    fn assign(
        &mut self,
        changed: &[usize],
        textures: &Textures,
        most: usize,
    ) -> Option<std::ops::Range<usize>> {
        if textures.len() > self.n_slots {
            return None;
        }
        let mut moved = self.n_slots..0;
        for &i in changed {
            let needed = of(textures, i).map_or(0, |texture| words_of(texture));
            let Some(region) = self.of.get_mut(i) else { continue };
            if needed > 0 && needed <= region.size {
                continue;
            }
            self.wasted += region.size;
            *region = Region::default();
            moved = moved.start.min(i)..moved.end.max(i + 1);
            // Larger than needed, because textures gain patches frame by frame.
            let size = needed + needed / 4;
            if needed > 0 && self.end + size <= self.capacity {
                *region = Region { at: self.end, size };
                self.end += size;
            } else if needed > 0 && self.capacity < most {
                return None;
            }
        }
        (2 * self.wasted <= self.end).then_some(moved.start.min(moved.end)..moved.end)
    }

    /// Assigns all regions without gaps and chooses the capacity. Textures beyond `most` words get no
    /// region.
    fn pack(&mut self, textures: &Textures, most: usize) {
        let n = textures.len();
        self.n_slots = (n + n / 2).min(most.saturating_sub(1));
        self.end = 1 + self.n_slots;
        self.wasted = 0;
        self.of = vec![Region::default(); self.n_slots];
        for (region, texture) in self.of.iter_mut().zip(textures) {
            let size = texture.as_ref().map_or(0, |texture| words_of(texture));
            if size > 0 && self.end + size <= most {
                *region = Region { at: self.end, size };
                self.end += size;
            }
        }
        if self.end > self.capacity {
            // Larger than needed, because scenes grow frame by frame.
            self.capacity = (self.end + self.end / 2).min(most);
        }
    }

    fn stage_list(&self, staged: &mut Staged<'_>, slots: std::ops::Range<usize>) {
        let Some(regions) = self.of.get(slots.clone()) else { return };
        staged.put(1 + slots.start, |words| {
            words.extend(regions.iter().map(|region| region.at as u32));
        });
    }

    fn stage_textures(&self, staged: &mut Staged<'_>, textures: &Textures, mut ids: Vec<usize>) {
        let region = |i: usize| self.of.get(i).copied().unwrap_or_default();
        // Adjacent regions make one copy.
        ids.sort_unstable_by_key(|&i| region(i).at);
        for i in ids {
            if let (Some(texture), Region { at: 1.., .. }) = (of(textures, i), region(i)) {
                staged.put(region(i).at, |words| pack_texture(texture, words));
            }
        }
    }
}

/// Returns the number of words of a texture's region.
fn words_of(texture: &Texture) -> usize {
    LATTICE_WORDS + texture.index.len() + TEXELS * texture.patches.len()
}

fn pack_texture(texture: &Texture, words: &mut Vec<u32>) {
    let Texture { lattice, index, patches } = texture;
    let first = LATTICE_WORDS + index.len();
    let numbers = lattice.anchor.iter().chain(lattice.axes.as_flattened());
    words.extend(numbers.map(|value| value.to_bits()));
    words.extend([(lattice.per_unit() as f32).to_bits(), lattice.side() as u32]);
    words.extend(index.iter().map(|&patch| {
        let patch = usize::from(patch);
        if patch < patches.len() { (first + TEXELS * patch) as u32 } else { 0 }
    }));
    words.extend(patches.iter().flatten().map(|texel| texel.0));
}

/// Words on their way to a buffer.
struct Staged<'a> {
    device: &'a wgpu::Device,
    queue: &'a wgpu::Queue,
    /// If `None`, nothing is sent.
    to: Option<&'a wgpu::Buffer>,
    words: Vec<u32>,
    /// First word in `words`, first word in the buffer, and number of words.
    copies: Vec<[usize; 3]>,
    n_bytes: u64,
}

impl<'a> Staged<'a> {
    fn new(device: &'a wgpu::Device, queue: &'a wgpu::Queue, to: Option<&'a wgpu::Buffer>) -> Self {
        Self { device, queue, to, words: Vec::new(), copies: Vec::new(), n_bytes: 0 }
    }

    /// Adds the words that `write` appends, for the buffer's words from `at`.
    fn put(&mut self, at: usize, write: impl FnOnce(&mut Vec<u32>)) {
        let from = self.words.len();
        write(&mut self.words);
        let n = self.words.len() - from;
        match self.copies.last_mut() {
            Some([_, to, before]) if *to + *before == at => *before += n,
            _ if n > 0 => self.copies.push([from, at, n]),
            _ => {}
        }
        if self.words.len() > MOST_STAGED {
            self.send();
        }
    }

    // One buffer with many copies, because a write of its own for every texture would be slow.
    fn send(&mut self) {
        let words = std::mem::take(&mut self.words);
        let copies = std::mem::take(&mut self.copies);
        let Some(to) = self.to.filter(|_| !words.is_empty()) else { return };
        let Self { device, queue, .. } = *self;
        let (usage, contents) = (wgpu::BufferUsages::COPY_SRC, bytemuck::cast_slice(&words));
        let from = filled_buffer(device, queue, "changed textures", usage, contents);
        let mut encoder = device.create_command_encoder(&Default::default());
        for copy in copies {
            let [at, into, n] = copy.map(|n_words| n_words as u64 * WORD);
            encoder.copy_buffer_to_buffer(&from, at, to, into, n);
        }
        queue.submit([encoder.finish()]);
        self.n_bytes += words.len() as u64 * WORD;
    }

    /// Sends the rest. Returns the number of bytes sent.
    fn finish(mut self) -> u64 {
        self.send();
        self.n_bytes
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::splat::texture::{ABSENT, Lattice, Texel};

    fn texture(n_patches: usize) -> Option<Arc<Texture>> {
        let axes = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
        let lattice = Lattice { anchor: [5.0, 6.0, 7.0], axes, half: 0.5, level: 1 };
        let index = (0..4).map(|i| if i < n_patches { i as u16 } else { ABSENT }).collect();
        let patches = vec![[Texel(9); TEXELS]; n_patches];
        Some(Arc::new(Texture { lattice, index, patches }))
    }

    #[test]
    fn a_region_holds_lattice_patches_and_texels() {
        let mut words = Vec::new();
        let texture = texture(1).unwrap();
        pack_texture(&texture, &mut words);
        assert_eq!(words.len(), words_of(&texture));
        assert_eq!(f32::from_bits(words[9]), 8.0, "texels per world unit");
        assert_eq!(words[10..15], [8, 15, 0, 0, 0]);
        assert_eq!(words[15..], [9; TEXELS]);
    }

    #[test]
    fn a_texture_that_grows_moves_to_the_end_until_half_is_waste() {
        let most = 10_000;
        let mut textures = vec![texture(1), None, texture(1)];
        let mut regions = Regions::default();
        assert_eq!(regions.assign(&[0, 2], &textures, most), None, "no list yet");
        regions.pack(&textures, most);
        assert_eq!(
            regions.of[..3],
            [(5, 31), (0, 0), (36, 31)].map(|(at, size)| Region { at, size })
        );
        assert_eq!((regions.n_slots, regions.end, regions.capacity), (4, 67, 100));

        assert_eq!(regions.assign(&[0], &textures, most), Some(0..0), "the same size stays");
        textures[0] = None;
        textures[1] = texture(0);
        assert_eq!(regions.assign(&[0, 1], &textures, most), Some(0..2));
        assert_eq!((regions.of[0].size, regions.of[1].at, regions.wasted), (0, 67, 31));
        textures[2] = texture(2);
        assert_eq!(regions.assign(&[2], &textures, most), None, "full");
        regions.pack(&textures, most);
        assert_eq!((regions.wasted, regions.end, regions.capacity), (0, 67, 100));
        textures[2] = None;
        assert_eq!(regions.assign(&[2], &textures, most), None, "half is waste");
    }

    #[test]
    fn what_exceeds_the_limit_has_no_region() {
        let mut textures = vec![texture(1), texture(4), texture(1)];
        let mut regions = Regions::default();
        regions.pack(&textures, 70);
        assert_eq!(regions.of.iter().map(|region| region.size).collect::<Vec<_>>(), [31, 0, 31, 0]);
        assert_eq!(regions.capacity, 70);
        textures[0] = texture(2);
        assert_eq!(regions.assign(&[0], &textures, 70), Some(0..1), "not packed in vain");
        assert_eq!(regions.of[0].size, 0);
    }
}
