//! Export of models: checks the options, selects and maps splats, and writes one format.

use super::error::{ExportError, Fault, shorten};
use super::format::{ModelFormat, WriteOptions};
use super::imported::ANTIALIASED_COMMENTS;
use super::source::ExportRows;
use super::stream::{ProgressCounter, SplatRows};
use super::{atomic, glb, html, ply, sog, spz, usd};
use crate::model::splat::appearance::SplatView;
use std::io;
use std::io::Write;
use std::path::Path;

/// Summary of an export.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct WriteSummary {
    /// Number of splats written. A native splat that was split counts as two or four.
    pub n_written: usize,
    /// Number of undrawable splats: not finite, or with opacity 0 (unused components).
    pub n_skipped: usize,
    /// Number of drawable splats excluded by [`WriteOptions::selection`].
    pub n_left_out: usize,
    /// Size of the file in bytes.
    pub bytes: u64,
}

/// Writes the drawable splats to `path` atomically (see [`atomic::write_atomic`]). Native splats are
/// mapped to plain ones (see [`super::mapping`]). Needs 8 bytes of memory per splat and a block of rows;
/// SPZ also needs memory for the compressed file and 16 bytes per splat, SOG 32 bytes per splat.
///
/// Positions are exact except in SPZ, SOG and HTML, and scales are at least 1e-7. Opacities in PLY are limited to
/// `[1e-6, 1 − 1e-6]`.
///
/// # Errors
/// [`Fault::NothingToExport`] if no splat is drawable, [`Fault::NothingSelected`] if none is selected,
/// [`Fault::Setting`] for invalid options, [`Fault::TooLargeForGlb`] from 4 GiB, [`Fault::Cancelled`], or an
/// error of writing the file.
pub fn write<'a>(
    path: &Path,
    splats: impl Into<SplatView<'a>>,
    options: &WriteOptions,
) -> Result<WriteSummary, ExportError> {
    let view: SplatView = splats.into();
    let comments = stated_comments(view, options);
    let options = &WriteOptions { comments: &comments, ..options.clone() };
    let source = select_rows(view, options).map_err(|fault| fault.with_path(path))?;
    // Prepared before any file is created, because layouts refuse what their format cannot hold.
    let content = prepare_content(&source, options).map_err(|fault| fault.with_path(path))?;
    let bytes = atomic::write_atomic(path, |out| content(out))?;
    let n_skipped = view.splats().len() - source.n_drawable;
    let n_left_out = source.n_left_out;
    Ok(WriteSummary { n_written: source.n_rows(), n_skipped, n_left_out, bytes })
}

pub(super) fn encode(view: SplatView, options: &WriteOptions) -> Result<Vec<u8>, Fault> {
    let comments = stated_comments(view, options);
    let options = &WriteOptions { comments: &comments, ..options.clone() };
    let source = select_rows(view, options)?;
    let content = prepare_content(&source, options)?;
    let mut bytes = Vec::new();
    content(&mut bytes).map_err(atomic::to_fault("convert", 0))?;
    Ok(bytes)
}

/// Returns the comments of a file: those given, and how other programs are to draw the splats.
fn stated_comments(view: SplatView, options: &WriteOptions) -> Vec<String> {
    let is_stated = view.finishing().is_antialiased && options.format != ModelFormat::PointCloudPly;
    let stated = ANTIALIASED_COMMENTS.iter().filter(|_| is_stated).map(|line| (*line).to_owned());
    options.all_comments().into_iter().chain(stated).collect()
}

fn select_rows<'a>(view: SplatView<'a>, options: &WriteOptions) -> Result<ExportRows<'a>, Fault> {
    check_comments(options.comments)?;
    let source = ExportRows::new(view, options)?;
    match (source.n_drawable, source.n_rows()) {
        (0, _) => Err(Fault::NothingToExport { n_splats: view.splats().len() }),
        (n_drawable, 0) => Err(Fault::NothingSelected { n_drawable }),
        _ => Ok(source),
    }
}

type Content<'a> = Box<dyn Fn(&mut dyn Write) -> io::Result<()> + 'a>;

fn prepare_content<'a>(
    source: &'a ExportRows<'a>,
    options: &'a WriteOptions,
) -> Result<Content<'a>, Fault> {
    let steps =
        |n_columns: usize| ProgressCounter::new(options.progress, source.n_rows() * n_columns);
    Ok(match options.format {
        ModelFormat::Ply => {
            let layout = ply::write::PlyLayout::new(source, options)?;
            Box::new(move |out| layout.write(out, source, &mut steps(1)))
        }
        ModelFormat::PointCloudPly => {
            let header = ply::write::header(source.n_rows(), options)?;
            Box::new(move |out| ply::write::points(out, &header, source, options, &mut steps(1)))
        }
        ModelFormat::Glb => {
            let layout = glb::write::GlbLayout::new(source, options)?;
            Box::new(move |out| layout.write(out, source, &mut steps(layout.n_columns())))
        }
        ModelFormat::Spz => {
            let layout =
                spz::write::SpzLayout::new(source, options.spz_version, source.is_antialiased())?;
            Box::new(move |out| layout.write(out, source, &mut steps(layout.n_columns())))
        }
        ModelFormat::Sog => {
            let layout = sog::write::SogLayout::new(source, source.is_antialiased());
            Box::new(move |out| layout.write(out, source, &mut steps(layout.n_columns())))
        }
        ModelFormat::Html => {
            let layout = html::HtmlLayout::new(source)?;
            Box::new(move |out| layout.write(out, source, &mut steps(layout.n_columns())))
        }
        ModelFormat::Usda => {
            let layout = usd::UsdLayout::new(source, options);
            Box::new(move |out| layout.write(out, source, &mut steps(layout.n_columns())))
        }
    })
}

fn check_comments(comments: &[String]) -> Result<(), Fault> {
    // A line break would end the comment and begin another header line.
    let printable = |line: &String| line.bytes().all(|b| (b' '..=b'~').contains(&b));
    match comments.iter().find(|line| !printable(line)) {
        None => Ok(()),
        Some(line) => Err(Fault::setting("comment", "one line of printable ASCII", shorten(line))),
    }
}

/// Comparison with golden files byte for byte. These were made from f64 values, which a
/// [`Splat`](crate::model::splat::splats::Splat) would round to f32, so the encoders are called directly;
/// `tests/export/golden.rs` compares the public path.
#[cfg(test)]
mod tests {
    use super::*;
    use crate::export::gaussian::{AxisRotation, Gaussian};
    use crate::export::stream::WriteProgress;
    use glam::{DMat3, DQuat, DVec3};
    use serde_json::Value;
    use std::path::PathBuf;

    fn golden(name: &str) -> Vec<u8> {
        let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("tests/golden");
        std::fs::read(folder.join(name)).unwrap()
    }

    fn gaussians() -> Vec<Gaussian> {
        let cases: Value = serde_json::from_slice(&golden("export_cases.json")).unwrap();
        let numbers = |v: &Value| -> Vec<f64> {
            v.as_array().unwrap().iter().map(|x| x.as_f64().unwrap()).collect()
        };
        let splat = |s: &Value| {
            let q = numbers(&s["quat"]);
            Gaussian {
                mean: DVec3::from_slice(&numbers(&s["mean"])),
                opacity: s["opacity"].as_f64().unwrap(),
                color: DVec3::from_slice(&numbers(&s["rgb"])),
                scale: DVec3::from_slice(&numbers(&s["scale"])),
                rotation: DQuat::from_xyzw(q[1], q[2], q[3], q[0]),
                directional: DMat3::ZERO,
                seen: DVec3::ZERO,
            }
        };
        cases["splats"].as_array().unwrap().iter().map(splat).collect()
    }

    impl SplatRows for Vec<Gaussian> {
        fn n_rows(&self) -> usize {
            self.len()
        }

        fn row(&self, row: usize) -> Gaussian {
            self[row]
        }

        fn has_directions(&self) -> bool {
            false
        }
    }

    #[test]
    fn ply_files_are_equal_byte_for_byte() {
        for (name, sh3_padding) in [("two_splats.ply", false), ("two_splats_sh3.ply", true)] {
            let options = WriteOptions { sh3_padding, ..WriteOptions::new(ModelFormat::Ply) };
            let rows = gaussians();
            let layout = ply::write::PlyLayout::new(&rows, &options).unwrap();
            let mut bytes = Vec::new();
            layout
                .write(&mut bytes, &rows, &mut ProgressCounter::new(WriteProgress::NONE, 2))
                .unwrap();
            assert!(bytes == golden(name), "{name} differs");
        }
    }

    #[test]
    fn glb_file_is_equal_byte_for_byte_except_the_generator() {
        let rows = gaussians().into_iter().map(|g| g.rotated(&AxisRotation::Z_UP_TO_Y_UP));
        let rows = rows.collect::<Vec<_>>();
        let mut layout =
            glb::write::GlbLayout::new(&rows, &WriteOptions::new(ModelFormat::Glb)).unwrap();
        let mine = concat!(r#""generator":"vbgs-studio "#, env!("CARGO_PKG_VERSION"), '"');
        assert!(layout.json.contains(mine), "{}", layout.json);
        layout.json = layout.json.replace(mine, r#""generator":"vbgs""#);
        let mut bytes = Vec::new();
        layout.write(&mut bytes, &rows, &mut ProgressCounter::new(WriteProgress::NONE, 2)).unwrap();
        assert!(bytes == golden("two_splats.glb"), "GLB differs");
    }
}
