//! Selected splat in the viewport: picking by click, and outline.

use super::state::{Inspected, Snapshot};
use super::viewer::photo::{Partner, PictureRequest};
use super::worker::Waker;
use crate::math::camera::Camera;
use crate::model::splat::appearance::SplatSet;
use crate::pipeline::job::Job;
use crate::pipeline::panic_report::PanicReport;
use crate::render::RenderOptions;
use crate::render::compare::Combination;
use crate::render::pick::{outline, pick};
use eframe::egui::{Color32, Pos2, Rect, Response, Stroke, Ui};
use glam::DVec2;
use std::sync::Arc;

/// Radii of the outlines, standard deviations, and their line widths, points.
const RIMS: [(f64, f32); 2] = [(1.0, 2.0), (2.0, 1.0)];
/// Visible on every colour of the ramp.
const LIGHT: Color32 = Color32::from_rgb(255, 90, 220);

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PickPurpose {
    Select,
    /// Move the orbit centre to the point.
    Pivot,
    Measure,
}

#[derive(Clone, Copy, Debug)]
pub struct PickedSplat {
    pub purpose: PickPurpose,
    pub camera: Camera,
    pub pixel: DVec2,
    /// Visible splat at this pixel, if any.
    pub splat: Option<u32>,
}

/// Picking of the splat under a click.
#[derive(Default)]
pub struct SplatSelection {
    picker: Picker,
    asked: Option<(PickPurpose, Camera, DVec2)>,
}

impl SplatSelection {
    /// Starts to pick the splat under a click, and draws the outline of the selected splat.
    #[expect(
        clippy::too_many_arguments,
        reason = "inputs of drawing, of the click and of the selection"
    )]
    pub fn ui(
        &mut self,
        ui: &Ui,
        response: &Response,
        request: &PictureRequest,
        splats: &Arc<SplatSet>,
        snapshot: &Snapshot,
        waker: &Waker,
        measures: bool,
    ) -> std::io::Result<()> {
        if let Some(inspected) = &snapshot.inspected {
            // One outline for both sides of a wipe: it is the same with either renderer.
            draw(inspected, ui, response.rect, request);
        }
        match response.interact_pointer_pos().filter(|_| response.clicked()) {
            Some(at) => {
                let pixel = (at - response.rect.min) * ui.ctx().pixels_per_point();
                let pixel = DVec2::new(pixel.x.into(), pixel.y.into());
                let options = options_at(request, pixel);
                let purpose = match (response.double_clicked(), measures) {
                    (true, _) => PickPurpose::Pivot,
                    (false, true) => PickPurpose::Measure,
                    (false, false) => PickPurpose::Select,
                };
                self.asked = Some((purpose, request.camera, pixel));
                self.picker.start_pick(
                    splats.clone(),
                    request.camera,
                    pixel,
                    options,
                    waker.clone(),
                )
            }
            None => Ok(()),
        }
    }

    /// Takes the result of a click, once.
    pub fn take_picked(&mut self) -> Option<Result<PickedSplat, PanicReport>> {
        let found = self.picker.take()?;
        let (purpose, camera, pixel) = self.asked.take()?;
        Some(found.map(|splat| PickedSplat { purpose, camera, pixel, splat }))
    }
}

/// Render options at a pixel: a wipe has two sides.
fn options_at(request: &PictureRequest, pixel: DVec2) -> RenderOptions {
    let width = f64::from(request.camera.intrinsics.width);
    match &request.second {
        Some(second) => match (&second.partner, second.how) {
            (Partner::Splats(options), Combination::Wipe(divider))
                if pixel.x >= f64::from(divider) * width =>
            {
                *options
            }
            _ => request.options,
        },
        None => request.options,
    }
}

fn draw(inspected: &Inspected, ui: &Ui, rect: Rect, request: &PictureRequest) {
    let painter = ui.painter().with_clip_rect(rect);
    let per_pixel = 1.0 / ui.ctx().pixels_per_point();
    let point = |p: DVec2| Pos2::new(p.x as f32, p.y as f32) * per_pixel + rect.min.to_vec2();
    let options = &request.options;
    for (radius, width) in RIMS {
        let lines =
            outline(inspected.splat(), &request.camera, options.method, &options.style, radius);
        for line in lines {
            painter.line_segment(line.map(point), Stroke::new(width, LIGHT));
        }
    }
}

/// Pick in progress, if any.
#[derive(Default)]
pub struct Picker(Option<Job<Option<u32>>>);

impl Picker {
    /// Starts to pick the splat at a position of the viewport, pixels; replaces a pick in progress.
    pub fn start_pick(
        &mut self,
        splats: Arc<SplatSet>,
        camera: Camera,
        position: DVec2,
        options: RenderOptions,
        waker: Waker,
    ) -> std::io::Result<()> {
        // The job owns its reference to the splats and drops it before the result arrives, so that
        // their next change need not copy them.
        let find = move || pick(&splats, &camera, position, &options).map(|p| p.index as u32);
        self.0 = Some(Job::start_waking("picking", waker, find)?);
        Ok(())
    }

    /// Takes the result, once: the splat, or `None` if there is none at that position.
    pub fn take(&mut self) -> Option<Result<Option<u32>, PanicReport>> {
        let answer = self.0.as_ref()?.poll()?;
        self.0 = None;
        Some(answer)
    }
}
