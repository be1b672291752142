//! Poses that cannot be: cameras that jump away for one frame and back.
//!
//! One lost frame of a tracker puts its points anywhere, and whatever is estimated from all frames
//! alike, the range of positions first, follows it. A recording moves in steps that are much alike, so
//! a frame that lies far from both the one before it and the one after it, by many usual steps and by
//! more than the whole recording usually spreads, is no movement. Rotations are left alone: a wrong one
//! keeps its points within the sensor's range.

use super::entry::DatasetSplit;
use glam::DVec3;

/// Frames below which nothing is usual.
const MIN_FRAMES: usize = 5;
/// Usual steps, median of the recording's, that a jump is longer than.
const STEPS: f64 = 20.0;
/// Spreads of the recording, median distance of its cameras from their median place, that a jump is
/// longer than.
const SPREADS: f64 = 3.0;

/// A frame whose camera lies far from those before and after it.
#[derive(Clone, Debug, PartialEq)]
pub struct WildPose {
    /// Position in the split.
    pub index: usize,
    /// Name of the frame within its split.
    pub frame: String,
    /// Distance from the nearer of its two neighbours, world units.
    pub distance: f64,
    /// Median of all frames' distances, world units.
    pub usual: f64,
}

impl std::fmt::Display for WildPose {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { frame, distance, usual, .. } = self;
        write!(
            f,
            "{frame}: its pose lies {distance:.3} from those of the frames before and after it, where {usual:.4} is usual; correct it or leave the frame out"
        )
    }
}

/// The wild poses of a split whose frames are in the order they were taken in.
pub fn wild_poses(split: &DatasetSplit) -> Vec<WildPose> {
    let centres: Vec<DVec3> = split.frames.iter().map(|f| f.camera.pose.centre()).collect();
    let found = isolated(&centres);
    let wild = |(index, distance, usual)| WildPose {
        index,
        frame: split.frames.get(index).map(|frame| frame.name.clone()).unwrap_or_default(),
        distance,
        usual,
    };
    found.into_iter().map(wild).collect()
}

/// Places that lie far from both their neighbours, how far, and how far is usual.
fn isolated(centres: &[DVec3]) -> Vec<(usize, f64, f64)> {
    if centres.len() < MIN_FRAMES {
        return Vec::new();
    }
    let last = centres.len() - 1;
    // The ends have one neighbour, which may be the wild one: the next but one speaks for them too.
    let neighbours = |i: usize| match i {
        0 => [1, 2],
        i if i == last => [last - 1, last - 2],
        i => [i - 1, i + 1],
    };
    let nearer = |(i, centre): (usize, &DVec3)| {
        let [a, b] = neighbours(i).map(|k| centres.get(k).map(|other| centre.distance(*other)));
        a.unwrap_or(f64::INFINITY).min(b.unwrap_or(f64::INFINITY))
    };
    let apart: Vec<f64> = centres.iter().enumerate().map(nearer).collect();
    let axis = |of: fn(&DVec3) -> f64| median(centres.iter().map(of));
    let middle = DVec3::new(axis(|c| c.x), axis(|c| c.y), axis(|c| c.z));
    let spread = median(centres.iter().map(|centre| centre.distance(middle)));
    let usual = median(apart.iter().copied());
    let least = (STEPS * usual).max(SPREADS * spread);
    let is_wild = |(_, apart): &(usize, f64)| least > 0.0 && *apart > least;
    apart.into_iter().enumerate().filter(is_wild).map(|(i, apart)| (i, apart, usual)).collect()
}

fn median(values: impl Iterator<Item = f64>) -> f64 {
    let mut values: Vec<f64> = values.collect();
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}

#[cfg(test)]
mod tests {
    use super::*;

    fn walk(n: usize, step: f64) -> Vec<DVec3> {
        (0..n).map(|i| DVec3::new(step * i as f64, (i as f64).sin() * 0.1 * step, 1.5)).collect()
    }

    fn wild(centres: &[DVec3]) -> Vec<usize> {
        isolated(centres).into_iter().map(|(i, ..)| i).collect()
    }

    #[test]
    fn a_jump_and_back_is_wild_wherever_it_is() {
        for at in [0, 1, 7, 39] {
            for far in [60.0, 1e6] {
                let mut centres = walk(40, 0.05);
                centres[at] += DVec3::new(far, 0.0, -far);
                assert_eq!(wild(&centres), [at], "{far}");
            }
        }
        let mut two = walk(40, 0.05);
        two[3] += DVec3::splat(100.0);
        two[4] -= DVec3::splat(100.0);
        assert_eq!(wild(&two), [3, 4]);
    }

    #[test]
    fn what_moves_or_stands_is_not() {
        assert!(wild(&walk(4, 100.0)).is_empty(), "too few to tell");
        assert!(wild(&walk(100, 0.05)).is_empty());
        assert!(wild(&[DVec3::ONE; 20]).is_empty(), "a tripod");
        // A room, then a walk away from it; two rooms with a gap in time between them.
        let mut away = vec![DVec3::ZERO; 60];
        away.extend(walk(30, 0.3));
        assert!(wild(&away).is_empty());
        let mut rooms = walk(20, 0.02);
        rooms.extend(walk(20, 0.02).iter().map(|c| *c + DVec3::X * 50.0));
        assert!(wild(&rooms).is_empty());
        // Cameras around an object, in no order.
        let around = |i: usize| {
            let a = (i * 37 % 100) as f64;
            4.0 * DVec3::new(a.sin(), a.cos(), 0.3)
        };
        assert!(wild(&(0..100).map(around).collect::<Vec<_>>()).is_empty());
    }
}
