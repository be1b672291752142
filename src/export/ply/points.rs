//! Centres as a coloured point cloud (`export.md`, Point cloud).

use super::write::{end_header, header_start, push_property, turn};
use crate::export::error::Fault;
use crate::export::format::WriteOptions;
use crate::export::gaussian::{Gaussian, drawable};
use crate::math::image::unit_to_byte;
use crate::model::splat::appearance::SplatView;
use glam::DVec3;
use std::io::{self, Write};

/// The header of `n` points, those of `n_splats` that are drawable.
pub(in crate::export) fn header(
    n: usize,
    n_splats: usize,
    options: &WriteOptions,
) -> Result<String, Fault> {
    // A list of another length would give every point a stranger's count.
    if let Some(confidence) = options.confidence.filter(|c| c.len() != n_splats) {
        return Err(Fault::Setting {
            setting: "confidence",
            expected: format!("one value for each of {n_splats} splats"),
            found: format!("{} values", confidence.len()),
        });
    }
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
    end_header(header)
}

/// Header and rows.
pub(in crate::export) fn points(
    out: &mut dyn Write,
    header: &str,
    view: SplatView,
    options: &WriteOptions,
) -> io::Result<()> {
    out.write_all(header.as_bytes())?;
    let turn = turn(options.axes);
    let vector = |v: DVec3| turn.vector(v).to_array().map(|x| (x as f32).to_le_bytes());
    for (i, point) in drawable(view) {
        out.write_all(vector(point.mean).as_flattened())?;
        let camera = nearest(point.mean, options.camera_centres);
        if let Some(camera) = camera {
            out.write_all(vector(normal(&point, camera)).as_flattened())?;
        }
        // A point has one colour: what the nearest camera saw is what was there to be seen.
        let color = camera.map_or(point.color, |camera| point.color_from(camera));
        out.write_all(&color.to_array().map(|c| unit_to_byte(c as f32)))?;
        if let Some(confidence) = options.confidence {
            out.write_all(&(confidence[i] as f32).to_le_bytes())?;
        }
    }
    Ok(())
}

fn nearest(point: DVec3, camera_centres: &[DVec3]) -> Option<DVec3> {
    let distances = camera_centres.iter().map(|&c| (c.distance_squared(point), c));
    distances.min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, centre)| centre)
}

/// The axis along which the splat is thinnest, on the side of a camera.
fn normal(splat: &Gaussian, camera: DVec3) -> DVec3 {
    let axis = splat.rotation * DVec3::AXES[splat.scale.min_position()];
    if axis.dot(camera - splat.mean) < 0.0 { -axis } else { axis }
}
