//! Outlier poses: cameras that jump away for one frame and back.
//!
//! If tracking is lost in a frame, its points are misplaced, which distorts estimates from all frames,
//! such as the range of positions. The steps of a recording are of similar size. So a frame is an
//! outlier if its distance from both neighbours exceeds many median steps and the recording's spread.
//! Rotations are not checked: a wrong rotation leaves the points within the sensor's range.

use super::entry::DatasetSplit;
use super::range::median;
use glam::DVec3;

/// Minimum number of frames for meaningful medians.
const MIN_FRAMES: usize = 5;
/// Minimum distance of an outlier camera from its neighbours, in multiples of the median distance
/// between neighbours.
const STEPS: f64 = 20.0;
/// Minimum distance of an outlier camera from its neighbours, in spreads of the recording. The spread is
/// the median distance of the cameras from their median position.
const SPREADS: f64 = 3.0;

/// Frame whose camera is far from the cameras of the frames before and after it.
#[derive(Clone, Debug, PartialEq)]
pub struct OutlierPose {
    /// Index of the frame in the split.
    pub index: usize,
    /// Name of the frame within its split.
    pub frame: String,
    /// Distance of the camera from the nearer of its two neighbours, world units.
    pub distance: f64,
    /// Median of the distances from the nearer neighbour over all frames, world units.
    pub median_distance: f64,
}

impl std::fmt::Display for OutlierPose {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { frame, distance, median_distance: usual, .. } = self;
        write!(
            f,
            "{frame}: its pose lies {distance:.3} from those of the frames before and after it, where the median is {usual:.4}; correct the pose or remove the frame"
        )
    }
}

/// Returns the outlier poses of a split whose frames are in order of capture.
pub fn outlier_poses(split: &DatasetSplit) -> Vec<OutlierPose> {
    let centres: Vec<DVec3> = split.frames.iter().map(|f| f.camera.pose.centre()).collect();
    let found = isolated(&centres);
    let wild = |(index, distance, usual)| OutlierPose {
        index,
        frame: split.frames.get(index).map(|frame| frame.name.clone()).unwrap_or_default(),
        distance,
        median_distance: usual,
    };
    found.into_iter().map(wild).collect()
}

/// Finds positions far from both neighbours. Returns the index of each, its distance from the nearer
/// neighbour, and the median of that distance over all positions.
fn isolated(centres: &[DVec3]) -> Vec<(usize, f64, f64)> {
    if centres.len() < MIN_FRAMES {
        return Vec::new();
    }
    let last = centres.len() - 1;
    // The only neighbour of an end may itself be the outlier: the next one is used as well.
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
    // Never empty here, so the default is never used.
    let median = |values: Vec<f64>| median(values).unwrap_or_default();
    let axis = |of: fn(&DVec3) -> f64| median(centres.iter().map(of).collect());
    let middle = DVec3::new(axis(|c| c.x), axis(|c| c.y), axis(|c| c.z));
    let spread = median(centres.iter().map(|centre| centre.distance(middle)).collect());
    let usual = median(apart.clone());
    let least = (STEPS * usual).max(SPREADS * spread);
    // `least > 0`: a camera that does not move has no outliers.
    let is_wild = |(_, apart): &(usize, f64)| least > 0.0 && *apart > least;
    apart.into_iter().enumerate().filter(is_wild).map(|(i, apart)| (i, apart, usual)).collect()
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
        // A room, then a walk away from it; then two rooms with a gap in time between them.
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
