//! The application in a window of a display server, run by eframe's event loop: screen content drawn by the
//! window's own painter, and a device lost while drawing.
#![cfg(target_os = "linux")]

use super::harness::{PATIENCE, dataset, is};
use super::window::display;
use crate::common::adapter::turn;
use eframe::egui::{ColorImage, Context, FullOutput, Plugin, Shape, Ui, Vec2, ViewportBuilder};
use std::collections::BTreeSet;
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Instant;
use vbgs_studio::app::state::{RunState, Subject};
use vbgs_studio::app::worker::{Worker, WorkerOrder};
use vbgs_studio::app::{Exit, ExitReason, Painting, Studio, run_window};
use winit::platform::x11::EventLoopBuilderExtX11;

const SIZE: [usize; 2] = [1000, 640];

/// Counts the passes that the window's own painter drew instead of egui's.
#[derive(Clone, Default)]
struct TakenOver(Arc<AtomicUsize>);

impl Plugin for TakenOver {
    fn debug_name(&self) -> &'static str {
        "taken over"
    }

    fn output_hook(&mut self, _: &Context, output: &mut FullOutput) {
        if let [shape] = &output.shapes[..]
            && matches!(shape.shape, Shape::Callback(_))
        {
            self.0.fetch_add(1, Ordering::Relaxed);
        }
    }
}

/// Wraps the application: takes one screenshot, then destroys the device.
struct Watched {
    studio: Studio,
    device: wgpu::Device,
    is_asked: bool,
    screen: Arc<Mutex<Option<Arc<ColorImage>>>>,
    started: Instant,
}

impl eframe::App for Watched {
    fn logic(&mut self, context: &Context, frame: &mut eframe::Frame) {
        self.studio.logic(context, frame);
    }

    fn ui(&mut self, ui: &mut Ui, frame: &mut eframe::Frame) {
        assert!(
            self.started.elapsed() < PATIENCE,
            "no screenshot was taken, or the device loss was not detected"
        );
        ui.ctx().request_repaint();
        if self.screen.lock().unwrap().is_some() {
            self.device.destroy();
        } else if !self.is_asked && is(RunState::Finished)(&self.studio) && self.is_seen() {
            self.is_asked = true;
            let screen = self.screen.clone();
            ui.ctx().request_screenshot(move |image| *screen.lock().unwrap() = Some(image));
        }
        self.studio.ui(ui, frame);
    }
}

impl Watched {
    fn is_seen(&self) -> bool {
        self.studio.n_drawn() > 100
    }
}

/// Runs one window until its device is lost; returns the screenshot taken before.
fn screen_of_a_window(
    worker: &Arc<Worker>,
    exit: &Exit,
    first: WorkerOrder,
    folder: &Path,
) -> Arc<ColorImage> {
    let (screen, taken_over) = (Arc::default(), TakenOver::default());
    let (own, word, found, seen) =
        (worker.clone(), exit.clone(), Arc::clone(&screen), taken_over.clone());
    let create = move |context: &eframe::CreationContext<'_>| {
        let device = context.wgpu_render_state.as_ref().unwrap().device.clone();
        let started = Instant::now();
        let studio =
            Studio::attach(context, own, vec![first], word, Painting::Auto, started).unwrap();
        // Added after the window's painter, so that it sees the painter's output.
        context.egui_ctx.add_plugin(seen);
        let watched = Watched { studio, device, is_asked: false, screen: found, started };
        Ok(Box::new(watched) as Box<dyn eframe::App>)
    };
    let size = Vec2::from(SIZE.map(|side| side as f32));
    let options = || eframe::NativeOptions {
        viewport: ViewportBuilder::default().with_inner_size(size),
        // Tests do not run on the main thread.
        event_loop_builder: Some(Box::new(|builder| {
            builder.with_x11().with_any_thread(true);
        })),
        persistence_path: Some(folder.join("app.ron")),
        ..Default::default()
    };
    run_window(worker, exit, options, create).unwrap();
    let n_taken = taken_over.0.load(Ordering::Relaxed);
    assert!(n_taken > 2, "the window's painter drew only {n_taken} passes");
    screen.lock().unwrap().take().expect("the window closed before a screenshot was taken")
}

/// Number of colours in a part of the screen.
fn n_colors(screen: &ColorImage, columns: std::ops::Range<usize>) -> usize {
    let rows = 150..450;
    let places = rows.flat_map(|y| columns.clone().map(move |x| [x, y]));
    places.map(|at| screen[(at[0], at[1])].to_array()).collect::<BTreeSet<_>>().len()
}

#[test]
fn a_screen_shows_the_window_and_a_lost_device_the_next_one() {
    let _turn = turn();
    let Some(_) = display() else { return };
    let folder = tempfile::tempdir().unwrap();
    let room = dataset(folder.path(), 3);
    let worker = Arc::new(Worker::start(Arc::new(|| {})).unwrap());
    let mut exit = Exit::default();
    let mut first = WorkerOrder::Open(Subject::Path(room));
    let mut screens = Vec::new();
    for window in 0..2 {
        exit = exit.for_next_window();
        if window == 0 {
            let trains = worker.clone();
            // Starts training as a user would, once the dataset is open.
            std::thread::spawn(move || {
                while !matches!(trains.snapshot().state, RunState::Ready) {
                    std::thread::sleep(std::time::Duration::from_millis(20));
                }
                trains.send(WorkerOrder::Train);
            });
        }
        screens.push(screen_of_a_window(&worker, &exit, first, folder.path()));
        assert_eq!(exit.reason.get(), ExitReason::DeviceLost, "window {window}");
        assert!(worker.is_alive() && worker.crash().is_none());
        first = WorkerOrder::Deliver;
    }
    for screen in &screens {
        assert_eq!(screen.size, SIZE);
        let (scene, panel) = (n_colors(screen, 50..550), n_colors(screen, 700..990));
        assert!(scene > 1000, "{scene} colours of the scene");
        assert!(panel > 20, "{panel} colours of the panel");
    }
}
