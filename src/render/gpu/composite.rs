//! Splat image over a background, into whatever the window or a picture wants.
//!
//! A pass of its own and not the splats' last step, because the image is drawn once and shown
//! often: while nothing moves, only this pass runs, and backgrounds, wipes and differences change
//! without drawing a splat again.

use super::constants::{COMPARE_DIFFERENCE, COMPARE_NOTHING, COMPARE_WIPE, module};
use super::draw_pipeline::DrawPipeline;
use super::layout::{Composite, shader};
use super::target::SplatTarget;
use crate::render::compare::{Area, Combination};
use crate::render::finish::Finish;

/// A second picture to compare with.
#[derive(Clone, Copy, Debug)]
pub struct Second<'a> {
    /// Of another [`SplatTarget`] or of a [`super::photo::PhotoTexture`].
    pub view: &'a wgpu::TextureView,
    /// What becomes of its pixels; nothing of a photograph's.
    pub finish: Finish,
    /// The part of the viewport that it fills.
    pub area: Area,
    /// What is shown of the two.
    pub how: Combination,
}

/// Finishes a splat image, lays it over a background, `C + (1 − A)·bg` (`rendering.md`, GPU
/// renderer), and compares it with a second picture if there is one.
#[derive(Debug)]
pub struct Compositor {
    pipeline: wgpu::RenderPipeline,
    uniforms: wgpu::Buffer,
    sampler: wgpu::Sampler,
    bindings: Option<wgpu::BindGroup>,
}

impl Compositor {
    /// For targets of `format`. Values are sRGB-encoded; a `*Srgb` format, which encodes what it is
    /// given, gets them decoded so that the same colours are shown.
    pub fn new(device: &wgpu::Device, format: wgpu::TextureFormat) -> Self {
        Self {
            pipeline: pipeline(device, format),
            uniforms: device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("composite"),
                size: size_of::<Composite>() as u64,
                usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
                mapped_at_creation: false,
            }),
            // Exact where sizes agree; smooth where the image is smaller than the viewport.
            sampler: device.create_sampler(&wgpu::SamplerDescriptor {
                label: Some("composite"),
                mag_filter: wgpu::FilterMode::Linear,
                min_filter: wgpu::FilterMode::Linear,
                ..Default::default()
            }),
            bindings: None,
        }
    }

    /// Chooses the image and the background (sRGB-encoded) of the next [`Self::draw`]; call it after
    /// the render that made the image and before the pass that draws it is submitted.
    pub fn prepare(
        &mut self,
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        image: &SplatTarget,
        background: [f32; 3],
    ) {
        self.prepare_pair(device, queue, image, background, None);
    }

    /// [`Self::prepare`] with a second picture to compare with, laid over an equal background.
    pub fn prepare_pair(
        &mut self,
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        image: &SplatTarget,
        background: [f32; 3],
        second: Option<Second<'_>>,
    ) {
        let uniforms = uniforms(background, image.finish(), second);
        queue.write_buffer(&self.uniforms, 0, bytemuck::bytes_of(&uniforms));
        // A binding cannot be empty: without a second picture the first stands in, unread.
        let second_view = second.map_or(image.view(), |second| second.view);
        self.bindings = Some(device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("composite"),
            layout: &self.pipeline.get_bind_group_layout(0),
            entries: &[
                wgpu::BindGroupEntry { binding: 0, resource: self.uniforms.as_entire_binding() },
                wgpu::BindGroupEntry {
                    binding: 1,
                    resource: wgpu::BindingResource::TextureView(image.view()),
                },
                wgpu::BindGroupEntry {
                    binding: 2,
                    resource: wgpu::BindingResource::Sampler(&self.sampler),
                },
                wgpu::BindGroupEntry {
                    binding: 3,
                    resource: wgpu::BindingResource::TextureView(second_view),
                },
            ],
        }));
    }

    /// Fills the viewport that `pass` has set; the pass must have one colour attachment of this
    /// compositor's format and no depth. Draws nothing before the first [`Self::prepare`].
    pub fn draw(&self, pass: &mut wgpu::RenderPass<'_>) {
        if let Some(bindings) = &self.bindings {
            pass.set_pipeline(&self.pipeline);
            pass.set_bind_group(0, bindings, &[]);
            pass.draw(0..3, 0..1);
        }
    }
}

fn uniforms(background: [f32; 3], finish: Finish, second: Option<Second<'_>>) -> Composite {
    let area = second.map_or(Area::FULL, |second| second.area);
    let (mode, amount) = match second.map(|second| second.how) {
        None => (COMPARE_NOTHING, 0.0),
        Some(Combination::Wipe(divider)) => (COMPARE_WIPE, divider),
        Some(Combination::Difference(gain)) => (COMPARE_DIFFERENCE, gain),
    };
    let second_finish = second.map_or(Finish::NONE, |second| second.finish);
    Composite {
        background,
        mode,
        area_min: area.min,
        area_max: area.max,
        amount,
        second_full_coverage: second_finish.full_coverage,
        padding: [0; 2],
        exposure: finish.exposure,
        full_coverage: finish.full_coverage,
        second_exposure: second_finish.exposure,
        end: 0,
    }
}

fn pipeline(device: &wgpu::Device, format: wgpu::TextureFormat) -> wgpu::RenderPipeline {
    let module = module(device, "composite", shader::COMPOSITE);
    // Values are sRGB-encoded already; such a target would encode them twice.
    let fragment = if format.is_srgb() { "fragment_linear" } else { "fragment_encoded" };
    DrawPipeline {
        label: "composite",
        module: &module,
        entries: ["vertex", fragment],
        buffers: &[],
        topology: wgpu::PrimitiveTopology::TriangleList,
        target: format.into(),
    }
    .made(device)
}
