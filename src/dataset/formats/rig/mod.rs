//! Estimates properties of a recording's rig from its images: errors of timestamps, and the mount of the
//! camera on the tracked body.
//!
//! If times and trajectory are right, the depth of one image, transformed into another, matches the
//! depth measured there. Matching points also have the same colour in both photographs. So differences
//! within image pairs reveal errors that all images share. Delays follow from pairs with different
//! rotation rates, the mount from pairs with different orientations.

mod clock;
mod images;
mod mount_search;
#[cfg(test)]
mod tests;

use clock::estimate_delay;
use glam::DVec3;
use images::{ColorPair, DepthPair, total_distance};
use rayon::prelude::*;

pub(super) use clock::{Clock, ImagePair};
pub(super) use mount_search::Mount;

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Rig {
    /// True if image rows are read one after the other (rolling shutter); false if depth agrees better
    /// without a rolling shutter.
    pub reads_rows: bool,
    /// Time from the timestamps of depth images to their capture, seconds; negative if captured earlier,
    /// 0 if undetermined.
    pub depth_delay: f64,
    pub color_delay: f64,
    pub mount: Mount,
}

impl Rig {
    /// Rig assumed before the estimate.
    pub const EXPECTED: Self = Self {
        reads_rows: true,
        depth_delay: 0.0,
        color_delay: 0.0,
        mount: Mount { shift: DVec3::ZERO, turn: DVec3::ZERO },
    };
}

pub(super) fn find(shots: &[ImagePair], clock: &Clock<'_>) -> Rig {
    let loaded = |chosen: Vec<[_; 2]>| -> Vec<DepthPair<'_>> {
        chosen.into_par_iter().filter_map(|pair| DepthPair::load(pair, clock)).collect()
    };
    let shaken = loaded(clock::pairs_by_rate_change(shots, clock));
    let delay = estimate_delay(&shaken, |pair, delay| pair.distance(clock, delay)).unwrap_or(0.0);
    let at_once = &clock.without_readout();
    let all: Vec<&DepthPair<'_>> = shaken.iter().collect();
    // A tie, as without pairs, keeps the expectation.
    let reads_rows = total_distance(&all, clock, delay) <= total_distance(&all, at_once, delay);
    let clock = if reads_rows { clock } else { at_once };
    let mount = mount_search::find(&loaded(clock::pairs_by_rotation(shots, clock)), clock, delay);
    // Photographs come last: their common points need the delay and mount of depth.
    let clock = &clock.mounted(mount);
    let shaken: Vec<ColorPair> =
        shaken.into_par_iter().filter_map(|pair| ColorPair::load(&pair, clock, delay)).collect();
    let color = estimate_delay(&shaken, |pair, delay| pair.distance(clock, delay)).unwrap_or(0.0);
    Rig { reads_rows, depth_delay: delay, color_delay: color, mount }
}
