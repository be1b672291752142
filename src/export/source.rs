//! Rows of an exported file: selected splats, converted to plain ones, in the file's axes and units.
//!
//! Each row stores only the indices of its splat and of the piece (see [`mapping`]), and its values are
//! computed on demand. A plain copy of a native scene would take as much memory as the scene.

use super::detail::Detail;
use super::error::Fault;
use super::format::{Axes, ModelFormat, WriteOptions, WriteSelection};
use super::gaussian::{AxisRotation, Gaussian, drawable_at};
use super::mapping::{self, Mapping};
use super::registration::{REGISTRATION, Registration, shift_and_origin};
use super::stream::SplatRows;
use crate::model::splat::appearance::SplatView;
use glam::DVec3;
use rayon::prelude::*;

pub(super) struct ExportRows<'a> {
    view: SplatView<'a>,
    /// Conversion of native splats; `None` for plain splats and point clouds.
    mapping: Option<Mapping>,
    /// Small splats in place of those with textures.
    detail: Detail,
    placement: Placement,
    rows: Vec<Row>,
    has_directions: bool,
    pub n_drawable: usize,
    pub n_left_out: usize,
}

#[derive(Clone, Copy)]
struct Row {
    splat: u32,
    /// Number of a piece of the mapping, or of a small splat of its texture.
    piece: u32,
}

impl<'a> ExportRows<'a> {
    pub fn new(view: SplatView<'a>, options: &WriteOptions) -> Result<Self, Fault> {
        check(view.splats().len(), options)?;
        let is_points = options.format == ModelFormat::PointCloudPly;
        // Points have neither a flat top nor a gradient.
        let mapping = (!is_points && !mapping::is_plain(view)).then_some(options.mapping);
        let most = options.mapping.detail.filter(|_| !is_points);
        let detail = most.map_or_else(Detail::default, |most| Detail::new(view, most));
        let (selection, evidence) = (options.selection, options.confidence);
        let selects = |i: usize, mean: DVec3| selection.selects(i, mean, evidence);
        let selects_small = |i: usize, small: &Gaussian| selects(i, small.mean);
        let rows_of = |i: usize| -> Option<(u32, bool)> {
            let native = drawable_at(view, i)?;
            if let Some(small) = detail.of(i) {
                let is_selected = small.iter().any(|small| selects_small(i, small));
                let n_rows = if is_selected { small.len() as u32 } else { 0 };
                return Some((n_rows, !native.is_diffuse()));
            }
            let n_pieces = mapping.map_or(1, |mapping| mapping::n_pieces(&native, mapping));
            let n_pieces = if selects(i, native.mean) { n_pieces as u32 } else { 0 };
            Some((n_pieces, !native.is_diffuse()))
        };
        let found: Vec<Option<(u32, bool)>> =
            (0..view.splats().len()).into_par_iter().map(rows_of).collect();
        let mut rows = Vec::new();
        for (i, n_pieces) in found.iter().enumerate().filter_map(|(i, f)| Some((i, (*f)?.0))) {
            let row = |piece| Row { splat: i as u32, piece };
            let fits = |piece: &u32| match detail.of(i) {
                Some(small) => small.get(*piece as usize).is_some_and(|s| selects_small(i, s)),
                // A piece of a split splat may be too large for f32 although the splat is not.
                None => mapping.is_none() || plain(view, row(*piece), mapping).is_some(),
            };
            rows.extend((0..n_pieces).filter(fits).map(row));
        }
        Ok(Self {
            view,
            mapping,
            detail,
            placement: Placement::of(options),
            rows,
            has_directions: found.iter().flatten().any(|&(n_pieces, has)| n_pieces > 0 && has),
            n_drawable: found.iter().flatten().count(),
            n_left_out: found.iter().flatten().filter(|(n_pieces, _)| *n_pieces == 0).count(),
        })
    }

    #[expect(clippy::indexing_slicing, reason = "rows are below the number of rows")]
    pub fn splat_index(&self, row: usize) -> usize {
        self.rows[row].splat as usize
    }

    #[expect(clippy::indexing_slicing, reason = "rows are below the number of rows")]
    pub fn in_world(&self, row: usize) -> Gaussian {
        let row = self.rows[row];
        if let Some(small) = self.detail.of(row.splat as usize) {
            return small[row.piece as usize];
        }
        // Rows only refer to drawable splats, so the fallback is never used.
        plain(self.view, row, self.mapping).unwrap_or(Gaussian::INVISIBLE)
    }

    pub fn is_antialiased(&self) -> bool {
        self.view.finishing().is_antialiased
    }

    /// Returns the sum of the directions in which the splats were seen, in the axes of the file; −x if they are
    /// unknown.
    pub fn mean_direction(&self) -> DVec3 {
        let seen = self.view.appearance().iter().map(|appearance| appearance.observed.mean());
        let sum = self.direction(seen.filter(|d| d.is_finite()).sum());
        if sum == DVec3::ZERO { DVec3::NEG_X } else { sum }
    }

    pub fn direction(&self, v: DVec3) -> DVec3 {
        self.placement.turn.rotate_vector(v)
    }
}

impl SplatRows for ExportRows<'_> {
    fn n_rows(&self) -> usize {
        self.rows.len()
    }

    fn row(&self, row: usize) -> Gaussian {
        let Placement { turn, scale, shift, .. } = &self.placement;
        self.in_world(row).rotated(turn).with_positive_w().scaled(*scale).shifted(*shift)
    }

    fn has_directions(&self) -> bool {
        self.has_directions
    }
}

fn plain(view: SplatView, row: Row, mapping: Option<Mapping>) -> Option<Gaussian> {
    let i = row.splat as usize;
    let native = drawable_at(view, i)?;
    let Some(mapping) = mapping else { return Some(native) };
    let (splat, appearance) = mapping::plain_piece(view, i, &native, row.piece as usize, mapping)?;
    // Plain splats have no cone of observed directions.
    Some(Gaussian { seen: native.seen, ..Gaussian::from_splat(&splat, &appearance) })
}

/// Similarity from positions of splats to those of a file.
#[derive(Clone, Copy)]
pub(super) struct Placement {
    pub turn: AxisRotation,
    /// File units per world unit.
    pub scale: f64,
    /// Shift in the file's axes and units.
    pub shift: DVec3,
    /// Local origin in the file's axes and units.
    pub origin: DVec3,
    /// Up direction in the file.
    pub up: DVec3,
}

impl Placement {
    pub fn of(options: &WriteOptions) -> Self {
        let registration = options.registration;
        let up = registration.map_or(options.up, |registration| registration.up(options.up));
        let to_z_up = AxisRotation::to_z_up(up.normalize());
        let axes = match options.format.own_axes().unwrap_or(options.axes) {
            Axes::AsIs => AxisRotation::IDENTITY,
            Axes::Viewer => to_z_up.then(AxisRotation::Z_UP_TO_Y_DOWN),
            Axes::YUp => to_z_up.then(AxisRotation::Z_UP_TO_Y_UP),
            Axes::ZUp => to_z_up,
        };
        let places = shift_and_origin(registration, options.local_origin);
        let [shift, origin] = places.map(|place| axes.rotate_vector(place) * options.unit_scale);
        Self {
            turn: registration.map_or(axes, |registration| registration.turn().then(axes)),
            scale: registration.map_or(1.0, |registration| registration.scale) * options.unit_scale,
            shift,
            origin,
            up: axes.rotate_vector(up),
        }
    }

    pub fn place(&self, p: DVec3) -> DVec3 {
        self.scale * self.turn.rotate_vector(p) + self.shift
    }
}

pub(super) fn check_axes(options: &WriteOptions) -> Result<(), Fault> {
    if options.up.try_normalize().is_none() {
        return Err(Fault::setting("up", "a direction", options.up));
    }
    if !(options.unit_scale.is_finite() && options.unit_scale > 0.0) {
        return Err(Fault::setting("unit scale", "a number above 0", options.unit_scale));
    }
    if !options.local_origin.is_finite() {
        return Err(Fault::setting("local origin", "finite numbers", options.local_origin));
    }
    if let Some(Err(found)) = options.registration.map(Registration::check) {
        return Err(Fault::setting("registration", REGISTRATION, found));
    }
    Ok(())
}

fn check(n_splats: usize, options: &WriteOptions) -> Result<(), Fault> {
    check_axes(options)?;
    let WriteSelection { crop, min_evidence, max_uncertainty, uncertainty, left_out } =
        options.selection;
    if let Some([a, b]) = crop.filter(|[a, b]| !(a.is_finite() && b.is_finite())) {
        return Err(Fault::setting("crop box", "finite corners", format!("{a} and {b}")));
    }
    let lists = [
        ("confidence", options.confidence.map(<[f64]>::len)),
        ("uncertainty", uncertainty.map(<[f64]>::len)),
        ("left out", left_out.map(<[bool]>::len)),
    ];
    // With lists of another length, splats would get each other's values.
    for (name, length) in lists {
        if let Some(length) = length.filter(|length| *length != n_splats) {
            let expected = format!("one value for each of {n_splats} splats");
            return Err(Fault::setting(name, expected, format!("{length} values")));
        }
    }
    let limit = match (min_evidence, options.confidence, max_uncertainty, uncertainty) {
        (Some(_), None, ..) => "least evidence",
        (.., Some(_), None) => "largest uncertainty",
        _ => return Ok(()),
    };
    let expected = "a model with training statistics (a checkpoint)";
    Err(Fault::setting(limit, expected, "splats alone"))
}
