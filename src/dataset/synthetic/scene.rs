//! The furnished and lit room, and what cameras in it see.

use super::light::LightMaps;
use super::params::{ParamsError, SyntheticCamera, SyntheticParams};
use super::phone::contents;
use super::room::FurnishedRoom;
use super::view::{self, SyntheticView};
use crate::dataset::depth::{Depth, DepthCodes, DepthKind, HOLE16, sensor_noise};
use crate::dataset::frame::Frame;
use crate::math::camera::{Camera, Intrinsics};
use crate::math::image::Image;
use crate::math::rng::{Purpose, Rng};
use glam::{DVec3, Vec3};

/// Metres per step of the 16-bit depth that demo frames carry: a quarter of a millimetre, 16 m in
/// all.
pub const DEPTH_UNIT: f64 = 0.000_25;

/// Horizontal field of view of the synthetic camera, radians (68°).
pub const FIELD_OF_VIEW: f64 = 1.187;
/// That of the phone held upright, radians (50°).
const PHONE_FIELD_OF_VIEW: f64 = 0.873;

/// The furnished and lit room.
#[derive(Debug)]
pub struct SyntheticScene {
    room: FurnishedRoom,
    light: LightMaps,
    params: SyntheticParams,
}

impl SyntheticScene {
    /// Furnishes and lights the room.
    pub fn new(params: &SyntheticParams) -> Result<Self, ParamsError> {
        params.check()?;
        let room = match params.camera {
            SyntheticCamera::Room => FurnishedRoom::new(params.seed),
            SyntheticCamera::Phone(scene) => contents::furnish(scene, params.seed),
        };
        let light = LightMaps::bake(&room);
        Ok(Self { room, light, params: *params })
    }

    /// Intrinsics of every frame.
    pub fn intrinsics(&self) -> Intrinsics {
        Intrinsics::from_horizontal_fov(self.params.width, self.params.height, self.field_of_view())
    }

    pub(super) fn field_of_view(&self) -> f64 {
        match self.params.camera {
            SyntheticCamera::Room => FIELD_OF_VIEW,
            SyntheticCamera::Phone(_) => PHONE_FIELD_OF_VIEW,
        }
    }

    pub(super) fn room(&self) -> &FurnishedRoom {
        &self.room
    }

    /// Low and high corner of the world, metres.
    pub(super) fn bounds(&self) -> (DVec3, DVec3) {
        self.room.bounds()
    }

    /// Linear light of one view.
    pub(super) fn radiance(&self, camera: &Camera) -> Image<Vec3> {
        view::radiance(&self.room, &self.light, camera)
    }

    /// Noise of its training depth; see [`SyntheticParams::depth_noise`].
    pub(in crate::dataset) fn depth_noise(&self) -> f64 {
        self.params.depth_noise
    }

    /// Colour and exact depth of one view; `camera` may be any pinhole.
    pub fn view(&self, camera: &Camera) -> SyntheticView {
        view::render(&self.room, &self.light, camera)
    }

    /// A view as a frame; `noise_stream` names the frame's depth noise, `None` leaves depth exact.
    pub(in crate::dataset) fn frame(
        &self,
        name: &str,
        camera: Camera,
        noise_stream: Option<u64>,
    ) -> Frame {
        let SyntheticView { color, depth_z } = self.sensed(&camera, noise_stream);
        let (color, codes) = (color.into(), quantise(&depth_z, DEPTH_UNIT));
        let depth = Depth {
            codes: DepthCodes::Linear16 { codes, unit: DEPTH_UNIT },
            kind: DepthKind::Z,
            trusted: [0.0, f64::INFINITY],
            metre: 1.0,
        };
        Frame { name: name.to_owned(), camera, color_camera: None, color, depth: Some(depth) }
    }

    /// A view as a depth camera measures it: its depth is off by normal noise.
    pub(super) fn sensed(&self, camera: &Camera, noise_stream: Option<u64>) -> SyntheticView {
        let mut view = self.view(camera);
        if let Some(index) = noise_stream {
            // A stream for every frame: loading out of order, or twice, gives equal noise.
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
pub(super) fn quantise(lengths: &Image<f64>, unit: f64) -> Image<u16> {
    lengths.map(|length| {
        let code = (length / unit).round();
        if code >= 1.0 && code < f64::from(HOLE16) { code as u16 } else { 0 }
    })
}
