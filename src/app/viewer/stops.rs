//! The dataset's cameras as places to stand at.

use crate::dataset::calibration::ColorCamera;
use crate::dataset::{Dataset, FrameEntry};
use crate::math::camera::{Camera, Intrinsics};
use crate::render::compare::Area;

/// One of a dataset's frames.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stop {
    /// Index of its split.
    pub split: usize,
    /// Index within the split.
    pub index: usize,
}

/// Where to step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Direction {
    /// To the frame before.
    Back,
    /// To the frame after.
    Forth,
}

impl Stop {
    /// The first frame of the dataset.
    pub const FIRST: Self = Self { split: 0, index: 0 };

    /// The neighbouring frame; splits follow each other, the last frame is followed by the first.
    pub fn stepped(self, dataset: &Dataset, direction: Direction) -> Self {
        let n = n_stops(dataset);
        let number = match direction {
            Direction::Forth => (self.number(dataset) + 1) % n,
            Direction::Back => (self.number(dataset) + n - 1) % n,
        };
        let mut index = number;
        for (split, frames) in dataset.splits.iter().map(|s| s.frames.len()).enumerate() {
            if index < frames {
                return Self { split, index };
            }
            index -= frames;
        }
        Self::FIRST
    }

    /// Its place among all frames of the dataset, from 0.
    pub fn number(self, dataset: &Dataset) -> usize {
        let before = dataset.splits[..self.split].iter().map(|s| s.frames.len()).sum::<usize>();
        before + self.index
    }

    /// The frame.
    pub fn entry(self, dataset: &Dataset) -> &FrameEntry {
        &dataset.splits[self.split].frames[self.index]
    }

    /// The camera that took its photograph, given where that stands if it is not the one that
    /// measured depth.
    pub fn photo_camera(self, dataset: &Dataset, color_camera: Option<&ColorCamera>) -> Camera {
        let depth = self.entry(dataset).camera;
        color_camera.map_or(depth, |color| color.beside(&depth))
    }
}

/// Frames of all splits.
pub fn n_stops(dataset: &Dataset) -> usize {
    dataset.splits.iter().map(|s| s.frames.len()).sum()
}

/// The camera of a viewport (pixels) in which `camera`'s image is as large as fits and in the
/// middle, and where that image lies.
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
    use crate::pipeline::demo;

    #[test]
    fn stepping_visits_every_frame_and_comes_round() {
        let dataset = demo::dataset().unwrap();
        let n = n_stops(&dataset);
        let mut stop = Stop::FIRST;
        for number in 0..n {
            assert_eq!(stop.number(&dataset), number);
            let next = stop.stepped(&dataset, Direction::Forth);
            assert_eq!(next.stepped(&dataset, Direction::Back), stop);
            stop = next;
        }
        assert_eq!(stop, Stop::FIRST);
        assert!(dataset.splits.len() > 1, "splits follow each other");
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
