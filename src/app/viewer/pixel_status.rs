//! Status of a photograph's pixels after preparation: painted over it, with a legend.

use crate::dataset::error::FrameError;
use crate::dataset::frame::Frame;
use crate::dataset::surface::{PixelStatus, Preparer, SurfaceCounts, SurfaceSettings};
use crate::eval::choices::GroundTruth;
use crate::eval::views::ground_truth;
use crate::math::image::{RgbImage, unit_to_byte};
use crate::observation::surface::Observation;
use eframe::egui::{
    Align2, Area, Color32, Frame as Plate, Grid, Id, Pos2, RichText, Sense, Ui, Vec2,
};

/// Opacity of a status colour over a dropped pixel.
const OVERLAY: f32 = 0.7;

/// Reason why a pixel was dropped.
struct Reason {
    status: PixelStatus,
    /// Distinguishable with red-green blindness (Okabe and Ito 2008).
    color: [f32; 3],
    label: &'static str,
    count: fn(&SurfaceCounts) -> usize,
}

/// Every reason, in the order of the checks.
const REASONS: [Reason; 7] = [
    reason(PixelStatus::Hole, [0.25; 3], "no depth", |c| c.holes),
    reason(PixelStatus::Alpha, [0.94, 0.89, 0.26], "partly transparent", |c| c.dropped_alpha),
    reason(PixelStatus::Range, [0.34, 0.71, 0.91], "outside the trusted depth range", |c| {
        c.dropped_range
    }),
    reason(PixelStatus::Flying, [0.84, 0.37, 0.0], "no plane fits", |c| c.dropped_flying),
    reason(PixelStatus::Slant, [0.0, 0.62, 0.45], "too oblique", |c| c.dropped_slant),
    reason(PixelStatus::Far, [0.0, 0.45, 0.7], "too far from the origin", |c| c.dropped_far),
    reason(PixelStatus::NoColor, [0.8, 0.47, 0.65], "outside the photograph", |c| {
        c.dropped_no_color
    }),
];

const fn reason(
    status: PixelStatus,
    color: [f32; 3],
    label: &'static str,
    count: fn(&SurfaceCounts) -> usize,
) -> Reason {
    Reason { status, color, label, count }
}

/// Prepares frames like training does and paints the status of their pixels.
pub struct PixelStatusPainter {
    preparer: Preparer,
    observation: Observation,
}

impl PixelStatusPainter {
    pub fn new() -> Self {
        Self { preparer: Preparer::new(), observation: Observation::empty() }
    }

    /// Returns the frame as training uses it: points in their colours, and dropped pixels of the
    /// photograph over `background` (sRGB-encoded), tinted by reason.
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
            if let Some(Reason { color, .. }) = REASONS.iter().find(|r| r.status == status) {
                *pixel = std::array::from_fn(|i| OVERLAY * color[i] + (1.0 - OVERLAY) * pixel[i]);
            }
        }
        for point in &self.observation.points {
            image.data[point.pixel as usize] = point.color;
        }
        Ok((image, counts))
    }
}

/// Draws the legend with its lower right corner at `corner`: the share of each status.
pub fn legend(counts: &SurfaceCounts, corner: Pos2, ui: &Ui) {
    let area = Area::new(Id::unique("pixel status")).fixed_pos(corner).pivot(Align2::RIGHT_BOTTOM);
    // Not interactable: the pointer steers the camera below.
    area.interactable(false).show(ui.ctx(), |ui| {
        Plate::popup(ui.style()).show(ui, |ui| {
            ui.label(RichText::new("Preparation").strong());
            Grid::new("pixel status").num_columns(3).show(ui, |ui| {
                let n_pixels = counts.kept + counts.holes + counts.dropped();
                let share = |n: usize| n as f64 / n_pixels.max(1) as f64;
                row(ui, None, "used", share(counts.kept));
                for Reason { color, label, count, .. } in REASONS {
                    if count(counts) > 0 {
                        row(ui, Some(color), label, share(count(counts)));
                    }
                }
            });
        });
    });
}

fn row(ui: &mut Ui, color: Option<[f32; 3]>, label: &str, share: f64) {
    let (swatch, _) = ui.allocate_exact_size(Vec2::splat(10.0), Sense::hover());
    if let Some(color) = color {
        let [r, g, b] = color.map(unit_to_byte);
        ui.painter().rect_filled(swatch, 2.0, Color32::from_rgb(r, g, b));
    }
    ui.label(label);
    ui.label(RichText::new(format!("{:.1} %", 100.0 * share)).monospace());
    ui.end_row();
}
