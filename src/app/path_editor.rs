//! Camera path edited in the window: keyframes in order, with playback.

use crate::export::camera_path::{CameraPathError, PacedPath};
use crate::math::camera_path::{CameraPath, Keyframe};
use glam::DVec3;
use std::path::Path;

/// Default time between two keyframes, seconds.
const STEP_S: f64 = 2.0;

#[derive(Clone, Debug)]
pub struct PathEditor {
    keyframes: Vec<Keyframe>,
    pub fps: f64,
    /// True if the path returns from the last keyframe to the first.
    pub is_loop: bool,
    /// Time from the last keyframe back to the first, seconds.
    pub way_back: f64,
    /// Playback position, seconds from the first keyframe.
    pub moment: f64,
    pub is_playing: bool,
    pub file: String,
    pub size: [u32; 2],
}

impl Default for PathEditor {
    fn default() -> Self {
        Self {
            keyframes: Vec::new(),
            fps: 30.0,
            is_loop: false,
            way_back: STEP_S,
            moment: 0.0,
            is_playing: false,
            file: String::new(),
            size: [1280, 720],
        }
    }
}

impl PathEditor {
    /// Returns the keyframes in ascending order of time; the first time is 0.
    pub fn keyframes(&self) -> &[Keyframe] {
        &self.keyframes
    }

    /// Returns the time from the previous keyframe to keyframe `i`, seconds.
    pub fn step(&self, i: usize) -> f64 {
        self.keyframes[i].time - self.keyframes[i - 1].time
    }

    /// Appends a keyframe [`STEP_S`] after the last one.
    pub fn add(&mut self, camera: Keyframe) {
        let time = self.keyframes.last().map_or(0.0, |last| last.time + STEP_S);
        self.keyframes.push(Keyframe { time, ..camera });
    }

    pub fn replace(&mut self, i: usize, camera: Keyframe) {
        self.keyframes[i] = Keyframe { time: self.keyframes[i].time, ..camera };
    }

    /// Removes a keyframe. The time steps between later keyframes do not change.
    pub fn remove(&mut self, i: usize) {
        let gap = match self.keyframes.get(i + 1) {
            Some(next) => next.time - self.keyframes[i].time,
            // No keyframe follows that would have to move.
            None => 0.0,
        };
        self.keyframes.remove(i);
        self.shift(i, -gap);
    }

    /// Sets the time from the previous keyframe to keyframe `i`, seconds. The time steps between later
    /// keyframes do not change.
    pub fn set_step(&mut self, i: usize, seconds: f64) {
        self.shift(i, seconds - self.step(i));
    }

    fn shift(&mut self, from: usize, by: f64) {
        self.keyframes[from..].iter_mut().for_each(|keyframe| keyframe.time += by);
    }

    pub fn take(&mut self, paced: &PacedPath) {
        let path = &paced.path;
        let all = path.keyframes();
        // The last keyframe of a loop repeats the first one.
        let (first, n) = (all[0].time, all.len() - usize::from(path.is_loop()));
        if path.is_loop() {
            self.way_back = all[n].time - all[n - 1].time;
        }
        let from_start = |k: &Keyframe| Keyframe { time: k.time - first, ..*k };
        self.keyframes = all[..n].iter().map(from_start).collect();
        (self.fps, self.is_loop, self.moment) = (paced.fps, path.is_loop(), 0.0);
    }

    /// Reads a camera path from a file. `up` is the up direction for cameras without their own.
    pub fn open(&mut self, file: &Path, up: DVec3) -> Result<(), CameraPathError> {
        PacedPath::read(file, up).map(|paced| self.take(&paced))
    }

    /// Returns the camera path with its frame rate; `None` for fewer than two keyframes.
    pub fn paced(&self) -> Option<PacedPath> {
        let mut keyframes = self.keyframes.clone();
        if let (true, Some(first), Some(last)) =
            (self.is_loop, self.keyframes.first(), self.keyframes.last())
        {
            keyframes.push(Keyframe { time: last.time + self.way_back, ..*first });
        }
        // A loop of one keyframe has two points but no movement.
        let is_enough = self.keyframes.len() > 1;
        let path = CameraPath::new(keyframes, self.is_loop).filter(|_| is_enough)?;
        Some(PacedPath { path, fps: self.fps })
    }

    /// During playback, advances the position by `seconds` and returns the camera there. A loop repeats;
    /// other paths stop at their end.
    pub fn advance(&mut self, seconds: f64) -> Option<Keyframe> {
        let path = self.paced()?.path;
        if !self.is_playing {
            return None;
        }
        self.moment += seconds;
        if self.moment >= path.duration() {
            self.is_playing = self.is_loop;
            // The remainder, because a slow pass may take longer than the whole loop.
            self.moment =
                if self.is_loop { self.moment % path.duration() } else { path.duration() };
        }
        Some(path.at(self.moment))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::pose::Pose;

    fn camera(x: f64) -> Keyframe {
        let pose = Pose::look_at(DVec3::new(x, -2.0, 0.0), DVec3::ZERO, DVec3::Z).unwrap();
        Keyframe { time: 77.0, pose, fov_y: 0.8 }
    }

    fn times(editor: &PathEditor) -> Vec<f64> {
        editor.keyframes().iter().map(|keyframe| keyframe.time).collect()
    }

    #[test]
    fn keyframes_keep_their_steps() {
        let mut editor = PathEditor::default();
        (0..4).for_each(|i| editor.add(camera(f64::from(i))));
        assert_eq!(times(&editor), [0.0, 2.0, 4.0, 6.0]);
        editor.set_step(1, 0.5);
        assert_eq!(times(&editor), [0.0, 0.5, 2.5, 4.5]);
        editor.replace(1, camera(9.0));
        assert_eq!(
            (editor.keyframes()[1].time, editor.keyframes()[1].pose),
            (0.5, camera(9.0).pose)
        );
        editor.remove(0);
        assert_eq!(times(&editor), [0.0, 2.0, 4.0]);
        editor.remove(2);
        assert_eq!(times(&editor), [0.0, 2.0]);
        editor.remove(1);
        assert!(editor.paced().is_none(), "one keyframe is no path");
        editor.is_loop = true;
        assert!(editor.paced().is_none(), "nor is it a loop");
    }

    #[test]
    fn playing_ends_at_the_end_or_goes_round() {
        let mut editor = PathEditor::default();
        (0..2).for_each(|i| editor.add(camera(f64::from(i))));
        assert_eq!(editor.advance(1.0), None, "not before playback starts");
        editor.is_playing = true;
        assert!(editor.advance(1.5).is_some() && editor.is_playing);
        assert_eq!(editor.advance(1.5).map(|k| k.pose), Some(camera(1.0).pose));
        assert_eq!((editor.is_playing, editor.moment), (false, 2.0));
        (editor.is_loop, editor.is_playing) = (true, true);
        editor.advance(3.0);
        assert_eq!((editor.is_playing, editor.moment), (true, 1.0));
    }

    #[test]
    fn what_was_saved_is_opened_again() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("way.json");
        for is_loop in [false, true] {
            let mut editor = PathEditor { is_loop, fps: 12.0, ..PathEditor::default() };
            (0..3).for_each(|i| editor.add(camera(f64::from(i))));
            editor.way_back = 3.5;
            std::fs::write(&file, editor.paced().unwrap().to_json()).unwrap();
            let mut again = PathEditor::default();
            again.open(&file, DVec3::Z).unwrap();
            assert_eq!((times(&again), again.fps, again.is_loop), (times(&editor), 12.0, is_loop));
            let duration = |editor: &PathEditor| editor.paced().unwrap().path.duration();
            assert_eq!(duration(&again), duration(&editor), "the way back too");
        }
    }
}
