//! Composites the splat image over a background into the window or a screenshot.
//!
//! A separate pass, because an image is drawn once and shown many times. While nothing moves, only this pass
//! runs. Background, wipe and difference change without drawing splats again.

use super::constants::{COMPARE_DIFFERENCE, COMPARE_NOTHING, COMPARE_WIPE, module};
use super::error::GpuError;
use super::layout::{Composite, shader};
use super::pipeline::{bind_group, draw_pipeline};
use super::renderer::SplatTarget;
use crate::math::image::{RgbImage, unit_to_byte};
use crate::render::compare::{Area, Combination};
use crate::render::finish::Finish;

/// Second image of a comparison.
#[derive(Clone, Copy, Debug)]
pub struct SecondImage<'a> {
    /// View of another [`SplatTarget`] or of a [`PhotoTexture`].
    pub view: &'a wgpu::TextureView,
    /// Crack filling and exposure of this image; [`Finish::NONE`] for a photograph.
    pub finish: Finish,
    /// Part of the viewport that this image fills.
    pub area: Area,
    /// Method of combining the two images.
    pub how: Combination,
}

/// Applies crack filling and exposure to a splat image and composites the image over a background. The
/// result is `C + (1 − A)·bg` with premultiplied colour `C` and coverage `A` (`rendering.md`, GPU
/// renderer). Optionally combines this result with a second image.
#[derive(Debug)]
pub struct Compositor {
    pipeline: wgpu::RenderPipeline,
    uniforms: wgpu::Buffer,
    sampler: wgpu::Sampler,
    bindings: Option<wgpu::BindGroup>,
}

impl Compositor {
    /// Creates a compositor for targets of `format`. Its input colours are sRGB-encoded. A `*Srgb` target
    /// encodes on write, so the shader decodes the colours first. All formats display the same colours.
    pub fn new(device: &wgpu::Device, format: wgpu::TextureFormat) -> Self {
        let module = module(device, "composite", shader::COMPOSITE);
        // The values are already sRGB-encoded, and such a target would encode them again.
        let fragment = if format.is_srgb() { "fragment_linear" } else { "fragment_encoded" };
        let entries = ["vertex", fragment];
        Self {
            pipeline: draw_pipeline(device, "composite", &module, entries, &[], format.into()),
            uniforms: device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("composite"),
                size: size_of::<Composite>() as u64,
                usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
                mapped_at_creation: false,
            }),
            // Exact for equal sizes, smooth if the image is smaller than the viewport.
            sampler: device.create_sampler(&wgpu::SamplerDescriptor {
                label: Some("composite"),
                mag_filter: wgpu::FilterMode::Linear,
                min_filter: wgpu::FilterMode::Linear,
                ..Default::default()
            }),
            bindings: None,
        }
    }

    /// Sets the image, the sRGB-encoded background and an optional second image over the same
    /// background for the next [`Self::draw`]. Must be called after the images have been rendered and
    /// before the pass that calls `draw` is submitted.
    pub fn prepare(
        &mut self,
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        image: &SplatTarget,
        background: [f32; 3],
        second: Option<SecondImage<'_>>,
    ) {
        let (mode, amount) = match second.map(|second| second.how) {
            None => (COMPARE_NOTHING, 0.0),
            Some(Combination::Wipe(divider)) => (COMPARE_WIPE, divider),
            Some(Combination::Difference(gain)) => (COMPARE_DIFFERENCE, gain),
        };
        let area = second.map_or(Area::FULL, |second| second.area);
        let (first, second_finish) =
            (image.finish(), second.map_or(Finish::NONE, |second| second.finish));
        let uniforms = Composite {
            background,
            mode,
            area_min: area.min,
            area_max: area.max,
            amount,
            second_full_coverage: second_finish.full_coverage,
            padding: [0; 2],
            exposure: first.exposure,
            full_coverage: first.full_coverage,
            second_exposure: second_finish.exposure,
            end: 0,
        };
        queue.write_buffer(&self.uniforms, 0, bytemuck::bytes_of(&uniforms));
        // A binding cannot be empty: without a second image the first is bound but unused.
        let second_view = second.map_or(image.view(), |second| second.view);
        let resources = [
            (0, self.uniforms.as_entire_binding()),
            (1, wgpu::BindingResource::TextureView(image.view())),
            (2, wgpu::BindingResource::Sampler(&self.sampler)),
            (3, wgpu::BindingResource::TextureView(second_view)),
        ];
        let layout = self.pipeline.get_bind_group_layout(0);
        self.bindings = Some(bind_group(device, &layout, &resources));
    }

    /// Draws the prepared image into the whole viewport set on `pass`. The pass must have one colour
    /// attachment of this compositor's format and no depth attachment. Does nothing before the first
    /// [`Self::prepare`].
    pub fn draw(&self, pass: &mut wgpu::RenderPass<'_>) {
        if let Some(bindings) = &self.bindings {
            pass.set_pipeline(&self.pipeline);
            pass.set_bind_group(0, bindings, &[]);
            pass.draw(0..3, 0..1);
        }
    }
}

/// Texture of an opaque, sRGB-encoded image, such as a photograph.
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
            let (what, remedy) = ("photograph", "use smaller images");
            return Err(GpuError::ImageTooLarge { what, width, height, limit, remedy });
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

    /// Texture view for sampling.
    pub fn view(&self) -> &wgpu::TextureView {
        &self.view
    }
}
