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

/// Radius in standard deviations and line width in points of each outline of the selected splat.
const RIMS: [(f64, f32); 2] = [(1.0, 2.0), (2.0, 1.0)];
/// Outline colour, distinguishable from every colour of the colour ramp.
const LIGHT: Color32 = Color32::from_rgb(255, 90, 220);

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PickPurpose {
    Select,
    /// Moves the orbit centre to the clicked point.
    Pivot,
    Measure,
}

#[derive(Clone, Copy, Debug)]
pub struct PickedSplat {
    pub purpose: PickPurpose,
    pub camera: Camera,
    pub pixel: DVec2,
    /// Slot of the visible splat at this pixel, if any.
    pub splat: Option<u32>,
}

/// Job that picks the splat under a click. A new click replaces the job.
#[derive(Default)]
pub struct SplatSelection(Option<(PickedSplat, Job<Option<u32>>)>);

impl SplatSelection {
    /// Starts picking the splat under a click, and draws the outline of the selected splat.
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
        let clicked = response.interact_pointer_pos().filter(|_| response.clicked());
        let Some(at) = clicked else { return Ok(()) };
        // egui measures in points, cameras in pixels.
        let pixel = (at - response.rect.min) * ui.ctx().pixels_per_point();
        let pixel = DVec2::new(pixel.x.into(), pixel.y.into());
        let purpose = match (response.double_clicked(), measures) {
            (true, _) => PickPurpose::Pivot,
            (false, true) => PickPurpose::Measure,
            (false, false) => PickPurpose::Select,
        };
        let (options, splats, camera) =
            (options_at(request, pixel), splats.clone(), request.camera);
        // The job owns its reference to the splats and drops it before the result arrives, so that their
        // next change need not copy them.
        let find = move || pick(splats.view(), &camera, pixel, &options).map(|p| p.index as u32);
        let job = Job::start_waking("picking", waker.clone(), find)?;
        self.0 = Some((PickedSplat { purpose, camera, pixel, splat: None }, job));
        Ok(())
    }

    pub fn take_picked(&mut self) -> Option<Result<PickedSplat, PanicReport>> {
        let (asked, job) = self.0.as_ref()?;
        let (asked, found) = (*asked, job.poll()?);
        self.0 = None;
        Some(found.map(|splat| PickedSplat { splat, ..asked }))
    }
}

/// Returns the render options at a pixel. They may differ between the two sides of a wipe.
fn options_at(request: &PictureRequest, pixel: DVec2) -> RenderOptions {
    let width = f64::from(request.camera.intrinsics.width);
    match &request.second {
        Some(second) => match (&second.partner, second.how) {
            (Partner::Splats(options), Combination::Wipe(divider))
                // The second picture is right of the divider.
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
