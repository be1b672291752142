//! Registration of a scene (`files.md`, Registration): the similarity from its world to coordinates that the user
//! chose, such as metres above a floor, or those of a map.
//!
//! ```
//! use glam::DVec3;
//! use vbgs_studio::export::registration::{References, Registration};
//!
//! // A door of 2 m is 0.8 units high, and the floor is the plane y = 0.
//! let references = References {
//!     length: Some(([DVec3::ZERO, 0.8 * DVec3::NEG_Y], 2.0)),
//!     floor: Some([DVec3::ZERO, DVec3::X, DVec3::Z]),
//!     ..References::default()
//! };
//! let registration = Registration::of(&references, DVec3::NEG_Y)?;
//! assert!((registration.apply(DVec3::new(0.0, -0.8, 0.0)) - 2.0 * DVec3::Z).length() < 1e-12);
//! # Ok::<(), vbgs_studio::export::Fault>(())
//! ```

use super::error::{ExportError, Fault, shorten};
use super::gaussian::AxisRotation;
use super::read::read_file;
use crate::math::pose::{best_rotation, unit_rotation};
use crate::math::sym3::Sym3;
use glam::{DMat3, DQuat, DVec3};
use serde::{Deserialize, Serialize};
use std::fmt;
use std::path::Path;

/// Similarity from the world of a model to registered coordinates: `scale · rotation · p + translation`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Registration {
    /// Units of the coordinates per world unit, above 0.
    pub scale: f64,
    /// Unit quaternion x, y, z, w from the axes of the world to those of the coordinates.
    pub rotation: [f64; 4],
    /// Place of the world's zero.
    pub translation: [f64; 3],
    /// Name of the coordinate system, such as `EPSG:25832`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub system: Option<String>,
    /// True if the unit is known to be the metre.
    #[serde(default)]
    pub is_metric: bool,
}

/// Measurements that a registration follows from. Positions are in the world of the model.
#[derive(Clone, Debug, Default)]
pub struct References {
    /// Two points and their distance in the coordinates.
    pub length: Option<([DVec3; 2], f64)>,
    /// Three points of a level surface, whose normal becomes z.
    pub floor: Option<[DVec3; 3]>,
    /// Pairs of a position and its coordinates: one, which is moved to, or three and more, which are fitted.
    pub pairs: Vec<[DVec3; 2]>,
}

/// Distances between control points and their coordinates after registration, in units of the coordinates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Residuals {
    /// Root mean square.
    pub rms: f64,
    /// The largest.
    pub largest: f64,
    /// Index of the pair with the largest.
    pub worst: usize,
    /// Root mean square distance of the coordinates from their mean.
    pub spread: f64,
}

/// Largest distance of a zero from that of its coordinates that 32-bit positions carry, world units: that of
/// datasets in metres.
const FAR: f64 = 320.0;
/// Largest ratio of width to length of points that count as lying on a line.
const LINE: f64 = 1e-3;
/// Largest number of control points in a file.
const MAX_PAIRS: usize = 10_000;
/// Largest size of a file of control points, bytes.
const MAX_TEXT_BYTES: u64 = 4 << 20;
/// Longest name of a coordinate system, bytes. It has to fit into a comment.
const MAX_NAME: usize = 200;

impl Registration {
    /// Finds the registration of references in a world with the given up direction. Scale and rotation that no
    /// reference determines stay those of the world. Three and more pairs are fitted by least squares (Umeyama), with the
    /// scale of a given length.
    ///
    /// # Errors
    /// [`Fault::Setting`] for references that do not determine a similarity.
    pub fn of(references: &References, up: DVec3) -> Result<Self, Fault> {
        let References { length, floor, pairs } = references;
        let scale = length.map(|(ends, length)| scale_of(ends, length)).transpose()?;
        let level = floor.map(|points| level(points, up)).transpose()?;
        let (scale, rotation, [from, to]) = match &pairs[..] {
            [] => (scale.unwrap_or(1.0), level.unwrap_or_default(), [DVec3::ZERO; 2]),
            [pair] => (scale.unwrap_or(1.0), level.unwrap_or_default(), *pair),
            _ if level.is_some() => {
                let expected = "one pair of control points beside a floor";
                return Err(Fault::setting("--to", expected, pairs.len()));
            }
            [_, _] => {
                let expected = "one pair of control points, or three and more";
                return Err(Fault::setting("--to", expected, "2"));
            }
            _ => fitted(pairs, scale)?,
        };
        let rotation = rotation.normalize();
        let registration = Self {
            scale,
            rotation: rotation.to_array(),
            translation: (to - scale * (rotation * from)).to_array(),
            system: None,
            is_metric: false,
        };
        registration.check().map_err(|found| Fault::setting("references", REGISTRATION, found))?;
        Ok(registration)
    }

    /// Checks values from outside the program. On failure returns what was found.
    pub fn check(&self) -> Result<(), String> {
        let Self { scale, rotation, translation, system, .. } = self;
        let is_name = |name: &String| {
            name.len() <= MAX_NAME && name.bytes().all(|b| (b' '..=b'~').contains(&b))
        };
        if !(*scale > 0.0 && scale.is_finite()) {
            return Err(format!("scale {scale}"));
        }
        if unit_rotation(*rotation).is_none() {
            return Err(format!("rotation {rotation:?}"));
        }
        match system.as_ref().filter(|name| !is_name(name)) {
            _ if !translation.iter().all(|v| v.is_finite()) => {
                Err(format!("translation {translation:?}"))
            }
            Some(name) => Err(format!("the name {:?}", shorten(name))),
            None => Ok(()),
        }
    }

    /// Returns the registration whose coordinates are the world.
    pub fn world(is_metric: bool) -> Self {
        let rotation = DQuat::IDENTITY.to_array();
        Self { scale: 1.0, rotation, translation: [0.0; 3], system: None, is_metric }
    }

    /// Returns the similarity that applies this one and then `next`, with system and unit of this one.
    pub fn then(&self, next: &Self) -> Self {
        let [first, second] = [self, next].map(|of| DQuat::from_array(of.rotation));
        Self {
            scale: next.scale * self.scale,
            rotation: (second * first).normalize().to_array(),
            translation: next.apply(DVec3::from_array(self.translation)).to_array(),
            ..self.clone()
        }
    }

    /// Transforms a position in the world to the coordinates.
    pub fn apply(&self, p: DVec3) -> DVec3 {
        let rotation = DQuat::from_array(self.rotation);
        self.scale * (rotation * p) + DVec3::from_array(self.translation)
    }

    /// Returns the up direction of the coordinates: the axis nearest to that of the world, or the latter itself if
    /// the axes are those of the world.
    pub fn up(&self, world: DVec3) -> DVec3 {
        if self.turn().is_identity() {
            return world;
        }
        let up = DQuat::from_array(self.rotation) * world;
        let axes = DVec3::AXES.into_iter().flat_map(|axis| [axis, -axis]);
        axes.max_by(|a, b| a.dot(up).total_cmp(&b.dot(up))).unwrap_or(DVec3::Z)
    }

    /// Returns the distances between pairs of a position, once registered, and its coordinates. `None` without pairs.
    pub fn residuals(&self, pairs: &[[DVec3; 2]]) -> Option<Residuals> {
        let n = pairs.len() as f64;
        let distances = || pairs.iter().map(|[from, to]| self.apply(*from).distance(*to));
        let worst = distances().enumerate().max_by(|a, b| a.1.total_cmp(&b.1));
        let mean = pairs.iter().map(|pair| pair[1]).sum::<DVec3>() / n;
        let spread = pairs.iter().map(|pair| pair[1].distance_squared(mean)).sum::<f64>();
        worst.map(|(worst, largest)| Residuals {
            rms: (distances().map(|d| d * d).sum::<f64>() / n).sqrt(),
            largest,
            worst,
            spread: (spread / n).sqrt(),
        })
    }

    /// Returns comment lines of files that state the transformation.
    pub(super) fn comments(&self) -> Vec<String> {
        let [x, y, z] = self.translation;
        let [qx, qy, qz, qw] = self.rotation;
        let scale = self.scale;
        let transform = format!(
            "vbgs registered by scale {scale} rotation {qw} {qx} {qy} {qz} translation {x} {y} {z}"
        );
        let system = self.system.iter().map(|name| format!("vbgs coordinate system {name}"));
        std::iter::once(transform).chain(system).collect()
    }

    pub(super) fn turn(&self) -> AxisRotation {
        AxisRotation::from_quaternion(DQuat::from_array(self.rotation))
    }
}

impl fmt::Display for Registration {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [x, y, z] = self.translation;
        let angle = DQuat::from_array(self.rotation).to_axis_angle().1.to_degrees();
        let turn = angle.min(360.0 - angle);
        write!(
            f,
            "scale {}, rotated by {turn:.2} degrees, its zero at ({x}, {y}, {z})",
            self.scale
        )?;
        let system = self.system.iter().map(String::as_str);
        system.chain(self.is_metric.then_some("metres")).try_for_each(|text| write!(f, ", {text}"))
    }
}

/// Values that [`Registration::check`] accepts.
pub(super) const REGISTRATION: &str =
    "a scale above 0, a unit quaternion, finite numbers and a name of at most 200 ASCII characters";

/// Returns where a zero of positions lies that has the position `local_origin` in the world. The first vector shifts
/// positions, the second is too far for 32-bit positions and becomes the local origin of files.
pub fn shift_and_origin(registration: Option<&Registration>, local_origin: DVec3) -> [DVec3; 2] {
    let Some(registration) = registration else { return [DVec3::ZERO, local_origin] };
    let place = registration.apply(local_origin);
    match place.length() <= FAR * registration.scale {
        true => [place, DVec3::ZERO],
        false => [DVec3::ZERO, place],
    }
}

fn scale_of([a, b]: [DVec3; 2], length: f64) -> Result<f64, Fault> {
    let scale = length / a.distance(b);
    let found = || Fault::setting("--scale-by", "two different points", format!("{a} and {b}"));
    (scale.is_finite() && scale > 0.0).then_some(scale).ok_or_else(found)
}

/// Returns the smallest rotation that makes a surface level, with its upper side on that of `up`.
fn level(points: [DVec3; 3], up: DVec3) -> Result<DQuat, Fault> {
    let [a, b, c] = points;
    if is_line(&points) {
        let found = format!("{a}, {b} and {c}");
        return Err(Fault::setting("--up-by", "three points that are not on a line", found));
    }
    let normal = (b - a).cross(c - a).normalize();
    let normal = if normal.dot(up) < 0.0 { -normal } else { normal };
    Ok(DQuat::from_rotation_arc(normal, DVec3::Z))
}

/// Returns scale, rotation and the two centres that minimise the squared distances of control points.
fn fitted(pairs: &[[DVec3; 2]], scale: Option<f64>) -> Result<(f64, DQuat, [DVec3; 2]), Fault> {
    let (from, to): (Vec<DVec3>, Vec<DVec3>) = pairs.iter().map(|[from, to]| (*from, *to)).unzip();
    let sides = [from, to];
    if sides.iter().any(|points| is_line(points)) {
        let expected = "control points that are not on a line";
        return Err(Fault::setting("--to", expected, format!("{} on one", pairs.len())));
    }
    let centres = sides.map(|points| mean(&points));
    let centred = || pairs.iter().map(|pair| [pair[0] - centres[0], pair[1] - centres[1]]);
    let products = centred().fold(DMat3::ZERO, |sum, [from, to]| {
        sum + DMat3::from_cols(to * from.x, to * from.y, to * from.z)
    });
    let rotation = best_rotation(products);
    let squares: f64 = centred().map(|[from, _]| from.length_squared()).sum();
    let along: f64 = centred().map(|[from, to]| to.dot(rotation * from)).sum();
    Ok((scale.unwrap_or(along / squares), DQuat::from_mat3(&rotation), centres))
}

fn mean(points: &[DVec3]) -> DVec3 {
    points.iter().sum::<DVec3>() / points.len() as f64
}

/// True if points lie on a line or at one place, or are not finite.
fn is_line(points: &[DVec3]) -> bool {
    let centre = mean(points);
    let scatter = points
        .iter()
        .fold(Sym3::diagonal(0.0), |sum, p| sum.add_scaled(1.0, Sym3::outer(*p - centre)));
    let [along, across, _] = scatter.eigen().values.to_array();
    !(along + across).is_finite() || across <= LINE * LINE * along
}

/// Reads control points from a text: in each line a position in the world and its coordinates, six numbers. Empty
/// lines and those that begin with `#` are left out.
///
/// # Errors
/// The file cannot be read, or [`Fault::Setting`] names the line.
pub fn read_pairs(path: &Path) -> Result<Vec<[DVec3; 2]>, ExportError> {
    let read = || {
        if std::fs::metadata(path).is_ok_and(|file| file.len() > MAX_TEXT_BYTES) {
            return Err(Fault::setting("--to", format!("at most {MAX_TEXT_BYTES} bytes"), "more"));
        }
        let bytes = read_file(path).map_err(|fault| match fault {
            Fault::Missing => Fault::setting("--to", "control points", "nothing at this path"),
            other => other,
        })?;
        let text = String::from_utf8_lossy(&bytes);
        let lines = text.lines().enumerate().map(|(i, line)| (i + 1, line.trim()));
        let lines = lines.filter(|(_, line)| !line.is_empty() && !line.starts_with('#'));
        let pairs: Result<Vec<_>, Fault> = lines.take(MAX_PAIRS + 1).map(pair).collect();
        pairs.and_then(|pairs| match pairs.len() {
            0 => Err(Fault::setting("--to", "one pair of control points or more", "none")),
            n if n > MAX_PAIRS => {
                Err(Fault::setting("--to", format!("at most {MAX_PAIRS} control points"), "more"))
            }
            _ => Ok(pairs),
        })
    };
    read().map_err(|fault: Fault| fault.with_path(path))
}

fn pair((number, line): (usize, &str)) -> Result<[DVec3; 2], Fault> {
    let words = line.split(|c: char| c.is_whitespace() || c == ',' || c == ';');
    let numbers = words.filter(|word| !word.is_empty()).map(|word| word.parse::<f64>().ok());
    let numbers: Option<Vec<f64>> = numbers.map(|n| n.filter(|n| n.is_finite())).collect();
    match numbers.as_deref() {
        Some(&[x, y, z, tx, ty, tz]) => Ok([DVec3::new(x, y, z), DVec3::new(tx, ty, tz)]),
        _ => {
            let expected = "six numbers: a position in the world and its coordinates";
            Err(Fault::setting("--to", expected, format!("{} in line {number}", shorten(line))))
        }
    }
}
