//! Public interface of the GPU renderer: draws a scene through a camera into an image.
//!
//! Quads and tiles share the camera's uniforms and the image; the paths differ only in the
//! recorded commands. The tile path is created on first use, so a software adapter never creates its
//! pipelines and buffers.

use super::chooser::{Chooser, Load};
use super::error::GpuError;
use super::layout::GpuView;
use super::path::{DrawPath, GpuTimes};
use super::quads::QuadPath;
use super::scene::{ComparedImage, GpuScene};
use super::tiles::{TileFrame, TilePath};
use super::timer::{GpuStage, StageTimer};
use crate::math::camera::Camera;
use crate::render::finish::Finish;
use crate::render::options::RenderOptions;

/// Draws scenes into its own image. Several renderers may share a scene.
#[derive(Debug)]
pub struct SplatRenderer {
    of: ComparedImage,
    quads: QuadPath,
    /// Created on first use.
    tiles: Option<TilePath>,
    chooser: Chooser,
    view: wgpu::Buffer,
    target: SplatTarget,
    timer: Option<StageTimer>,
    extent_cap: f32,
}

impl SplatRenderer {
    /// Creates the pipelines and an empty image; `of` selects the draw order of the scene. Uses quads on
    /// software adapters and on adapters without timestamps. Otherwise the first images measure both paths
    /// and the faster one is used.
    pub fn new(
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        of: ComparedImage,
    ) -> Result<Self, GpuError> {
        let timer = StageTimer::new(device, queue);
        let is_software = device.adapter_info().device_type == wgpu::DeviceType::Cpu;
        Ok(Self {
            of,
            quads: QuadPath::new(device),
            tiles: None,
            chooser: match timer {
                Some(_) if !is_software => Chooser::measuring(),
                // Without timestamps nothing can be measured; on a CPU adapter measuring is not
                // worthwhile.
                _ => Chooser::fixed(DrawPath::Quads),
            },
            view: device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("view"),
                size: size_of::<GpuView>() as u64,
                usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
                mapped_at_creation: false,
            }),
            target: SplatTarget::new(device, 0, 0)?,
            timer,
            extent_cap: f32::INFINITY,
        })
    }

    /// Sets the maximum support of a splat in standard deviations, for quads only. 3 is faster while the
    /// camera moves. The default, infinity, draws everything above the alpha cut.
    pub fn set_extent_cap(&mut self, extent_cap: f32) {
        self.extent_cap = extent_cap;
    }

    /// Fixes the path, for tests and benchmarks.
    pub fn set_path(&mut self, path: DrawPath) {
        self.chooser = Chooser::fixed(path);
    }

    /// Path of the next image.
    pub fn path(&self) -> DrawPath {
        self.chooser.path()
    }

    /// Records the drawing of a scene into `encoder`; the image has the camera's size. For quads the scene's
    /// order must have been computed for the same camera and options ([`super::sort::back_to_front`]).
    /// The background is added by [`super::composite::Compositor`]. Call it once per submission: the
    /// camera's uniforms are written at submission, not when encoding.
    pub fn render(
        &mut self,
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        encoder: &mut wgpu::CommandEncoder,
        scene: &GpuScene,
        camera: &Camera,
        options: &RenderOptions,
    ) -> Result<(), GpuError> {
        let (width, height) = (camera.intrinsics.width, camera.intrinsics.height);
        let path = self.choose(scene, (width, height));
        let extent_cap = match path {
            DrawPath::Quads => self.extent_cap,
            // Tiles stop at full pixels anyway; a cap would only change images.
            DrawPath::Tiles => f32::INFINITY,
        };
        let view = GpuView::new(camera, options, extent_cap)?;
        // Called every frame, but the texture is recreated only after a resize.
        if self.target.size() != (width, height) {
            self.target = SplatTarget::new(device, width, height)?;
        }
        self.target.set_finish(scene.finish(camera, options));
        queue.write_buffer(&self.view, 0, bytemuck::bytes_of(&view));
        // A minimised window has no pixels, and wgpu rejects an empty pass.
        if self.target.is_empty() {
            return Ok(());
        }
        let slot = self.timer.as_mut().and_then(|timer| timer.reserve_slot(path));
        match path {
            DrawPath::Quads => self.record_quads(device, encoder, scene, slot),
            DrawPath::Tiles => {
                let drawn = self.record_tiles(device, queue, encoder, scene, slot);
                drawn.inspect_err(|_| self.chooser.rule_out_tiles())?;
            }
        }
        if let (Some(timer), Some(slot)) = (&self.timer, slot) {
            timer.end(encoder, slot);
        }
        Ok(())
    }

    /// Image of the last render.
    pub fn target(&self) -> &SplatTarget {
        &self.target
    }

    /// Measurement from a few frames ago; `None` without timestamps or before the first result.
    pub fn gpu_times(&self) -> Option<GpuTimes> {
        self.timer.as_ref().and_then(StageTimer::latest)
    }

    /// Shortage that leaves out the farthest splats, if any.
    pub fn shortage(&self) -> Option<&GpuError> {
        self.tiles.as_ref().filter(|_| self.path() == DrawPath::Tiles).and_then(TilePath::shortage)
    }

    fn choose(&mut self, scene: &GpuScene, (width, height): (u32, u32)) -> DrawPath {
        if let Some(shortage) = self.shortage()
            && self.chooser.is_measured()
        {
            tracing::warn!("{shortage}; drawing quads instead");
            self.chooser.rule_out_tiles();
        }
        if let Some((path, times)) = self.timer.as_mut().and_then(StageTimer::take_latest) {
            self.chooser.record_time(path, times.total());
        }
        // Quads without an order draw nothing, so their time would be meaningless.
        if scene.n_drawn(self.of) > 0 {
            let n_pixels = width as usize * height as usize;
            self.chooser.update_load(Load { n_splats: scene.n_splats(), n_pixels });
        }
        self.chooser.path()
    }

    fn record_tiles(
        &mut self,
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        encoder: &mut wgpu::CommandEncoder,
        scene: &GpuScene,
        timer_slot: Option<usize>,
    ) -> Result<(), GpuError> {
        let tiles = match &mut self.tiles {
            Some(tiles) => tiles,
            none => none.insert(TilePath::new(device)?),
        };
        let timer = self.timer.as_ref().zip(timer_slot);
        let frame = TileFrame { view: &self.view, scene, image: &self.target, timer };
        tiles.record(device, queue, encoder, frame)
    }

    fn record_quads(
        &self,
        device: &wgpu::Device,
        encoder: &mut wgpu::CommandEncoder,
        scene: &GpuScene,
        timer_slot: Option<usize>,
    ) {
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("splats"),
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view: self.target.view(),
                depth_slice: None,
                resolve_target: None,
                ops: wgpu::Operations {
                    load: wgpu::LoadOp::Clear(wgpu::Color::TRANSPARENT),
                    store: wgpu::StoreOp::Store,
                },
            })],
            timestamp_writes: timer_slot
                .and_then(|slot| self.timer.as_ref().map(|t| t.of_render(slot, GpuStage::Draw))),
            ..Default::default()
        });
        if scene.n_drawn(self.of) > 0 {
            self.quads.draw(device, &mut pass, &self.view, scene, self.of);
        }
    }
}

/// Half floats, because blending in bytes would cause banding.
pub(super) const FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba16Float;

/// Premultiplied, sRGB-encoded splat colour and coverage before finishing, without background.
#[derive(Debug)]
pub struct SplatTarget {
    texture: wgpu::Texture,
    view: wgpu::TextureView,
    width: u32,
    height: u32,
    finish: Finish,
}

impl SplatTarget {
    /// Creates a target of `width` by `height` pixels. An empty viewport (a side of 0) gets a single unused
    /// pixel, because a texture cannot be empty.
    pub fn new(device: &wgpu::Device, width: u32, height: u32) -> Result<Self, GpuError> {
        let limit = device.limits().max_texture_dimension_2d;
        // wgpu would report an uncaptured error that does not mention the viewport.
        if width.max(height) > limit {
            return Err(GpuError::ViewportTooLarge { width, height, limit });
        }
        let texture = device.create_texture(&wgpu::TextureDescriptor {
            label: Some("splat image"),
            size: wgpu::Extent3d {
                // A texture cannot be empty.
                width: width.max(1),
                height: height.max(1),
                depth_or_array_layers: 1,
            },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: FORMAT,
            usage: wgpu::TextureUsages::RENDER_ATTACHMENT
                | wgpu::TextureUsages::TEXTURE_BINDING
                | wgpu::TextureUsages::STORAGE_BINDING
                | wgpu::TextureUsages::COPY_SRC,
            view_formats: &[],
        });
        let view = texture.create_view(&Default::default());
        Ok(Self { texture, view, width, height, finish: Finish::NONE })
    }

    /// Width and height; either may be 0.
    pub fn size(&self) -> (u32, u32) {
        (self.width, self.height)
    }

    /// Finishing to apply when the image is composited.
    pub fn finish(&self) -> Finish {
        self.finish
    }

    pub(super) fn set_finish(&mut self, finish: Finish) {
        self.finish = finish;
    }

    pub(super) fn is_empty(&self) -> bool {
        self.width == 0 || self.height == 0
    }

    pub(super) fn texture(&self) -> &wgpu::Texture {
        &self.texture
    }

    /// View for sampling or drawing.
    pub fn view(&self) -> &wgpu::TextureView {
        &self.view
    }
}
