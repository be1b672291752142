//! Options for opening a dataset.

use super::archive::Archive;
use super::bag::Message;
use super::error::{DatasetError, FrameProblem};
use super::folder::{MAX_IMAGE_BYTES, read_bytes};
use super::pose_check::PoseConvention;
use super::video::Video;
use crate::math::pose::Pose;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Options for opening a dataset. Unset options take their values from the dataset's files.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct LoadOptions {
    /// World units per code step of 16-bit depth; overrides the value of the dataset.
    pub depth_scale: Option<f64>,
    /// Nearest and farthest depth that training uses, world units; overrides the range of the layout.
    pub depth_range: Option<[f64; 2]>,
    /// Convention of the recording's pose matrices; overrides the convention of the layout.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub poses: Option<PoseConvention>,
    /// Intrinsics `fx`, `fy`, `cx`, `cy` of the depth image, pixels; they override the intrinsics of the
    /// dataset. In layouts without intrinsics, they override those of the camera with which such
    /// datasets are usually recorded.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub intrinsics: Option<[f64; 4]>,
    /// Lowest confidence, 0 to 2, of depth that is used, if the recording has confidence maps; 1 by
    /// default.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub confidence: Option<u8>,
    /// True to open recordings without readable photographs as well; their colours are grey.
    #[serde(default, skip_serializing_if = "is_false")]
    pub geometry_only: bool,
    /// True to leave the poses to tracking: recorded poses are ignored and may be missing.
    #[serde(default, skip_serializing_if = "is_false")]
    pub track: bool,
    /// True if a calibration states the photographs' camera, whose images may have another shape than
    /// depth.
    #[serde(default, skip_serializing_if = "is_false")]
    pub calibrated_photographs: bool,
    /// Origin of the camera poses in the coordinates of the files, world units. If a model is shown with
    /// the dataset, it is the model's origin. By default it is zero, or near the first camera if cameras
    /// are too distant for 32-bit positions.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub local_origin: Option<[f64; 3]>,
}

/// Usual range of depth sensors, metres. Comparing it with the depth range of the options gives the
/// world unit.
const SENSOR_RANGE: [f64; 2] = [0.3, FARTHEST_SENSED];
/// Largest depth that sensors usually measure, metres.
pub(super) const FARTHEST_SENSED: f64 = 5.0;
/// Depth quantisation step of most sensors, metres.
pub(super) const MILLIMETRE: f64 = 0.001;
/// Penalty factor of the least likely world unit: an arbitrary unit with depth codes in steps of a
/// millimetre.
const UNLIKELY: f64 = 3.0;

fn is_false(value: &bool) -> bool {
    !value
}

/// Returns the ratio of a depth range to the usual range of sensors: of the geometric means, or of one
/// limit if the other is open. `None` if both limits are open.
fn relative_to_sensor_range([near, far]: [f64; 2]) -> Option<f64> {
    let [least, most] = SENSOR_RANGE;
    match (near > 0.0, far.is_finite()) {
        (true, true) => Some((near * far / (least * most)).sqrt()),
        (false, true) => Some(far / most),
        (true, false) => Some(near / least),
        (false, false) => None,
    }
}

impl LoadOptions {
    /// Estimates the number of world units per metre from depth scale and depth range; 1 unless both are
    /// set. `unit` is the layout's code step in metres. A depth scale alone does not suffice: it may
    /// only correct the code step in a metric world. The depth range decides, because it must match the
    /// range of sensors. Candidates for the world unit are the metre, the centimetre and the millimetre.
    /// Another candidate is the unit in which the depth scale equals the layout's code step. The least
    /// likely candidate is an arbitrary unit with codes in steps of a millimetre.
    pub(super) fn units_per_metre(&self, unit: f64) -> f64 {
        let (Some(scale), Some(range)) = (self.depth_scale, self.depth_range) else { return 1.0 };
        let Some(ratio) = relative_to_sensor_range(range) else { return 1.0 };
        // Ratios, so that too large and too small count alike.
        let off = |(metre, unlikely): &(f64, f64)| unlikely * (ratio / metre).max(metre / ratio);
        // Metres come first: `min_by` returns the first of equals.
        let units = [1.0, scale / unit, 100.0, 1000.0].map(|metre| (metre, 1.0));
        let units = units.into_iter().chain([(scale / MILLIMETRE, UNLIKELY)]);
        units.min_by(|a, b| off(a).total_cmp(&off(b))).map_or(1.0, |(metre, _)| metre)
    }

    /// Reads a frame's pose, unless poses are left to tracking: then nothing is read.
    pub(super) fn pose(
        &self,
        read: impl FnOnce() -> Result<Pose, FrameProblem>,
    ) -> Result<Pose, FrameProblem> {
        if self.track { Ok(Pose::IDENTITY) } else { read() }
    }

    /// Returns options for opening another dataset in the same coordinates. The local origin is set even
    /// if it is zero.
    pub fn with_fixed_origin(&self) -> Self {
        Self { local_origin: Some(self.local_origin.unwrap_or_default()), ..*self }
    }

    pub(super) fn check(&self) -> Result<(), DatasetError> {
        let wrong =
            |setting, expected, found| Err(DatasetError::Option { setting, expected, found });
        // Conditions are negated, so that NaN is refused too; an infinite far end is allowed.
        if let Some(scale) = self.depth_scale.filter(|s| !(*s > 0.0 && *s <= MAX_LENGTH)) {
            let expected = "a positive number of world units per code, at most 1e9";
            return wrong("depth scale", expected, format!("{scale:?}"));
        }
        if let Some([near, far]) =
            self.depth_range.filter(|[a, b]| !(*a >= 0.0 && a < b && *a <= MAX_LENGTH))
        {
            let expected = "0 ≤ near < far in world units, near at most 1e9";
            return wrong("depth range", expected, format!("{near:?} to {far:?}"));
        }
        let is_camera = |[fx, fy, cx, cy]: &[f64; 4]| {
            let is_length = |f: &f64| *f > 0.0 && *f <= MAX_LENGTH;
            is_length(fx) && is_length(fy) && *cx >= 0.0 && *cy >= 0.0
        };
        if let Some(given) = self.intrinsics.filter(|given| !is_camera(given)) {
            let expected = "positive focal lengths of at most 1e9 and a principal point inside the image, pixels";
            return wrong("intrinsics", expected, format!("{given:?}"));
        }
        if let Some(confidence) = self.confidence.filter(|least| *least > 2) {
            return wrong("confidence", "0, 1 or 2", confidence.to_string());
        }
        if let Some(origin) = self.local_origin.filter(|at| !at.iter().all(|x| x.is_finite())) {
            return wrong("local origin", "three finite numbers", format!("{origin:?}"));
        }
        Ok(())
    }
}

/// Largest length that an option may state, world units or pixels. Products of larger ones would not be finite.
const MAX_LENGTH: f64 = 1e9;

#[derive(Clone, Debug)]
pub(super) enum ByteSource {
    File(PathBuf),
    /// Member (file) of an archive; `shown` is its path in messages.
    Member {
        archive: Arc<Archive>,
        name: String,
        shown: PathBuf,
    },
    VideoFrame {
        video: Arc<Video>,
        index: usize,
    },
    /// Image in a message of a ROS bag.
    Message(Arc<Message>),
    /// Grey placeholder for a photograph that was not recorded; the path is that of the depth file.
    Grey(PathBuf),
}

impl ByteSource {
    pub fn member(archive: &Arc<Archive>, name: &str) -> Self {
        let shown = archive.path.join(name);
        Self::Member { archive: Arc::clone(archive), name: name.to_owned(), shown }
    }

    pub fn path(&self) -> &Path {
        match self {
            Self::File(path) | Self::Grey(path) => path,
            Self::Member { shown, .. } => shown,
            Self::VideoFrame { video, .. } => &video.path,
            Self::Message(message) => &message.shown,
        }
    }

    pub fn disk_path(&self) -> &Path {
        match self {
            Self::Member { archive, .. } => &archive.path,
            Self::Message(message) => &message.bag,
            Self::File(_) | Self::Grey(_) | Self::VideoFrame { .. } => self.path(),
        }
    }

    pub fn read(&self) -> Result<Vec<u8>, FrameProblem> {
        match self {
            Self::File(path) | Self::Grey(path) => Ok(read_bytes(path, MAX_IMAGE_BYTES)?),
            Self::Member { archive, name, .. } => archive.read(name),
            Self::Message(message) => message.read(),
            Self::VideoFrame { video, index } => {
                Ok(read_bytes(&video.frame(*index)?, MAX_IMAGE_BYTES)?)
            }
        }
    }
}

impl From<PathBuf> for ByteSource {
    fn from(path: PathBuf) -> Self {
        Self::File(path)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scale_and_range_tell_the_unit_of_the_world() {
        let metre = |scale, range| {
            let options =
                LoadOptions { depth_scale: scale, depth_range: range, ..LoadOptions::default() };
            options.units_per_metre(0.001)
        };
        assert_eq!(metre(None, Some([300.0, 4000.0])), 1.0, "the layout is in metres");
        assert_eq!(metre(Some(1.0), None), 1.0);
        assert_eq!(metre(Some(1.0), Some([300.0, 4000.0])), 1000.0);
        assert_eq!(metre(Some(0.1), Some([30.0, 400.0])), 100.0);
        assert_eq!(metre(Some(10.0), Some([3e3, 4e4])), 1e4);
        assert_eq!(metre(Some(1e-7), Some([3e-5, 4e-4])), 1e-7 / 0.001);
        // Codes of another step in a world of metres.
        assert_eq!(metre(Some(0.0002), Some([0.3, 4.0])), 1.0);
        assert_eq!(metre(Some(0.001 / 5.0), Some([0.1, 100.0])), 1.0);
        assert_eq!(metre(Some(1e-6), Some([0.5, f64::INFINITY])), 1.0);
        assert_eq!(metre(Some(1.0), Some([0.0, 5000.0])), 1000.0);
        assert_eq!(metre(Some(1.0), Some([0.0, f64::INFINITY])), 1.0);
        // Steps of another layout's files, in millimetres.
        let tum = LoadOptions {
            depth_scale: Some(1.0),
            depth_range: Some([300.0, 4000.0]),
            ..LoadOptions::default()
        };
        assert_eq!(tum.units_per_metre(1.0 / 5000.0), 1000.0);
        let of_tum = |scale, range| {
            let options = LoadOptions { depth_scale: Some(scale), depth_range: Some(range), ..tum };
            options.units_per_metre(1.0 / 5000.0)
        };
        assert_eq!(of_tum(0.01, [3.0, 40.0]), 10.0, "millimetres in a world of decimetres");
        assert_eq!(of_tum(0.002, [3.0, 40.0]), 10.0, "its own steps there");
        assert_eq!(of_tum(0.2, [100.0, 2000.0]), 1000.0, "its own steps of millimetres");
    }
}
