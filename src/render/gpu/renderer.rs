//! Public interface of the GPU renderer: draws a scene through a camera into an image.

use super::error::GpuError;
use super::layout::GpuView;
use super::scene::GpuScene;
use super::tiles::{TileFrame, TilePath};
use super::timer::{GpuTimes, N_SLOTS, StageTimer};
use crate::math::camera::Camera;
use crate::render::finish::Finish;
use crate::render::options::{Paint, RenderOptions};

/// Draws scenes into an image of its own. Several renderers may share a scene.
#[derive(Debug)]
pub struct SplatRenderer {
    tiles: TilePath,
    view: wgpu::Buffer,
    target: SplatTarget,
    timer: Option<StageTimer>,
    textures_left_out: Option<GpuError>,
}

impl SplatRenderer {
    /// Creates the pipelines and an empty image.
    pub fn new(device: &wgpu::Device, queue: &wgpu::Queue) -> Result<Self, GpuError> {
        Ok(Self {
            tiles: TilePath::new(device)?,
            view: device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("view"),
                size: size_of::<GpuView>() as u64,
                usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
                mapped_at_creation: false,
            }),
            target: SplatTarget::new(device, 0, 0)?,
            timer: StageTimer::new(device, queue),
            textures_left_out: None,
        })
    }

    /// Records the drawing of a scene into `encoder`; the image has the camera's size. The background
    /// is added by [`super::composite::Compositor`]. Must be called at most once per submission: the
    /// camera's uniforms are written at submission, not when encoding.
    ///
    /// If the splats cover more tiles than expected, the first image leaves out the farthest splats. An
    /// unchanged view is complete [`SETTLING_IMAGES`] images later.
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
        let is_antialiased = scene.finishing.is_antialiased.into();
        let view = GpuView { is_antialiased, ..GpuView::new(camera, options)? };
        // Called every frame, but the texture is recreated only after a resize.
        if self.target.size() != (width, height) {
            self.target = SplatTarget::new(device, width, height)?;
        }
        self.target.finish = Finish::new(&scene.finishing, camera, options);
        queue.write_buffer(&self.view, 0, bytemuck::bytes_of(&view));
        // A minimised window has no pixels, and wgpu rejects an empty pass.
        if width == 0 || height == 0 {
            return Ok(());
        }
        let slot = self.timer.as_mut().and_then(StageTimer::reserve_slot);
        let timer = self.timer.as_ref().zip(slot);
        let shows_textures = options.style.paint == Paint::Stored;
        self.textures_left_out = scene.textures.shortage.clone().filter(|_| shows_textures);
        let frame =
            TileFrame { view: &self.view, scene, image: &self.target, timer, shows_textures };
        self.tiles.record(device, queue, encoder, frame)?;
        if let Some((timer, slot)) = timer {
            timer.end(encoder, slot);
        }
        Ok(())
    }

    /// Returns the image of the last render.
    pub fn target(&self) -> &SplatTarget {
        &self.target
    }

    /// Returns the GPU times of an image from a few frames ago. `None` if the device has no timestamps,
    /// or before the first result.
    pub fn gpu_times(&self) -> Option<GpuTimes> {
        self.timer.as_ref().and_then(|timer| timer.latest)
    }

    /// Returns an error if the farthest splats or some textures are permanently left out, because they
    /// do not fit in GPU memory.
    pub fn shortage(&self) -> Option<&GpuError> {
        self.tiles.demand.shortage.as_ref().or(self.textures_left_out.as_ref())
    }
}

/// Number of further images after which an unchanged view is complete. Two images pass until the number
/// of splat-tile pairs is read back; the third is drawn with sufficient capacity.
pub const SETTLING_IMAGES: usize = N_SLOTS;

// Half floats, because blending in bytes would cause banding.
pub(super) const FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba16Float;

/// Image of premultiplied, sRGB-encoded splat colour and coverage, without background. Crack filling
/// and exposure are not applied yet.
#[derive(Debug)]
pub struct SplatTarget {
    texture: wgpu::Texture,
    view: wgpu::TextureView,
    width: u32,
    height: u32,
    finish: Finish,
}

impl SplatTarget {
    /// Creates a target of `width` by `height` pixels; either may be 0.
    pub fn new(device: &wgpu::Device, width: u32, height: u32) -> Result<Self, GpuError> {
        let limit = device.limits().max_texture_dimension_2d;
        // wgpu would report an uncaptured error that does not mention the viewport.
        if width.max(height) > limit {
            let (what, remedy) = ("viewport", "make the window smaller");
            return Err(GpuError::ImageTooLarge { what, width, height, limit, remedy });
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

    /// Returns width and height in pixels; either may be 0.
    pub fn size(&self) -> (u32, u32) {
        (self.width, self.height)
    }

    /// Returns the crack filling and exposure to apply when the image is composited.
    pub fn finish(&self) -> Finish {
        self.finish
    }

    /// Returns the half-float texture of the image; 1 pixel per side if the image is empty.
    pub fn texture(&self) -> &wgpu::Texture {
        &self.texture
    }

    /// Returns a texture view for sampling or drawing.
    pub fn view(&self) -> &wgpu::TextureView {
        &self.view
    }
}
