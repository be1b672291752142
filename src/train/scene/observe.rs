//! Which components a frame could see: evidence for and against them (`scene.md`, Visibility
//! counts).

use super::ledger::{Ledger, Look, Word};
use super::places::Places;
use crate::math::camera::Camera;
use crate::math::observation::Observation;
use glam::{DMat3, DVec3};

/// Runs of rows that threads take.
const PARTS: usize = 64;

/// A frame to look at components from.
struct Viewer<'a> {
    frame: &'a Observation,
    rotation: DMat3,
    centre: DVec3,
    h: f64,
}

/// Counts the looks of one frame at every component: seen where the frame measured it, missed where
/// it measured something farther; what is hidden or unknown does not count. `camera` is the frame's,
/// where it really stood.
pub fn observe<W: Word>(
    ledger: &mut Ledger<W>,
    places: Places<'_>,
    frame: &Observation,
    camera: &Camera,
    h: f64,
) {
    let pose = &camera.pose;
    let viewer = Viewer {
        frame,
        rotation: pose.rotation().transpose(),
        centre: pose.centre() - frame.origin,
        h,
    };
    ledger.for_each_part(PARTS, |first, rows, carried| {
        for (id, row) in (first..).zip(rows) {
            let (n, sum, normal) = carried.plane(id, row);
            if n == 0.0 {
                continue;
            }
            let seed = DVec3::from_array(places.of(id).map(f64::from));
            let mean = seed + DVec3::from_array(sum) * (h / n);
            if let Some((look, expected)) = viewer.look(mean, DVec3::from_array(normal)) {
                row.look(look, expected * places.components.n_seeds(id));
            }
        }
    });
}

impl Viewer<'_> {
    /// What the frame says of a component at `mean`, and the returns it could have given.
    fn look(&self, mean: DVec3, normal: DVec3) -> Option<(Look, f64)> {
        let local = self.rotation * (mean - self.centre);
        if local.z <= 0.0 {
            return None;
        }
        let k = &self.frame.camera.intrinsics;
        let (u, v) = (k.fx * local.x / local.z + k.cx, k.fy * local.y / local.z + k.cy);
        let ranges = &self.frame.ranges;
        if !(u >= 0.0 && v >= 0.0 && u < ranges.width as f64 && v < ranges.height as f64) {
            return None;
        }
        let range = local.length();
        let measured = f64::from(*ranges.at(u as usize, v as usize));
        let [constant, growing] = self.frame.tolerance.margin.map(f64::from);
        let margin = constant + growing * range;
        let look = if measured > range + margin {
            Look::Missed
        } else if (measured - range).abs() <= margin {
            Look::Seen
        } else {
            return None; // hidden, or unknown
        };
        let facing =
            (self.rotation * normal).dot(local).abs() / (range * normal.length().max(1e-30));
        Some((look, facing * self.h * self.h * k.fx * k.fy / (range * range)))
    }
}
