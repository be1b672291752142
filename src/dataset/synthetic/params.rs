//! Parameters of a procedural recording.

use strum::{EnumMessage, EnumString, VariantNames};

const SIDE_LIMITS: [u32; 2] = [8, 8192];
const MAX_FRAMES: usize = 100_000;

/// Recording device.
#[derive(Clone, Copy, Debug, PartialEq, Eq, EnumMessage, EnumString, VariantNames)]
#[strum(serialize_all = "kebab-case")]
pub enum SyntheticCamera {
    /// Ideal camera on a path around the furnished room.
    Room,
    /// Phone held upright: photographs larger than its lidar depth, exposure steps, motion blur and poses
    /// with drift.
    Phone(PhoneScene),
}

/// Scene that the phone records.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, EnumMessage, EnumString, VariantNames)]
#[strum(serialize_all = "kebab-case")]
pub enum PhoneScene {
    #[default]
    /// The whole room, with fine print, wood grain, tiles and thin cables.
    Room,
    /// A flat door at close range, with its frame, handle, hinges and the wall beside it.
    Door,
}

/// Parameters of a procedural recording.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SyntheticParams {
    /// Image width in pixels, 8 to 8192.
    pub width: u32,
    /// Image height in pixels, 8 to 8192.
    pub height: u32,
    /// Number of frames in the split `train`, 1 to 100 000.
    pub n_train: usize,
    /// Number of frames in the split `eval`, at viewpoints between those of `train`; 0 for none.
    pub n_eval: usize,
    /// Number of frames in the split `free`, at viewpoints off the camera trajectory; 0 for none.
    pub n_free: usize,
    /// Seed of textures, colours and the start of the trajectory.
    pub seed: u64,
    /// Standard deviation of the depth noise, in units of the sensor's noise half-width `max(0.003,
    /// 0.003 z²)` m. 0 yields exact depth. Only the split `train` has noise.
    pub depth_noise: f64,
    /// Recording device and, for the phone, the scene.
    pub camera: SyntheticCamera,
}

impl SyntheticParams {
    /// Returns the parameters of the demo shown at startup.
    pub const fn demo() -> Self {
        Self {
            width: 320,
            height: 240,
            n_train: 96,
            n_eval: 12,
            n_free: 0,
            seed: 0,
            depth_noise: 0.0,
            camera: SyntheticCamera::Room,
        }
    }

    pub(super) fn check(&self) -> Result<(), ParamsError> {
        let wrong =
            |setting, expected, found: String| Err(ParamsError { setting, expected, found });
        let [low, high] = SIDE_LIMITS;
        for (setting, side) in [("width", self.width), ("height", self.height)] {
            if side < low || side > high {
                return wrong(setting, "8 to 8192 pixels", side.to_string());
            }
        }
        // A dataset without training frames has no first frame to take the camera from.
        if self.n_train == 0 || self.n_train > MAX_FRAMES {
            return wrong("training frames", "1 to 100000", self.n_train.to_string());
        }
        if self.n_eval > MAX_FRAMES {
            return wrong("evaluation frames", "0 to 100000", self.n_eval.to_string());
        }
        if self.n_free > MAX_FRAMES {
            return wrong("free frames", "0 to 100000", self.n_free.to_string());
        }
        if self.camera != SyntheticCamera::Room && self.depth_noise != 0.0 {
            let expected = "0 with the phone, whose lidar model adds its own noise";
            return wrong("depth noise", expected, self.depth_noise.to_string());
        }
        // Refuses NaN as well.
        if !(0.0..=100.0).contains(&self.depth_noise) {
            return wrong("depth noise", "0 to 100 half-widths", self.depth_noise.to_string());
        }
        Ok(())
    }
}

/// Error: a parameter outside its range.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("setting {setting}: expected {expected}, found {found}; choose a value in this range")]
pub struct ParamsError {
    /// Name of the parameter.
    pub setting: &'static str,
    /// Permitted range, with the unit.
    pub expected: &'static str,
    /// Rejected value.
    pub found: String,
}
