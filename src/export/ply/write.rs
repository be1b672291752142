//! Splats in the 3DGS layout (`files.md`, PLY of splats).

use super::{N_REST_DEGREE_1, N_REST_DEGREE_3};
use crate::export::error::Fault;
use crate::export::format::WriteOptions;
use crate::export::gaussian::{Gaussian, color_to_harmonic, directional_to_harmonics, logit, wxyz};
use crate::export::imported::VERTICAL_AXIS;
use crate::export::local_origin::comment;
use crate::export::source::{ExportRows, Placement};
use crate::export::stream::{ProgressCounter, SplatRows, put_floats, write_rows};
use crate::math::image::unit_to_byte;
use glam::DVec3;
use std::fmt::Write as _;
use std::io;
use std::io::Write;

/// Maximum header size in bytes.
// antimatter15/splat reads up to 10 KB, others more (`files.md`, PLY of splats).
const MAX_HEADER_BYTES: usize = 4096;

// Without `red green blue`: otherwise spark would read bare points, and brush would prefer them over `f_dc`.
const BEFORE_REST: [&str; 9] = ["x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2"];
const AFTER_REST: [&str; 8] =
    ["opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"];

pub(in crate::export) struct PlyLayout {
    header: String,
    /// Number of harmonic coefficients per channel above degree 0.
    n_rest: usize,
}

impl PlyLayout {
    pub fn new(rows: &impl SplatRows, options: &WriteOptions) -> Result<Self, Fault> {
        let n_rest = match (options.sh3_padding, rows.has_directions()) {
            (true, _) => N_REST_DEGREE_3,
            (false, true) => N_REST_DEGREE_1,
            (false, false) => 0,
        };
        let mut header = header_start(rows.n_rows(), options);
        let rest = (0..3 * n_rest).map(|i| format!("f_rest_{i}"));
        let names = BEFORE_REST.map(str::to_owned).into_iter().chain(rest);
        for name in names.chain(AFTER_REST.map(str::to_owned)) {
            push_property(&mut header, "float", &name);
        }
        Ok(Self { header: end_header(header)?, n_rest })
    }

    pub fn write(
        &self,
        out: &mut dyn Write,
        rows: &impl SplatRows,
        steps: &mut ProgressCounter,
    ) -> io::Result<()> {
        out.write_all(self.header.as_bytes())?;
        write_rows(out, rows.n_rows(), steps, |i, row| self.encode_row(row, &rows.row(i)))
    }

    #[expect(
        clippy::indexing_slicing,
        reason = "three channels, and at most N_REST_DEGREE_3 coefficients"
    )]
    fn encode_row(&self, row: &mut Vec<u8>, gaussian: &Gaussian) {
        let mut put = |values: &[f64]| put_floats(row, values);
        put(&gaussian.mean.to_array());
        put(&[0.0; 3]); // normals, ignored by readers of this layout
        put(&color_to_harmonic(gaussian.color).to_array());
        let degree_1 = directional_to_harmonics(gaussian.directional);
        // Channel by channel, each padded, as readers expect.
        for channel in 0..3 {
            let mut rest = [0.0; N_REST_DEGREE_3];
            rest[..N_REST_DEGREE_1].copy_from_slice(&degree_1.map(|f| f[channel]));
            put(&rest[..self.n_rest]);
        }
        put(&[logit(gaussian.opacity)]);
        put(&gaussian.scale.map(f64::ln).to_array());
        put(&wxyz(gaussian.rotation));
    }
}

fn header_start(n: usize, options: &WriteOptions) -> String {
    // brush reads this comment as the up direction.
    let Placement { up, origin, .. } = Placement::of(options);
    // Adding zero turns −0 into 0.
    let [x, y, z] = up.as_vec3().to_array().map(|v| v + 0.0);
    let mut header =
        format!("ply\nformat binary_little_endian 1.0\ncomment {VERTICAL_AXIS} {x} {y} {z}\n");
    for comment in options.comments.iter().chain(&comment(origin)) {
        let _ = writeln!(header, "comment {comment}");
    }
    let _ = writeln!(header, "element vertex {n}");
    header
}

fn push_property(header: &mut String, kind: &str, name: &str) {
    let _ = writeln!(header, "property {kind} {name}");
}

fn end_header(mut header: String) -> Result<String, Fault> {
    header.push_str("end_header\n");
    // The caller's comments may have any length, and viewers reject a header that is too long.
    if header.len() < MAX_HEADER_BYTES {
        return Ok(header);
    }
    let expected = format!("a PLY header below {MAX_HEADER_BYTES} bytes");
    Err(Fault::setting("comments", expected, format!("{} bytes", header.len())))
}

pub(in crate::export) fn header(n: usize, options: &WriteOptions) -> Result<String, Fault> {
    let mut header = header_start(n, options);
    let mut put = |kind, names: &[&str]| {
        names.iter().for_each(|name| push_property(&mut header, kind, name));
    };
    put("float", &["x", "y", "z"]);
    if !options.camera_centres.is_empty() {
        put("float", &["nx", "ny", "nz"]);
    }
    put("uchar", &["red", "green", "blue"]);
    if options.confidence.is_some() {
        put("float", &["confidence"]);
    }
    if options.selection.uncertainty.is_some() {
        put("float", &["uncertainty"]);
    }
    end_header(header)
}

pub(in crate::export) fn points(
    out: &mut dyn Write,
    header: &str,
    source: &ExportRows,
    options: &WriteOptions,
    steps: &mut ProgressCounter,
) -> io::Result<()> {
    out.write_all(header.as_bytes())?;
    // Camera positions are in the model's world, so normals and colours are computed there.
    let (cameras, confidence) = (options.camera_centres, options.confidence);
    let (uncertainty, unit) = (options.selection.uncertainty, Placement::of(options).scale);
    let of = |list: &[f64], i: usize| list.get(source.splat_index(i)).copied().unwrap_or(f64::NAN);
    write_rows(out, source.n_rows(), steps, |i, row| {
        let point = source.in_world(i);
        put_floats(row, &source.row(i).mean.to_array());
        let camera = nearest(point.mean, cameras);
        if let Some(camera) = camera {
            put_floats(row, &source.direction(normal(&point, camera)).to_array());
        }
        // A point has one colour: the one seen by the nearest camera.
        let color = camera.map_or(point.color, |camera| point.color_from(camera));
        row.extend_from_slice(&color.to_array().map(|c| unit_to_byte(c as f32)));
        if let Some(confidence) = confidence {
            put_floats(row, &[of(confidence, i)]);
        }
        if let Some(uncertainty) = uncertainty {
            put_floats(row, &[of(uncertainty, i) * unit]);
        }
    })
}

fn nearest(point: DVec3, camera_centres: &[DVec3]) -> Option<DVec3> {
    let distances = camera_centres.iter().map(|&c| (c.distance_squared(point), c));
    distances.min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, centre)| centre)
}

/// Returns a splat's unit normal, the axis along which it is thinnest, directed towards the camera.
#[expect(clippy::indexing_slicing, reason = "one of three axes")]
fn normal(splat: &Gaussian, camera: DVec3) -> DVec3 {
    let axis = splat.rotation * DVec3::AXES[splat.scale.min_position()];
    if axis.dot(camera - splat.mean) < 0.0 { -axis } else { axis }
}
