//! `export`: a model in another format.

use super::args::{AxesName, ExportArgs, FormatName};
use super::failure::Failure;
use super::{model, output};
use glam::DVec3;
use vbgs_studio::export::{Axes, Format, WriteOptions, write};

/// Converts as asked.
pub fn run(args: &ExportArgs) -> Result<(), Failure> {
    let format = match args.format {
        Some(FormatName::Ply) => Format::Ply,
        Some(FormatName::PointCloud) => Format::PointCloudPly,
        Some(FormatName::Glb) => Format::Glb,
        None => Format::from_path(&args.output)?,
    };
    let model = model::load(&args.model)?;
    let up = model.up.unwrap_or(DVec3::Z);
    let options = WriteOptions {
        axes: match args.axes {
            AxesName::AsIs => Axes::AsIs,
            AxesName::Viewer => Axes::Viewer,
        },
        sh3_padding: args.sh3_padding,
        comments: &model.comments,
        up,
        ..WriteOptions::new(format)
    };
    let summary = write(&args.output, &model.splats, &options)?;
    output::line(format!(
        "wrote {} splats, {} bytes, to {}",
        summary.n_written,
        summary.bytes,
        args.output.display()
    ));
    Ok(())
}
