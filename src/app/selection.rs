//! The selected splat in the viewport: choosing it by a click, and its outline.

use super::picker::Picker;
use super::software::View;
use super::state::{Inspected, Snapshot};
use super::worker::Waker;
use crate::model::splats::Splat;
use crate::render::outline::outline;
use eframe::egui::{Color32, Pos2, Rect, Response, Stroke, Ui};
use glam::DVec2;
use std::sync::Arc;

/// Rims drawn, standard deviations, and their widths, points.
const RIMS: [(f64, f32); 2] = [(1.0, 2.0), (2.0, 1.0)];
/// Seen on every colour of the ramp.
const LIGHT: Color32 = Color32::from_rgb(255, 90, 220);

/// The open question of a click.
#[derive(Default)]
pub struct Selection(Picker);

impl Selection {
    /// Asks for the splat under a click and draws the outline of the one that is selected.
    pub fn ui(
        &mut self,
        ui: &Ui,
        response: &Response,
        view: &View,
        splats: &Arc<Vec<Splat>>,
        snapshot: &Snapshot,
        waker: &Waker,
    ) -> std::io::Result<()> {
        if let Some(inspected) = &snapshot.inspected {
            draw(inspected, ui, response.rect, view);
        }
        match response.interact_pointer_pos().filter(|_| response.clicked()) {
            Some(at) => {
                let pixel = (at - response.rect.min) * ui.ctx().pixels_per_point();
                let pixel = DVec2::new(pixel.x.into(), pixel.y.into());
                self.0.ask(splats.clone(), view.camera, pixel, view.options, waker.clone())
            }
            None => Ok(()),
        }
    }

    /// What the user clicked at, once: a splat, or `Some(None)` for none.
    pub fn take_picked(&mut self) -> Option<Option<u32>> {
        self.0.take()
    }
}

fn draw(inspected: &Inspected, ui: &Ui, rect: Rect, view: &View) {
    let painter = ui.painter().with_clip_rect(rect);
    let per_pixel = 1.0 / ui.ctx().pixels_per_point();
    let point = |p: DVec2| Pos2::new(p.x as f32, p.y as f32) * per_pixel + rect.min.to_vec2();
    let options = &view.options;
    for (radius, width) in RIMS {
        let lines = outline(inspected.splat(), &view.camera, options.method, &options.look, radius);
        for line in lines {
            painter.line_segment(line.map(point), Stroke::new(width, LIGHT));
        }
    }
}
