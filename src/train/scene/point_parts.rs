//! Lists of a frame's points by range of components.

use rayon::prelude::*;

/// Number of ranges of components, each for one thread.
pub const PARTS: usize = 32;
/// Number of points sampled to choose the ranges.
const SAMPLED: usize = 1024;
/// Points per task.
const CHUNK: usize = 2048;

/// A frame's points, partitioned by ranges of consecutive components.
pub struct PointParts {
    firsts: Vec<usize>,
    chunks: Vec<Chunk>,
}

/// Consecutive points, sorted by part.
struct Chunk {
    points: Vec<u32>,
    /// End of each part; points without a component follow the last.
    ends: [usize; PARTS],
}

impl PointParts {
    /// Partitions points by owner; values beyond the last component mean none.
    pub fn new(owners: &[u32], n_components: usize) -> Self {
        let firsts = firsts(owners, n_components);
        let mut part_of = vec![0u8; n_components];
        for (part, &first) in (0..).zip(&firsts) {
            part_of[first.min(n_components)..].fill(part);
        }
        let chunks = owners.par_chunks(CHUNK).enumerate();
        let chunks = chunks.map(|(i, owners)| Chunk::new((i * CHUNK) as u32, owners, &part_of));
        Self { firsts, chunks: chunks.collect() }
    }

    /// Returns the first component of every part, ascending, beginning with 0.
    pub fn firsts(&self) -> &[usize] {
        &self.firsts
    }

    /// Returns the points, ascending, of the part that begins at component `first`.
    pub fn of(&self, first: usize) -> impl Iterator<Item = &[u32]> + Clone {
        let part = self.firsts.partition_point(|&other| other < first);
        self.chunks.iter().map(move |chunk| {
            let start = part.checked_sub(1).map_or(0, |before| chunk.ends[before]);
            &chunk.points[start..chunk.ends[part]]
        })
    }
}

impl Chunk {
    fn new(first: u32, owners: &[u32], part_of: &[u8]) -> Self {
        let part = |owner: u32| part_of.get(owner as usize).map_or(PARTS, |&part| part as usize);
        // Counts are stored one index late: their prefix sums are the starts of the parts, which filling
        // turns into ends.
        let mut ends = [0; PARTS + 2];
        owners.iter().for_each(|&owner| ends[part(owner) + 1] += 1);
        (1..=PARTS).for_each(|part| ends[part] += ends[part - 1]);
        let mut points = vec![0; owners.len()];
        for (point, &owner) in (first..).zip(owners) {
            let end = &mut ends[part(owner)];
            points[*end] = point;
            *end += 1;
        }
        Self { points, ends: std::array::from_fn(|part| ends[part]) }
    }
}

/// Chooses the first components of parts with similar numbers of points. A frame shows neighbouring
/// components, which have consecutive numbers: parts of equal numbers of components would leave most threads
/// idle.
fn firsts(owners: &[u32], n_components: usize) -> Vec<usize> {
    // A sample suffices, since parts need only similar sizes.
    let some = owners.iter().step_by(owners.len() / SAMPLED + 1).map(|&owner| owner as usize);
    let mut some: Vec<usize> = some.filter(|&owner| owner < n_components).collect();
    some.sort_unstable();
    let cut = |part: usize| some.get(part * some.len() / PARTS).copied();
    let mut firsts: Vec<usize> = (1..PARTS).filter_map(cut).collect();
    firsts.insert(0, 0);
    firsts.dedup();
    firsts
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Most points belong to the last hundredth of the components.
    fn owners() -> Vec<u32> {
        let owner = |i: u32| match i % 50 {
            0 => u32::MAX,
            1 => i / 2,
            _ => 99_000 + i % 1000,
        };
        (0..50_000).map(owner).collect()
    }

    #[test]
    fn parts_have_about_as_many_points() {
        let owners = owners();
        let parts = PointParts::new(&owners, 100_000);
        let firsts = parts.firsts();
        assert!(firsts[0] == 0 && firsts.len() > PARTS / 2 && firsts.is_sorted_by(|a, b| a < b));
        let n_points = |first: usize| parts.of(first).map(<[u32]>::len).sum::<usize>();
        let most = firsts.iter().map(|&first| n_points(first)).max().unwrap();
        assert!(most < 2 * owners.len() / PARTS, "{most}");
        assert_eq!(super::firsts(&[], 10), [0]);
    }

    #[test]
    fn every_point_with_a_component_is_in_its_part_in_order() {
        let owners = owners();
        for n_components in [0, 1, 25, 99_500, 100_000] {
            let parts = PointParts::new(&owners, n_components);
            let ends = parts.firsts()[1..].iter().copied().chain([n_components]);
            for (&first, end) in parts.firsts().iter().zip(ends) {
                let found: Vec<u32> = parts.of(first).flatten().copied().collect();
                let mine = (0..).zip(&owners);
                let mine = mine.filter(|(_, owner)| (first..end).contains(&(**owner as usize)));
                let expected: Vec<u32> = mine.map(|(point, _)| point).collect();
                assert!(found == expected, "{first} of {n_components}");
            }
        }
    }
}
