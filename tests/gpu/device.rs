//! Images drawn on a device.

use super::fixture::Fixture;
use super::readback;
use glam::DVec3;
use std::cell::RefCell;
use std::ops::Deref;
use vbgs_studio::math::camera::{Camera, Intrinsics};
use vbgs_studio::math::image::Image;
use vbgs_studio::math::pose::Pose;
use vbgs_studio::math::rng::{Purpose, Rng};
use vbgs_studio::model::splat::appearance::SplatView;
use vbgs_studio::model::splat::splats::Splat;
use vbgs_studio::render::Exposing;
use vbgs_studio::render::gpu::renderer::SplatRenderer;
use vbgs_studio::render::gpu::scene::GpuScene;
use vbgs_studio::render::{RenderMethod, RenderOptions};

/// A device and the renderer's objects on it.
pub struct Gpu {
    fixture: Fixture,
    /// Draws [`Self::image_of`]; shared, because creating its pipelines takes longer than drawing.
    renderer: RefCell<Option<SplatRenderer>>,
}

impl Deref for Gpu {
    type Target = Fixture;

    fn deref(&self) -> &Fixture {
        &self.fixture
    }
}

impl From<Fixture> for Gpu {
    fn from(fixture: Fixture) -> Self {
        Self { fixture, renderer: RefCell::default() }
    }
}

impl Gpu {
    /// Uses the shared device; `None` if Vulkan is missing and not required.
    #[track_caller]
    pub fn new() -> Option<Self> {
        Fixture::shared().map(Self::from)
    }

    /// Creates a separate device, which the test will lose.
    #[track_caller]
    pub fn to_be_lost() -> Option<Self> {
        Fixture::own(|_| ()).map(Self::from)
    }

    /// Creates a separate device with smaller buffers than the adapter allows.
    #[track_caller]
    pub fn with_buffers_up_to(bytes: u64) -> Option<Self> {
        let limit = |limits: &mut wgpu::Limits| {
            limits.max_storage_buffer_binding_size =
                limits.max_storage_buffer_binding_size.min(bytes);
        };
        Fixture::own(limit).map(Self::from)
    }

    pub fn scene<'a>(&self, splats: impl Into<SplatView<'a>>) -> GpuScene {
        GpuScene::new(&self.device, &self.queue, splats).unwrap()
    }

    pub fn renderer(&self) -> SplatRenderer {
        SplatRenderer::new(&self.device, &self.queue).unwrap()
    }

    /// Draws once.
    pub fn draw(
        &self,
        renderer: &mut SplatRenderer,
        scene: &GpuScene,
        camera: &Camera,
        options: &RenderOptions,
    ) {
        let mut encoder = self.device.create_command_encoder(&Default::default());
        renderer.render(&self.device, &self.queue, &mut encoder, scene, camera, options).unwrap();
        self.queue.submit([encoder.finish()]);
    }

    /// Premultiplied colour and coverage of the last image.
    pub fn read(&self, renderer: &SplatRenderer) -> Image<[f32; 4]> {
        readback::premultiplied(&self.device, &self.queue, renderer.target())
    }

    /// Draws one image and waits for it.
    pub fn drawn(
        &self,
        renderer: &mut SplatRenderer,
        scene: &GpuScene,
        camera: &Camera,
        options: &RenderOptions,
    ) -> Image<[f32; 4]> {
        self.draw(renderer, scene, camera, options);
        self.read(renderer)
    }

    pub fn image_of(
        &self,
        scene: &GpuScene,
        camera: &Camera,
        options: &RenderOptions,
    ) -> Image<[f32; 4]> {
        let mut renderer = self.renderer.borrow_mut();
        self.drawn(renderer.get_or_insert_with(|| self.renderer()), scene, camera, options)
    }

    pub fn image<'a>(
        &self,
        splats: impl Into<SplatView<'a>>,
        camera: &Camera,
        options: &RenderOptions,
    ) -> Image<[f32; 4]> {
        self.image_of(&self.scene(splats), camera, options)
    }
}

/// The projected renderer over black.
pub const PLAIN: RenderOptions = RenderOptions {
    background: [0.0; 3],
    near: 0.2,
    method: RenderMethod::PROJECTED,
    style: vbgs_studio::render::DisplayStyle::PLAIN,
    exposure_mode: Exposing::Neutral,
};

/// Random splats in a cube of side 3 around the origin, axis ratios up to 100.
pub fn random_scene(seed: u64, n: usize, largest: f64) -> Vec<Splat> {
    let mut rng = Rng::new(seed, Purpose::Synthetic, 0);
    (0..n)
        .map(|_| {
            let mut at = |lo: f64, hi: f64| rng.range(lo, hi) as f32;
            Splat {
                mean: [at(-1.5, 1.5), at(-1.5, 1.5), at(-1.5, 1.5)],
                opacity: at(0.0, 1.0),
                color: [at(0.0, 1.0), at(0.0, 1.0), at(0.0, 1.0)],
                scale: std::array::from_fn(|_| {
                    (largest * 10f64.powf(f64::from(at(-2.0, 0.0)))) as f32
                }),
                rotation: {
                    let q = [at(-1.0, 1.0), at(-1.0, 1.0), at(-1.0, 1.0), at(-1.0, 1.0)];
                    let norm = q.iter().map(|v| v * v).sum::<f32>().sqrt();
                    q.map(|v| v / norm)
                },
            }
        })
        .collect()
}

pub fn camera(width: u32, height: u32, eye: DVec3, fov: f64) -> Camera {
    Camera {
        intrinsics: Intrinsics::from_horizontal_fov(width, height, fov),
        pose: Pose::look_at(eye, DVec3::new(0.1, 0.2, 0.0), DVec3::Z).unwrap(),
    }
}

/// A camera outside the cube of [`random_scene`].
pub fn outside(width: u32, height: u32) -> Camera {
    camera(width, height, DVec3::new(4.0, -3.0, 1.0), 0.8)
}
