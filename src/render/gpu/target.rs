//! Offscreen image that splats are drawn into.

use super::error::GpuError;
use crate::render::finish::Finish;

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
