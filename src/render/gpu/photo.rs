//! Photograph as a GPU texture, for comparison with splats.

use super::error::GpuError;
use crate::math::image::{RgbImage, unit_to_byte};

/// Opaque image of sRGB-encoded bytes.
#[derive(Debug)]
pub struct PhotoTexture {
    view: wgpu::TextureView,
}

impl PhotoTexture {
    /// Uploads an image. An empty image becomes a single white texel.
    pub fn new(
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        picture: &RgbImage,
    ) -> Result<Self, GpuError> {
        let (width, height) = (picture.width as u32, picture.height as u32);
        let limit = device.limits().max_texture_dimension_2d;
        // wgpu would report an uncaptured error that does not mention the photograph.
        if width.max(height) > limit {
            return Err(GpuError::PhotoTooLarge { width, height, limit });
        }
        let size =
            wgpu::Extent3d { width: width.max(1), height: height.max(1), depth_or_array_layers: 1 };
        let texture = device.create_texture(&wgpu::TextureDescriptor {
            label: Some("photograph"),
            size,
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: wgpu::TextureFormat::Rgba8Unorm,
            usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
            view_formats: &[],
        });
        let mut bytes: Vec<u8> = picture
            .data
            .iter()
            .flat_map(|&[r, g, b]| [unit_to_byte(r), unit_to_byte(g), unit_to_byte(b), u8::MAX])
            .collect();
        // An empty image still needs one texel.
        bytes.resize((4 * size.width * size.height) as usize, u8::MAX);
        let layout = wgpu::TexelCopyBufferLayout {
            offset: 0,
            bytes_per_row: Some(4 * size.width),
            rows_per_image: None,
        };
        queue.write_texture(texture.as_image_copy(), &bytes, layout, size);
        Ok(Self { view: texture.create_view(&Default::default()) })
    }

    /// View for sampling.
    pub fn view(&self) -> &wgpu::TextureView {
        &self.view
    }
}
