//! References to the frames of a dataset.
//!
//! A reference keeps its dataset in memory, so that it stays valid when another dataset is opened. A plain
//! index could still be used in the next egui pass, and exceed the number of frames of the new dataset.

use crate::app::state::Opened;
use crate::dataset::calibration::ColorCamera;
use crate::dataset::{Dataset, DatasetSplit, FrameEntry};
use crate::math::camera::{Camera, Intrinsics};
use crate::model::splat::appearance::Finishing;
use crate::render::compare::Area;
use std::sync::Arc;

/// Reference to a frame of a dataset. The dataset stays in memory while the reference exists.
#[derive(Clone, Debug)]
pub struct FrameRef {
    dataset: Arc<Dataset>,
    split: usize,
    index: usize,
}

impl PartialEq for FrameRef {
    /// True if both references are to the same frame of the same opened dataset. A folder opened twice
    /// yields two different datasets.
    fn eq(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.dataset, &other.dataset)
            && (self.split, self.index) == (other.split, other.index)
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Direction {
    Back,
    Forth,
}

impl FrameRef {
    pub fn first(dataset: &Arc<Dataset>) -> Option<Self> {
        Self::numbered(dataset, 0)
    }

    /// Returns the frame at a position of the training order; `None` beyond the last position or for a
    /// model.
    pub fn trained(opened: &Opened, position: usize) -> Option<Self> {
        let plan = opened.plan.as_ref()?;
        Self::at(opened.dataset.as_ref()?, plan.split, *plan.frames.get(position)?)
    }

    pub fn at(dataset: &Arc<Dataset>, split: usize, index: usize) -> Option<Self> {
        dataset.splits.get(split)?.frames.get(index)?;
        Some(Self { dataset: dataset.clone(), split, index })
    }

    /// Returns frame `number` among all frames of a dataset, counted from 0; `None` beyond the last frame.
    pub fn numbered(dataset: &Arc<Dataset>, number: usize) -> Option<Self> {
        let mut index = number;
        for (split, frames) in dataset.splits.iter().map(|split| split.frames.len()).enumerate() {
            if index < frames {
                return Some(Self { dataset: dataset.clone(), split, index });
            }
            index -= frames;
        }
        None
    }

    /// Returns the same frame of `dataset` if that is a newer state of the same recording; otherwise
    /// this frame.
    pub fn in_current_dataset(&self, dataset: Option<&Arc<Dataset>>) -> Self {
        let (split, index) = self.position();
        let is_there = |dataset: &&Arc<Dataset>| {
            dataset.path == self.dataset.path
                && dataset.splits.get(split).is_some_and(|split| index < split.frames.len())
        };
        let dataset = dataset.filter(is_there).unwrap_or(&self.dataset).clone();
        Self { dataset, split, index }
    }

    /// Returns the next or previous frame. The order continues across splits and from the last frame to
    /// the first.
    pub fn neighbour(&self, direction: Direction) -> Self {
        let n = self.n_frames();
        let number = match direction {
            Direction::Forth => (self.number() + 1) % n,
            // `n` is added first, because unsigned numbers cannot go below 0.
            Direction::Back => (self.number() + n - 1) % n,
        };
        // `number` is below the number of frames, so this frame always exists.
        Self::numbered(&self.dataset, number).unwrap_or_else(|| self.clone())
    }

    /// Returns the number of the frame among all frames of the dataset, counted from 0.
    pub fn number(&self) -> usize {
        let before =
            self.dataset.splits[..self.split].iter().map(|s| s.frames.len()).sum::<usize>();
        before + self.index
    }

    pub fn n_frames(&self) -> usize {
        self.dataset.splits.iter().map(|s| s.frames.len()).sum()
    }

    pub fn position(&self) -> (usize, usize) {
        (self.split, self.index)
    }

    pub fn dataset(&self) -> &Arc<Dataset> {
        &self.dataset
    }

    pub fn split(&self) -> &DatasetSplit {
        &self.dataset.splits[self.split]
    }

    pub fn entry(&self) -> &FrameEntry {
        &self.split().frames[self.index]
    }

    /// Returns the camera that took the photograph, at the pose corrected by the scene. `color_camera`
    /// is given if the depth camera did not take the photographs.
    pub fn photo_camera(&self, color_camera: Option<&ColorCamera>, scene: &Finishing) -> Camera {
        let entry = self.entry();
        let pose = scene.corrected_pose(&entry.camera.pose);
        scene.photograph_camera(entry.photo_camera_at(pose, color_camera))
    }
}

/// Fits the image of `camera` into a viewport of the given size (pixels), centred and as large as
/// possible. Returns the camera of the whole viewport and the part that the image fills.
pub fn fit(camera: &Camera, [width, height]: [u32; 2]) -> (Camera, Area) {
    let k = &camera.intrinsics;
    let size = [f64::from(width), f64::from(height)];
    let image = [f64::from(k.width), f64::from(k.height)];
    let scale = (size[0] / image[0]).min(size[1] / image[1]);
    let margin = [0, 1].map(|axis| 0.5 * (size[axis] - scale * image[axis]));
    let intrinsics = Intrinsics {
        width,
        height,
        fx: scale * k.fx,
        fy: scale * k.fy,
        cx: scale * k.cx + margin[0],
        cy: scale * k.cy + margin[1],
    };
    let min = [0, 1].map(|axis| (margin[axis] / size[axis]) as f32);
    let area = Area { min, max: min.map(|share| 1.0 - share) };
    (Camera { intrinsics, ..*camera }, area)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::pose::Pose;
    use crate::pipeline::session::demo_dataset;

    #[test]
    fn stepping_visits_every_frame_and_comes_round() {
        let dataset = demo_dataset().unwrap();
        let first = FrameRef::first(&dataset).unwrap();
        let mut frame = first.clone();
        for number in 0..first.n_frames() {
            assert_eq!(frame.number(), number);
            assert_eq!(FrameRef::numbered(&dataset, number).as_ref(), Some(&frame));
            let next = frame.neighbour(Direction::Forth);
            assert_eq!(next.neighbour(Direction::Back), frame);
            frame = next;
        }
        assert_eq!(frame, first);
        assert_eq!(FrameRef::numbered(&dataset, first.n_frames()), None);
        assert!(dataset.splits.len() > 1, "splits follow each other");
    }

    #[test]
    fn the_same_numbers_in_another_dataset_are_another_frame() {
        let [a, b] = [(); 2].map(|()| FrameRef::first(&demo_dataset().unwrap()).unwrap());
        assert_eq!(a.position(), b.position());
        assert_ne!(a, b);
        let mut empty = Dataset::clone(a.dataset());
        empty.splits.clear();
        assert_eq!(FrameRef::first(&Arc::new(empty)), None);
    }

    #[test]
    fn a_fitted_image_is_centred_and_keeps_every_pixels_ray() {
        let intrinsics =
            Intrinsics { width: 64, height: 48, fx: 70.0, fy: 65.0, cx: 30.0, cy: 26.0 };
        let camera = Camera { intrinsics, pose: Pose::IDENTITY };
        for size in [[300, 100], [100, 300], [640, 480], [33, 1]] {
            let (fitted, area) = fit(&camera, size);
            for (column, row) in [(0.0, 0.0), (64.0, 48.0), (10.25, 40.5)] {
                let share = [column / 64.0, row / 48.0];
                let at: [f64; 2] = std::array::from_fn(|axis| {
                    let [min, max] = [area.min[axis], area.max[axis]].map(f64::from);
                    (min + share[axis] * (max - min)) * f64::from(size[axis])
                });
                let k = &fitted.intrinsics;
                let ray = [(at[0] - k.cx) / k.fx, (at[1] - k.cy) / k.fy];
                let expected = [(column - 30.0) / 70.0, (row - 26.0) / 65.0];
                assert!(ray.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-4), "{size:?}");
            }
        }
    }
}
