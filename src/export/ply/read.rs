//! Import of PLY files from any program: splats if there are scales and rotations, otherwise points.
//!
//! Properties are found by name, because programs write them in any order and add their own.

use super::body::{Body, pick};
use super::compressed;
use super::{Kind, MAX_HEADER_BYTES, N_REST_DEGREE_1, PlyElement, PlyHeader};
use crate::export::error::{Fault, shorten_to};
use crate::export::gaussian::{Gaussian, harmonic_to_color, harmonics_to_directional, sigmoid};
use crate::export::imported::{Imported, Intake, ModelKind, Note, Rows};
use crate::export::read::Source;
use glam::{DMat3, DQuat, DVec3};

/// Third scale of flat splats, as a fraction of the larger of the other two (`files.md`, PLY of splats).
const FLATNESS: f64 = 1e-6;
// Messages show only the start of a file's list of properties, which may have any length.
const MAX_NAMED_PROPERTIES: usize = 20;
const MAX_NAMED_CHARS: usize = 300;

/// Properties of points that are used, or add nothing: normals, and what this program writes.
const POINT_PROPERTIES: [&str; 12] =
    ["x", "y", "z", "nx", "ny", "nz", "red", "green", "blue", "alpha", "confidence", "uncertainty"];
/// Beginnings of the properties that only splats use.
const SPLAT_PROPERTIES: [&str; 6] = ["f_dc_", "f_rest_", "opacity", "scale_", "rot_", "filter_3D"];

/// Highest degree of harmonics that trainers write.
const MAX_DEGREE: usize = 4;

pub(in crate::export) fn ply(mut source: Source, intake: Intake) -> Result<Imported, Fault> {
    let io = |source| Fault::Io { action: "read", source };
    let size = source.left;
    let n = size.min(MAX_HEADER_BYTES as u64 + 1) as usize;
    let header = PlyHeader::parse(source.peek(n).map_err(io)?)?;
    source.take(header.body_offset).map_err(io)?;
    let mut body = Body::new(header.encoding, source);
    if header.elements.iter().any(|element| element.name == compressed::CHUNK) {
        return compressed::read(body, header, size, intake);
    }
    for element in &header.elements {
        if element.name == "vertex" {
            let others = header.elements.iter().filter(|other| other.name != element.name);
            let others = others.filter(|other| other.count > 0).map(|other| other.name.as_str());
            let notes = Note::not_used("element", others).into_iter().collect();
            return vertices(&mut body, element, notes, header.comments, size, intake);
        }
        body.skip(element)?;
    }
    Err(Fault::malformed("header", "an element vertex", "none"))
}

fn vertices(
    body: &mut Body,
    element: &PlyElement,
    mut notes: Vec<Note>,
    comments: Vec<String>,
    size: u64,
    intake: Intake,
) -> Result<Imported, Fault> {
    let n_rows = body.n_rows(element)?;
    let layout = Layout::find(element, &mut notes)?;
    // Checked after the layout, because a wrong kind of file gives the more useful message.
    if n_rows > intake.max_splats {
        return Err(Fault::TooMany { declared: element.count, cap: intake.max_splats });
    }
    let is_directional = layout.shape.as_ref().is_some_and(|shape| shape.degree_1.is_some());
    let mut rows = Rows::with_capacity(n_rows, is_directional, size, intake)?;
    let mut values = vec![0.0; element.properties.len()];
    for row in 0..n_rows {
        body.read_row(element, row, &mut values)?;
        let gaussian = layout.decode(&values, &mut rows);
        rows.push(gaussian);
    }
    // Determined by the columns, not by the file name.
    let kind = if layout.shape.is_some() { ModelKind::Splats } else { ModelKind::PointCloud };
    rows.finish(kind, notes, comments)
}

impl PlyElement {
    fn require<const N: usize>(&self, names: [&str; N]) -> Result<[usize; N], Fault> {
        let mut columns = [0; N];
        for (column, name) in columns.iter_mut().zip(names) {
            *column = self.column(name).ok_or_else(|| self.missing(name))?;
        }
        Ok(columns)
    }

    /// Finds the columns of the degree 1 coefficients, ordered by coefficient, then by channel. Adds a
    /// note about all other coefficients, which are ignored.
    fn degree_1(&self, notes: &mut Vec<Note>) -> Option<[[usize; 3]; N_REST_DEGREE_1]> {
        let names = self.properties.iter().map(|p| p.name.as_str());
        let n = names.filter(|name| name.starts_with("f_rest_")).count();
        // Channel by channel, each with the coefficients of complete degrees.
        let mut counts = (1..=MAX_DEGREE).map(|degree| (degree + 1) * (degree + 1) - 1);
        let found = counts.find(|per_channel| 3 * per_channel == n).and_then(|k| {
            let column = |i, channel| self.column(&format!("f_rest_{}", channel * k + i));
            let mut columns = [[0; 3]; N_REST_DEGREE_1];
            for (i, row) in columns.iter_mut().enumerate() {
                *row = [column(i, 0)?, column(i, 1)?, column(i, 2)?];
            }
            Some(columns)
        });
        let n_coefficients = n - found.map_or(0, |columns| columns.as_flattened().len());
        if n_coefficients > 0 {
            notes.push(Note::ViewDependentColorIgnored { n_coefficients });
        }
        found
    }

    fn missing(&self, name: &str) -> Fault {
        let names = self.properties.iter().take(MAX_NAMED_PROPERTIES);
        let names: Vec<&str> = names.map(|p| p.name.as_str()).collect();
        let found = shorten_to(&names.join(" "), MAX_NAMED_CHARS);
        Fault::MissingProperty { property: name.to_owned(), found }
    }
}

struct Layout {
    mean: [usize; 3],
    color: Color,
    /// Columns besides position and colour; `None` for point clouds.
    shape: Option<Shape>,
}

struct Shape {
    opacity: usize,
    scale: [usize; 2],
    /// Column of the third scale; `None` for flat splats.
    scale_2: Option<usize>,
    /// Column of the standard deviation of Mip-Splatting's 3D filter, world units.
    filter: Option<usize>,
    /// Columns of the quaternion w x y z.
    rotation: [usize; 4],
    degree_1: Option<[[usize; 3]; N_REST_DEGREE_1]>,
}

enum Color {
    Sh([usize; 3]),
    Rgb { columns: [usize; 3], full: DVec3 },
    None,
}

impl Layout {
    fn find(element: &PlyElement, notes: &mut Vec<Note>) -> Result<Self, Fault> {
        let mean = element.require(["x", "y", "z"])?;
        let is_splat = element.column("scale_0").is_some() && element.column("rot_0").is_some();
        let color = Color::find(element)?;
        if matches!(color, Color::None) {
            if is_splat {
                return Err(element.missing("f_dc_0"));
            }
            notes.push(Note::NoColor);
        }
        let is_used = |name: &&str| {
            POINT_PROPERTIES.contains(name)
                || is_splat && SPLAT_PROPERTIES.iter().any(|start| name.starts_with(start))
        };
        let names = element.properties.iter().map(|property| property.name.as_str());
        notes.extend(Note::not_used("property", names.filter(|name| !is_used(name))));
        if !is_splat {
            return Ok(Self { mean, color, shape: None });
        }
        let degree_1 = element.degree_1(notes);
        let [opacity] = element.require(["opacity"])?;
        let scale = element.require(["scale_0", "scale_1"])?;
        let scale_2 = element.column("scale_2");
        if scale_2.is_none() {
            notes.push(Note::FlatSplats);
        }
        let rotation = element.require(["rot_0", "rot_1", "rot_2", "rot_3"])?;
        let filter = element.column("filter_3D");
        notes.extend(filter.map(|_| Note::FilterApplied));
        let shape = Shape { opacity, scale, scale_2, filter, rotation, degree_1 };
        Ok(Self { mean, color, shape: Some(shape) })
    }

    fn decode(&self, values: &[f64], rows: &mut Rows) -> Gaussian {
        let vector = |columns: [usize; 3]| DVec3::from_array(pick(values, columns));
        let point = Gaussian {
            mean: vector(self.mean),
            opacity: 1.0,
            color: match &self.color {
                Color::Sh(columns) => harmonic_to_color(vector(*columns)),
                Color::Rgb { columns, full } => vector(*columns) / *full,
                Color::None => DVec3::splat(0.5),
            },
            scale: DVec3::ZERO,
            rotation: DQuat::IDENTITY,
            directional: DMat3::ZERO,
            seen: DVec3::ZERO,
        };
        match &self.shape {
            None => point,
            Some(shape) => {
                let (scale, share) = shape.filtered_scale(values);
                Gaussian {
                    // Stored as a logit.
                    opacity: sigmoid(pick(values, [shape.opacity])[0]) * share,
                    scale,
                    rotation: rows.rotation(pick(values, shape.rotation)),
                    directional: shape.degree_1.map_or(DMat3::ZERO, |coefficients| {
                        harmonics_to_directional(coefficients.map(vector))
                    }),
                    ..point
                }
            }
        }
    }
}

impl Shape {
    /// Returns the scales after the 3D filter, and the factor by which it lowers the opacity.
    fn filtered_scale(&self, values: &[f64]) -> (DVec3, f64) {
        let own = self.scale(values);
        let Some(filter) = self.filter else { return (own, 1.0) };
        let [filter] = pick(values, [filter]);
        let scale = own.map(|s| s.hypot(filter));
        (scale, (own / scale).element_product())
    }

    fn scale(&self, values: &[f64]) -> DVec3 {
        let [s0, s1] = pick(values, self.scale).map(f64::exp);
        let s2 = self.scale_2.map(|column| pick(values, [column])[0].exp());
        DVec3::new(s0, s1, s2.unwrap_or(FLATNESS * s0.max(s1)))
    }
}

impl Color {
    fn find(element: &PlyElement) -> Result<Self, Fault> {
        // Coefficients first: some files add red, green and blue as a preview.
        if element.column("f_dc_0").is_some() {
            return Ok(Color::Sh(element.require(["f_dc_0", "f_dc_1", "f_dc_2"])?));
        }
        if element.column("red").is_none() {
            return Ok(Color::None);
        }
        let found = element.require(["red", "green", "blue"])?;
        let full = found.map(|c| match element.properties.get(c).map(|p| &p.kind) {
            Some(Kind::Scalar(kind)) => kind.full_channel(),
            // Never used: `Body::n_rows` refuses lists.
            _ => 1.0,
        });
        Ok(Color::Rgb { columns: found, full: DVec3::from_array(full) })
    }
}
