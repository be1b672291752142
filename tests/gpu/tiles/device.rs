//! Images of the tile path, and buffer uploads and readbacks.

use crate::fixture::Fixture;
use std::ops::Deref;
use vbgs_studio::math::camera::Camera;
use vbgs_studio::math::image::Image;
use vbgs_studio::model::splat::appearance::SplatView;
use vbgs_studio::render::RenderOptions;
use vbgs_studio::render::gpu::DrawPath;
use vbgs_studio::render::gpu::readback;
use vbgs_studio::render::gpu::renderer::SplatRenderer;
use vbgs_studio::render::gpu::scene::{ComparedImage, GpuScene};
use vbgs_studio::render::gpu::sort::{SortScratch, back_to_front};

/// A device for tests of the tile path.
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

    /// Creates a separate device with smaller buffers than the adapter allows.
    #[track_caller]
    pub fn with_buffers_up_to(bytes: u64) -> Option<Self> {
        let limit = |limits: &mut wgpu::Limits| {
            limits.max_storage_buffer_binding_size =
                limits.max_storage_buffer_binding_size.min(bytes);
        };
        Fixture::own(limit).map(Self)
    }

    /// A storage buffer with these words; it has room for at least one.
    pub fn words(&self, words: &[u32]) -> wgpu::Buffer {
        let buffer = self.device.create_buffer(&wgpu::BufferDescriptor {
            label: None,
            size: 4 * words.len().max(1) as u64,
            usage: wgpu::BufferUsages::STORAGE
                | wgpu::BufferUsages::COPY_SRC
                | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        self.queue.write_buffer(&buffer, 0, bytemuck::cast_slice(words));
        buffer
    }

    /// Reads the first `n` words of a buffer after all submitted work.
    pub fn read(&self, buffer: &wgpu::Buffer, n: usize) -> Vec<u32> {
        if n == 0 {
            return Vec::new();
        }
        let staging = self.device.create_buffer(&wgpu::BufferDescriptor {
            label: None,
            size: 4 * n as u64,
            usage: wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        let mut encoder = self.device.create_command_encoder(&Default::default());
        encoder.copy_buffer_to_buffer(buffer, 0, &staging, 0, 4 * n as u64);
        self.queue.submit([encoder.finish()]);
        staging.map_async(wgpu::MapMode::Read, .., Result::unwrap);
        self.device.poll(wgpu::PollType::wait_indefinitely()).unwrap();
        let bytes = staging.get_mapped_range(..).unwrap();
        bytemuck::pod_collect_to_vec(&bytes)
    }

    pub fn renderer(&self, path: DrawPath) -> SplatRenderer {
        let mut renderer =
            SplatRenderer::new(&self.device, &self.queue, ComparedImage::First).unwrap();
        renderer.set_path(path);
        renderer
    }

    /// A scene with the splat order of one view.
    pub fn scene(
        &self,
        splats: SplatView<'_>,
        camera: &Camera,
        options: &RenderOptions,
    ) -> GpuScene {
        let mut scene = GpuScene::new(&self.device, &self.queue, splats).unwrap();
        let mut scratch = SortScratch::default();
        let order = back_to_front(splats.splats(), camera, options, &mut scratch);
        scene.set_order(&self.queue, ComparedImage::First, order).unwrap();
        scene
    }

    /// Draws one image and waits for its premultiplied colour and coverage.
    pub fn image(
        &self,
        renderer: &mut SplatRenderer,
        scene: &GpuScene,
        camera: &Camera,
        options: &RenderOptions,
    ) -> Image<[f32; 4]> {
        let (device, queue) = (&self.device, &self.queue);
        let mut encoder = device.create_command_encoder(&Default::default());
        renderer.render(device, queue, &mut encoder, scene, camera, options).unwrap();
        queue.submit([encoder.finish()]);
        readback::read_premultiplied(device, queue, renderer.target()).unwrap()
    }

    /// Draws one image with a new renderer.
    pub fn image_by(
        &self,
        path: DrawPath,
        splats: SplatView<'_>,
        camera: &Camera,
        options: &RenderOptions,
    ) -> Image<[f32; 4]> {
        let scene = self.scene(splats, camera, options);
        self.image(&mut self.renderer(path), &scene, camera, options)
    }
}

pub fn largest_difference(a: &Image<[f32; 4]>, b: &Image<[f32; 4]>) -> f32 {
    assert_eq!((a.width, a.height), (b.width, b.height));
    let channels = a.data.iter().flatten().zip(b.data.iter().flatten());
    // A NaN counts as the largest difference.
    channels.fold(0.0, |worst, (x, y)| if (x - y).abs() <= worst { worst } else { (x - y).abs() })
}
