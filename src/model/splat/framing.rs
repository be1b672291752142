//! Camera framing: the centre of a scene and the radius that should be visible.
//!
//! The scene must not be cropped, and a few distant stray splats must not make it tiny. The core is a
//! sphere that holds nine tenths of the splats. From there, the radius grows shell by shell while
//! shells contain splats. A fixed share of splats would crop protruding parts (Lego's shovel), while
//! all splats would include every stray.

use super::splats::Splat;
use glam::{DMat3, DQuat, DVec3};

/// Sphere around the part of a scene that should be visible.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Framing {
    /// Centre, world units.
    pub centre: DVec3,
    /// Radius, world units.
    pub radius: f64,
}

// Share of the splats in the scene's core.
const CORE_SHARE: f64 = 0.9;
/// Thickness of a shell around the core, relative to the core's radius.
const SHELL: f64 = 0.25;
/// Maximum number of shells around the core. Anything farther away, such as sky and hills, surrounds the
/// scene and is not part of it.
const N_SHELLS: usize = 6;
/// Minimum share of all splats in a shell that is part of the scene. A shell with fewer splats contains
/// only strays.
// A Kinect room has a shell of 1/1500 between its walls and floaters behind a window.
const STRAY_SHARE: f64 = 1.0 / 1000.0;
/// Visible extent of a splat from its centre, in standard deviations.
const VISIBLE_SIGMAS: f64 = 2.5;
/// Factor on the radius that adds a margin around the visible splats.
const AIR: f64 = 1.03;

impl Framing {
    /// Returns the distance from the sphere's centre at which the sphere just fills a field of view
    /// (radians).
    pub fn distance(&self, fov: f64) -> f64 {
        (self.radius / (0.5 * fov).sin()).max(1e-6)
    }
}

/// Returns the sphere that frames the finite splats; `None` if there are none.
pub fn framing<'a>(splats: impl IntoIterator<Item = &'a Splat>) -> Option<Framing> {
    let blobs: Vec<SplatExtent> =
        splats.into_iter().filter(|s| s.is_finite()).map(SplatExtent::new).collect();
    let middle = median(&blobs)?;
    let reaches: Vec<f64> = blobs.iter().map(|blob| blob.reach(middle)).collect();
    let end = end_of_scene(&reaches, quantile(reaches.clone(), CORE_SHARE)?);
    let scene = || blobs.iter().zip(&reaches).filter(|(_, reach)| **reach <= end).map(|(b, _)| b);
    // The median lies where splats are dense, which may be far from the centre of their extent.
    let none = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    let (lo, hi) = scene().fold(none, |(lo, hi), blob| {
        let half = blob.half_extent();
        (lo.min(blob.centre - half), hi.max(blob.centre + half))
    });
    let centre = 0.5 * (lo + hi);
    let radius = AIR * scene().map(|blob| blob.reach(centre)).fold(0.0, f64::max);
    // A radius of 0 would leave the camera no distance.
    Some(Framing { centre, radius: radius.max(1e-6) })
}

/// Returns the core sphere: it is centred at the median of the finite splats and holds nine tenths of
/// their centres. It excludes protruding parts. Rendering benchmarks use this viewpoint.
pub fn core_sphere(splats: &[Splat]) -> Option<Framing> {
    let blobs: Vec<SplatExtent> =
        splats.iter().filter(|s| s.is_finite()).map(SplatExtent::new).collect();
    let centre = median(&blobs)?;
    let away = blobs.iter().map(|blob| blob.centre.distance(centre)).collect();
    // A radius of 0 would leave the camera no distance.
    Some(Framing { centre, radius: quantile(away, CORE_SHARE)?.max(1e-6) })
}

/// Returns the median of the centres, per axis; it is insensitive to distant strays.
fn median(blobs: &[SplatExtent]) -> Option<DVec3> {
    let axis = |i: usize| quantile(blobs.iter().map(|blob| blob.centre[i]).collect(), 0.5);
    Some(DVec3::new(axis(0)?, axis(1)?, axis(2)?))
}

/// Returns the radius of the scene, given the radius of the core and the reach of every splat. The
/// reach is the distance from the centre to the far side of the splat.
fn end_of_scene(reaches: &[f64], core: f64) -> f64 {
    let mut counts = [0usize; N_SHELLS];
    for reach in reaches.iter().filter(|reach| **reach > core) {
        // The core has no extent if most splats are points at one place.
        let shell = ((reach / core.max(f64::MIN_POSITIVE) - 1.0) / SHELL) as usize;
        if let Some(count) = counts.get_mut(shell) {
            *count += 1;
        }
    }
    let most_strays = reaches.len() as f64 * STRAY_SHARE;
    let n_shells = counts.iter().take_while(|count| **count as f64 > most_strays).count();
    core * (1.0 + SHELL * n_shells as f64)
}

fn quantile(mut values: Vec<f64>, share: f64) -> Option<f64> {
    // A share of 1 would name the value after the last.
    let n = ((values.len() as f64 * share) as usize).min(values.len().checked_sub(1)?);
    Some(*values.select_nth_unstable_by(n, f64::total_cmp).1)
}

struct SplatExtent {
    centre: DVec3,
    /// Half axes of the visible ellipsoid: each column is an axis of the splat, scaled to its visible
    /// extent.
    axes: DMat3,
}

impl SplatExtent {
    fn new(splat: &Splat) -> Self {
        let q = splat.quaternion();
        // Files may hold a zero quaternion.
        let q = if q.length_squared() > 0.0 { q.normalize() } else { DQuat::IDENTITY };
        let rotation = DMat3::from_quat(q);
        let scale = VISIBLE_SIGMAS * DVec3::from_array(splat.scale.map(f64::from));
        Self {
            centre: DVec3::from_array(splat.mean.map(f64::from)),
            axes: rotation * DMat3::from_diagonal(scale),
        }
    }

    /// Returns the distance from the point `from` to the far side of the splat.
    fn reach(&self, from: DVec3) -> f64 {
        let away = self.centre - from;
        // For a splat centred at `from` the longest axis counts.
        let Some(direction) = away.try_normalize() else {
            let [x, y, z] = [self.axes.x_axis, self.axes.y_axis, self.axes.z_axis];
            return x.length().max(y.length()).max(z.length());
        };
        away.length() + (self.axes.transpose() * direction).length()
    }

    /// Returns half of the splat's visible extent along each world axis.
    fn half_extent(&self) -> DVec3 {
        let rows = self.axes.transpose();
        DVec3::new(rows.x_axis.length(), rows.y_axis.length(), rows.z_axis.length())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(x: f32, y: f32, z: f32) -> Splat {
        Splat { mean: [x, y, z], opacity: 0.9, scale: [0.01; 3], ..Splat::default() }
    }

    /// Returns a cube of 10 × 10 × 10 splats with an edge length of 2.
    fn cube() -> Vec<Splat> {
        let side = |i: usize| -1.0 + 2.0 * i as f32 / 9.0;
        (0..1000).map(|i| at(side(i / 100), side(i / 10 % 10), side(i % 10))).collect()
    }

    #[test]
    fn all_of_a_scene_lies_inside_with_what_sticks_out_of_it() {
        let mut splats = cube();
        // A mast on one side, made of a fiftieth of the splats.
        splats.extend((0..20).map(|i| at(0.0, 0.0, 1.0 + 0.05 * i as f32)));
        let found = framing(&splats).unwrap();
        for splat in &splats {
            let away = DVec3::from_array(splat.mean.map(f64::from)).distance(found.centre);
            assert!(away + 0.02 < found.radius, "{:?} of {found:?}", splat.mean);
        }
        assert!(found.radius < 2.2, "not much larger than half the diagonal: {found:?}");
        assert!(core_sphere(&splats).unwrap().radius < found.radius);
    }

    #[test]
    fn strays_and_a_giant_do_not_make_it_tiny() {
        let alone = framing(&cube()).unwrap();
        let mut splats = cube();
        splats.extend([at(90.0, 0.0, 0.0), at(0.0, -50.0, 3.0), at(5.0, 5.0, 5.0)]);
        splats.push(Splat { scale: [40.0; 3], ..at(0.1, 0.0, 0.0) });
        let found = framing(&splats).unwrap();
        assert!(found.radius < 1.05 * alone.radius, "{found:?} of {alone:?}");
        assert!(found.centre.distance(alone.centre) < 0.05 * alone.radius, "{found:?}");
    }

    #[test]
    fn one_splat_is_framed_by_its_size_and_none_by_nothing() {
        let one = Splat { scale: [0.2; 3], rotation: [0.0; 4], ..at(1.0, 2.0, 3.0) };
        let found = framing([&one]).unwrap();
        assert!(found.centre.distance(DVec3::new(1.0, 2.0, 3.0)) < 1e-6, "{found:?}");
        assert!((0.4..0.8).contains(&found.radius), "{found:?}");
        assert!(framing([]).is_none() && framing([&Splat::default()]).is_none());
    }
}
