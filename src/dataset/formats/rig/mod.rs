//! What a recording's images tell of the rig that took them: when it took them, and how the camera sits on what
//! its trajectory follows.
//!
//! Depth of one image, moved by the trajectory into another, lies on what that one measured if both were
//! taken when their times say and from where the trajectory says; and what it measured has one colour in the
//! photographs beside both. So pairs of images tell of errors that all of them share: delays by pairs between
//! which the turning changes, the mount by pairs that are turned against each other.

mod clock;
mod color;
mod delays;
mod depth;
mod mount;
mod mount_search;
mod pairs;
mod strips;
#[cfg(test)]
mod tests;

use crate::math::pose::Pose;
pub(super) use clock::{Clock, Shot};
use delays::lowest_of;
use glam::DVec3;
pub(super) use mount::Mount;
use rayon::prelude::*;

/// What all images of a recording share.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Rig {
    /// Whether rows are read one after the other, as was expected: unless depth agrees better without.
    pub reads_rows: bool,
    /// Seconds by which depth was taken after its times, negative before them; 0 where the recording does not
    /// determine it.
    pub depth_delay: f64,
    /// The same of photographs.
    pub color_delay: f64,
    /// How the camera sits on what the trajectory follows.
    pub mount: Mount,
}

impl Rig {
    /// What is expected before any image is looked at.
    pub const EXPECTED: Self = Self {
        reads_rows: true,
        depth_delay: 0.0,
        color_delay: 0.0,
        mount: Mount { shift: DVec3::ZERO, turn: DVec3::ZERO },
    };
}

/// That of a recording.
pub(super) fn find<At>(shots: &[Shot], clock: &Clock<At>) -> Rig
where
    At: Fn(f64) -> Option<Pose> + Sync,
{
    let loaded = |chosen: Vec<[_; 2]>| -> Vec<depth::Pair<'_>> {
        chosen.into_par_iter().filter_map(|pair| depth::Pair::load(pair, clock)).collect()
    };
    let shaken = loaded(pairs::shaken(shots, clock));
    let delay = lowest_of(&shaken, |pair, delay| pair.distance(clock, delay)).unwrap_or(0.0);
    let [one_by_one, at_once] = [1.0, 0.0].map(|times| clock.slowed(times));
    let all: Vec<&depth::Pair<'_>> = shaken.iter().collect();
    let reads_rows = depth::total(&all, &one_by_one, delay) <= depth::total(&all, &at_once, delay);
    let clock = if reads_rows { one_by_one } else { at_once };
    let mount = mount_search::find(&loaded(pairs::turned(shots, &clock)), &clock, delay);
    let clock = &clock.mounted(mount);
    let shaken: Vec<color::Pair> =
        shaken.into_par_iter().filter_map(|pair| color::Pair::load(&pair, clock, delay)).collect();
    let color = lowest_of(&shaken, |pair, delay| pair.distance(clock, delay)).unwrap_or(0.0);
    Rig { reads_rows, depth_delay: delay, color_delay: color, mount }
}
