//! Painting with a real GPU: hands eframe's device to `render::gpu` and draws its result inside the
//! window's own pass. The only file of the window that knows wgpu.

use super::feed::SplatChange;
use super::view_thread::{Announce, ViewThread};
use super::worker::Waker;
use crate::math::camera::Camera;
use crate::model::splats::Splat;
use crate::render::RenderOptions;
use crate::render::gpu::GpuError;
use crate::render::gpu::adapters::{self, AdapterChoice, AdapterFacts};
use crate::render::gpu::composite::Compositor;
use crate::render::gpu::context::GpuCaps;
use crate::render::gpu::faults::GpuFaults;
use crate::render::gpu::projected::{ProjectedRenderer, RenderSettings};
use crate::render::gpu::scene::GpuScene;
use crate::render::gpu::sort::{SortScratch, back_to_front};
use eframe::egui::{PaintCallbackInfo, Rect, Ui};
use eframe::egui_wgpu::{self, CallbackResources, CallbackTrait, RenderState};
use std::sync::{Arc, Mutex, PoisonError};

/// The adapter eframe chose, and what it can do.
pub fn capabilities(state: &RenderState) -> GpuCaps {
    GpuCaps::new(&state.adapter, &state.device)
}

/// Asks for all the adapter offers, since the default limits bind 128 MiB only.
pub fn wgpu_configuration(choice: &AdapterChoice) -> egui_wgpu::WgpuConfiguration {
    let mut configuration = egui_wgpu::WgpuConfiguration::default();
    if let egui_wgpu::WgpuSetup::CreateNew(setup) = &mut configuration.wgpu_setup {
        setup.device_descriptor = Arc::new(crate::render::gpu::context::device_descriptor);
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
pub enum PaintError {
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

/// Painter of the viewport on a real GPU.
pub struct GpuPainter {
    device: wgpu::Device,
    queue: wgpu::Queue,
    faults: GpuFaults,
    scene: GpuScene,
    renderer: ProjectedRenderer,
    compositor: Arc<Mutex<Compositor>>,
    /// Changes the GPU has not got yet; `None` while all of it must be uploaded.
    pending: Option<Vec<u32>>,
    sorter: ViewThread<(Camera, f32), Vec<u32>>,
    sorted_for: Option<Camera>,
    is_stale: bool,
    n_drawn: usize,
}

impl GpuPainter {
    /// Builds all GPU state on eframe's device.
    pub fn new(state: &RenderState, faults: GpuFaults, waker: Waker) -> Result<Self, PaintError> {
        capabilities(state).check()?;
        let (device, queue) = (state.device.clone(), state.queue.clone());
        let mut scratch = SortScratch::default();
        let sort = move |splats: &[Splat], (camera, near): (Camera, f32)| {
            back_to_front(splats, &camera, near, &mut scratch).to_vec()
        };
        let sorter = ViewThread::start("sorting", waker, sort)?;
        Ok(Self {
            scene: GpuScene::new(&device, &queue, &[])?,
            renderer: ProjectedRenderer::new(&device, &queue)?,
            compositor: Arc::new(Mutex::new(Compositor::new(&device, state.target_format))),
            device,
            queue,
            faults,
            pending: None,
            sorter,
            sorted_for: None,
            is_stale: true,
            n_drawn: 0,
        })
    }

    /// Hands changed splats over; `splats` are all of them, the change applied.
    pub fn change(&mut self, change: SplatChange, splats: &[Splat]) {
        match (&change, &mut self.pending) {
            (SplatChange::Some { ids, .. }, Some(pending)) => pending.extend(ids),
            (SplatChange::Some { .. }, None) => {}
            (SplatChange::All(_), pending) => *pending = None,
        }
        self.sorter.change(change);
        self.is_stale = true;
        self.n_drawn = splats.iter().filter(|s| s.opacity > 0.0).count();
    }

    /// Draws the scene and queues it for painting over `rect`. Returns the number of splats there
    /// are; an error means that this painter is of no more use.
    pub fn paint(
        &mut self,
        ui: &Ui,
        rect: Rect,
        camera: Camera,
        options: &RenderOptions,
        splats: &[Splat],
    ) -> Result<usize, PaintError> {
        if let Some(fault) = self.faults.take().into_iter().next() {
            return Err(PaintError::Fault(fault.message));
        }
        self.upload(splats)?;
        self.sort(camera, options.near as f32);
        let mut encoder =
            self.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        let settings = RenderSettings { near: options.near as f32, extent_cap: f32::INFINITY };
        self.renderer.render(
            &self.device,
            &self.queue,
            &mut encoder,
            &self.scene,
            &camera,
            settings,
        )?;
        self.queue.submit([encoder.finish()]);
        let mut compositor = self.compositor.lock().unwrap_or_else(PoisonError::into_inner);
        compositor.prepare(&self.device, &self.queue, self.renderer.target(), options.background);
        drop(compositor);
        let callback = PaintScene(self.compositor.clone());
        ui.painter().add(egui_wgpu::Callback::new_paint_callback(rect, callback));
        Ok(self.n_drawn)
    }

    fn upload(&mut self, splats: &[Splat]) -> Result<(), GpuError> {
        match self.pending.take() {
            None => self.scene = GpuScene::new(&self.device, &self.queue, splats)?,
            Some(ids) if ids.is_empty() => {}
            Some(ids) => {
                self.scene.update(&self.device, &self.queue, &ids, splats)?;
            }
        }
        self.pending = Some(Vec::new());
        Ok(())
    }

    /// Takes a finished order and asks for the next one if the view or the splats changed.
    fn sort(&mut self, camera: Camera, near: f32) {
        if let Some(order) = self.sorter.take()
            && self.scene.set_order(&self.queue, &order).is_err()
        {
            self.is_stale = true; // the scene shrank meanwhile: a new order is on its way
        }
        if (self.is_stale || self.sorted_for != Some(camera)) && !self.sorter.is_busy() {
            self.sorter.ask((camera, near), Announce::Wake);
            self.sorted_for = Some(camera);
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
