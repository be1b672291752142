//! Painting with a real GPU: hands eframe's device to `render::gpu` and draws its result inside the
//! window's own pass. The only file of the window that knows wgpu.

use super::drawing::{DrawSample, DrawStage, Drawer};
use super::splat_updates::SplatChange;
use super::view_thread::{Announce, ViewThread};
use super::viewer::compared_model::ComparedModel;
use super::viewer::picture_request::{ComparedPicture, Partner, PictureRequest};
use super::window_meshes::{KeptWindow, WindowPass};
use super::worker::Waker;
use crate::math::camera::Camera;
use crate::math::image::RgbImage;
use crate::model::splat::appearance::SplatSet;
use crate::render::RenderOptions;
use crate::render::finish::Finish;
use crate::render::gpu::GpuError;
use crate::render::gpu::adapters::{self, AdapterChoice, AdapterFacts};
use crate::render::gpu::composite::{Compositor, Second};
use crate::render::gpu::context::GpuCaps;
use crate::render::gpu::faults::GpuFaults;
use crate::render::gpu::photo::PhotoTexture;
use crate::render::gpu::renderer::SplatRenderer;
use crate::render::gpu::scene::{GpuScene, OrderOf};
use crate::render::gpu::sort::{SortScratch, back_to_front};
use eframe::egui::{PaintCallback, PaintCallbackInfo, Rect, Ui};
use eframe::egui_wgpu::{self, CallbackResources, CallbackTrait, RenderState, ScreenDescriptor};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;

/// The adapter eframe chose, and what it can do.
pub fn capabilities(state: &RenderState) -> GpuCaps {
    GpuCaps::new(&state.adapter, &state.device)
}

/// Asks for all the adapter offers, since the default limits bind 128 MiB only.
pub fn wgpu_configuration(choice: &AdapterChoice) -> egui_wgpu::WgpuConfiguration {
    let mut configuration = egui_wgpu::WgpuConfiguration::default();
    if let egui_wgpu::WgpuSetup::CreateNew(setup) = &mut configuration.wgpu_setup {
        setup.device_descriptor = Arc::new(crate::render::gpu::context::device_descriptor);
        // Without a selector wgpu ranks the adapters itself, by what this
        // surface can be drawn with.
        if *choice != AdapterChoice::Auto {
            setup.native_adapter_selector = Some(selector(choice.clone()));
        }
    }
    configuration
}

/// Takes the chosen adapter, if the window can be drawn with it.
fn selector(choice: AdapterChoice) -> egui_wgpu::NativeAdapterSelectorMethod {
    Arc::new(move |adapters, surface| {
        let facts: Vec<AdapterFacts> = adapters.iter().map(AdapterFacts::new).collect();
        // `None` is the answer to `Auto` alone, which sets no selector.
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

/// Why the user should know what draws the window, if so.
pub fn caveat(state: &RenderState) -> Option<String> {
    AdapterFacts::new(&state.adapter).caveat()
}

/// What could draw the window, and what does.
pub fn adapters(state: &RenderState) -> (Vec<AdapterFacts>, AdapterFacts) {
    let there = state.available_adapters.iter().map(AdapterFacts::new).collect();
    (there, AdapterFacts::new(&state.adapter))
}

/// What the device says after the fact, from the start: without a listener wgpu panics.
pub fn watch(state: &RenderState) -> GpuFaults {
    let faults = GpuFaults::default();
    faults.watch(&state.device);
    faults
}

/// Lets the device say what has happened to it, without waiting.
pub fn poll(state: &RenderState) {
    // A failure to poll is the loss of the device, which the callback tells.
    let _ = state.device.poll(wgpu::PollType::Poll);
}

/// Why the GPU cannot draw the scene.
#[derive(Debug, thiserror::Error)]
pub enum ViewPaintError {
    /// A call of ours failed.
    #[error(transparent)]
    Gpu(#[from] GpuError),
    /// The device failed by itself.
    #[error("{0}")]
    Fault(String),
    /// The sorting thread did not start.
    #[error("starting the sorting thread failed: {0}")]
    Thread(#[from] std::io::Error),
}

/// Room for so many times the splats of another scene is given back.
const IDLE_ROOM: usize = 4;

/// Painter of the viewport on a real GPU.
pub struct GpuViewPainter {
    device: wgpu::Device,
    queue: wgpu::Queue,
    faults: GpuFaults,
    drawer: Drawer,
    scene: GpuScene,
    renderer: SplatRenderer,
    /// For the other picture of a comparison; made when first needed.
    second: Option<SplatRenderer>,
    photo: Option<(Arc<RgbImage>, PhotoTexture)>,
    model: Option<GpuModel>,
    compositor: Arc<Mutex<Compositor>>,
    /// Changes the GPU has not got yet; `None` while all of it must be uploaded.
    pending: Option<Vec<u32>>,
    sorter: ViewThread<SortRequest, Sorted>,
    /// What the newest order took to find.
    sort_ms: Option<f64>,
    sorted_for: Option<SortRequest>,
    is_stale: bool,
    n_drawn: usize,
}

/// A second model, which has a scene and a renderer of its own.
struct GpuModel {
    model: Arc<ComparedModel>,
    scene: GpuScene,
    renderer: SplatRenderer,
}

/// A view, and how it is drawn: once, or twice for a comparison with other splats.
type SortRequest = (Camera, RenderOptions, Option<Partner>);

struct Sorted {
    first: Vec<u32>,
    second: Option<(Partner, Vec<u32>)>,
    ms: f64,
}

impl GpuViewPainter {
    /// Builds all GPU state on eframe's device.
    pub fn new(
        state: &RenderState,
        faults: GpuFaults,
        waker: Waker,
    ) -> Result<Self, ViewPaintError> {
        let capabilities = capabilities(state);
        capabilities.check()?;
        let (device, queue) = (state.device.clone(), state.queue.clone());
        let mut scratch = SortScratch::default();
        let sort = move |splats: &SplatSet, (camera, first, second): SortRequest| {
            let started = Instant::now();
            // Copied out of the scratch, since the order leaves this thread and the memory stays.
            let mut order = |splats: &SplatSet, options: &RenderOptions| {
                back_to_front(splats, &camera, options, &mut scratch).to_vec()
            };
            let first = order(splats, &first);
            let second = second.map(|partner| {
                let order = match &partner {
                    Partner::Splats(options) => order(splats, options),
                    Partner::Model(model, options) => order(&model.splats, options),
                    Partner::Photo(_) => Vec::new(),
                };
                (partner, order)
            });
            Sorted { first, second, ms: started.elapsed().as_secs_f64() * 1e3 }
        };
        let sorter = ViewThread::start("sorting", waker, sort)?;
        Ok(Self {
            scene: GpuScene::new(&device, &queue, &[])?,
            renderer: SplatRenderer::new(&device, &queue, OrderOf::First)?,
            second: None,
            photo: None,
            model: None,
            compositor: Arc::new(Mutex::new(Compositor::new(&device, state.target_format))),
            drawer: if capabilities.has_timestamps { Drawer::Gpu } else { Drawer::UntimedGpu },
            device,
            queue,
            faults,
            pending: None,
            sorter,
            sort_ms: None,
            sorted_for: None,
            is_stale: true,
            n_drawn: 0,
        })
    }

    /// Whether its passes can be timed.
    pub fn drawer(&self) -> Drawer {
        self.drawer
    }

    /// Splats there are.
    pub fn n_drawn(&self) -> usize {
        self.n_drawn
    }

    /// Hands changed splats over; `splats` are all of them, the change applied.
    pub fn change(&mut self, change: SplatChange, splats: &SplatSet) {
        match (&change, &mut self.pending) {
            // While nothing is painted, changes come again and again: from some number on everything
            // is uploaded instead.
            (SplatChange::Some { ids, .. }, Some(pending))
                if pending.len() + ids.len() <= 2 * splats.len() =>
            {
                pending.extend(ids.iter());
            }
            // All of it is still to be uploaded, these splats among it.
            (SplatChange::Some { .. }, None) => {}
            (_, pending) => *pending = None,
        }
        self.sorter.change(change);
        self.is_stale = true;
        self.n_drawn = splats.iter().filter(|s| s.opacity > 0.0).count();
    }

    /// Draws the scene, twice where renderers are compared, and queues it for painting over `rect`.
    /// Returns what it takes; an error means that this painter is of no more use.
    pub fn paint(
        &mut self,
        ui: &Ui,
        rect: Rect,
        request: &PictureRequest,
        splats: &SplatSet,
    ) -> Result<DrawSample, ViewPaintError> {
        // Any fault ends this painter, even one of egui's drawing: both use one device, and a fault
        // does not say whose it is.
        if let Some(fault) = self.faults.take().into_iter().next() {
            return Err(ViewPaintError::Fault(fault.message));
        }
        // Uploaded before an order is set, which is refused if it names splats
        // that are not there yet.
        let mut sample = DrawSample::new(self.upload(splats)?);
        self.turn_to_model(request)?;
        self.sort(request);
        sample.add(DrawStage::Order, self.sort_ms);
        self.draw(request, &mut sample)?;
        self.compose(request)?;
        // egui keeps the callback until the window's pass, where `self` is out of its reach: hence
        // the shared compositor.
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
            sample.add(DrawStage::Preprocess, times.and_then(|times| times.preprocess));
            sample.add(DrawStage::Sort, times.and_then(|times| times.sort));
            sample.add(DrawStage::Draw, times.map(|times| times.draw));
            Ok(())
        };
        draw(&mut self.renderer, scene, &request.options)?;
        // A second renderer and not the first again: a renderer holds one camera and one
        // image for each submission.
        match request.second.as_ref().map(|second| &second.partner) {
            Some(Partner::Splats(options)) => {
                if self.second.is_none() {
                    self.second = Some(SplatRenderer::new(device, queue, OrderOf::Second)?);
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
        // Before egui submits the window's pass, which reads these images from the same queue.
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
            Some(Second { view, finish, area: second.area, how: second.how })
        });
        let image = self.renderer.target();
        let background = request.options.background;
        let mut compositor = self.compositor.lock().unwrap_or_else(PoisonError::into_inner);
        compositor.prepare_pair(&self.device, &self.queue, image, background, second);
        Ok(())
    }

    /// Brings the scene up to date; the bytes sent.
    fn upload(&mut self, splats: &SplatSet) -> Result<u64, GpuError> {
        let bytes = match self.pending.take() {
            None => {
                // Buffers are kept over replacements, since scenes grow again; only those of a far
                // larger scene are given back.
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

    /// Uploads the second model that is asked for, and lets go of one that is not.
    fn turn_to_model(&mut self, request: &PictureRequest) -> Result<(), GpuError> {
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
                renderer: SplatRenderer::new(device, queue, OrderOf::First)?,
            });
            // An order found for it before went with its scene.
            self.is_stale = true;
        }
        Ok(())
    }

    /// Takes a finished order and asks for the next one if the view or the splats changed.
    fn sort(&mut self, request: &PictureRequest) {
        let second = request.second.as_ref().map(|second| second.partner.clone());
        let second = second.filter(|partner| !matches!(partner, Partner::Photo(_)));
        let asked = (request.camera, request.options, second);
        // It may be of an older view, which nobody sees for a frame or two
        // (`rendering.md`, Uploads).
        if let Some(sorted) = self.sorter.take() {
            self.sort_ms = Some(sorted.ms);
            let set = self.scene.set_order(&self.queue, OrderOf::First, &sorted.first);
            // After the scene shrank meanwhile, a new order is needed.
            self.is_stale |= set.is_err();
            let set = match (&sorted.second, &mut self.model) {
                (Some((Partner::Splats(_), order)), _) => {
                    self.scene.set_order(&self.queue, OrderOf::Second, order)
                }
                (Some((Partner::Model(of, _), order)), Some(there))
                    if Arc::ptr_eq(of, &there.model) =>
                {
                    there.scene.set_order(&self.queue, OrderOf::First, order)
                }
                _ => Ok(()),
            };
            self.is_stale |= set.is_err();
        }
        // Not while one is being sought: that wakes the window, which then
        // asks for the newest view.
        if (self.is_stale || self.sorted_for.as_ref() != Some(&asked)) && !self.sorter.is_busy() {
            self.sorter.ask(asked.clone(), Announce::Wake);
            self.sorted_for = Some(asked);
            self.is_stale = false;
        }
    }
}

/// Draws the finished picture inside the window's pass.
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

/// Draws a pass of the window over what is kept of it, and shows that in all of the window.
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
        _: &wgpu::Queue,
        screen: &ScreenDescriptor,
        encoder: &mut wgpu::CommandEncoder,
        _: &mut CallbackResources,
    ) -> Vec<wgpu::CommandBuffer> {
        let mut window = self.window.lock().unwrap_or_else(PoisonError::into_inner);
        let list = window.turn_to(&self.pass, screen.size_in_pixels);
        window.painter.draw(device, encoder, screen.size_in_pixels, &list);
        Vec::new()
    }

    fn paint(
        &self,
        info: PaintCallbackInfo,
        pass: &mut wgpu::RenderPass<'static>,
        _: &CallbackResources,
    ) {
        let [width, height] = info.screen_size_px;
        pass.set_viewport(0.0, 0.0, width as f32, height as f32, 0.0, 1.0);
        pass.set_scissor_rect(0, 0, width, height);
        self.window.lock().unwrap_or_else(PoisonError::into_inner).painter.show(pass);
    }
}
