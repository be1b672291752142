//! Chooses the faster drawing path by measurement.
//!
//! Blended quads are slow on chips with much compute and few raster units, and fast on gaming
//! cards; the adapter's name does not reveal which. The first images are therefore drawn by both paths
//! and the medians compared. The choice is repeated after a large change of load, because the load affects
//! which path is faster (`rendering.md`, GPU renderer).

use super::path::DrawPath;

/// Measurements per path. The first ones are ignored: buffers are still growing and clocks still
/// rising.
const N_TRIALS: usize = 8;
const N_IGNORED: usize = 4;
/// Factors of change in splats and pixels that trigger a new choice.
const MANY_SPLATS: f64 = 2.0;
const MANY_PIXELS: f64 = 1.5;

/// Amount of work per image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Load {
    pub(super) n_splats: usize,
    pub(super) n_pixels: usize,
}

/// Measures both paths and selects the faster one.
#[derive(Debug)]
pub(super) struct Chooser {
    state: State,
    load: Load,
}

#[derive(Debug)]
enum State {
    /// Not measured.
    Fixed(DrawPath),
    Trying {
        path: DrawPath,
        milliseconds: Vec<f64>,
        quads: Option<f64>,
    },
    Chosen(DrawPath),
}

impl Chooser {
    /// Always selects one path.
    pub(super) fn fixed(path: DrawPath) -> Self {
        Self { state: State::Fixed(path), load: Load { n_splats: 0, n_pixels: 0 } }
    }

    /// Starts measuring, with quads first.
    pub(super) fn measuring() -> Self {
        Self { state: trial_state(DrawPath::Quads, None), load: Load { n_splats: 0, n_pixels: 0 } }
    }

    pub(super) fn is_measured(&self) -> bool {
        !matches!(self.state, State::Fixed(_))
    }

    /// Selects quads because tiles cannot draw the current load. A free choice is repeated when the load
    /// changes.
    pub(super) fn rule_out_tiles(&mut self) {
        self.state = if self.is_measured() {
            State::Chosen(DrawPath::Quads)
        } else {
            State::Fixed(DrawPath::Quads)
        };
    }

    pub(super) fn path(&self) -> DrawPath {
        match &self.state {
            State::Fixed(path) | State::Chosen(path) => *path,
            State::Trying { path, .. } => *path,
        }
    }

    /// Restarts the measurement if the load differs greatly from that of the last choice.
    pub(super) fn update_load(&mut self, load: Load) {
        let is_new = differs(load.n_splats, self.load.n_splats, MANY_SPLATS)
            || differs(load.n_pixels, self.load.n_pixels, MANY_PIXELS);
        if is_new && self.is_measured() {
            self.state = trial_state(DrawPath::Quads, None);
            self.load = load;
        }
    }

    /// Records the time of an image in milliseconds; the image may be a few frames old.
    pub(super) fn record_time(&mut self, path: DrawPath, total: f64) {
        let State::Trying { path: tried, milliseconds, quads } = &mut self.state else { return };
        // Results arrive some frames late, so the first ones may belong to the other path.
        if path != *tried {
            return;
        }
        milliseconds.push(total);
        if milliseconds.len() < N_TRIALS {
            return;
        }
        let kept = &mut milliseconds[N_IGNORED..];
        // Median, so that a disturbance by another program does not decide.
        kept.sort_by(f64::total_cmp);
        let median = kept[kept.len() / 2];
        self.state = match *quads {
            None => trial_state(DrawPath::Tiles, Some(median)),
            Some(quads) if quads <= median => State::Chosen(DrawPath::Quads),
            Some(_) => State::Chosen(DrawPath::Tiles),
        };
    }
}

fn trial_state(path: DrawPath, quads: Option<f64>) -> State {
    State::Trying { path, milliseconds: Vec::with_capacity(N_TRIALS), quads }
}

fn differs(now: usize, before: usize, factor: f64) -> bool {
    let (now, before) = (now as f64, before as f64);
    now > factor * before || before > factor * now
}

#[cfg(test)]
mod tests {
    use super::*;

    const LOAD: Load = Load { n_splats: 1000, n_pixels: 100 };

    /// Draws until the choice is made, with measurements two frames late.
    fn settle(chooser: &mut Chooser, load: Load, quads: f64, tiles: f64) -> DrawPath {
        let mut under_way = Vec::new();
        for _ in 0..4 * N_TRIALS {
            chooser.update_load(load);
            under_way.push(chooser.path());
            if under_way.len() > 2 {
                let path = under_way.remove(0);
                chooser.record_time(path, if path == DrawPath::Quads { quads } else { tiles });
            }
        }
        chooser.path()
    }

    #[test]
    fn the_faster_path_is_kept() {
        for (quads, tiles, faster) in [(3.0, 1.0, DrawPath::Tiles), (1.0, 3.0, DrawPath::Quads)] {
            let mut chooser = Chooser::measuring();
            assert_eq!(settle(&mut chooser, LOAD, quads, tiles), faster);
            // Small changes of load do not start a new trial, whatever is measured.
            let more = Load { n_splats: 1900, n_pixels: 149 };
            assert_eq!(settle(&mut chooser, more, tiles, quads), faster);
        }
    }

    #[test]
    fn a_new_load_is_measured_anew() {
        for load in [
            Load { n_splats: 2001, ..LOAD },
            Load { n_splats: 499, ..LOAD },
            Load { n_pixels: 151, ..LOAD },
            Load { n_pixels: 66, ..LOAD },
        ] {
            let mut chooser = Chooser::measuring();
            assert_eq!(settle(&mut chooser, LOAD, 1.0, 2.0), DrawPath::Quads);
            assert_eq!(settle(&mut chooser, load, 2.0, 1.0), DrawPath::Tiles, "{load:?}");
        }
    }

    #[test]
    fn a_fixed_path_stays() {
        let mut chooser = Chooser::fixed(DrawPath::Quads);
        assert_eq!(settle(&mut chooser, LOAD, 5.0, 1.0), DrawPath::Quads);
    }

    #[test]
    fn slow_first_images_do_not_count() {
        let mut chooser = Chooser::measuring();
        chooser.update_load(LOAD);
        for path in [DrawPath::Quads, DrawPath::Tiles] {
            for i in 0..N_TRIALS {
                let total = match (path, i < N_IGNORED) {
                    (DrawPath::Quads, _) => 2.0,
                    (DrawPath::Tiles, true) => 100.0,
                    (DrawPath::Tiles, false) => 1.0,
                };
                chooser.record_time(path, total);
            }
        }
        assert_eq!(chooser.path(), DrawPath::Tiles);
    }
}
