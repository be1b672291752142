//! Drawing of the window in place of egui, if the adapter computes on the CPU cores (`rendering.md`,
//! Window on a software adapter).
//!
//! egui passes its shapes and textures after every pass, and receives one callback that draws them all.
//! Textures stay with egui's painter, so that everything this painter does not support can be left to
//! egui.

use super::viewport;
use super::window_damage::TextureChange;
use super::window_meshes::{KeptWindow, WindowPass};
use crate::render::gpu::meshes::{MeshPainter, MeshSampling};
use eframe::egui::epaint::textures::{TextureFilter, TextureOptions, TextureWrapMode};
use eframe::egui::epaint::{ClippedPrimitive, ClippedShape, ImageDelta, Primitive};
use eframe::egui::{Context, FullOutput, Plugin, Pos2, Rect, Shape, TextureId, ViewportId};
use eframe::egui_wgpu::RenderState;
use std::collections::BTreeSet;
use std::sync::{Arc, Mutex, PoisonError};

/// Plugin of egui that draws the window.
pub struct WindowPainter {
    state: RenderState,
    window: Arc<Mutex<KeptWindow>>,
}

impl WindowPainter {
    /// Draws a context's window from now on. Windows with an sRGB format, which encode colours
    /// themselves, are left to egui.
    pub fn install(context: &Context, state: &RenderState) {
        if !state.target_format.is_srgb() {
            let painter = MeshPainter::new(&state.device, state.target_format);
            let window = Arc::new(Mutex::new(KeptWindow::new(painter)));
            context.add_plugin(Self { state: state.clone(), window });
        }
    }

    /// Passes changed texels of a texture to egui's painter, which would otherwise read them after the
    /// pass.
    fn update_texture(&self, window: &mut KeptWindow, id: TextureId, delta: &ImageDelta) {
        let RenderState { device, queue, renderer, .. } = &self.state;
        let mut renderer = renderer.write();
        renderer.update_texture(device, queue, id, delta);
        let Some(texture) = renderer.texture(&id).and_then(|there| there.texture.as_ref()) else {
            return;
        };
        let size = [texture.width() as f32, texture.height() as f32];
        let [x, y] = delta.pos.unwrap_or_default();
        let [width, height] = delta.image.size();
        let place = |x: usize, y: usize| Pos2::new(x as f32 / size[0], y as f32 / size[1]);
        let area = Rect::from_min_max(place(x, y), place(x + width, y + height));
        window.change(TextureChange { id, area });
    }

    /// Binds the textures of a pass; false if this painter cannot draw it.
    fn bind_textures(&self, window: &mut KeptWindow, primitives: &[ClippedPrimitive]) -> bool {
        let mut ids = BTreeSet::new();
        for ClippedPrimitive { primitive, .. } in primitives {
            match primitive {
                Primitive::Mesh(mesh) => match mesh.texture_id {
                    TextureId::Managed(key) => drop(ids.insert(key)),
                    TextureId::User(_) => return false,
                },
                Primitive::Callback(_) => return false,
            }
        }
        window.painter.retain_textures(|key| ids.contains(&key));
        let renderer = self.state.renderer.read();
        ids.into_iter().all(|key| {
            let there = renderer.texture(&TextureId::Managed(key));
            let texture = there.and_then(|there| there.texture.as_ref());
            let sampling = there.and_then(|there| there.options).and_then(sampling);
            texture.zip(sampling).is_some_and(|(texture, sampling)| {
                window.painter.set_texture(&self.state.device, key, texture, sampling);
                true
            })
        })
    }
}

impl Plugin for WindowPainter {
    fn debug_name(&self) -> &'static str {
        "window painter"
    }

    fn output_hook(&mut self, context: &Context, output: &mut FullOutput) {
        if context.viewport_id() != ViewportId::ROOT {
            return;
        }
        let mut window = self.window.lock().unwrap_or_else(PoisonError::into_inner);
        for (id, deltas) in output.textures_delta.set.drain() {
            deltas.iter().for_each(|delta| self.update_texture(&mut window, id, delta));
        }
        let shapes = std::mem::take(&mut output.shapes);
        let pixels_per_point = output.pixels_per_point;
        let primitives = context.tessellate(shapes, pixels_per_point);
        if !self.bind_textures(&mut window, &primitives) {
            window.invalidate();
            output.shapes = primitives.into_iter().map(shape).collect();
            return;
        }
        let background = context.global_style().visuals.panel_fill;
        let pass = Arc::new(WindowPass { primitives, pixels_per_point, background });
        let rect = context.viewport_rect();
        let callback = viewport::window_callback(rect, self.window.clone(), pass);
        output.shapes = vec![ClippedShape::new(rect, Shape::Callback(callback))];
    }
}

/// Converts a primitive back to a shape for egui's painter.
fn shape(ClippedPrimitive { clip_rect, primitive }: ClippedPrimitive) -> ClippedShape {
    let shape = match primitive {
        Primitive::Mesh(mesh) => Shape::mesh(mesh),
        Primitive::Callback(callback) => Shape::Callback(callback),
    };
    ClippedShape::new(clip_rect, shape)
}

/// Sampling of a texture; `None` if it repeats, which the window does not use.
fn sampling(options: TextureOptions) -> Option<MeshSampling> {
    let is_smooth = |filter| filter == TextureFilter::Linear;
    (options.wrap_mode == TextureWrapMode::ClampToEdge).then_some(MeshSampling {
        is_magnified_smoothly: is_smooth(options.magnification),
        is_minified_smoothly: is_smooth(options.minification),
    })
}
