//! Splats in the 3DGS layout (`export.md` 1).

use super::N_REST_DEGREE_3;
use crate::export::error::Fault;
use crate::export::format::{Axes, WriteOptions};
use crate::export::gaussian::{Gaussian, Turn, color_to_sh, logit, wxyz};
use crate::export::imported::VERTICAL_AXIS;
use std::fmt::Write as _;
use std::io::{self, Write};

/// antimatter15/splat reads headers up to 10 KB, others more; 4 KB leaves room (`export.md` 1).
const LONGEST_HEADER: usize = 4096;

const BEFORE_REST: [&str; 9] = ["x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2"];
const AFTER_REST: [&str; 8] =
    ["opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"];

/// The header of `n` splats.
pub(in crate::export) fn splat_header(n: usize, options: &WriteOptions) -> Result<String, Fault> {
    let mut header = header_start(n, options);
    let rest = (0..n_rest(options)).map(|i| format!("f_rest_{i}"));
    let names = BEFORE_REST.map(str::to_owned).into_iter().chain(rest);
    for name in names.chain(AFTER_REST.map(str::to_owned)) {
        push_property(&mut header, "float", &name);
    }
    end_header(header)
}

/// Header and rows.
pub(in crate::export) fn splats(
    out: &mut dyn Write,
    header: &str,
    gaussians: impl Iterator<Item = Gaussian>,
    options: &WriteOptions,
) -> io::Result<()> {
    out.write_all(header.as_bytes())?;
    let turn = turn(options.axes);
    let mut row = Vec::new();
    for gaussian in gaussians {
        row.clear();
        encode_row(&mut row, &gaussian.turned(&turn), n_rest(options));
        out.write_all(&row)?;
    }
    Ok(())
}

fn encode_row(row: &mut Vec<u8>, gaussian: &Gaussian, n_rest: usize) {
    let mut put = |values: &[f64]| {
        row.extend(values.iter().flat_map(|&v| (v as f32).to_le_bytes()));
    };
    put(&gaussian.mean.to_array());
    put(&[0.0; 3]); // normals: readers of this layout skip them
    put(&color_to_sh(gaussian.color).to_array());
    put(&[0.0; N_REST_DEGREE_3][..n_rest]);
    put(&[logit(gaussian.opacity)]);
    put(&gaussian.scale.map(f64::ln).to_array());
    put(&wxyz(gaussian.rotation));
}

fn n_rest(options: &WriteOptions) -> usize {
    if options.sh3_padding { N_REST_DEGREE_3 } else { 0 }
}

/// Everything up to the first property of the vertex element.
pub(super) fn header_start(n: usize, options: &WriteOptions) -> String {
    // brush reads this comment as the up direction.
    let up = turn(options.axes).vector(options.up);
    // Adding zero turns −0 into 0.
    let [x, y, z] = up.as_vec3().to_array().map(|v| v + 0.0);
    let mut header =
        format!("ply\nformat binary_little_endian 1.0\ncomment {VERTICAL_AXIS} {x} {y} {z}\n");
    for comment in options.comments {
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
    if header.len() < LONGEST_HEADER {
        return Ok(header);
    }
    Err(Fault::Setting {
        setting: "comments",
        expected: format!("a PLY header below {LONGEST_HEADER} bytes"),
        found: format!("{} bytes", header.len()),
    })
}

/// The change of axes an option asks for.
pub(super) fn turn(axes: Axes) -> Turn {
    match axes {
        Axes::AsIs => Turn::NONE,
        Axes::Viewer => Turn::Z_UP_TO_Y_DOWN,
    }
}
