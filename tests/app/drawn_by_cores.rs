//! If the CPU draws the window, the result matches egui's own painter.

use super::harness::{Window, click, dataset, device, studio, train};
use crate::common::adapter::turn;
use eframe::egui::epaint::ClippedShape;
use eframe::egui::epaint::textures::TexturesDelta;
use eframe::egui::{
    Context, FullOutput, Key, PaintCallbackInfo, Plugin, Pos2, Rect, Shape, Theme, Vec2,
};
use eframe::egui_wgpu::{Callback, CallbackResources, CallbackTrait};
use egui_kittest::wgpu::WgpuTestRenderer;
use egui_kittest::{Harness, TestRenderer};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};
use vbgs_studio::app::Painting;
use vbgs_studio::app::state::Subject;

/// Records egui's shapes and textures before the window's painter replaces them.
#[derive(Clone, Default)]
struct Witness(Arc<Mutex<Handed>>);

#[derive(Default)]
struct Handed {
    /// Foreign paint callback that is drawn over everything else.
    foreign: Option<ClippedShape>,
    shapes: Vec<ClippedShape>,
    textures: TexturesDelta,
}

impl Plugin for Witness {
    fn debug_name(&self) -> &'static str {
        "witness"
    }

    fn output_hook(&mut self, _: &Context, output: &mut FullOutput) {
        let mut handed = self.0.lock().unwrap();
        output.shapes.extend(handed.foreign.clone());
        handed.shapes = output.shapes.clone();
        handed.textures.append(output.textures_delta.clone());
    }
}

/// A window and a separate egui painter for comparison.
struct Pair {
    window: Window,
    witness: Witness,
    egui: WgpuTestRenderer,
}

impl Pair {
    fn new(subject: Option<Subject>) -> Option<Self> {
        let witness = Witness::default();
        let first = witness.clone();
        let window = Harness::builder()
            .with_size(Vec2::new(1000.0, 640.0))
            .with_max_steps(8)
            .wgpu_setup(device()?)
            .build_eframe(move |cc| {
                // Added before the window's painter, which replaces all shapes.
                cc.egui_ctx.add_plugin(first);
                studio(cc, subject, Painting::Auto)
            });
        Some(Self { window, witness, egui: WgpuTestRenderer::from_setup(device()?) })
    }

    /// True if egui's only remaining shape is the callback of the window's painter.
    fn is_taken_over(&self) -> bool {
        let shapes = &self.window.output().shapes;
        matches!(&shapes[..], [shape] if matches!(shape.shape, Shape::Callback(_)))
    }

    /// Compares the last pass, which the window's painter must have drawn.
    #[track_caller]
    fn assert_alike(&mut self, what: &str) {
        assert!(
            self.is_taken_over(),
            "{what}: egui drew the window instead of the window's painter"
        );
        self.compare(what);
    }

    #[track_caller]
    fn compare(&mut self, what: &str) {
        let context = self.window.ctx.clone();
        let mut handed = self.witness.0.lock().unwrap();
        self.egui.handle_delta(&mut handed.textures);
        let area = Rect::from_min_size(Pos2::ZERO, Vec2::splat(10_000.0));
        let background = Shape::rect_filled(area, 0.0, context.global_style().visuals.panel_fill);
        let background = ClippedShape::new(area, background);
        // Not rendered by the harness, which would draw its pointer over the picture.
        let [found, expected] = [&self.window.output().shapes, &handed.shapes].map(|shapes| {
            let shapes = [std::slice::from_ref(&background), shapes].concat();
            let output = FullOutput { shapes, ..Default::default() };
            self.egui.render(&context, &output).unwrap()
        });
        assert_eq!(found.dimensions(), expected.dimensions(), "{what}");
        let differences: Vec<u8> =
            found.iter().zip(expected.iter()).map(|(a, b)| a.abs_diff(*b)).collect();
        let largest = differences.iter().max().unwrap();
        let mean =
            differences.iter().map(|&d| f64::from(d)).sum::<f64>() / differences.len() as f64;
        if *largest > MAX_DIFFERENCE || mean > MEAN_DIFFERENCE {
            let folder = std::env::temp_dir();
            found.save(folder.join("drawn-by-cores-found.png")).unwrap();
            expected.save(folder.join("drawn-by-cores-expected.png")).unwrap();
            panic!("{what}: {largest} and {mean}, see {}", folder.display());
        }
    }
}

/// Largest difference of a channel: sampler and blending weights have eight bits each.
const MAX_DIFFERENCE: u8 = 3;
/// Largest mean difference of the channels.
const MEAN_DIFFERENCE: f64 = 0.1;

#[test]
fn the_window_looks_as_egui_would_draw_it() {
    let _turn = turn();
    let folder = tempfile::tempdir().unwrap();
    let path = dataset(folder.path(), 4);
    let Some(mut pair) = Pair::new(None) else { return };
    pair.window.run_steps(2);
    pair.assert_alike("the start");
    super::harness::drop_on(&mut pair.window, &path);
    train(&mut pair.window);
    super::harness::wait_for_picture(&mut pair.window);
    pair.assert_alike("a trained scene");
    // Every step changes part of the window and reuses the rest.
    for tab in ["Quality", "Summary", "Inspector", "Edit", "Path", "Settings"] {
        click(&mut pair.window, tab);
        pair.assert_alike(tab);
    }
    for theme in [Theme::Light, Theme::Dark] {
        pair.window.ctx.set_theme(theme);
        pair.window.run_steps(3);
        assert_eq!(pair.window.ctx.theme(), theme);
        pair.assert_alike("another theme");
    }
    pair.window.hover_at(Pos2::new(30.0, 12.0));
    pair.window.run_steps(3);
    pair.assert_alike("a button under the pointer");
    click(&mut pair.window, "Open");
    pair.assert_alike("an open menu");
    pair.window.key_press(Key::Escape);
    pair.window.key_press(Key::F1);
    pair.window.run_steps(3);
    pair.assert_alike("the help");
    pair.window.key_press(Key::Escape);
    super::harness::drag(&mut pair.window, eframe::egui::PointerButton::Primary);
    pair.assert_alike("a camera that moves");
}

#[test]
fn a_window_of_another_size_or_scale_is_drawn_anew() {
    let _turn = turn();
    let Some(mut pair) = Pair::new(None) else { return };
    pair.window.run_steps(2);
    pair.assert_alike("the start");
    pair.window.set_size(Vec2::new(720.0, 500.0));
    pair.window.run_steps(2);
    pair.assert_alike("smaller");
    for scale in [1.5, 2.0, 1.0] {
        pair.window.set_pixels_per_point(scale);
        pair.window.run_steps(3);
        pair.assert_alike("another scale");
    }
}

/// Draws nothing and counts its paint calls.
struct Foreign(Arc<AtomicUsize>);

impl CallbackTrait for Foreign {
    fn paint(
        &self,
        _: PaintCallbackInfo,
        _: &mut wgpu::RenderPass<'static>,
        _: &CallbackResources,
    ) {
        self.0.fetch_add(1, Ordering::Relaxed);
    }
}

/// A foreign paint callback switches the window to egui's painter; without it the window's painter resumes
/// and redraws everything.
#[test]
fn a_window_with_a_callback_of_others_is_left_to_egui() {
    let _turn = turn();
    let Some(mut pair) = Pair::new(None) else { return };
    pair.window.run_steps(2);
    pair.assert_alike("before");
    let asked = Arc::new(AtomicUsize::new(0));
    let rect = Rect::from_min_size(Pos2::new(100.0, 100.0), Vec2::splat(50.0));
    let callback = Callback::new_paint_callback(rect, Foreign(asked.clone()));
    let foreign = ClippedShape::new(rect, Shape::Callback(callback));
    pair.witness.0.lock().unwrap().foreign = Some(foreign);
    for tab in ["Quality", "Settings"] {
        click(&mut pair.window, tab);
        assert!(!pair.is_taken_over(), "{tab}: the callback would not be called");
        let before = asked.load(Ordering::Relaxed);
        pair.compare(tab);
        // One call by the window and one by the comparison.
        assert_eq!(asked.load(Ordering::Relaxed) - before, 2, "{tab}");
    }
    pair.witness.0.lock().unwrap().foreign = None;
    pair.window.run_steps(2);
    pair.assert_alike("after");
    click(&mut pair.window, "Summary");
    pair.assert_alike("one more tab");
}
