//! `export`: a model in another format.

use super::args::{AxesName, ExportArgs, FormatName};
use super::failure::Failure;
use super::interrupt::Interrupt;
use super::model::{self, Model};
use super::{output, progress};
use glam::DVec3;
use vbgs_studio::export::{
    Axes, ExportError, Fault, ModelFormat, WriteOptions, WriteProgress, WriteSelection, mapping,
    write,
};

/// Converts as asked.
pub fn run(args: &ExportArgs) -> Result<(), Failure> {
    let format = format(args)?;
    let (model, certainty) = match (args.min_evidence, args.max_uncertainty) {
        (None, None) => (model::load(&args.model)?, None),
        _ => model::load_with_certainty(&args.model)?,
    };
    say_what_is_assumed(args, format, &model);
    let interrupt = Interrupt::listen()?;
    let summary = progress::share("splats", |told| {
        let going_on = |share| {
            told(share);
            !interrupt.is_asked()
        };
        let options = WriteOptions {
            axes: match args.axes {
                AxesName::AsIs => Axes::AsIs,
                AxesName::Viewer => Axes::Viewer,
                AxesName::YUp => Axes::YUp,
                AxesName::ZUp => Axes::ZUp,
            },
            sh3_padding: args.sh3_padding,
            mapping: args.mapping.mapping(),
            comments: &model.comments,
            up: up(args, &model),
            unit_scale: args.unit_scale,
            confidence: certainty.as_ref().map(|c| &c.evidence[..]),
            selection: WriteSelection {
                crop: args.crop,
                min_evidence: args.min_evidence,
                max_uncertainty: args.max_uncertainty,
                uncertainty: certainty.as_ref().map(|c| &c.uncertainty[..]),
            },
            progress: WriteProgress::new(&going_on),
            ..WriteOptions::new(format)
        };
        write(&args.output, &model.splats, &options)
    });
    let summary = match summary {
        Err(ExportError { fault: Fault::Cancelled, .. }) => return Err(Failure::Interrupted),
        other => other?,
    };
    output::line(format!(
        "wrote {} splats, {} bytes, to {}",
        summary.n_written,
        summary.bytes,
        args.output.display()
    ));
    Ok(())
}

/// The format, if every option has a meaning for it.
fn format(args: &ExportArgs) -> Result<ModelFormat, Failure> {
    let format = match args.format {
        Some(FormatName::Ply) => ModelFormat::Ply,
        Some(FormatName::PointCloud) => ModelFormat::PointCloudPly,
        Some(FormatName::Glb) => ModelFormat::Glb,
        Some(FormatName::Spz) => ModelFormat::Spz,
        None => ModelFormat::from_path(&args.output)?,
    };
    match (args.mapping.said(), format) {
        (Some(option), ModelFormat::PointCloudPly) => Err(Failure::Usage(format!(
            "{option}: a setting of splats, found with the format point-cloud, which holds none; leave it out or export ply, glb or spz"
        ))),
        _ => Ok(format),
    }
}

fn say_what_is_assumed(args: &ExportArgs, format: ModelFormat, model: &Model) {
    let path = args.model.display();
    if let Some(option) = args.mapping.said().filter(|_| mapping::is_plain(model.splats.view())) {
        eprintln!(
            "note: {path}: no splat has an opacity above 1 or a colour gradient: {option} changes nothing"
        );
    }
    let is_turned = matches!(format, ModelFormat::Glb | ModelFormat::Spz)
        || !matches!(args.axes, AxesName::AsIs);
    if is_turned && args.up.is_none() && model.up.is_none() {
        eprintln!(
            "note: {path}: the file does not say what is up; taken as z, --up says otherwise"
        );
    }
}

fn up(args: &ExportArgs, model: &Model) -> DVec3 {
    args.up.map(|up| up.direction()).or(model.up).unwrap_or(DVec3::Z)
}
