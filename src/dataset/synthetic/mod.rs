//! A procedural room that stands in for a recording: posed colour and exact depth at any size, on
//! demand, deterministic by seed. It is the demo a stranger sees first and the ground truth that
//! loaders, trainer and renderers are tested against.
//!
//! World: z up, metres, floor at 0, the room's centre above the origin.

mod light;
mod room;
mod solid;
mod texture;
mod trajectory;
mod view;
pub mod write;
mod write_blender;
mod write_seven_scenes;

use super::frame::{Depth, DepthCodes, DepthKind, Frame, HOLE16, sensor_noise};
use super::range::PositionRange;
use super::{Dataset, FrameEntry, FrameSource, Layout, LoadOptions, Split};
use crate::math::camera::{Camera, Intrinsics};
use crate::math::image::Image;
use crate::math::pose::Pose;
use crate::math::rng::{Purpose, Rng};
use light::LightMaps;
use room::Room;
use std::sync::Arc;
pub use view::View;

/// Metres per step of the 16-bit depth that demo frames carry: a quarter of a millimetre, 16 m in
/// all.
pub const DEPTH_UNIT: f64 = 0.000_25;

/// Horizontal field of view of the synthetic camera, radians (68°).
pub const FIELD_OF_VIEW: f64 = 1.187;

/// Smallest and largest image side.
const SIDE_LIMITS: [u32; 2] = [8, 8192];
/// Largest number of frames in a split.
const MAX_FRAMES: usize = 100_000;

/// What to generate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SyntheticParams {
    /// Columns, 8 to 8192.
    pub width: u32,
    /// Rows, 8 to 8192.
    pub height: u32,
    /// Frames of the split `train`, 1 to 100 000.
    pub n_train: usize,
    /// Frames of the split `eval`, from viewpoints between those of `train`; may be 0.
    pub n_eval: usize,
    /// Textures, colours and the phase of the trajectory.
    pub seed: u64,
    /// Standard deviation of depth noise in units of the sensor's noise half-width
    /// `max(0.003, 0.003 z²)` m; 0 is exact depth. Only `train` is noisy.
    pub depth_noise: f64,
}

impl SyntheticParams {
    /// The demo that the window starts with.
    pub fn demo() -> Self {
        Self { width: 320, height: 240, n_train: 96, n_eval: 12, seed: 0, depth_noise: 0.0 }
    }

    fn check(&self) -> Result<(), ParamsError> {
        let wrong =
            |setting, expected, found: String| Err(ParamsError { setting, expected, found });
        let [low, high] = SIDE_LIMITS;
        for (setting, side) in [("width", self.width), ("height", self.height)] {
            if side < low || side > high {
                return wrong(setting, "8 to 8192 pixels", side.to_string());
            }
        }
        if self.n_train == 0 || self.n_train > MAX_FRAMES {
            return wrong("training frames", "1 to 100000", self.n_train.to_string());
        }
        if self.n_eval > MAX_FRAMES {
            return wrong("evaluation frames", "0 to 100000", self.n_eval.to_string());
        }
        if !(0.0..=100.0).contains(&self.depth_noise) {
            return wrong("depth noise", "0 to 100 sensor noises", self.depth_noise.to_string());
        }
        Ok(())
    }
}

/// A parameter outside its range.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("setting {setting}: expected {expected}, found {found}; choose a value in this range")]
pub struct ParamsError {
    /// Its name.
    pub setting: &'static str,
    /// Its legal values.
    pub expected: &'static str,
    /// Its value.
    pub found: String,
}

/// The furnished and lit room.
#[derive(Debug)]
pub struct SyntheticScene {
    room: Room,
    light: LightMaps,
    params: SyntheticParams,
}

/// The demo: [`SyntheticParams::demo`] as a dataset.
pub fn demo() -> Result<Dataset, ParamsError> {
    dataset(&SyntheticParams::demo())
}

/// A dataset whose frames are rendered when they are loaded.
///
/// ```
/// use vbgs_studio::dataset::synthetic::{self, SyntheticParams};
///
/// let small = SyntheticParams { width: 32, height: 24, n_train: 6, n_eval: 1, ..SyntheticParams::demo() };
/// let room = synthetic::dataset(&small)?;
/// let frame = room.load(room.training_split()?, 0)?;
/// assert_eq!((frame.color.width, frame.color.height), (32, 24));
/// assert!(frame.depth_z().is_some_and(|z| z.data.iter().all(|&z| z > 0.0)));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn dataset(params: &SyntheticParams) -> Result<Dataset, ParamsError> {
    let Plan { scene, splits } = Plan::new(params)?;
    let intrinsics = scene.intrinsics();
    let split = |planned: PlannedSplit| {
        let entry = |(i, pose): (usize, Pose)| FrameEntry {
            name: format!("{}/{i:04}", planned.name),
            camera: Camera { intrinsics, pose },
            source: FrameSource::Synthetic {
                scene: Arc::clone(&scene),
                noise_stream: planned.noise_stream(i),
            },
        };
        let frames = planned.poses.iter().copied().enumerate().map(entry).collect();
        Split { name: planned.name.to_owned(), frames, has_depth: true }
    };
    Ok(Dataset {
        name: "synthetic room".to_owned(),
        path: None,
        layout: Layout::Synthetic,
        recognised_by: "generated, no files".to_owned(),
        splits: splits.into_iter().map(split).collect(),
        warnings: Vec::new(),
        notes: Vec::new(),
        known_range: position_range(),
        options: LoadOptions::default(),
    })
}

/// The scene and the viewpoints of each split.
struct Plan {
    scene: Arc<SyntheticScene>,
    splits: Vec<PlannedSplit>,
}

struct PlannedSplit {
    name: &'static str,
    poses: Vec<Pose>,
    is_noisy: bool,
}

impl PlannedSplit {
    /// Name of a frame's depth noise, `None` for exact depth.
    fn noise_stream(&self, frame: usize) -> Option<u64> {
        self.is_noisy.then_some(frame as u64)
    }
}

impl Plan {
    fn new(params: &SyntheticParams) -> Result<Self, ParamsError> {
        let scene = Arc::new(SyntheticScene::new(params)?);
        let train = trajectory::train(params.n_train, params.seed);
        let mut splits =
            vec![PlannedSplit { name: "train", poses: train, is_noisy: params.depth_noise > 0.0 }];
        if params.n_eval > 0 {
            let poses = trajectory::eval(params.n_eval, params.seed);
            splits.push(PlannedSplit { name: "eval", poses, is_noisy: false });
        }
        Ok(Self { scene, splits })
    }

    fn view(&self, split: &PlannedSplit, frame: usize) -> View {
        let camera = Camera { intrinsics: self.scene.intrinsics(), pose: split.poses[frame] };
        self.scene.sensed(&camera, split.noise_stream(frame))
    }
}

/// The room's walls, floor and ceiling: no point lies outside.
pub fn position_range() -> Option<PositionRange> {
    PositionRange::new(room::LO, room::HI, "the bounds of the synthetic room")
}

impl SyntheticScene {
    /// Furnishes and lights the room.
    pub fn new(params: &SyntheticParams) -> Result<Self, ParamsError> {
        params.check()?;
        let room = Room::new(params.seed);
        let light = LightMaps::bake(&room);
        Ok(Self { room, light, params: *params })
    }

    /// Intrinsics of every frame.
    pub fn intrinsics(&self) -> Intrinsics {
        Intrinsics::from_horizontal_fov(self.params.width, self.params.height, FIELD_OF_VIEW)
    }

    /// Noise of its training depth; see [`SyntheticParams::depth_noise`].
    pub(super) fn depth_noise(&self) -> f64 {
        self.params.depth_noise
    }

    /// Colour and exact depth of one view; `camera` may be any pinhole.
    pub fn view(&self, camera: &Camera) -> View {
        view::render(&self.room, &self.light, camera)
    }

    /// A view as a frame; `noise_stream` names the frame's depth noise, `None` leaves depth exact.
    pub(super) fn frame(&self, name: &str, camera: Camera, noise_stream: Option<u64>) -> Frame {
        let View { color, depth_z } = self.sensed(&camera, noise_stream);
        let codes = quantise(&depth_z, DEPTH_UNIT);
        let depth = Depth {
            codes: DepthCodes::Linear16 { codes, unit: DEPTH_UNIT },
            kind: DepthKind::Z,
            trusted: [0.0, f64::INFINITY],
        };
        Frame { name: name.to_owned(), camera, color, depth: Some(depth) }
    }

    fn sensed(&self, camera: &Camera, noise_stream: Option<u64>) -> View {
        let mut view = self.view(camera);
        if let Some(index) = noise_stream {
            let mut rng = Rng::new(self.params.seed, Purpose::Synthetic, index);
            for z in &mut view.depth_z.data {
                let deviation = self.params.depth_noise * f64::from(sensor_noise(*z as f32));
                *z += deviation * rng.normal();
            }
        }
        view
    }
}

/// 16-bit codes of lengths, rounded to nearest; what does not fit is a hole.
fn quantise(lengths: &Image<f64>, unit: f64) -> Image<u16> {
    lengths.map(|length| {
        let code = (length / unit).round();
        if code >= 1.0 && code < f64::from(HOLE16) { code as u16 } else { 0 }
    })
}
