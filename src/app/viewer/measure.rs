//! Measuring tool: distance between two clicked points and its posterior standard deviation, and the registration that
//! follows from one to three points.
//!
//! A click finds the visible splat and the intersection of the pixel's ray with the splat's plane. The
//! mean of a component has the posterior covariance `E[Σ]/κ` (`model.md`, Posterior). The variance of a
//! distance is the sum of both ends' variances along the connecting line.

use super::world_painter::WorldPainter;
use crate::app::panels::controls::named;
use crate::app::panels::signal_color::{format_number, swatch, to_color32};
use crate::app::state::Inspected;
use crate::dataset::error::FrameError;
use crate::dataset::frame::Frame;
use crate::dataset::surface::{PixelStatus, Preparer, SurfaceCounts, SurfaceSettings};
use crate::eval::choices::GroundTruth;
use crate::eval::views::ground_truth;
use crate::export::registration::{References, Registration};
use crate::math::camera::Camera;
use crate::math::image::RgbImage;
use crate::math::sym3::Sym3;
use crate::model::splat::splats::Splat;
use crate::observation::surface::Observation;
use eframe::egui::{
    Align2, Area, Color32, DragValue, FontId, Frame as Plate, Grid, Id, Pos2, RichText, Stroke,
    TextEdit, Ui, Vec2,
};
use glam::{DQuat, DVec2, DVec3};

const LINE: Color32 = Color32::from_rgb(255, 210, 70);
/// Maximum distance between a splat's centre and a measured point in its plane, in largest standard
/// deviations of the splat.
const REACH: f64 = 4.0;

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MeasuredPoint {
    pub point: DVec3,
    /// Covariance of the position, world units²; `None` for splats from files, which contain no
    /// posterior.
    pub covariance: Option<Sym3>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MeasuredLength {
    pub length: f64,
    /// Standard deviation of the length, world units, if both ends have a posterior.
    pub deviation: Option<f64>,
}

/// World of the measured points, and the coordinates of files.
pub struct MeasuredWorld<'a> {
    pub registration: Option<&'a Registration>,
    /// Up direction in the world.
    pub up: DVec3,
    /// Origin of splat positions in the world.
    pub origin: DVec3,
    /// True if the world's unit is the metre.
    pub is_metric: bool,
}

impl MeasuredWorld<'_> {
    fn coordinates(&self) -> Registration {
        self.registration.cloned().unwrap_or_else(|| Registration::world(self.is_metric))
    }
}

/// Fields of the tool's panel.
#[derive(Clone, Debug)]
struct Fields {
    length: f64,
    is_metric: bool,
    place: [f64; 3],
    system: String,
    problem: Option<&'static str>,
}

impl Default for Fields {
    fn default() -> Self {
        let (length, place, system) = (1.0, [0.0; 3], String::new());
        Self { length, is_metric: true, place, system, problem: None }
    }
}

/// Maximum number of measured points.
const MOST_ENDS: usize = 3;

/// Measuring tool with up to three measured points.
#[derive(Clone, Debug, Default)]
pub struct MeasureTool {
    pub is_on: bool,
    ends: Vec<MeasuredPoint>,
    fields: Fields,
    /// Registration that the user has set; `Some(None)` to remove it.
    asked: Option<Option<Registration>>,
    /// Slot of the clicked splat, and the measured point, until the trainer has inspected the splat.
    // Only the trainer knows the posterior of a component.
    pub(super) waiting: Option<(u32, DVec3)>,
}

impl MeasureTool {
    pub fn toggle(&mut self) {
        *self = Self { is_on: !self.is_on, ..Self::default() };
    }

    /// Adds the clicked point once its splat is inspected. A fourth point starts a new measurement.
    pub fn add_inspected_point(&mut self, inspected: Option<&Inspected>) {
        let (Some((id, point)), Some(inspected)) = (self.waiting, inspected) else { return };
        // The snapshot may still inspect the splat clicked before.
        if inspected.id() != id {
            return;
        }
        self.waiting = None;
        if self.ends.len() == MOST_ENDS {
            self.ends.clear();
        }
        self.fields.problem = None;
        let covariance = match inspected {
            Inspected::Component(i) => Some(i.covariance.scaled(1.0 / i.posterior.kappa_space)),
            Inspected::Splat { .. } => None,
        };
        self.ends.push(MeasuredPoint { point, covariance });
        // The GUI tests parse this line and that of the photograph (`tests/app/journey.rs`).
        tracing::debug!("measured from {point:.3}: {:?}", self.length());
    }

    pub fn n_ends(&self) -> usize {
        self.ends.len()
    }

    pub fn length(&self) -> Option<MeasuredLength> {
        let &[a, b] = self.ends.as_slice() else { return None };
        let line = b.point - a.point;
        let length = line.length();
        // Two clicks at the same point have no direction.
        let along = line / length.max(f64::MIN_POSITIVE);
        let variance = |end: MeasuredPoint| end.covariance.map(|c| c.quadratic_form(along));
        let deviation = variance(a).zip(variance(b)).map(|(a, b)| (a + b).sqrt());
        Some(MeasuredLength { length, deviation })
    }

    pub fn hint(&self) -> Option<&'static str> {
        match self.ends.len() {
            _ if !self.is_on => None,
            0 => Some("Measure: click the first point (M to exit)"),
            1 => Some("Measure: click the second point"),
            2 => Some("Measure: click a third point to level a surface"),
            _ => None,
        }
    }

    /// Returns the registration that was set in the panel, once.
    pub fn take_registration(&mut self) -> Option<Option<Registration>> {
        self.asked.take()
    }

    /// Draws the panel in which measured points become references of the exports' coordinates. `corner` is its upper
    /// left corner.
    pub fn ui(&mut self, ui: &Ui, corner: Pos2, world: &MeasuredWorld<'_>) {
        if self.ends.is_empty() && world.registration.is_none() {
            return;
        }
        Area::new(Id::unique("measure")).fixed_pos(corner).show(ui.ctx(), |ui| {
            Plate::popup(ui.style()).show(ui, |ui| {
                ui.label(RichText::new("Coordinates of exports").strong());
                let at = world.coordinates();
                let of = |end: &MeasuredPoint| at.apply(end.point + world.origin);
                let ends: Vec<DVec3> = self.ends.iter().map(of).collect();
                if let Some(references) = self.references(&ends, ui) {
                    self.set(&references, world, at);
                }
                if let Some(problem) = self.fields.problem {
                    ui.colored_label(ui.visuals().error_fg_color, problem);
                }
                if let Some(registration) = world.registration {
                    ui.separator();
                    ui.weak(registration.to_string());
                    let hint = "Exports have the coordinates of the dataset again";
                    if ui.button("Clear").on_hover_text(hint).clicked() {
                        self.asked = Some(None);
                    }
                }
            });
        });
    }

    /// Draws the rows for the measured points, whose coordinates are given. Returns the references that the user sets.
    fn references(&mut self, ends: &[DVec3], ui: &mut Ui) -> Option<References> {
        let Fields { length, is_metric, place, system, .. } = &mut self.fields;
        let none = References::default();
        match *ends {
            [point] => {
                ui.label(format!("This point is at {point:.3}"));
                ui.horizontal(|ui| {
                    for (value, axis) in place.iter_mut().zip(["X", "Y", "Z"]) {
                        let field = DragValue::new(value).speed(0.1).prefix(format!("{axis} "));
                        named(ui.add(field), axis);
                    }
                    let field =
                        TextEdit::singleline(system).desired_width(90.0).hint_text("EPSG:25832");
                    named(ui.add(field), "Coordinate system");
                });
                let is_set = ui.button("Move it there").clicked();
                is_set
                    .then(|| References { pairs: vec![[point, DVec3::from_array(*place)]], ..none })
            }
            [a, b] => {
                ui.horizontal(|ui| {
                    ui.label("True length");
                    let field = DragValue::new(length).speed(0.01).range(1e-6..=1e9);
                    named(ui.add(field), "True length");
                    ui.checkbox(is_metric, "metres");
                });
                let is_set = ui.button("Set scale").clicked();
                is_set.then_some(References { length: Some(([a, b], *length)), ..none })
            }
            [a, b, c] => {
                ui.label("The three points lie on a level surface, such as the floor");
                let is_set = ui.button("Set level").clicked();
                is_set.then_some(References { floor: Some([a, b, c]), ..none })
            }
            _ => None,
        }
    }

    /// Asks for the registration that references in coordinates `at` lead to.
    fn set(&mut self, references: &References, world: &MeasuredWorld<'_>, at: Registration) {
        let up = DQuat::from_array(at.rotation) * world.up;
        let system = match references.pairs.is_empty() || self.fields.system.is_empty() {
            true => at.system.clone(),
            false => Some(self.fields.system.clone()),
        };
        let is_metric = match references.length {
            Some(_) => self.fields.is_metric,
            None => at.is_metric,
        };
        let next = Registration::of(references, up);
        let next = next.map(|next| Registration { system, is_metric, ..at.then(&next) });
        self.fields.problem = None;
        match next {
            Ok(next) if next.check().is_ok() => self.asked = Some(Some(next)),
            Ok(_) => {
                self.fields.problem =
                    Some("Expected numbers and an ASCII name of at most 200 characters")
            }
            Err(_) => {
                self.fields.problem = Some("These points coincide or lie on a line: click others")
            }
        }
    }

    pub fn draw(&self, world: &WorldPainter, measured: &MeasuredWorld<'_>) {
        for end in &self.ends {
            if let Some(at) = world.position(end.point) {
                world.painter.circle_filled(at, 4.0, LINE);
            }
        }
        if let &[a, b, c] = self.ends.as_slice() {
            for pair in [[a, b], [b, c], [c, a]] {
                world.line(pair.map(|end| end.point), Stroke::new(2.0, LINE));
            }
        }
        let (&[a, b], Some(length)) = (self.ends.as_slice(), self.length()) else { return };
        world.line([a.point, b.point], Stroke::new(2.0, LINE));
        let text = format_length(length, &measured.coordinates());
        if let Some(at) = world.position(0.5 * (a.point + b.point)) {
            let (painter, font) = (&world.painter, FontId::proportional(15.0));
            let galley = painter.layout_no_wrap(text, font, Color32::WHITE);
            let size = galley.size() + Vec2::new(12.0, 6.0);
            let plate = Align2::CENTER_BOTTOM.anchor_size(at - Vec2::new(0.0, 8.0), size);
            painter.rect_filled(plate, 4.0, Color32::from_black_alpha(190));
            painter.galley(plate.min + Vec2::new(6.0, 3.0), galley, Color32::WHITE);
        }
    }
}

fn format_length(measured: MeasuredLength, coordinates: &Registration) -> String {
    let unit = if coordinates.is_metric { "m" } else { "units" };
    let length = coordinates.scale * measured.length;
    let deviation = measured.deviation.map(|deviation| coordinates.scale * deviation);
    match deviation.filter(|deviation| (1e-6..1e6).contains(deviation)) {
        Some(deviation) => {
            // To the first digit of the deviation.
            let digits = (-deviation.log10()).ceil().max(0.0) as usize;
            format!("{length:.digits$} ± {deviation:.digits$} {unit}")
        }
        None => format!("{} {unit}", format_number(length)),
    }
}

/// Returns the intersection of a pixel's ray with the plane of the visible splat. If the intersection is
/// too far from the splat's centre or does not exist, returns the centre.
pub fn surface_point(splat: &Splat, camera: &Camera, pixel: DVec2) -> DVec3 {
    let mean = DVec3::from_array(splat.mean.map(f64::from));
    let [w, x, y, z] = splat.rotation.map(f64::from);
    let scale = splat.scale.map(f64::from);
    let normal = DQuat::from_xyzw(x, y, z, w).normalize() * DVec3::AXES[splat.thinnest_axis()];
    let k = &camera.intrinsics;
    let ray = DVec3::new((pixel.x - k.cx) / k.fx, (pixel.y - k.cy) / k.fy, 1.0);
    let (eye, ray) = (camera.pose.centre(), camera.pose.rotation() * ray);
    // Infinite or NaN for a ray parallel to the plane; checked below.
    let share = normal.dot(mean - eye) / normal.dot(ray);
    let point = eye + ray * share;
    let reach = REACH * scale.into_iter().fold(0.0, f64::max);
    match share.is_finite() && share > 0.0 && point.distance(mean) <= reach {
        true => point,
        false => mean,
    }
}

/// Opacity of the colour over a pixel that training drops.
// Below 1, so that the photograph shows through.
const OVERLAY: f32 = 0.7;

/// Reason why training drops a pixel: the pixel's status, sRGB colour, label, and function that counts such
/// pixels. The colours are distinguishable with red-green blindness (Okabe and Ito 2008).
type Reason = (PixelStatus, [f32; 3], &'static str, fn(&SurfaceCounts) -> usize);

/// All reasons, in the order of the checks.
// A pixel has the status of the first check that it fails.
const REASONS: [Reason; 7] = [
    (PixelStatus::Hole, [0.25; 3], "no depth", |c| c.holes),
    (PixelStatus::Alpha, [0.94, 0.89, 0.26], "partly transparent", |c| c.dropped_alpha),
    (PixelStatus::Range, [0.34, 0.71, 0.91], "outside the trusted depth range", |c| {
        c.dropped_range
    }),
    (PixelStatus::Flying, [0.84, 0.37, 0.0], "no plane fits", |c| c.dropped_flying),
    (PixelStatus::Slant, [0.0, 0.62, 0.45], "too oblique", |c| c.dropped_slant),
    (PixelStatus::Far, [0.0, 0.45, 0.7], "too far from the origin", |c| c.dropped_far),
    (PixelStatus::NoColor, [0.8, 0.47, 0.65], "outside the photograph", |c| c.dropped_no_color),
];

/// Prepares frames in the same way as training and paints the status of each pixel.
pub struct PixelStatusPainter {
    preparer: Preparer,
    observation: Observation,
}

impl PixelStatusPainter {
    pub(in crate::app) fn new() -> Self {
        Self { preparer: Preparer::new(), observation: Observation::empty() }
    }

    /// Returns the frame as training uses it, composited over `background` (sRGB-encoded). Pixels that
    /// become points have the colours of the points; dropped pixels are tinted by reason.
    ///
    /// # Errors
    /// If the frame has no depth.
    pub fn paint(
        &mut self,
        frame: &Frame,
        settings: &SurfaceSettings,
        background: [f32; 3],
    ) -> Result<(RgbImage, SurfaceCounts), FrameError> {
        let counts = self.preparer.prepare(frame, settings, &mut self.observation)?;
        // Statuses refer to depth pixels, whatever size the photograph has.
        let mut image =
            ground_truth(&frame.with_registered_color(), GroundTruth::Composited, background);
        for (pixel, &status) in image.data.iter_mut().zip(&self.preparer.statuses().data) {
            if let Some((_, color, ..)) = REASONS.iter().find(|reason| reason.0 == status) {
                *pixel = std::array::from_fn(|i| OVERLAY * color[i] + (1.0 - OVERLAY) * pixel[i]);
            }
        }
        for point in &self.observation.points {
            image.data[point.pixel as usize] = point.color;
        }
        Ok((image, counts))
    }
}

/// Draws the legend with the fraction of pixels of each status. `corner` is its lower right corner.
pub fn legend(counts: &SurfaceCounts, corner: Pos2, ui: &Ui) {
    let area = Area::new(Id::unique("pixel status")).fixed_pos(corner).pivot(Align2::RIGHT_BOTTOM);
    // Not interactable: the pointer steers the camera below.
    area.interactable(false).show(ui.ctx(), |ui| {
        Plate::popup(ui.style()).show(ui, |ui| {
            ui.label(RichText::new("Preparation").strong());
            Grid::new("pixel status").num_columns(3).show(ui, |ui| {
                let n_pixels = counts.kept + counts.holes + counts.dropped();
                // At least 1: an image without pixels has no shares.
                let share = |n: usize| n as f64 / n_pixels.max(1) as f64;
                row(ui, None, "used", share(counts.kept));
                for (_, color, label, count) in REASONS {
                    if count(counts) > 0 {
                        row(ui, Some(color), label, share(count(counts)));
                    }
                }
            });
        });
    });
}

fn row(ui: &mut Ui, color: Option<[f32; 3]>, label: &str, share: f64) {
    swatch(color.map(to_color32), ui);
    ui.label(label);
    ui.label(RichText::new(format!("{:.1} %", 100.0 * share)).monospace());
    ui.end_row();
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::camera::Intrinsics;
    use crate::math::pose::Pose;

    fn end(x: f64, variance: Option<f64>) -> MeasuredPoint {
        let point = DVec3::new(x, 0.0, 0.0);
        MeasuredPoint { point, covariance: variance.map(Sym3::diagonal) }
    }

    #[test]
    fn variances_of_both_ends_add_up_and_files_know_none() {
        let ends = vec![end(1.0, Some(9.0)), end(4.0, Some(16.0))];
        let tool = MeasureTool { is_on: true, ends, ..MeasureTool::default() };
        assert_eq!(tool.length(), Some(MeasuredLength { length: 3.0, deviation: Some(5.0) }));
        let ends = vec![end(1.0, Some(9.0)), end(4.0, None)];
        let tool = MeasureTool { is_on: true, ends, ..MeasureTool::default() };
        assert_eq!(tool.length(), Some(MeasuredLength { length: 3.0, deviation: None }));
    }

    #[test]
    fn lengths_have_the_digits_that_are_known() {
        let text = |length, deviation, coordinates: &Registration| {
            format_length(MeasuredLength { length, deviation }, coordinates)
        };
        let metres = Registration::world(true);
        assert_eq!(text(1.580_31, Some(4.76e-4), &metres), "1.5803 ± 0.0005 m");
        assert_eq!(text(120.4, Some(3.2), &metres), "120 ± 3 m");
        assert_eq!(text(1.25, None, &metres), "1.25 m");
        let scaled = Registration { scale: 2.0, ..Registration::world(false) };
        assert_eq!(text(1.25, Some(0.01), &scaled), "2.50 ± 0.02 units");
    }

    #[test]
    fn a_ray_meets_the_plane_of_a_flat_splat_and_else_its_centre() {
        let intrinsics = Intrinsics::from_horizontal_fov(100, 100, 1.0);
        let camera = Camera { intrinsics, pose: Pose::IDENTITY };
        let flat = Splat {
            mean: [0.0, 0.0, 2.0],
            opacity: 1.0,
            color: [0.0; 3],
            scale: [1.0, 1.0, 0.01],
            rotation: [1.0, 0.0, 0.0, 0.0],
        };
        let at = surface_point(&flat, &camera, DVec2::new(100.0, 50.0));
        assert!((at - DVec3::new(2.0 * 0.5f64.tan(), 0.0, 2.0)).length() < 1e-9, "{at}");
        let small = Splat { scale: [0.1, 0.1, 0.01], ..flat };
        let at = surface_point(&small, &camera, DVec2::new(100.0, 50.0));
        assert_eq!(at, DVec3::new(0.0, 0.0, 2.0), "too far out to be this splat's");
    }
}
