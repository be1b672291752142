//! The furnished and lit room, and its rendering to frames.

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

/// Unit of the 16-bit depth codes of demo frames: 0.25 mm per step, up to 16 m.
pub const DEPTH_UNIT: f64 = 0.000_25;

/// Horizontal field of view of the synthetic camera, radians (68°).
pub const FIELD_OF_VIEW: f64 = 1.187;
/// Horizontal field of view of the phone held upright, radians (50°).
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
    ///
    /// # Errors
    /// Parameters outside their range.
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

    /// Renders one view as linear radiance.
    pub(super) fn radiance(&self, camera: &Camera) -> Image<Vec3> {
        view::radiance(&self.room, &self.light, camera)
    }

    /// Noise level of the training depth; see [`SyntheticParams::depth_noise`].
    pub(in crate::dataset) fn depth_noise(&self) -> f64 {
        self.params.depth_noise
    }

    /// Renders colour and exact depth for any pinhole camera.
    pub fn render_view(&self, camera: &Camera) -> SyntheticView {
        view::render(&self.room, &self.light, camera)
    }

    /// Renders a view as a frame; `noise_stream` selects the depth noise, `None` leaves depth exact.
    pub(in crate::dataset) fn frame(
        &self,
        name: &str,
        camera: Camera,
        noise_stream: Option<u64>,
    ) -> Frame {
        let SyntheticView { color, depth_z } = self.render_sensed(&camera, noise_stream);
        let (color, codes) = (color.into(), quantise(&depth_z, DEPTH_UNIT));
        let depth = Depth {
            codes: DepthCodes::Linear16 { codes, unit: DEPTH_UNIT },
            kind: DepthKind::Z,
            trusted: [0.0, f64::INFINITY],
            units_per_metre: 1.0,
        };
        Frame { name: name.to_owned(), camera, color_camera: None, color, depth: Some(depth) }
    }

    /// Renders a view as a depth camera measures it, with normally distributed depth noise.
    pub(super) fn render_sensed(
        &self,
        camera: &Camera,
        noise_stream: Option<u64>,
    ) -> SyntheticView {
        let mut view = self.render_view(camera);
        if let Some(index) = noise_stream {
            // One stream per frame: the noise does not depend on the order or number of loads.
            let mut rng = Rng::new(self.params.seed, Purpose::Synthetic, index);
            for z in &mut view.depth_z.data {
                let deviation = self.params.depth_noise * f64::from(sensor_noise(*z as f32));
                *z += deviation * rng.normal();
            }
        }
        view
    }
}

/// Converts lengths to 16-bit codes, rounded to nearest; lengths out of range become holes (0).
pub(super) fn quantise(lengths: &Image<f64>, unit: f64) -> Image<u16> {
    lengths.map(|length| {
        let code = (length / unit).round();
        if code >= 1.0 && code < f64::from(HOLE16) { code as u16 } else { 0 }
    })
}
