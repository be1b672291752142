//! Splats in the 3DGS layout (`export.md`, PLY of splats).

use super::{N_REST_DEGREE_1, N_REST_DEGREE_3};
use crate::export::error::Fault;
use crate::export::format::WriteOptions;
use crate::export::gaussian::{Gaussian, logit, wxyz};
use crate::export::harmonics;
use crate::export::imported::VERTICAL_AXIS;
use crate::export::local_origin::comment;
use crate::export::progress::ProgressCounter;
use crate::export::source::{file_origin, file_rotation};
use crate::export::stream::{SplatRows, put_floats, write_rows};
use std::fmt::Write as _;
use std::io::{self, Write};

/// Maximum header size: antimatter15/splat reads up to 10 KB, others more (`export.md`, PLY of splats).
const MAX_HEADER_BYTES: usize = 4096;

// Without `red green blue`: otherwise spark would read bare points, and brush would prefer them over `f_dc`.
const BEFORE_REST: [&str; 9] = ["x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2"];
const AFTER_REST: [&str; 8] =
    ["opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"];

/// Prepared file: header and number of coefficients.
pub(in crate::export) struct PlyLayout {
    header: String,
    /// Coefficients per channel above degree 0.
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
        put(&harmonics::from_color(gaussian.color).to_array());
        let degree_1 = harmonics::from_directional(gaussian.directional);
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

/// Header up to the first property of the vertex element.
pub(super) fn header_start(n: usize, options: &WriteOptions) -> String {
    // brush reads this comment as the up direction.
    let up = file_rotation(options).rotate_vector(options.up);
    // Adding zero turns −0 into 0.
    let [x, y, z] = up.as_vec3().to_array().map(|v| v + 0.0);
    let mut header =
        format!("ply\nformat binary_little_endian 1.0\ncomment {VERTICAL_AXIS} {x} {y} {z}\n");
    for comment in options.comments.iter().chain(&comment(file_origin(options))) {
        let _ = writeln!(header, "comment {comment}");
    }
    let _ = writeln!(header, "element vertex {n}");
    header
}

pub(super) fn push_property(header: &mut String, kind: &str, name: &str) {
    let _ = writeln!(header, "property {kind} {name}");
}

pub(super) fn end_header(mut header: String) -> Result<String, Fault> {
    header.push_str("end_header\n");
    // The caller's comments may have any length, and viewers reject a header that is too long.
    if header.len() < MAX_HEADER_BYTES {
        return Ok(header);
    }
    Err(Fault::Setting {
        setting: "comments",
        expected: format!("a PLY header below {MAX_HEADER_BYTES} bytes"),
        found: format!("{} bytes", header.len()),
    })
}
