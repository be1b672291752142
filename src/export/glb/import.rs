//! Import of splats or points from a parsed glTF with loaded buffers.
//!
//! If any primitive holds splats, only the splats are imported, and all other primitives are reported as
//! skipped. Otherwise points are imported. All columns are opened and all rows counted before memory is
//! allocated: many nodes may share one mesh, so a small file can request any number of rows.

use super::container::{Column, unsupported};
use super::read::BufferBytes;
use super::{
    COLOR_0, EXTENSION, GaussianSplatting, KERNEL, LINEAR, Node, OPACITY, POINTS, POSITION,
    Primitive, ROTATION, Root, SCALE, SH_0, SH_1, SH_PREFIX, SRGB,
};
use crate::export::error::{Fault, shorten};
use crate::export::gaussian::{
    AxisRotation, Gaussian, harmonic_to_color, harmonics_to_directional, linear_to_srgb,
};
use crate::export::imported::{Imported, Intake, ModelKind, Note, Rows};
use crate::export::local_origin::EXTRA;
use crate::math::sym3::Sym3;
use crate::model::splat::splats::{CovarianceForm, decompose};
use glam::{DMat3, DMat4, DQuat, DVec3, Vec4Swizzles};

/// Mode of a primitive that states none: `TRIANGLES`.
const DEFAULT_MODE: u32 = 4;

/// Maximum number of primitives per scene.
// Nodes times primitives may be very large in a small file.
const MAX_PARTS: usize = 100_000;
struct Part<'a> {
    primitive: &'a Primitive,
    placement: Placement,
    place: String,
}

/// Imports all splats of the scene, or its points if it has no splats.
pub(super) fn model(
    root: &Root,
    buffers: &[BufferBytes],
    intake: Intake,
) -> Result<Imported, Fault> {
    // Subtracted from the node translation before positions are rounded to f32.
    let origin = local_origin(root);
    let parts = scene_primitives(root, origin)?;
    let n_parts = parts.len();
    let (splats, others): (Vec<Part>, Vec<Part>) =
        parts.into_iter().partition(|part| part.primitive.extensions.splatting.is_some());
    let (kind, chosen) = if splats.is_empty() {
        let is_points = |part: &Part| part.primitive.mode == Some(POINTS);
        (ModelKind::PointCloud, others.into_iter().filter(is_points).collect())
    } else {
        (ModelKind::Splats, splats)
    };
    if chosen.is_empty() {
        let expected = format!("primitives with {EXTENSION} or with mode POINTS");
        let found = format!("{n_parts} other primitives");
        return Err(Fault::malformed("scene", expected, found));
    }
    let mut notes = Vec::new();
    if chosen.len() < n_parts {
        notes.push(Note::PrimitivesSkipped { n_primitives: n_parts - chosen.len() });
    }
    let mut columns = Vec::new();
    for part in &chosen {
        columns.push(match kind {
            ModelKind::Splats => Columns::of_splats(root, buffers, part, &mut notes)?,
            ModelKind::PointCloud => Columns::of_points(root, buffers, part, &mut notes)?,
        });
    }
    let n_rows = checked_row_count(&columns, intake.max_splats)?;
    let n_bytes = buffers.iter().fold(0, |n: u64, buffer| n.saturating_add(buffer.len() as u64));
    let is_directional = columns.iter().any(Columns::is_directional);
    let mut rows = Rows::with_capacity(n_rows, is_directional, n_bytes, intake)?;
    columns.iter_mut().flat_map(Columns::all).try_for_each(Column::load)?;
    let scales = ScaleForm::of(&columns);
    if scales == ScaleForm::Logarithmic {
        notes.push(Note::LogarithmicScales);
    }
    for (part, columns) in chosen.iter().zip(&columns) {
        columns.read(&part.placement, scales, &mut rows)?;
    }
    let imported = rows.finish(kind, notes, comments(root))?;
    let local_origin = AxisRotation::Y_UP_TO_Z_UP.rotate_vector(origin);
    Ok(Imported { local_origin, defined_up: Some(DVec3::Z), ..imported })
}

fn scene_primitives(root: &Root, origin: DVec3) -> Result<Vec<Part<'_>>, Fault> {
    let mut parts = Vec::new();
    for (placement, index) in placed_meshes(root)? {
        let mesh = root.meshes.get(index).ok_or_else(|| {
            let found = format!("{} meshes", root.meshes.len());
            Fault::malformed(format!("mesh {index}"), "a mesh of that number", found)
        })?;
        for (i, primitive) in mesh.primitives.iter().enumerate() {
            if parts.len() == MAX_PARTS {
                return Err(Fault::Unsupported {
                    feature: format!("more than {MAX_PARTS} primitives in the scene"),
                    advice: "join the primitives before exporting",
                });
            }
            let placement = placement.relative_to(origin);
            parts.push(Part { primitive, placement, place: format!("mesh {index} primitive {i}") });
        }
    }
    Ok(parts)
}

fn checked_row_count(columns: &[Columns], max_splats: usize) -> Result<usize, Fault> {
    let counts = columns.iter().map(|c| c.position.count as u64);
    let declared = counts.fold(0u64, u64::saturating_add);
    match usize::try_from(declared) {
        Ok(n) if n <= max_splats => Ok(n),
        _ => Err(Fault::TooMany { declared, cap: max_splats }),
    }
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum ScaleForm {
    /// Standard deviations, as in the ratified extension.
    Linear,
    /// Natural logarithms, as in the drafts published for review.
    Logarithmic,
}

impl ScaleForm {
    /// Infers the encoding of the scales from their component types and values.
    fn of(columns: &[Columns]) -> Self {
        // Files do not state their draft. Only drafts used signed integers, and standard deviations are not
        // mostly zero or negative.
        let scales = || columns.iter().filter_map(|c| c.shape.as_ref()).map(|shape| &shape.scale);
        let components = || scales().flat_map(|s| (0..s.count).flat_map(|row| s.get::<3>(row)));
        let n_low = components().filter(|s| *s <= 0.0).count();
        match scales().any(Column::is_signed_integer) || 2 * n_low > components().count() {
            true => Self::Logarithmic,
            false => Self::Linear,
        }
    }
}

/// Attributes of one primitive, all with equal numbers of rows.
struct Columns<'a> {
    position: Column<'a>,
    color: Color<'a>,
    /// Columns besides position and colour; `None` for point clouds.
    shape: Option<Shape<'a>>,
}

struct Shape<'a> {
    rotation: Column<'a>,
    scale: Column<'a>,
    opacity: Column<'a>,
    degree_1: Option<[Column<'a>; 3]>,
}

enum Color<'a> {
    Sh { coefficient: Column<'a>, linear: bool },
    Linear(Column<'a>),
    None,
}

impl<'a> Columns<'a> {
    fn of_splats(
        root: &Root,
        buffers: &'a [BufferBytes],
        part: &Part,
        notes: &mut Vec<Note>,
    ) -> Result<Self, Fault> {
        let linear = check_splatting(part, notes)?;
        let position = open(root, buffers, part, POSITION, None)?;
        let count = Some(position.count);
        let has = |semantic| part.primitive.attributes.get(semantic).is_some();
        // If both are missing, `open` reports the harmonics.
        let color = if has(SH_0) || !has(COLOR_0) {
            let coefficient = open(root, buffers, part, SH_0, count)?;
            Color::Sh { coefficient, linear }
        } else {
            note_once(notes, Note::FallbackColor);
            Color::Linear(open(root, buffers, part, COLOR_0, count)?)
        };
        let shape = Shape {
            rotation: open(root, buffers, part, ROTATION, count)?,
            scale: open(root, buffers, part, SCALE, count)?,
            opacity: open(root, buffers, part, OPACITY, count)?,
            // Not for linear colours: after sRGB encoding they are no longer linear in the direction.
            degree_1: match has_degree_1(part) && !linear {
                true => {
                    let [y, z, x] = SH_1.map(|name| open(root, buffers, part, name, count));
                    Some([y?, z?, x?])
                }
                false => None,
            },
        };
        let above_0 = |name: &&str| name.starts_with(SH_PREFIX) && *name != SH_0;
        let names = part.primitive.attributes.0.iter().map(|(name, _)| name.as_str());
        // Harmonics above degree 1 are noted, not refused: only the view-dependent colour is incomplete.
        let n_read = shape.degree_1.as_ref().map_or(0, |columns| columns.len());
        let n_coefficients = 3 * (names.filter(above_0).count() - n_read);
        if n_coefficients > 0 {
            note_once(notes, Note::ViewDependentColorIgnored { n_coefficients });
        }
        if linear {
            note_once(notes, Note::LinearColorEncoded);
        }
        Ok(Self { position, color, shape: Some(shape) })
    }

    fn of_points(
        root: &Root,
        buffers: &'a [BufferBytes],
        part: &Part,
        notes: &mut Vec<Note>,
    ) -> Result<Self, Fault> {
        let position = open(root, buffers, part, POSITION, None)?;
        let color = if part.primitive.attributes.get(COLOR_0).is_some() {
            Color::Linear(open(root, buffers, part, COLOR_0, Some(position.count))?)
        } else {
            note_once(notes, Note::NoColor);
            Color::None
        };
        Ok(Self { position, color, shape: None })
    }

    fn is_directional(&self) -> bool {
        self.shape.as_ref().is_some_and(|shape| shape.degree_1.is_some())
    }

    fn all(&mut self) -> impl Iterator<Item = &mut Column<'a>> {
        let color = match &mut self.color {
            Color::Sh { coefficient: column, .. } | Color::Linear(column) => Some(column),
            Color::None => None,
        };
        let shape =
            self.shape.iter_mut().flat_map(|Shape { rotation, scale, opacity, degree_1 }| {
                [rotation, scale, opacity].into_iter().chain(degree_1.iter_mut().flatten())
            });
        [&mut self.position].into_iter().chain(color).chain(shape)
    }

    fn read(&self, placement: &Placement, scales: ScaleForm, rows: &mut Rows) -> Result<(), Fault> {
        for row in 0..self.position.count {
            let point = Gaussian {
                mean: placement.position(DVec3::from_array(self.position.get(row))),
                opacity: 1.0,
                color: self.color.get(row),
                scale: DVec3::ZERO,
                rotation: DQuat::IDENTITY,
                directional: DMat3::ZERO,
                seen: DVec3::ZERO,
            };
            let gaussian = match &self.shape {
                None => point,
                Some(shape) => {
                    // glTF stores w last.
                    let [x, y, z, w] = shape.rotation.get(row);
                    let rotation = rows.rotation([w, x, y, z]);
                    let (scale, rotation) = placement.shape(shape.scale(row, scales)?, rotation);
                    let [opacity] = shape.opacity.get(row);
                    let directional = placement.directional(shape.directional(row));
                    Gaussian { opacity, scale, rotation, directional, ..point }
                }
            };
            rows.push(gaussian.rotated(&AxisRotation::Y_UP_TO_Z_UP));
        }
        Ok(())
    }
}

impl Shape<'_> {
    fn directional(&self, row: usize) -> DMat3 {
        let coefficient = |column: &Column| DVec3::from_array(column.get(row));
        self.degree_1.as_ref().map_or(DMat3::ZERO, |columns| {
            harmonics_to_directional(columns.each_ref().map(coefficient))
        })
    }

    fn scale(&self, row: usize, form: ScaleForm) -> Result<DVec3, Fault> {
        let scale: [f64; 3] = self.scale.get(row);
        if form == ScaleForm::Logarithmic {
            return Ok(DVec3::from_array(scale).exp());
        }
        // Zero is valid: such a splat is flat.
        match scale.iter().find(|s| **s < 0.0) {
            None => Ok(DVec3::from_array(scale)),
            Some(negative) => Err(Fault::malformed(
                format!("{}, row {row}", self.scale.place),
                "scales of 0 or more",
                negative.to_string(),
            )),
        }
    }
}

impl Color<'_> {
    fn get(&self, row: usize) -> DVec3 {
        match self {
            Color::Sh { coefficient, linear } => {
                let color = harmonic_to_color(DVec3::from_array(coefficient.get(row)));
                if *linear { color.map(linear_to_srgb) } else { color }
            }
            Color::Linear(column) => DVec3::from_array(column.get(row)).map(linear_to_srgb),
            Color::None => DVec3::splat(0.5),
        }
    }
}

fn has_degree_1(part: &Part) -> bool {
    SH_1.iter().all(|name| part.primitive.attributes.get(name).is_some())
}

fn open<'a>(
    root: &Root,
    buffers: &'a [BufferBytes],
    part: &Part,
    semantic: &str,
    count: Option<usize>,
) -> Result<Column<'a>, Fault> {
    let index =
        part.primitive.attributes.get(semantic).ok_or_else(|| {
            Fault::malformed(&part.place, format!("attribute {semantic}"), "none")
        })?;
    let column = Column::open(root, buffers, index, semantic)?;
    match count {
        Some(count) if count != column.count => {
            let expected = format!("{count} rows, as many as {POSITION}");
            Err(Fault::malformed(column.place, expected, column.count.to_string()))
        }
        _ => Ok(column),
    }
}

/// Checks the splat extension of a primitive; returns true if its coefficients are in linear colour.
fn check_splatting(part: &Part, notes: &mut Vec<Note>) -> Result<bool, Fault> {
    let primitive = part.primitive;
    let attributes = &primitive.attributes;
    if ["_ROTATION", "_SCALE"].iter().any(|name| attributes.get(name).is_some()) {
        return Err(Fault::Unsupported {
            feature: format!("{} uses an unsupported draft of {EXTENSION}", part.place),
            advice: "export it again with a program that writes the ratified extension",
        });
    }
    let Some(splatting) = &primitive.extensions.splatting else { return Ok(false) };
    let GaussianSplatting { kernel, color_space, projection, sorting_method, extensions } =
        splatting;
    let nested = || extensions.keys().chain(primitive.extensions.other.keys());
    if let Some(name) = nested().find(|name| name.contains("compression")) {
        let feature = format!("{} is compressed ({})", part.place, shorten(name));
        return Err(unsupported(feature));
    }
    let mode = primitive.mode.unwrap_or(DEFAULT_MODE);
    if mode != POINTS {
        let found = format!("mode {mode}");
        return Err(Fault::malformed(&part.place, format!("mode {POINTS} (POINTS)"), found));
    }
    // Further extensions may add kernels and colour spaces; readers fall back to ellipses in sRGB.
    let stated = [
        ("kernel", kernel, [KERNEL, KERNEL], "an ellipse"),
        ("color space", color_space, [SRGB, LINEAR], "sRGB"),
        ("projection", projection, ["perspective", ""], "perspective"),
        ("sorting method", sorting_method, ["cameraDistance", ""], "the renderer's order"),
    ];
    for (name, value, known, used) in stated {
        if !known.contains(&value.as_str()) {
            let value = format!("\"{}\"", shorten(value));
            note_once(notes, Note::Unsupported { name, value, used });
        }
    }
    if let Some(note) = Note::not_used("extension", nested().map(String::as_str)) {
        note_once(notes, note);
    }
    Ok(color_space == LINEAR)
}

fn note_once(notes: &mut Vec<Note>, note: Note) {
    if !notes.contains(&note) {
        notes.push(note);
    }
}

/// Returns the local origin stored in a file of this program; zero for other files.
fn local_origin(root: &Root) -> DVec3 {
    let named = root.asset.extras.as_ref().and_then(|extras| extras.get(EXTRA));
    // Another program may have stored anything under this name.
    let numbers: Option<[f64; 3]> = named.and_then(|v| serde_json::from_value(v.clone()).ok());
    numbers.map(DVec3::from_array).filter(|origin| origin.is_finite()).unwrap_or(DVec3::ZERO)
}

fn comments(root: &Root) -> Vec<String> {
    let extras = root.asset.extras.as_ref();
    let lines = extras.and_then(|extras| extras.get("comments")).and_then(|v| v.as_array());
    lines.into_iter().flatten().filter_map(|line| line.as_str().map(str::to_owned)).collect()
}

/// Cosine of the angle between two matrix columns below which they count as orthogonal.
const SHEAR_TOLERANCE: f64 = 1e-4;

#[derive(Clone, Copy, Debug)]
pub(super) struct Placement {
    linear: DMat3,
    translation: DVec3,
}

pub(super) fn placed_meshes(root: &Root) -> Result<Vec<(Placement, usize)>, Fault> {
    let mut meshes = Vec::new();
    let mut seen = vec![false; root.nodes.len()];
    let mut stack: Vec<(usize, DMat4)> =
        start_nodes(root)?.into_iter().rev().map(|node| (node, DMat4::IDENTITY)).collect();
    // A stack instead of recursion: a file may nest nodes arbitrarily deep.
    while let Some((index, scene_from_parent)) = stack.pop() {
        let place = || format!("node {index}");
        let (Some(node), Some(is_seen)) = (root.nodes.get(index), seen.get_mut(index)) else {
            let found = format!("{} nodes", root.nodes.len());
            return Err(Fault::malformed(place(), "a node of that number", found));
        };
        // A node reached twice means a cycle or a shared child; the traversal might not end.
        if std::mem::replace(is_seen, true) {
            return Err(Fault::malformed(place(), "a tree of nodes", "a node with two parents"));
        }
        let scene_from_node = scene_from_parent * local_matrix(node);
        if let Some(mesh) = node.mesh {
            meshes.push((Placement::checked(scene_from_node, &place())?, mesh));
        }
        // Reversed, since a stack is last in, first out: meshes keep the order of the file.
        stack.extend(node.children.iter().rev().map(|&child| (child, scene_from_node)));
    }
    Ok(meshes)
}

fn start_nodes(root: &Root) -> Result<Vec<usize>, Fault> {
    // Without a default scene, glTF leaves the choice to the reader.
    let index = root.scene.unwrap_or(0);
    match root.scenes.get(index) {
        Some(scene) => Ok(scene.nodes.clone()),
        None if root.scenes.is_empty() => {
            let mut is_child = vec![false; root.nodes.len()];
            for child in root.nodes.iter().flat_map(|node| &node.children) {
                if let Some(flag) = is_child.get_mut(*child) {
                    *flag = true;
                }
            }
            let roots = is_child.iter().enumerate().filter(|(_, is_child)| !**is_child);
            Ok(roots.map(|(node, _)| node).collect())
        }
        None => {
            let found = format!("{} scenes", root.scenes.len());
            Err(Fault::malformed(format!("scene {index}"), "a scene of that number", found))
        }
    }
}

fn local_matrix(node: &Node) -> DMat4 {
    // A node has either a matrix or the three properties below.
    if let Some(matrix) = &node.matrix {
        return DMat4::from_cols_array(matrix);
    }
    // Normalised, because a quaternion rounded to few digits would scale the splats.
    let rotation = DQuat::from_array(node.rotation.unwrap_or([0.0, 0.0, 0.0, 1.0]));
    DMat4::from_scale_rotation_translation(
        DVec3::from_array(node.scale.unwrap_or([1.0; 3])),
        rotation / rotation.length(),
        DVec3::from_array(node.translation.unwrap_or_default()),
    )
}

impl Placement {
    fn checked(matrix: DMat4, place: &str) -> Result<Self, Fault> {
        let linear = DMat3::from_mat4(matrix);
        let fault = |found: &str| {
            let expected = "a rotation with positive scales and a translation";
            Err(Fault::Unsupported {
                feature: format!("{place}: expected {expected}, found {found}"),
                advice: "apply the node's transform before exporting",
            })
        };
        // Any other last row than (0, 0, 0, 1) is a perspective, which splats cannot represent.
        if !matrix.is_finite() || matrix.row(3).xyz() != DVec3::ZERO {
            return fault("a matrix that is not finite or not affine");
        }
        let (x, y, z) = (linear.x_axis, linear.y_axis, linear.z_axis);
        // A mirrored matrix is not a rotation, and a singular one cannot be inverted.
        if linear.determinant() <= 0.0 {
            return fault("a negative or zero scale, which mirrors or flattens splats");
        }
        // NaN counts as sheared.
        let sheared = |a: DVec3, b: DVec3| {
            a.normalize().dot(b.normalize()).abs().partial_cmp(&SHEAR_TOLERANCE)
                != Some(std::cmp::Ordering::Less)
        };
        if sheared(x, y) || sheared(y, z) || sheared(x, z) {
            return fault("shear, which splats cannot represent");
        }
        Ok(Self { linear, translation: matrix.w_axis.xyz() })
    }

    pub fn relative_to(self, origin: DVec3) -> Self {
        Self { translation: self.translation - origin, ..self }
    }

    pub fn position(&self, p: DVec3) -> DVec3 {
        self.linear * p + self.translation
    }

    pub fn directional(&self, w: DMat3) -> DMat3 {
        // The columns are orthogonal: normalised, they are the rotation.
        let m = self.linear;
        let rotation =
            DMat3::from_cols(m.x_axis.normalize(), m.y_axis.normalize(), m.z_axis.normalize());
        w * rotation.transpose()
    }

    /// Transforms a splat's covariance by the linear part of the placement; returns the resulting scales
    /// and rotation.
    pub fn shape(&self, scale: DVec3, rotation: DQuat) -> (DVec3, DQuat) {
        if self.linear == DMat3::IDENTITY {
            return (scale, rotation); // avoids rounding
        }
        let factor = self.linear * DMat3::from_quat(rotation) * DMat3::from_diagonal(scale);
        let covariance = Sym3::from_mat3(factor * factor.transpose());
        decompose(covariance, CovarianceForm::Eigen)
    }
}
