//! Frames as files that any program reads: arrays of NumPy and one JSON beside them.
//!
//! Of frame `i` `points-i.npy` holds normalised rows x, y, z, r, g, b, `color-i.npy` bytes, `depth-i.npy`
//! lengths along the optical axis with 0 at holes.

use crate::bench::findings::BenchError;
use crate::bench::paper::sample::spaced;
use crate::dataset::Dataset;
use crate::dataset::frame::Frame;
use crate::dataset::unproject::Unprojector;
use crate::observation::points::Points;
use crate::pipeline::plan::Selection;
use crate::pipeline::preset::TypedPreset;
use crate::pipeline::session::Session;
use crate::train::paper::config::PaperConfig;
use bytemuck::cast_slice;
use serde_json::{Value, json};
use std::path::Path;
use std::sync::Arc;
use tempfile::TempDir;

/// Frames in memory for us and in a folder for others.
pub(super) struct SharedFrames {
    /// By frame what the mixture learns from.
    pub points: Vec<Points<f32>>,
    /// Where the same lies for others; goes with its handle.
    pub folder: TempDir,
}

impl SharedFrames {
    /// Up to `n` training frames, evenly spaced; unusable ones are passed over. `told` is what programs
    /// are told besides.
    pub fn write(
        dataset: &Arc<Dataset>,
        n: usize,
        config: &PaperConfig,
        told: Value,
    ) -> Result<Self, BenchError> {
        let session = Session::new(dataset.clone(), config.clone(), Selection::all_frames())?;
        let normalization = *session.normalization();
        let preparation = config.preparation(session.config(), normalization);
        let (split, chosen) = (session.plan().split, spaced(&session.plan().frames, n));
        drop(session);
        let folder = tempfile::tempdir().map_err(at(&std::env::temp_dir()))?;
        let (mut all, mut described, mut first_problem) = (Vec::new(), Vec::new(), None);
        let mut unprojector = Unprojector::new();
        for i in chosen {
            let mut points = Points::new();
            let frame = dataset.load(split, i).and_then(|frame| {
                unprojector.unproject(&frame, &preparation, &mut points).map(|_| frame)
            });
            match frame {
                Ok(frame) => {
                    described.push(write_frame(folder.path(), all.len(), &frame, &points)?);
                    all.push(points);
                }
                Err(problem) => drop(first_problem.get_or_insert(problem.to_string())),
            }
        }
        if all.is_empty() {
            let first = first_problem.unwrap_or_else(|| "no frame is selected".to_owned());
            return Err(BenchError::NoFrame { dataset: dataset.name.clone(), first });
        }
        let frames = json!({ "frames": described, "told": told });
        let path = folder.path().join("frames.json");
        std::fs::write(&path, serde_json::to_vec(&frames)?).map_err(at(&path))?;
        Ok(Self { points: all, folder })
    }
}

fn write_frame(
    folder: &Path,
    number: usize,
    frame: &Frame,
    points: &Points<f32>,
) -> Result<Value, BenchError> {
    let array = |name: &str, kind, shape: &[usize], bytes: &[u8]| {
        let path = folder.join(format!("{name}-{number}.npy"));
        std::fs::write(&path, npy(kind, shape, bytes)).map_err(at(&path))
    };
    let row = |i| {
        let ([x, y, z], [r, g, b]) = (points.position(i), points.color(i));
        [x, y, z, r, g, b]
    };
    let rows: Vec<[f32; 6]> = (0..points.len()).map(row).collect();
    array("points", "<f4", &[rows.len(), 6], cast_slice(&rows))?;
    let registered = frame.with_registered_color();
    let color = &registered.color;
    let rgb: Vec<[u8; 3]> = color.data.iter().map(|&[r, g, b, _]| [r, g, b]).collect();
    array("color", "|u1", &[color.height, color.width, 3], cast_slice(&rgb))?;
    if let Some(depth) = frame.depth_z() {
        array("depth", "<f4", &[depth.height, depth.width], cast_slice(&depth.data))?;
    }
    let k = &frame.camera.intrinsics;
    let pose = frame.camera.pose;
    Ok(json!({
        "name": frame.name,
        "intrinsics": [k.fx, k.fy, k.cx, k.cy],
        // Columns of the rotation, camera to world in OpenCV's axes, and the camera's centre.
        "axes": pose.rotation().to_cols_array_2d(),
        "centre": pose.centre().to_array(),
    }))
}

/// An array as NumPy stores it, version 1.0.
fn npy(kind: &str, shape: &[usize], bytes: &[u8]) -> Vec<u8> {
    /// Bytes before the data are a multiple of this.
    const ALIGNMENT: usize = 64;
    /// Magic, version, and the length of what follows.
    const BEFORE: usize = 10;
    let shape: String = shape.iter().map(|n| format!("{n}, ")).collect();
    let mut header = format!("{{'descr': '{kind}', 'fortran_order': False, 'shape': ({shape}), }}");
    let padded = (BEFORE + header.len() + 1).next_multiple_of(ALIGNMENT) - BEFORE;
    header.extend(std::iter::repeat_n(' ', padded - header.len() - 1));
    header.push('\n');
    let length = (header.len() as u16).to_le_bytes();
    [b"\x93NUMPY\x01\x00", &length[..], header.as_bytes(), bytes].concat()
}

fn at(path: &Path) -> impl FnOnce(std::io::Error) -> BenchError {
    |source| BenchError::File { path: path.to_owned(), source }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arrays_begin_at_a_multiple_of_64_bytes_behind_their_shape() {
        let values = [1.5f32, -2.0, 0.25, 3.0, 4.0, 5.0];
        let array = npy("<f4", &[3, 2], cast_slice(&values));
        let header = usize::from(u16::from_le_bytes([array[8], array[9]]));
        assert_eq!((10 + header) % 64, 0);
        let text = std::str::from_utf8(&array[10..10 + header]).unwrap();
        assert!(text.starts_with("{'descr': '<f4', 'fortran_order': False, 'shape': (3, 2, ), }"));
        assert!(text.ends_with(" \n"), "{text:?}");
        assert_eq!(array[10 + header..], *cast_slice::<f32, u8>(&values));
    }
}
