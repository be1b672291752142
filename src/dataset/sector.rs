//! Hold-out by sector (`evaluation.md`, Views from the side): trains on a sector of a recording or around an
//! object and measures views outside it.

use super::error::DatasetError;
use super::opened::Dataset;
use super::range::median;
use super::splits::{Evaluation, HOLD_OUT_EVERY, HoldOut, ViewGroup, ViewGroupName};
use crate::math::pose::Pose;
use glam::{DMat3, DVec3};
use std::f64::consts::TAU;

/// Share of a recording from which training frames are chosen, in fifths of its frames.
const TRAINING_FIFTHS: usize = 3;
/// First side view of a recording, in thirds of its frames. Frames between the training frames and the
/// side views are not used.
const SIDE_THIRDS: usize = 2;
/// Largest azimuth between the first frame and a training frame of an object, degrees.
const TRAINING_AZIMUTH: f64 = 60.0;
/// Largest azimuth between the first frame and a side view of an object, degrees. Views beyond it show
/// the object's far side, which was never trained.
const SIDE_AZIMUTH: f64 = 110.0;
const MIN_TRAINING: usize = 2;

/// Minimum share of the cameras that must face the object.
const IN_FRONT: f64 = 0.95;
/// Largest median distance between optical axes and the object's centre, relative to the cameras'
/// distance from the centre.
const MAX_AXIS_MISS: f64 = 0.1;
/// Minimum azimuth range that cameras around an object must span, degrees.
const MIN_SPAN: f64 = 120.0;
/// Minimum determinant of the mean projector onto the planes perpendicular to the optical axes. It is 0
/// for parallel axes, which have no common point.
const MIN_DETERMINANT: f64 = 1e-6;

impl Dataset {
    /// Chooses the views for evaluation by the hold-out method; `training_split` is an index into
    /// [`Dataset::splits`].
    ///
    /// # Errors
    /// [`DatasetError::Sector`] if the sector leaves a group of views empty, or fewer than two training
    /// frames.
    pub fn evaluation_by(
        &self,
        hold_out: HoldOut,
        training_split: usize,
    ) -> Result<Evaluation, DatasetError> {
        match hold_out {
            HoldOut::Every8th => Ok(self.evaluation(training_split)),
            HoldOut::Sector => self.sector(training_split),
        }
    }

    fn sector(&self, training_split: usize) -> Result<Evaluation, DatasetError> {
        let poses = self.poses(training_split);
        let ring = CameraRing::around(&poses, self.up(training_split));
        let ViewSector { split, training, new_views, side, why } = match &ring {
            Some(ring) => self.object(training_split, &poses, ring),
            None => recording(training_split, poses.len()),
        };
        if training.len() < MIN_TRAINING || new_views.is_empty() || side.is_empty() {
            let (kind, hint) = match ring {
                Some(_) => ("an object", "add views at up to 110 degrees from the first frame"),
                None => ("a recording", "use a longer recording"),
            };
            return Err(DatasetError::Sector {
                path: self.display_path(),
                kind,
                frames: poses.len(),
                training: training.len(),
                new_views: new_views.len(),
                from_the_side: side.len(),
                hint,
            });
        }
        let group = |name, frames| ViewGroup { name: Some(name), split, frames };
        let mut from_the_side = vec![group(ViewGroupName::FromTheSide, side)];
        from_the_side.extend(self.free_views(training_split));
        let new_views = group(ViewGroupName::NewViews, new_views);
        Ok(Evaluation { new_views, from_the_side, training: Some(training), why })
    }

    fn poses(&self, split: usize) -> Vec<Pose> {
        let frames = self.splits.get(split).into_iter().flat_map(|split| &split.frames);
        frames.map(|frame| frame.camera.pose).collect()
    }

    /// Divides the frames of an object by azimuth. Views for evaluation come from the evaluation split,
    /// if there is one.
    fn object(&self, training_split: usize, poses: &[Pose], ring: &CameraRing) -> ViewSector {
        let within = |poses: &[Pose], is_within: fn(f64) -> bool| -> Vec<usize> {
            let azimuths = poses.iter().map(|pose| ring.azimuth(pose).abs().to_degrees());
            azimuths
                .enumerate()
                .filter(|(_, azimuth)| is_within(*azimuth))
                .map(|(i, _)| i)
                .collect()
        };
        let inside = |azimuth| azimuth <= TRAINING_AZIMUTH;
        let beyond = |azimuth| azimuth > TRAINING_AZIMUTH && azimuth <= SIDE_AZIMUTH;
        let sector = within(poses, inside);
        let (split, training, new_views, side) = match self.evaluation_split(training_split) {
            Some((split, _)) => {
                let poses = self.poses(split);
                (split, sector, within(&poses, inside), within(&poses, beyond))
            }
            None => {
                let (training, new_views) = hold_out_eighth(sector);
                (training_split, training, new_views, within(poses, beyond))
            }
        };
        let name = self.splits.get(split).map_or("", |split| split.name.as_str());
        let why = format!(
            "a sector of an object: {} of {} frames train, within {TRAINING_AZIMUTH} degrees of azimuth from the first one; {} new views of `{name}` there, {} from the side at up to {SIDE_AZIMUTH} degrees",
            training.len(),
            poses.len(),
            new_views.len(),
            side.len(),
        );
        ViewSector { split, training, new_views, side, why }
    }
}

/// Indices of training frames, and of the views of `split` for evaluation.
struct ViewSector {
    split: usize,
    training: Vec<usize>,
    new_views: Vec<usize>,
    side: Vec<usize>,
    why: String,
}

/// Chooses the start of a camera path for training and its end for evaluation.
fn recording(split: usize, n_frames: usize) -> ViewSector {
    let (training, new_views) = hold_out_eighth((0..n_frames * TRAINING_FIFTHS / 5).collect());
    let first = (n_frames * SIDE_THIRDS).div_ceil(3);
    let side: Vec<usize> = (first..n_frames).collect();
    let why = format!(
        "a sector of a recording: {} of {n_frames} frames train; {} new views, every {HOLD_OUT_EVERY}th of the first 60 %; {} views from the side, after two thirds of the recording",
        training.len(),
        new_views.len(),
        side.len(),
    );
    ViewSector { split, training, new_views, side, why }
}

fn hold_out_eighth(frames: Vec<usize>) -> (Vec<usize>, Vec<usize>) {
    let numbered = frames.into_iter().enumerate();
    let (held_out, training): (Vec<_>, Vec<_>) =
        numbered.partition(|(i, _)| i.is_multiple_of(HOLD_OUT_EVERY));
    let frames = |of: Vec<(usize, usize)>| of.into_iter().map(|(_, frame)| frame).collect();
    (frames(training), frames(held_out))
}

struct CameraRing {
    centre: DVec3,
    /// Unit vectors perpendicular to the up axis: towards the first camera, and a quarter turn further.
    horizon: [DVec3; 2],
}

impl CameraRing {
    fn around(poses: &[Pose], up: DVec3) -> Option<Self> {
        let centre = axes_intersection(poses)?;
        let from_centre = |pose: &Pose| pose.centre() - centre;
        let is_in_front = |pose: &&Pose| pose.forward().dot(-from_centre(pose)) > 0.0;
        let n_in_front = poses.iter().filter(is_in_front).count();
        if (n_in_front as f64) < IN_FRONT * poses.len() as f64 {
            return None;
        }
        let miss = |pose: &Pose| {
            let to_camera = from_centre(pose);
            // Sine of the angle between axis and centre, so that the world's scale does not matter.
            to_camera.cross(pose.forward()).length() / to_camera.length()
        };
        // The median tolerates a few cameras that face elsewhere.
        if median(poses.iter().map(miss).collect())? > MAX_AXIS_MISS {
            return None;
        }
        // Azimuth is measured in the plane across the up axis.
        let first = from_centre(poses.first()?).reject_from(up).try_normalize()?;
        let ring = Self { centre, horizon: [first, up.cross(first)] };
        // Cameras on one side only make a recording, not an object.
        (ring.span(poses) > MIN_SPAN.to_radians()).then_some(ring)
    }

    /// Returns the azimuth of a camera relative to the first camera, −π to π.
    fn azimuth(&self, pose: &Pose) -> f64 {
        let [x, y] = self.horizon.map(|axis| (pose.centre() - self.centre).dot(axis));
        y.atan2(x)
    }

    fn span(&self, poses: &[Pose]) -> f64 {
        let mut azimuths: Vec<f64> = poses.iter().map(|pose| self.azimuth(pose)).collect();
        azimuths.sort_by(f64::total_cmp);
        let (Some(first), Some(last)) = (azimuths.first(), azimuths.last()) else { return 0.0 };
        // The span is the circle less the largest gap; the gap from last to first crosses ±π.
        let around = first + TAU - last;
        let gaps = azimuths.iter().zip(azimuths.iter().skip(1)).map(|(a, b)| b - a);
        TAU - gaps.fold(around, f64::max)
    }
}

/// Returns the least-squares intersection of all optical axes; `None` if they are nearly parallel.
fn axes_intersection(poses: &[Pose]) -> Option<DVec3> {
    let (mut across, mut sum) = (DMat3::ZERO, DVec3::ZERO);
    for pose in poses {
        let axis = pose.forward();
        // Projector onto the plane across the axis.
        let off_axis =
            DMat3::IDENTITY - DMat3::from_cols(axis * axis.x, axis * axis.y, axis * axis.z);
        across += off_axis;
        sum += off_axis * pose.centre();
    }
    // Means, so that the limit of the determinant does not depend on the number of cameras.
    let n = poses.len().max(1) as f64;
    let (across, sum) = (across * n.recip(), sum / n);
    (across.determinant() > MIN_DETERMINANT).then(|| across.inverse() * sum)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::synthetic::{self, SyntheticParams};

    /// Returns `n` poses on a circle around the origin, `step` degrees apart. Each optical axis passes
    /// the origin at a distance of about `miss`.
    fn orbit(n: usize, start: f64, step: f64, miss: f64) -> Vec<Pose> {
        let pose = |i: usize| {
            let (sin, cos) = (start + step * i as f64).to_radians().sin_cos();
            let height = 0.4 + 0.3 * (i % 3) as f64;
            let eye = DVec3::new(2.0 * cos, 2.0 * sin, height);
            Pose::look_at(eye, miss * DVec3::new(sin, -cos, 0.0), DVec3::Z).unwrap()
        };
        (0..n).map(pose).collect()
    }

    fn walk(n: usize) -> Vec<Pose> {
        let eye = |i: usize| DVec3::new(0.1 * i as f64, 0.05 * (i as f64).sin(), 1.0);
        (0..n).map(|i| Pose::look_at(eye(i), eye(i) + DVec3::Y, DVec3::Z).unwrap()).collect()
    }

    fn dataset(train: &[Pose], eval: &[Pose]) -> Dataset {
        let (n_train, n_eval) = (train.len(), eval.len());
        let params =
            SyntheticParams { width: 16, height: 12, n_train, n_eval, ..SyntheticParams::demo() };
        let mut room = synthetic::dataset(&params).unwrap();
        for (split, poses) in room.splits.iter_mut().zip([train, eval]) {
            let frames = split.frames.iter_mut().zip(poses);
            frames.for_each(|(frame, pose)| frame.camera.pose = *pose);
        }
        room
    }

    fn sector(dataset: &Dataset) -> Evaluation {
        dataset.evaluation_by(HoldOut::Sector, 0).unwrap()
    }

    #[test]
    fn a_recording_trains_its_beginning_and_is_measured_at_its_end() {
        let alone = sector(&dataset(&walk(30), &[]));
        assert_eq!(alone.new_views.frames, [0, 8, 16]);
        let trained = [1, 2, 3, 4, 5, 6, 7, 9, 10, 11, 12, 13, 14, 15, 17];
        assert_eq!(alone.training.as_deref(), Some(&trained[..]));
        let [side] = &alone.from_the_side[..] else { panic!("one group") };
        assert_eq!((side.split, &side.frames), (0, &(20..30).collect()));
        assert_eq!(side.name, Some(ViewGroupName::FromTheSide));
        // An evaluation split changes nothing.
        let beside = sector(&dataset(&walk(30), &walk(5)));
        assert_eq!(beside, alone);
    }

    #[test]
    fn an_object_trains_a_sector_of_azimuth() {
        let alone = sector(&dataset(&orbit(40, 40.0, 9.0, 0.0), &[]));
        // The first frame and six on each side, of which every eighth is a new view.
        assert_eq!(alone.new_views.frames, [0, 35]);
        let trained = [1, 2, 3, 4, 5, 6, 34, 36, 37, 38, 39];
        assert_eq!(alone.training.as_deref(), Some(&trained[..]));
        let side = [7, 8, 9, 10, 11, 12, 28, 29, 30, 31, 32, 33];
        assert_eq!(alone.from_the_side[0].frames, side);
    }

    #[test]
    fn views_of_an_object_are_of_the_split_for_evaluation() {
        let found = sector(&dataset(&orbit(40, 0.0, 9.0, 0.1), &orbit(12, 5.0, 30.0, 0.0)));
        assert_eq!(found.training.map(|training| training.len()), Some(13));
        let side = &found.from_the_side[0];
        assert_eq!((found.new_views.split, side.split), (1, 1));
        assert_eq!(found.new_views.frames, [0, 1, 10, 11]);
        assert_eq!(side.frames, [2, 3, 9]);
    }

    #[test]
    fn cameras_that_look_past_each_other_or_span_little_walk() {
        let is_object = |poses: &[Pose]| CameraRing::around(poses, DVec3::Z).is_some();
        assert!(is_object(&orbit(24, 0.0, 15.0, 0.1)));
        assert!(!is_object(&orbit(24, 0.0, 15.0, 0.5)), "axes miss the centre");
        assert!(!is_object(&orbit(12, 0.0, 10.0, 0.0)), "a span of 110 degrees");
        assert!(is_object(&orbit(14, 0.0, 10.0, 0.0)), "a span of 130 degrees");
        assert!(!is_object(&walk(24)) && !is_object(&[]));
        let outward = orbit(24, 0.0, 15.0, 0.0).into_iter().map(|pose| {
            let eye = 0.1 * pose.centre();
            Pose::look_at(eye, 2.0 * pose.centre(), DVec3::Z).unwrap()
        });
        assert!(!is_object(&outward.collect::<Vec<_>>()), "a camera that turns in its place");
    }

    #[test]
    fn too_few_views_are_refused_with_what_was_found() {
        let poses = [orbit(7, 0.0, 10.0, 0.0), orbit(7, 120.0, 10.0, 0.0)].concat();
        let found = dataset(&poses, &[]).evaluation_by(HoldOut::Sector, 0);
        let text = found.unwrap_err().to_string();
        let parts =
            ["--hold-out sector", "found 6, 1 and 0", "an object, 14 frames", "up to 110 degrees"];
        parts.iter().for_each(|part| assert!(text.contains(part), "{part}: {text}"));
    }

    #[test]
    fn true_pictures_from_free_viewpoints_are_from_the_side() {
        let mut room = dataset(&walk(30), &walk(5));
        let mut free = room.splits[1].clone();
        free.name = "free".to_owned();
        room.splits.push(free);
        let sides = |hold_out| {
            let found = room.evaluation_by(hold_out, 0).unwrap();
            let sides = found.from_the_side.into_iter();
            sides.map(|group| (group.split, group.frames.len())).collect::<Vec<_>>()
        };
        assert_eq!(sides(HoldOut::Every8th), [(2, 5)]);
        assert_eq!(sides(HoldOut::Sector), [(0, 10), (2, 5)]);
        assert_eq!(room.evaluation(0).new_views.split, 1);
    }
}
