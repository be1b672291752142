//! Paints the scene with a hardware GPU: passes eframe's device to `render::gpu` and draws the result in
//! the window's render pass. The only file of the window that uses wgpu.

use super::drawing::{DrawSample, DrawStage, ViewRenderer};
use super::splat_updates::SplatChange;
use super::viewer::comparison::ComparedModel;
use super::viewer::photo::{ComparedPicture, Partner, PictureRequest};
use super::window_painter::{KeptWindow, WindowPass};
use crate::math::camera::Camera;
use crate::math::image::RgbImage;
use crate::model::splat::appearance::SplatSet;
use crate::render::RenderOptions;
use crate::render::finish::Finish;
use crate::render::gpu::adapters::{AdapterChoice, AdapterInfo, GpuCaps};
use crate::render::gpu::composite::{Compositor, PhotoTexture, SecondImage};
use crate::render::gpu::error::GpuFaults;
use crate::render::gpu::renderer::{SETTLING_IMAGES, SplatRenderer};
use crate::render::gpu::scene::GpuScene;
use crate::render::gpu::{GpuError, adapters};
use eframe::egui::{PaintCallback, PaintCallbackInfo, Rect, Ui};
use eframe::egui_wgpu;
use eframe::egui_wgpu::{CallbackResources, CallbackTrait, RenderState, ScreenDescriptor};
use std::sync::{Arc, Mutex, PoisonError};

pub fn capabilities(state: &RenderState) -> GpuCaps {
    GpuCaps::new(&state.adapter, &state.device)
}

pub fn wgpu_configuration(choice: &AdapterChoice) -> egui_wgpu::WgpuConfiguration {
    let mut configuration = egui_wgpu::WgpuConfiguration::default();
    if let egui_wgpu::WgpuSetup::CreateNew(setup) = &mut configuration.wgpu_setup {
        // With the adapter's full limits: the default ones limit bindings to 128 MiB.
        setup.device_descriptor = Arc::new(crate::render::gpu::adapters::device_descriptor);
        // Without a selector wgpu ranks the adapters itself, by their support for this surface.
        if *choice != AdapterChoice::Auto {
            setup.native_adapter_selector = Some(selector(choice.clone()));
        }
    }
    configuration
}

fn selector(choice: AdapterChoice) -> egui_wgpu::NativeAdapterSelectorMethod {
    Arc::new(move |adapters, surface| {
        let facts: Vec<AdapterInfo> = adapters.iter().map(AdapterInfo::new).collect();
        // `choose` returns `None` only for `Auto`, which sets no selector.
        let chosen = adapters::choose(&choice, &facts).map_err(|e| e.to_string())?.unwrap_or(0);
        let adapter = adapters.get(chosen).ok_or("no adapter found")?;
        match surface {
            Some(surface) if !adapter.is_surface_supported(surface) => {
                Err(format!("{} cannot draw on this display", facts[chosen]))
            }
            _ => Ok(adapter.clone()),
        }
    })
}

pub fn caveat(state: &RenderState) -> Option<String> {
    AdapterInfo::new(&state.adapter).warning()
}

/// Maximum ratio of buffer capacity to the size of a new scene. Larger buffers are released.
const IDLE_ROOM: usize = 4;

pub struct GpuViewPainter {
    device: wgpu::Device,
    queue: wgpu::Queue,
    faults: GpuFaults,
    drawer: ViewRenderer,
    scene: GpuScene,
    renderer: SplatRenderer,
    /// Renderer of the second picture of a comparison; created when first needed.
    second: Option<SplatRenderer>,
    photo: Option<(Arc<RgbImage>, PhotoTexture)>,
    model: Option<GpuModel>,
    compositor: Arc<Mutex<Compositor>>,
    /// Slots whose splats must be uploaded; `None` if all must be uploaded.
    pending: Option<Vec<u32>>,
    drawn_view: Option<DrawnView>,
    /// Number of pictures still to be rendered until the picture of `drawn_view` is complete.
    n_unsettled: usize,
    n_drawn: usize,
}

struct GpuModel {
    model: Arc<ComparedModel>,
    scene: GpuScene,
    renderer: SplatRenderer,
}

/// Camera, render options, and the second set of splats if two are compared.
type DrawnView = (Camera, RenderOptions, Option<Partner>);

impl GpuViewPainter {
    pub fn new(state: &RenderState, faults: GpuFaults) -> Result<Self, GpuError> {
        let capabilities = capabilities(state);
        capabilities.check()?;
        let (device, queue) = (state.device.clone(), state.queue.clone());
        Ok(Self {
            scene: GpuScene::new(&device, &queue, &[])?,
            renderer: SplatRenderer::new(&device, &queue)?,
            second: None,
            photo: None,
            model: None,
            compositor: Arc::new(Mutex::new(Compositor::new(&device, state.target_format))),
            drawer: if capabilities.has_timestamps {
                ViewRenderer::Gpu
            } else {
                ViewRenderer::UntimedGpu
            },
            device,
            queue,
            faults,
            pending: None,
            drawn_view: None,
            n_unsettled: 0,
            n_drawn: 0,
        })
    }

    pub fn drawer(&self) -> ViewRenderer {
        self.drawer
    }

    /// Returns the number of drawn splats, without empty slots.
    pub fn n_drawn(&self) -> usize {
        self.n_drawn
    }

    pub fn change(&mut self, change: SplatChange, splats: &SplatSet) {
        match (change, &mut self.pending) {
            // Changes accumulate while nothing is painted; beyond a limit everything is uploaded
            // instead.
            (SplatChange::Some { ids, .. }, Some(pending))
                if pending.len() + ids.len() <= 2 * splats.len() =>
            {
                pending.extend(ids.iter());
            }
            // Everything is to be uploaded anyway.
            (SplatChange::Some { .. }, None) => {}
            (_, pending) => *pending = None,
        }
        // Empty slots have opacity 0.
        self.n_drawn = splats.iter().filter(|s| s.opacity > 0.0).count();
    }

    /// Renders the scene, twice to compare renderers, and queues the picture for painting over `rect`.
    /// If the picture is complete and nothing has changed, it is not rendered again. Returns the timings
    /// if a picture was rendered.
    ///
    /// # Errors
    /// The GPU's error message. This painter is then unusable.
    pub fn paint(
        &mut self,
        ui: &Ui,
        rect: Rect,
        request: &PictureRequest,
        splats: &SplatSet,
    ) -> Result<Option<DrawSample>, String> {
        // Any fault ends this painter, even one of egui's drawing: both use one device, and a fault does
        // not state its source.
        if let Some(fault) = self.faults.take_new().into_iter().next() {
            return Err(fault);
        }
        // Not by the uploaded bytes, which are 0 if the last splats disappear.
        let is_changed = self.pending.as_ref().is_none_or(|ids| !ids.is_empty());
        let mut render = || -> Result<Option<DrawSample>, GpuError> {
            let mut sample = DrawSample::new(self.upload(splats)?);
            self.update_second_model(request)?;
            let is_due = self.is_render_due(ui, request, is_changed);
            if is_due {
                self.draw(request, &mut sample)?;
            }
            self.compose(request)?;
            Ok(is_due.then_some(sample))
        };
        let sample = render().map_err(|error| error.to_string())?;
        // egui runs the callback in the window's pass, where `self` is out of reach: hence the shared
        // compositor.
        let callback = PaintScene(self.compositor.clone());
        ui.painter().add(egui_wgpu::Callback::new_paint_callback(rect, callback));
        Ok(sample)
    }

    fn draw(&mut self, request: &PictureRequest, sample: &mut DrawSample) -> Result<(), GpuError> {
        let Self { device, queue, scene, .. } = self;
        let mut encoder = device.create_command_encoder(&Default::default());
        let mut draw = |renderer: &mut SplatRenderer, scene: &GpuScene, options: &RenderOptions| {
            renderer.render(device, queue, &mut encoder, scene, &request.camera, options)?;
            let times = renderer.gpu_times();
            sample.add(DrawStage::Preprocess, times.map(|times| times.preprocess));
            sample.add(DrawStage::Sort, times.map(|times| times.sort));
            sample.add(DrawStage::Draw, times.map(|times| times.draw));
            Ok(())
        };
        draw(&mut self.renderer, scene, &request.options)?;
        // A second renderer, because a renderer holds one camera and one image per submission.
        match request.second.as_ref().map(|second| &second.partner) {
            Some(Partner::Splats(options)) => {
                if self.second.is_none() {
                    self.second = Some(SplatRenderer::new(device, queue)?);
                }
                if let Some(second) = &mut self.second {
                    draw(second, scene, options)?;
                }
            }
            Some(Partner::Model(_, options)) => {
                if let Some(GpuModel { scene, renderer, .. }) = &mut self.model {
                    draw(renderer, scene, options)?;
                }
            }
            Some(Partner::Photo(_)) | None => {}
        }
        // Submitted before egui's pass of the window, which reads these images on the same queue.
        queue.submit([encoder.finish()]);
        Ok(())
    }

    fn compose(&mut self, request: &PictureRequest) -> Result<(), GpuError> {
        if let Some(ComparedPicture { partner: Partner::Photo(photo), .. }) = &request.second
            && self.photo.as_ref().is_none_or(|(shown, _)| !Arc::ptr_eq(shown, photo))
        {
            let texture = PhotoTexture::new(&self.device, &self.queue, photo)?;
            self.photo = Some((photo.clone(), texture));
        }
        let second = request.second.as_ref().and_then(|second| {
            let (view, finish) = match second.partner {
                Partner::Splats(_) => {
                    let target = self.second.as_ref()?.target();
                    (target.view(), target.finish())
                }
                Partner::Model(..) => {
                    let target = self.model.as_ref()?.renderer.target();
                    (target.view(), target.finish())
                }
                Partner::Photo(_) => (self.photo.as_ref()?.1.view(), Finish::NONE),
            };
            Some(SecondImage { view, finish, area: second.area, how: second.how })
        });
        let image = self.renderer.target();
        let background = request.options.background;
        let mut compositor = self.compositor.lock().unwrap_or_else(PoisonError::into_inner);
        compositor.prepare(&self.device, &self.queue, image, background, second);
        Ok(())
    }

    fn upload(&mut self, splats: &SplatSet) -> Result<u64, GpuError> {
        let bytes = match self.pending.take() {
            None => {
                // Buffers are reused for another scene, because scenes grow again; only those of a far
                // larger scene are released.
                if self.scene.capacity() > IDLE_ROOM * splats.len() {
                    self.scene = GpuScene::new(&self.device, &self.queue, &[])?;
                }
                let all: Vec<u32> = (0..splats.len() as u32).collect();
                self.scene.update(&self.device, &self.queue, &all, splats)?
            }
            Some(ids) if ids.is_empty() => 0,
            Some(ids) => self.scene.update(&self.device, &self.queue, &ids, splats)?,
        };
        self.pending = Some(Vec::new());
        Ok(bytes)
    }

    /// Uploads the second model if one is requested, otherwise releases it.
    fn update_second_model(&mut self, request: &PictureRequest) -> Result<(), GpuError> {
        let asked = match &request.second {
            Some(ComparedPicture { partner: Partner::Model(model, _), .. }) => model,
            _ => {
                self.model = None;
                return Ok(());
            }
        };
        if self.model.as_ref().is_none_or(|there| !Arc::ptr_eq(&there.model, asked)) {
            let (device, queue) = (&self.device, &self.queue);
            self.model = Some(GpuModel {
                model: asked.clone(),
                scene: GpuScene::new(device, queue, &asked.splats)?,
                renderer: SplatRenderer::new(device, queue)?,
            });
        }
        Ok(())
    }

    /// Returns true if the picture must be rendered, because the view has changed or the picture is not
    /// complete. If it will still be incomplete, also requests another egui pass.
    fn is_render_due(&mut self, ui: &Ui, request: &PictureRequest, is_changed: bool) -> bool {
        let partner = request.second.as_ref().map(|second| &second.partner);
        let partner = partner.filter(|partner| !matches!(partner, Partner::Photo(_)));
        let view = Some((request.camera, request.options, partner.cloned()));
        if is_changed || self.drawn_view != view {
            self.drawn_view = view;
            // The first picture may lack the farthest splats.
            self.n_unsettled = SETTLING_IMAGES;
        } else if self.n_unsettled == 0 {
            return false;
        } else {
            self.n_unsettled -= 1;
        }
        if self.n_unsettled > 0 {
            // An idle window draws no further pass by itself.
            ui.ctx().request_repaint();
        }
        true
    }
}

struct PaintScene(Arc<Mutex<Compositor>>);

impl CallbackTrait for PaintScene {
    fn paint(
        &self,
        _: PaintCallbackInfo,
        pass: &mut wgpu::RenderPass<'static>,
        _: &CallbackResources,
    ) {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).draw(pass);
    }
}

pub fn window_callback(
    rect: Rect,
    window: Arc<Mutex<KeptWindow>>,
    pass: Arc<WindowPass>,
) -> PaintCallback {
    egui_wgpu::Callback::new_paint_callback(rect, PaintWindow { window, pass })
}

struct PaintWindow {
    window: Arc<Mutex<KeptWindow>>,
    pass: Arc<WindowPass>,
}

impl CallbackTrait for PaintWindow {
    fn prepare(
        &self,
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        screen: &ScreenDescriptor,
        encoder: &mut wgpu::CommandEncoder,
        _: &mut CallbackResources,
    ) -> Vec<wgpu::CommandBuffer> {
        let mut window = self.window.lock().unwrap_or_else(PoisonError::into_inner);
        // Drawn before the window's pass, in which no other render pass can begin.
        let list = window.update_to_pass(&self.pass, screen.size_in_pixels);
        window.painter.draw(device, queue, encoder, screen.size_in_pixels, &list);
        Vec::new()
    }

    fn paint(
        &self,
        info: PaintCallbackInfo,
        pass: &mut wgpu::RenderPass<'static>,
        _: &CallbackResources,
    ) {
        // egui sets both to the callback's rectangle, rounded from points; the image has exactly the
        // window's pixels.
        let [width, height] = info.screen_size_px;
        pass.set_viewport(0.0, 0.0, width as f32, height as f32, 0.0, 1.0);
        pass.set_scissor_rect(0, 0, width, height);
        self.window.lock().unwrap_or_else(PoisonError::into_inner).painter.show(pass);
    }
}

pub struct WindowDevice {
    pub state: RenderState,
    /// Collects asynchronous GPU errors and device loss.
    pub faults: GpuFaults,
    /// Graphics adapters that can draw the window.
    pub there: Vec<AdapterInfo>,
    pub adapter: AdapterInfo,
}

impl WindowDevice {
    pub fn new(state: &RenderState) -> Self {
        // Installed before any drawing, because wgpu panics without a handler.
        let faults = GpuFaults::default();
        faults.watch(&state.device);
        let there = state.available_adapters.iter().map(AdapterInfo::new).collect();
        let adapter = AdapterInfo::new(&state.adapter);
        Self { state: state.clone(), faults, there, adapter }
    }

    pub fn is_lost(&self) -> bool {
        // A loss is reported only by a poll or a submission, and an idle window submits nothing. A
        // failed poll means a lost device, which the callback reports.
        let _ = self.state.device.poll(wgpu::PollType::Poll);
        self.faults.is_lost()
    }
}
