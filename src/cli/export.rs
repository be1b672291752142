//! `export`: a model in another format.

use super::args::{AxesName, ExportArgs, FormatName};
use super::failure::Failure;
use super::{model, output};
use glam::DVec3;
use vbgs_studio::export::mapping;
use vbgs_studio::export::{Axes, ModelFormat, WriteOptions, write};

/// Converts as asked.
pub fn run(args: &ExportArgs) -> Result<(), Failure> {
    let format = match args.format {
        Some(FormatName::Ply) => ModelFormat::Ply,
        Some(FormatName::PointCloud) => ModelFormat::PointCloudPly,
        Some(FormatName::Glb) => ModelFormat::Glb,
        None => ModelFormat::from_path(&args.output)?,
    };
    let asked = args.mapping.said();
    if let (Some(option), ModelFormat::PointCloudPly) = (asked, format) {
        return Err(Failure::Usage(format!(
            "{option}: a setting of splats, found with the format point-cloud, which holds none; leave it out or export ply or glb"
        )));
    }
    let model = model::load(&args.model)?;
    if let Some(option) = asked.filter(|_| mapping::is_plain(model.splats.view())) {
        eprintln!(
            "note: {}: no splat has an opacity above 1 or a colour gradient: {option} changes nothing",
            args.model.display()
        );
    }
    let up = model.up.unwrap_or(DVec3::Z);
    let options = WriteOptions {
        axes: match args.axes {
            AxesName::AsIs => Axes::AsIs,
            AxesName::Viewer => Axes::Viewer,
        },
        sh3_padding: args.sh3_padding,
        mapping: args.mapping.mapping(),
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
