//! Images drawn on a device.

use super::fixture::Fixture;
use glam::DVec3;
use std::ops::Deref;
use vbgs_studio::math::camera::{Camera, Intrinsics};
use vbgs_studio::math::image::Image;
use vbgs_studio::math::pose::Pose;
use vbgs_studio::math::rng::{Purpose, Rng};
use vbgs_studio::model::splat::appearance::SplatView;
use vbgs_studio::model::splat::splats::Splat;
use vbgs_studio::render::Exposing;
use vbgs_studio::render::gpu::readback;
use vbgs_studio::render::gpu::renderer::SplatRenderer;
use vbgs_studio::render::gpu::scene::{ComparedImage, GpuScene};
use vbgs_studio::render::gpu::sort::{SortScratch, back_to_front};
use vbgs_studio::render::{RenderMethod, RenderOptions};

/// A device and the renderer's objects on it.
pub struct Gpu(Fixture);

impl Deref for Gpu {
    type Target = Fixture;

    fn deref(&self) -> &Fixture {
        &self.0
    }
}

impl Gpu {
    /// Uses the shared device; `None` if Vulkan is missing and not required.
    #[track_caller]
    pub fn new() -> Option<Self> {
        Fixture::shared().map(Self)
    }

    /// Creates a separate device, which the test will lose.
    #[track_caller]
    pub fn to_be_lost() -> Option<Self> {
        Fixture::own(|_| ()).map(Self)
    }

    pub fn scene<'a>(&self, splats: impl Into<SplatView<'a>>) -> GpuScene {
        GpuScene::new(&self.device, &self.queue, splats).unwrap()
    }

    pub fn renderer(&self) -> SplatRenderer {
        SplatRenderer::new(&self.device, &self.queue, ComparedImage::First).unwrap()
    }

    /// Sorts, uploads the order and draws once.
    pub fn draw(
        &self,
        renderer: &mut SplatRenderer,
        scene: &mut GpuScene,
        splats: &[Splat],
        camera: &Camera,
        options: &RenderOptions,
    ) {
        let mut scratch = SortScratch::default();
        let order = back_to_front(splats, camera, options, &mut scratch);
        scene.set_order(&self.queue, ComparedImage::First, order).unwrap();
        let mut encoder = self.device.create_command_encoder(&Default::default());
        renderer.render(&self.device, &self.queue, &mut encoder, scene, camera, options).unwrap();
        self.queue.submit([encoder.finish()]);
    }

    /// Premultiplied colour and coverage of the last image.
    pub fn read(&self, renderer: &SplatRenderer) -> Image<[f32; 4]> {
        readback::read_premultiplied(&self.device, &self.queue, renderer.target()).unwrap()
    }

    /// Draws `splats` through a scene that already holds them.
    pub fn image_of(
        &self,
        scene: &mut GpuScene,
        splats: &[Splat],
        camera: &Camera,
        options: &RenderOptions,
    ) -> Image<[f32; 4]> {
        let mut renderer = self.renderer();
        self.draw(&mut renderer, scene, splats, camera, options);
        self.read(&renderer)
    }

    pub fn image<'a>(
        &self,
        splats: impl Into<SplatView<'a>>,
        camera: &Camera,
        options: &RenderOptions,
    ) -> Image<[f32; 4]> {
        let view: SplatView<'a> = splats.into();
        self.image_of(&mut self.scene(view), view.splats(), camera, options)
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
