//! The furnished and lit room, and its rendering to frames.

use super::params::{ParamsError, SyntheticCamera, SyntheticParams};
use super::phone::contents;
use super::room::{FurnishedRoom, Lamp};
use super::solid::{Ray, Shape};
use super::view;
use super::view::SyntheticView;
use crate::dataset::depth::{Depth, DepthCodes, DepthKind, HOLE16, sensor_noise};
use crate::dataset::frame::Frame;
use crate::math::camera::{Camera, Intrinsics};
use crate::math::image::Image;
use crate::math::rng::{Purpose, Rng};
use glam::{DVec2, DVec3, Vec3, vec3};

/// Step of the 16-bit depth codes of demo frames: 0.25 mm, which yields a range of 16 m.
pub const DEPTH_UNIT: f64 = 0.000_25;

/// Horizontal field of view of the synthetic camera, radians (68°).
pub const FIELD_OF_VIEW: f64 = 1.187;
/// Horizontal field of view of the phone held upright, radians (50°).
const PHONE_FIELD_OF_VIEW: f64 = 0.873;

/// Room with furniture and baked light.
#[derive(Debug)]
pub struct SyntheticScene {
    room: FurnishedRoom,
    light: LightMaps,
    params: SyntheticParams,
}

impl SyntheticScene {
    /// Creates the furniture and computes the light.
    ///
    /// # Errors
    /// Fails for parameters outside their range.
    pub fn new(params: &SyntheticParams) -> Result<Self, ParamsError> {
        params.check()?;
        let room = match params.camera {
            SyntheticCamera::Room => FurnishedRoom::new(params.seed),
            SyntheticCamera::Phone(scene) => contents::furnish(scene, params.seed),
        };
        let light = LightMaps::bake(&room);
        Ok(Self { room, light, params: *params })
    }

    /// Returns the intrinsics of every frame.
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

    pub(super) fn radiance(&self, camera: &Camera) -> Image<Vec3> {
        view::radiance(&self.room, &self.light, camera)
    }

    pub(in crate::dataset) fn depth_noise(&self) -> f64 {
        self.params.depth_noise
    }

    /// Renders colour and exact depth for any pinhole camera.
    pub fn render_view(&self, camera: &Camera) -> SyntheticView {
        view::render(&self.room, &self.light, camera)
    }

    /// Renders a view as a frame. `noise_stream` selects the random depth noise; with `None`, depth is
    /// exact.
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

/// Converts lengths to 16-bit codes, rounded to the nearest. Lengths outside the range of the codes
/// become holes (0).
pub(super) fn quantise(lengths: &Image<f64>, unit: f64) -> Image<u16> {
    lengths.map(|length| {
        let code = (length / unit).round();
        if code >= 1.0 && code < f64::from(HOLE16) { code as u16 } else { 0 }
    })
}

/// Size of a light map's texel, metres.
const TEXEL: f64 = 0.1;
/// Minimum number of texels per side of a light map, so that small objects are shaded too.
const MIN_TEXELS: usize = 6;
/// Number of shadow rays per lamp and side. They form a square grid on the lamp.
const LAMP_GRID: usize = 4;
/// Number of rays over the hemisphere for ambient light.
const SKY_RAYS: usize = 20;
/// Ambient radiance from walls, for rays that no object blocks, linear RGB. [`FROM_THINGS`] is the
/// radiance for blocked rays.
const FROM_WALLS: Vec3 = vec3(0.46, 0.42, 0.36);
const FROM_THINGS: Vec3 = vec3(0.11, 0.09, 0.07);
/// Maximum length of ambient rays, metres.
const REACH: f64 = 3.0;

/// Baked irradiance of all surfaces, divided by π.
#[derive(Debug)]
pub(super) struct LightMaps {
    /// Light maps by solid, then by face; none for emissive surfaces.
    maps: Vec<Vec<LightMap>>,
}

#[derive(Debug)]
struct LightMap {
    columns: usize,
    rows: usize,
    texels: Vec<Vec3>,
}

impl LightMaps {
    pub fn bake(room: &FurnishedRoom) -> Self {
        let map = |shape: &Shape, face| LightMap::bake(room, shape, face);
        let maps = room.solids.iter().map(|solid| match solid.texture.is_emissive() {
            // Emitted light does not depend on the light received.
            true => Vec::new(),
            false => (0..solid.shape.n_faces()).map(|face| map(&solid.shape, face)).collect(),
        });
        Self { maps: maps.collect() }
    }

    /// Returns the irradiance, divided by π, at a surface point; zero on emissive surfaces.
    #[inline]
    pub fn at(&self, solid: usize, face: usize, uv: DVec2) -> Vec3 {
        self.maps[solid].get(face).map_or(Vec3::ZERO, |map| map.at(uv))
    }
}

impl LightMap {
    fn bake(room: &FurnishedRoom, shape: &Shape, face: usize) -> Self {
        let size = shape.face_size(face);
        let count = |metres: f64| ((metres / TEXEL).ceil() as usize).max(MIN_TEXELS);
        let (columns, rows) = (count(size.x), count(size.y));
        let mut texels = Vec::with_capacity(columns * rows);
        for row in 0..rows {
            for column in 0..columns {
                let centre = DVec2::new(column as f64 + 0.5, row as f64 + 0.5);
                let uv = centre / DVec2::new(columns as f64, rows as f64);
                let point = shape.point(uv, face);
                texels.push(gather(room, point, shape.normal(point, face)));
            }
        }
        Self { columns, rows, texels }
    }

    #[inline]
    fn at(&self, uv: DVec2) -> Vec3 {
        let place = |v: f64, n: usize| {
            // The outer half texel has only one neighbour.
            let x = (v * n as f64 - 0.5).clamp(0.0, (n - 1) as f64);
            // The last texel is a right neighbour only.
            let i = (x as usize).min(n - 2);
            (i, (x - i as f64) as f32)
        };
        let ((i, s), (j, t)) = (place(uv.x, self.columns), place(uv.y, self.rows));
        let row = |j: usize| {
            let base = j * self.columns + i;
            self.texels[base].lerp(self.texels[base + 1], s)
        };
        row(j).lerp(row(j + 1), t)
    }
}

fn gather(room: &FurnishedRoom, point: DVec3, normal: DVec3) -> Vec3 {
    // Offset from the surface, which would otherwise shadow itself.
    let start = point + normal * 1e-4;
    let direct = room.lamps.iter().map(|lamp| lamp_irradiance(room, start, normal, lamp));
    direct.sum::<Vec3>() + ambient(room, start, normal)
}

fn lamp_irradiance(room: &FurnishedRoom, start: DVec3, normal: DVec3, lamp: &Lamp) -> Vec3 {
    let area = lamp.edges[0].length() * lamp.edges[1].length();
    // Divided by π, as the maps store it.
    let per_sample = area / (std::f64::consts::PI * (LAMP_GRID * LAMP_GRID) as f64);
    let mut sum = 0.0;
    for i in 0..LAMP_GRID * LAMP_GRID {
        let part = |k: usize| (k as f64 + 0.5) / LAMP_GRID as f64;
        let on_lamp =
            lamp.corner + lamp.edges[0] * part(i % LAMP_GRID) + lamp.edges[1] * part(i / LAMP_GRID);
        let way = on_lamp - start;
        let square = way.length_squared();
        let cosines = normal.dot(way).max(0.0) * (-lamp.normal.dot(way)).max(0.0) / square;
        if cosines > 0.0 && !room.is_blocked(&Ray::new(start, way)) {
            // Bounds the 1/r² term next to a lamp.
            sum += cosines / square.max(0.05) * per_sample;
        }
    }
    lamp.radiance * sum as f32
}

/// Returns the ambient light at a point, from cosine-weighted directions on a golden-angle spiral. The
/// directions relative to the normal are the same at every point, so flat surfaces are shaded without
/// noise.
fn ambient(room: &FurnishedRoom, start: DVec3, normal: DVec3) -> Vec3 {
    const GOLDEN_ANGLE: f64 = 2.399_963_229_728_653;
    let (tangent, bitangent) = normal.any_orthonormal_pair();
    let mut n_open = 0;
    for i in 0..SKY_RAYS {
        // Uniform on the disc, which projects to a cosine weight.
        let radius = ((i as f64 + 0.5) / SKY_RAYS as f64).sqrt();
        let disc = DVec2::from_angle(i as f64 * GOLDEN_ANGLE) * radius;
        let up = (1.0 - radius * radius).sqrt();
        let direction = tangent * disc.x + bitangent * disc.y + normal * up;
        n_open += usize::from(!room.is_blocked(&Ray::new(start, direction * REACH)));
    }
    FROM_THINGS.lerp(FROM_WALLS, n_open as f32 / SKY_RAYS as f32)
}
