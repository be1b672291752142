//! Retention: PSNR of frames that were trained on earlier, measured repeatedly during training.

use crate::eval::report::RetainedFrame;

/// Position in the training order of the second frame whose PSNR is tracked.
// Positions double from there, so that a long run tracks few frames.
const STEP: usize = 10;
// Each is rendered and measured again and again.
const MAX_FOLLOWED: usize = 8;

#[derive(Clone, Debug, Default)]
pub struct Retention {
    pub frames: Vec<RetainedFrame>,
    measured_at: Option<usize>,
}

impl Retention {
    /// Continues curves of an earlier window.
    pub fn restored(known: &[RetainedFrame]) -> Self {
        let mut retention = Self::default();
        for frame in known {
            for [frames_done, psnr] in &frame.psnr {
                retention.insert(*frames_done as usize, [(frame.position, *psnr)]);
            }
        }
        retention
    }

    /// True if there is no measurement, or if the latest one was made before `frames_done` frames were
    /// trained.
    pub fn measured_before(&self, frames_done: usize) -> bool {
        self.measured_at.is_none_or(|at| at < frames_done)
    }

    /// Makes a new measurement due, because the scene was changed.
    pub fn invalidate(&mut self) {
        self.measured_at = None;
    }

    /// Adds measurements made after training on `frames_done` frames. Each consists of a frame's position
    /// in the training order and its PSNR, dB.
    pub fn add_measurements(
        &mut self,
        frames_done: usize,
        measured: impl IntoIterator<Item = (usize, f64)>,
    ) {
        self.measured_at = Some(frames_done);
        self.insert(frames_done, measured);
    }

    /// Inserts measurements of a scene as it was after `frames_done` frames. Later measurements of the same
    /// scene replace earlier ones.
    pub fn insert(&mut self, frames_done: usize, measured: impl IntoIterator<Item = (usize, f64)>) {
        for (position, psnr) in measured {
            let at = match self.frames.iter().position(|frame| frame.position == position) {
                Some(at) => at,
                None => {
                    self.frames.push(RetainedFrame { position, psnr: Vec::new() });
                    self.frames.len() - 1
                }
            };
            put(&mut self.frames[at].psnr, [frames_done as f64, psnr], |point| point[0]);
        }
    }
}

/// Adds a point to a curve that ascends by `x`, in place of one with the same `x`.
pub fn put<T>(curve: &mut Vec<T>, point: T, x: impl Fn(&T) -> f64) {
    let at = curve.partition_point(|known| x(known) < x(&point));
    let n_replaced = usize::from(curve.get(at).is_some_and(|known| x(known) == x(&point)));
    curve.splice(at..at + n_replaced, [point]);
}

/// Returns the positions of the frames tracked after `frames_done` frames: 0, 10, 20, 40, 80 and so on.
pub fn positions(frames_done: usize) -> Vec<usize> {
    let doubling = std::iter::successors(Some(STEP), |position| position.checked_mul(2));
    let all = std::iter::once(0).chain(doubling).take(MAX_FOLLOWED);
    all.take_while(|position| *position < frames_done).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn few_frames_are_followed_from_the_moment_they_are_trained() {
        assert!(positions(0).is_empty());
        assert_eq!(positions(1), [0]);
        assert_eq!(positions(21), [0, 10, 20]);
        assert_eq!(positions(100_000).len(), MAX_FOLLOWED);
    }

    #[test]
    fn curves_begin_when_their_frame_is_trained() {
        let mut retention = Retention::default();
        assert!(retention.measured_before(1));
        retention.add_measurements(5, [(0, 30.0)]);
        retention.add_measurements(12, [(0, 29.0), (10, 31.0)]);
        assert!(!retention.measured_before(12) && retention.measured_before(13));
        let [first, second] = &retention.frames[..] else { panic!("two frames") };
        assert_eq!(first.psnr, [[5.0, 30.0], [12.0, 29.0]]);
        assert_eq!((second.position, second.psnr.len()), (10, 1));
        retention.insert(7, [(0, 29.5)]);
        assert_eq!(retention.frames[0].psnr, [[5.0, 30.0], [7.0, 29.5], [12.0, 29.0]]);
        assert!(!retention.measured_before(12), "earlier scenes do not count as the newest");
        let mut restored = Retention::restored(&retention.frames);
        assert_eq!(restored.frames, retention.frames);
        assert!(restored.measured_before(12));
        restored.add_measurements(12, [(0, 28.0), (10, 31.0)]);
        assert_eq!(restored.frames[0].psnr, [[5.0, 30.0], [7.0, 29.5], [12.0, 28.0]]);
    }
}
