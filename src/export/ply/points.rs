//! Splat centres as a coloured point cloud (`export.md`, Point cloud).

use super::write::{end_header, header_start, push_property};
use crate::export::error::Fault;
use crate::export::format::WriteOptions;
use crate::export::gaussian::Gaussian;
use crate::export::progress::ProgressCounter;
use crate::export::source::ExportRows;
use crate::export::stream::{SplatRows, put_floats, write_rows};
use crate::math::image::unit_to_byte;
use glam::DVec3;
use std::io::{self, Write};

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
    let (uncertainty, unit) = (options.selection.uncertainty, options.unit_scale);
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

/// Axis along which the splat is thinnest, facing the camera.
#[expect(clippy::indexing_slicing, reason = "one of three axes")]
fn normal(splat: &Gaussian, camera: DVec3) -> DVec3 {
    let axis = splat.rotation * DVec3::AXES[splat.scale.min_position()];
    if axis.dot(camera - splat.mean) < 0.0 { -axis } else { axis }
}
