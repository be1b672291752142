//! Draws the triangles of the user interface into a persistent image, and copies this image into the window.
//!
//! Used on software adapters (`rendering.md`, Window on a software adapter), where fragments are expensive.
//! Only changed areas are redrawn, untextured triangles read no texture, and opaque ones are not blended.
//! Colours are sRGB-encoded bytes, as in the window.

use super::constants::module;
use super::growing::filled_buffer;
use super::layout::shader;
use super::pipeline::{bind_group, draw_pipeline};
use std::collections::HashMap;
use std::ops::Range;

/// Corner of a triangle.
#[derive(Clone, Copy, Debug, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct MeshVertex {
    /// Position in clip space, −1 to 1; x to the right, y up.
    pub position: [f32; 2],
    /// Texture coordinates, 0 to 1.
    pub uv: [f32; 2],
    /// Colour, premultiplied and sRGB-encoded.
    pub color: [u8; 4],
}

/// Half-open pixel rectangle in a target.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PixelRect {
    /// First column and row.
    pub min: [u32; 2],
    /// One past the last column and row.
    pub max: [u32; 2],
}

/// Shading of triangles, cheapest first.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MeshKind {
    /// Opaque vertex colours, drawn without blending.
    Opaque,
    /// Vertex colours blended over the image.
    Blended,
    /// Colours of a texture, drawn without blending; vertex colours are ignored. The value is the key
    /// passed to [`MeshPainter::set_texture`].
    Picture(u64),
    /// Vertex colours times a texture, blended over the image. The value is the key passed to
    /// [`MeshPainter::set_texture`].
    Textured(u64),
}

/// Triangles drawn by one call.
#[derive(Clone, Debug, PartialEq)]
pub struct MeshBatch {
    /// Shading of the triangles.
    pub kind: MeshKind,
    /// Clip rectangle in the target, pixels.
    pub scissor: PixelRect,
    /// Range in [`MeshList::indices`].
    pub indices: Range<u32>,
}

/// Batches to draw over the persistent image, in order.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MeshList {
    /// Corners of all triangles.
    pub vertices: Vec<MeshVertex>,
    /// Three vertex indices per triangle.
    pub indices: Vec<u32>,
    /// Batches in drawing order.
    pub batches: Vec<MeshBatch>,
}

/// Texture filtering; coordinates are clamped to the edge.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MeshSampling {
    /// True for linear filtering where texels are larger than pixels, false for nearest.
    pub is_magnified_smoothly: bool,
    /// True for linear filtering where texels are smaller than pixels, false for nearest.
    pub is_minified_smoothly: bool,
}

/// Draws triangle lists into a persistent image and copies this image into the window.
#[derive(Debug)]
pub struct MeshPainter {
    format: wgpu::TextureFormat,
    opaque: wgpu::RenderPipeline,
    blended: wgpu::RenderPipeline,
    pictured: wgpu::RenderPipeline,
    textured: wgpu::RenderPipeline,
    whole: wgpu::RenderPipeline,
    textures: HashMap<u64, BoundTexture>,
    /// Persistent image, and the binding for copying it into the window.
    picture: Option<(wgpu::Texture, wgpu::BindGroup)>,
}

#[derive(Debug)]
struct BoundTexture {
    texture: wgpu::Texture,
    sampling: MeshSampling,
    /// Bindings for [`MeshKind::Picture`] and for [`MeshKind::Textured`].
    bindings: [wgpu::BindGroup; 2],
}

impl MeshPainter {
    /// Creates a painter for targets of `format`, which must not be a `*Srgb` format.
    pub fn new(device: &wgpu::Device, format: wgpu::TextureFormat) -> Self {
        let module = module(device, "meshes", shader::MESHES);
        let over = Some(wgpu::BlendState::PREMULTIPLIED_ALPHA_BLENDING);
        let pipeline = |name: &str, buffers: &[_], blend| {
            let [vertex, fragment] = ["vertex", "fragment"].map(|stage| format!("{stage}_{name}"));
            let target =
                wgpu::ColorTargetState { format, blend, write_mask: wgpu::ColorWrites::ALL };
            draw_pipeline(device, "meshes", &module, [&vertex, &fragment], buffers, target)
        };
        let corners = [Some(wgpu::VertexBufferLayout {
            array_stride: size_of::<MeshVertex>() as u64,
            step_mode: wgpu::VertexStepMode::Vertex,
            attributes: &wgpu::vertex_attr_array![0 => Float32x2, 1 => Float32x2, 2 => Unorm8x4],
        })];
        Self {
            format,
            opaque: pipeline("plain", &corners, None),
            blended: pipeline("plain", &corners, over),
            pictured: pipeline("picture", &corners, None),
            textured: pipeline("textured", &corners, over),
            whole: pipeline("whole", &[], None),
            textures: HashMap::new(),
            picture: None,
        }
    }

    /// Registers a texture of sRGB-encoded, premultiplied colours under a key.
    pub fn set_texture(
        &mut self,
        device: &wgpu::Device,
        key: u64,
        texture: &wgpu::Texture,
        sampling: MeshSampling,
    ) {
        let is_bound =
            |bound: &BoundTexture| bound.texture == *texture && bound.sampling == sampling;
        if self.textures.get(&key).is_some_and(is_bound) {
            return;
        }
        let filter = |is_smooth| {
            if is_smooth { wgpu::FilterMode::Linear } else { wgpu::FilterMode::Nearest }
        };
        let sampler = device.create_sampler(&wgpu::SamplerDescriptor {
            label: Some("mesh texture"),
            mag_filter: filter(sampling.is_magnified_smoothly),
            min_filter: filter(sampling.is_minified_smoothly),
            ..Default::default()
        });
        let view = texture.create_view(&Default::default());
        let resources = [
            (0, wgpu::BindingResource::TextureView(&view)),
            (1, wgpu::BindingResource::Sampler(&sampler)),
        ];
        let bindings = [&self.pictured, &self.textured]
            .map(|pipeline| bind_group(device, &pipeline.get_bind_group_layout(0), &resources));
        self.textures.insert(key, BoundTexture { texture: texture.clone(), sampling, bindings });
    }

    /// Retains only the textures for whose keys `is_wanted` returns true.
    pub fn retain_textures(&mut self, is_wanted: impl Fn(u64) -> bool) {
        self.textures.retain(|key, _| is_wanted(*key));
    }

    /// Width and height of the persistent image; `None` before the first [`Self::draw`].
    pub fn size(&self) -> Option<[u32; 2]> {
        self.picture.as_ref().map(|(texture, _)| [texture.width(), texture.height()])
    }

    /// Draws a list over the persistent image. If `size` (width and height, not 0) differs from the last
    /// call, the list must cover the whole image. Batches of unregistered textures are skipped.
    pub fn draw(
        &mut self,
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        encoder: &mut wgpu::CommandEncoder,
        size: [u32; 2],
        list: &MeshList,
    ) {
        if self.size() != Some(size) {
            self.picture = Some(self.new_picture(device, size));
        }
        let Some((picture, _)) = self.picture.as_ref().filter(|_| !list.batches.is_empty()) else {
            return;
        };
        let view = picture.create_view(&Default::default());
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("meshes"),
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view: &view,
                depth_slice: None,
                resolve_target: None,
                // The image persists: only changed areas are drawn again.
                ops: wgpu::Operations { load: wgpu::LoadOp::Load, store: wgpu::StoreOp::Store },
            })],
            ..Default::default()
        });
        let buffer = |contents, usage| filled_buffer(device, queue, "meshes", usage, contents);
        let vertices = buffer(bytemuck::cast_slice(&list.vertices), wgpu::BufferUsages::VERTEX);
        let indices = buffer(bytemuck::cast_slice(&list.indices), wgpu::BufferUsages::INDEX);
        pass.set_vertex_buffer(0, vertices.slice(..));
        pass.set_index_buffer(indices.slice(..), wgpu::IndexFormat::Uint32);
        for MeshBatch { kind, scissor, indices } in &list.batches {
            match kind {
                MeshKind::Opaque => pass.set_pipeline(&self.opaque),
                MeshKind::Blended => pass.set_pipeline(&self.blended),
                MeshKind::Picture(key) | MeshKind::Textured(key) => {
                    let Some(texture) = self.textures.get(key) else { continue };
                    let [as_picture, blended] = &texture.bindings;
                    let (pipeline, bindings) = match kind {
                        MeshKind::Picture(_) => (&self.pictured, as_picture),
                        _ => (&self.textured, blended),
                    };
                    pass.set_pipeline(pipeline);
                    pass.set_bind_group(0, bindings, &[]);
                }
            }
            let PixelRect { min, max } = *scissor;
            pass.set_scissor_rect(min[0], min[1], max[0] - min[0], max[1] - min[1]);
            pass.draw_indexed(indices.clone(), 0, 0..1);
        }
    }

    /// Copies the persistent image to the viewport set on `pass`, which must have the same size. The
    /// pass must have one colour attachment of this painter's format and no depth attachment. Does
    /// nothing before the first [`Self::draw`].
    pub fn show(&self, pass: &mut wgpu::RenderPass<'_>) {
        if let Some((_, bindings)) = &self.picture {
            pass.set_pipeline(&self.whole);
            pass.set_bind_group(0, bindings, &[]);
            pass.draw(0..3, 0..1);
        }
    }

    fn new_picture(
        &self,
        device: &wgpu::Device,
        [width, height]: [u32; 2],
    ) -> (wgpu::Texture, wgpu::BindGroup) {
        let texture = device.create_texture(&wgpu::TextureDescriptor {
            label: Some("window"),
            size: wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: self.format,
            usage: wgpu::TextureUsages::RENDER_ATTACHMENT
                | wgpu::TextureUsages::TEXTURE_BINDING
                | wgpu::TextureUsages::COPY_SRC,
            view_formats: &[],
        });
        let view = texture.create_view(&Default::default());
        let resources = [(0, wgpu::BindingResource::TextureView(&view))];
        let bindings = bind_group(device, &self.whole.get_bind_group_layout(0), &resources);
        (texture, bindings)
    }
}
