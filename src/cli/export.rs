//! `export`: converts a model to another format.

use super::args::{
    ExportArgs, FormatName, KindName, MergeArgs, RegisterArgs, parse_length, parse_point,
};
use super::failure::Failure;
use super::interrupt::Interrupt;
use super::model::{Model, Training};
use super::{model, output};
use glam::DVec3;
use std::path::Path;
use vbgs_studio::export::atomic::remove_leftovers;
use vbgs_studio::export::checkpoint::StoredModel;
use vbgs_studio::export::local_origin::OriginCarrier;
use vbgs_studio::export::mesh::{MeshFormat, Surfel, write_mesh};
use vbgs_studio::export::registration::{
    References, Registration, Residuals, read_pairs, shift_and_origin,
};
use vbgs_studio::export::{
    Axes, ExportError, Fault, ModelFormat, SpzVersion, WriteOptions, WriteProgress, WriteSelection,
    checkpoint, local_origin, mapping, write,
};
use vbgs_studio::pipeline::checkpoint::{SavedRun, merge, merge_onto};

pub fn run(args: &ExportArgs) -> Result<(), Failure> {
    match args.kind {
        KindName::Splats => splats(args),
        KindName::Mesh => mesh(args),
    }
}

fn splats(args: &ExportArgs) -> Result<(), Failure> {
    let format = format(args)?;
    // Point clouds contain each point's confidence; other formats use it only to select splats.
    let is_asked = args.min_evidence.is_some() || args.max_uncertainty.is_some();
    let (model, training) = match is_asked || format == ModelFormat::PointCloudPly {
        true => model::load_with_training(&args.model)?,
        false => (model::load(&args.model)?, None),
    };
    note_assumptions(args, format.own_axes().is_some(), &model);
    let summary = write_with_progress(&args.output, "splats", |progress| {
        let options = options(args, format, &model, training.as_ref(), progress);
        write(&args.output, &model.splats, &options)
    })?;
    warn_of_origin(&args.output, origin(&model), format.origin_carrier());
    out!(
        "wrote {} splats, {} bytes, to {}",
        summary.n_written,
        summary.bytes,
        args.output.display()
    );
    Ok(())
}

fn mesh(args: &ExportArgs) -> Result<(), Failure> {
    let asked = args.format.map(|_| "--format").or(args.mapping.first_given_option());
    let asked = asked.or(args.spz_version.map(|_| "--spz-version"));
    if let Some(option) = asked.or(args.sh3_padding.then_some("--sh3-padding")) {
        return Err(usage!("{option}: a setting of splats, found with --as mesh; leave it out"));
    }
    let format = MeshFormat::from_path(&args.output)?;
    // No other mesh format prescribes its axes.
    if format == MeshFormat::Glb {
        check_axes(args, Axes::YUp, &"glb")?;
    }
    let path = args.model.display();
    let needed = || {
        failed!(
            "{path}: expected a checkpoint of the `scene` preset, which contains normals, found none; train with --preset scene and export its checkpoint.vbgs"
        )
    };
    let (model, training) = model::load_with_training(&args.model)?;
    let training = training.ok_or_else(needed)?;
    let h = model.method.as_ref().and_then(|m| m.scene()).map(|scene| scene.engine.h);
    let cell = args.cell.or(h.map(|h| 0.5 * h)).ok_or_else(needed)?;
    if let Some(loss) =
        mapping::lost_textures(model.splats.view()).filter(|_| !format.has_textures())
    {
        note!("note: {path}: {loss}; meshes as GLB and OBJ show them");
    }
    let summary = write_with_progress(&args.output, "mesh", |progress| {
        // A mesh ignores the format of splats.
        let options = options(args, ModelFormat::Ply, &model, Some(&training), progress);
        let asked = |i: usize, surfel: &Surfel| {
            options.selection.selects(i, surfel.mean, options.confidence).then(|| surfel.clone())
        };
        let surfels: Vec<Surfel> =
            training.surfels.iter().filter_map(|(i, surfel)| asked(*i, surfel)).collect();
        write_mesh(&args.output, &surfels, cell, format, &options)
    })?;
    warn_of_origin(&args.output, origin(&model), format.origin_carrier());
    out!(
        "wrote {} vertices and {} triangles, {} bytes, to {}",
        summary.n_vertices,
        summary.n_triangles,
        summary.bytes,
        args.output.display()
    );
    Ok(())
}

/// Writes a file and shows a progress bar. Ctrl-C cancels and removes the unfinished file. Temporary
/// files left by killed exports to the same path are removed.
fn write_with_progress<T>(
    output: &Path,
    what: &'static str,
    work: impl FnOnce(WriteProgress) -> Result<T, ExportError>,
) -> Result<T, Failure> {
    let interrupt = Interrupt::listen()?;
    remove_leftovers(output);
    let written = output::share(what, |told| {
        let goes_on = |share| {
            told(share);
            !interrupt.is_requested()
        };
        work(WriteProgress::new(&goes_on))
    });
    match written {
        Err(ExportError { fault: Fault::Cancelled, .. }) => Err(Failure::Interrupted),
        other => Ok(other?),
    }
}

fn options<'a>(
    args: &ExportArgs,
    format: ModelFormat,
    model: &'a Model,
    training: Option<&'a Training>,
    progress: WriteProgress<'a>,
) -> WriteOptions<'a> {
    WriteOptions {
        axes: args.axes,
        sh3_padding: args.sh3_padding,
        spz_version: args.spz_version.unwrap_or_default(),
        mapping: args.mapping.mapping(),
        comments: &model.comments,
        // A note states this assumption.
        up: args.up.or(model.up).unwrap_or(DVec3::Z),
        local_origin: model.local_origin,
        metric: model.is_metric,
        registration: model.registration.as_ref(),
        unit_scale: args.unit_scale,
        confidence: training.map(|t| &t.evidence[..]),
        selection: WriteSelection {
            // Given in world coordinates, while splats are relative to the local origin.
            crop: args.crop.map(|corners| corners.map(|at| at - model.local_origin)),
            min_evidence: args.min_evidence,
            max_uncertainty: args.max_uncertainty,
            uncertainty: training.map(|t| &t.uncertainty[..]),
            left_out: None,
        },
        progress,
        ..WriteOptions::new(format)
    }
}

/// Warns if other programs will misplace the model because it is far from the world's origin.
pub fn warn_of_origin(path: &Path, origin: DVec3, carrier: OriginCarrier) {
    if let Some(warning) = local_origin::warning(origin, carrier) {
        note!("warning: {}: {warning}", path.display());
    }
}

/// Local origin of an exported model, in the coordinates of its registration.
fn origin(model: &Model) -> DVec3 {
    shift_and_origin(model.registration.as_ref(), model.local_origin)[1]
}

fn format(args: &ExportArgs) -> Result<ModelFormat, Failure> {
    let format = match args.format {
        Some(FormatName::Ply) => ModelFormat::Ply,
        Some(FormatName::PointCloud) => ModelFormat::PointCloudPly,
        Some(FormatName::Glb) => ModelFormat::Glb,
        Some(FormatName::Spz) => ModelFormat::Spz,
        Some(FormatName::Sog) => ModelFormat::Sog,
        Some(FormatName::Html) => ModelFormat::Html,
        Some(FormatName::Usda) => ModelFormat::Usda,
        None => ModelFormat::from_path(&args.output)?,
    };
    match (args.mapping.first_given_option(), format) {
        (Some(option), ModelFormat::PointCloudPly) => Err(usage!(
            "{option}: a setting of splats, found with the format point-cloud, which contains none; leave it out or export splats, such as ply"
        )),
        _ if args.cell.is_some() => Err(usage!(
            "--cell: a setting of meshes, found without --as mesh; add that or leave it out"
        )),
        _ if args.sh3_padding && format != ModelFormat::Ply => Err(usage!(
            "--sh3-padding: a setting of splat PLY, found with the format {format}; leave it out"
        )),
        _ if args.spz_version.is_some() && format != ModelFormat::Spz => Err(usage!(
            "--spz-version: a setting of SPZ, found with the format {format}; leave it out"
        )),
        _ => match format.own_axes() {
            Some(own) => check_axes(args, own, &format).map(|()| format),
            None => Ok(format),
        },
    }
}

fn check_axes(args: &ExportArgs, own: Axes, format: &dyn std::fmt::Display) -> Result<(), Failure> {
    // `as-is` is the default, so it includes commands without the option.
    if args.axes == Axes::AsIs || args.axes == own {
        return Ok(());
    }
    Err(usage!(
        "--axes: expected {own}, which the format {format} prescribes, found {}; leave the option out or write a PLY",
        args.axes
    ))
}

fn note_assumptions(args: &ExportArgs, is_turned: bool, model: &Model) {
    let path = args.model.display();
    if let Some(option) =
        args.mapping.first_for_natives().filter(|_| mapping::is_plain(model.splats.view()))
    {
        note!(
            "note: {path}: no splat has an opacity above 1 or a colour gradient: {option} has no effect"
        );
    }
    match (mapping::lost_textures(model.splats.view()), args.mapping.export_detail) {
        (Some(loss), Some(0)) => note!("note: {path}: {loss}"),
        (None, Some(_)) => {
            note!("note: {path}: no splat has a texture: --export-detail has no effect");
        }
        _ => {}
    }
    if let Some(loss) = args.spz_version.and_then(SpzVersion::loss) {
        note!(
            "note: {}: {loss}; use --spz-version 3 where readers accept it",
            args.output.display()
        );
    }
    let is_turned = is_turned || !matches!(args.axes, Axes::AsIs);
    if is_turned && args.up.is_none() && model.up.is_none() {
        note!("note: {path}: the file has no up direction; z is assumed, use --up to change it");
    }
}

/// Sets or removes the registration of a checkpoint.
pub fn run_register(args: &RegisterArgs) -> Result<(), Failure> {
    let RegisterArgs { model, output, scale_by, up_by, to, system, clear } = args;
    if !clear && scale_by.is_none() && up_by.is_none() && to.is_none() {
        return Err(usage!(
            "register: expected --scale-by, --up-by, --to or --clear, found none of them"
        ));
    }
    let length = scale_by.as_deref().map(length).transpose()?;
    let references = References {
        length: length.map(|(ends, length, _)| (ends, length)),
        floor: up_by.as_deref().and_then(|points| points.try_into().ok()),
        pairs: to.as_deref().map(read_pairs).transpose()?.unwrap_or_default(),
    };
    let mut run = SavedRun::read(model)?;
    let registration = match clear {
        true => None,
        false => {
            // Without a length the unit is that of the world, unless the scale is fitted.
            let same_unit = run.is_metric() && references.pairs.len() < 2;
            let registration = Registration::of(&references, run.up());
            Some(Registration {
                system: system.clone(),
                is_metric: length.map_or(same_unit, |(.., is_metric)| is_metric),
                ..registration.map_err(|fault| failed!("{}: {fault}", model.display()))?
            })
        }
    };
    if let Some(Err(found)) = registration.as_ref().map(Registration::check) {
        return Err(usage!("--system: expected at most 200 ASCII characters, found {found}"));
    }
    run.register(registration.clone())?;
    let output = output.as_ref().unwrap_or(model);
    checkpoint::write_keeping_old(output, run.content)?;
    match registration {
        None => out!("wrote {}: without a registration", output.display()),
        Some(registration) => {
            out!("wrote {}: {registration}", output.display());
            print_residuals(&registration, &references);
        }
    }
    Ok(())
}

/// Ratio of deviations to the extent of control points above which axes or units are probably mistaken.
const DOUBTFUL: f64 = 0.02;

fn print_residuals(registration: &Registration, references: &References) {
    let pairs = &references.pairs;
    let Some(residuals) = registration.residuals(pairs).filter(|_| pairs.len() > 2) else { return };
    let Residuals { rms, largest, worst, spread } = residuals;
    out!(
        "  {} control points deviate by {rms:.4} RMS, at most {largest:.4} (number {})",
        pairs.len(),
        worst + 1
    );
    if rms > DOUBTFUL * spread {
        note!(
            "warning: control points deviate by more than {:.0} % of their extent; check their order, units, and that axes are east, north and height",
            100.0 * DOUBTFUL
        );
    }
}

/// Parses two points and their distance, which is in metres if the third value is true.
fn length(values: &[String]) -> Result<([DVec3; 2], f64, bool), Failure> {
    let found = match values {
        [a, b, length] => {
            let ends = parse_point(a).ok().zip(parse_point(b).ok());
            ends.zip(parse_length(length)).map(|((a, b), (length, unit))| ([a, b], length, unit))
        }
        _ => None,
    };
    found.ok_or_else(|| {
        usage!(
            "--scale-by: expected X,Y,Z X,Y,Z LENGTH with a length above 0, such as 0,0,0 1,0,0 1.25m, found {}",
            values.join(" ")
        )
    })
}

pub fn run_merge(args: &MergeArgs) -> Result<(), Failure> {
    // Checked before the models are read, which takes longer.
    output::check_files(std::slice::from_ref(&args.output))?;
    let runs: Result<Vec<_>, _> = args.checkpoints.iter().map(|p| SavedRun::read(p)).collect();
    let start = args.start.as_deref().map(SavedRun::read).transpose()?;
    let merged = match &start {
        None => merge(warn_about_fusing(runs?))?,
        Some(start) => merge_onto(start, runs?)?,
    };
    // Never `None`: clap requires two checkpoints.
    let Some(merged) = merged else { return Ok(()) };
    checkpoint::write(&args.output, &merged.content)?;
    if let Some(start) = start {
        note_new_components(&start, &merged, &args.output);
    }
    out!(
        "wrote {}: {} models, {} frames",
        args.output.display(),
        args.checkpoints.len(),
        merged.content.cursor.frames
    );
    Ok(())
}

/// Share of components that are not in the start, from which a second pass is worth its time: of a room's, 11 % cost .34 dB.
const MANY_NEW: f64 = 0.05;

/// Notes that components which several shards created are blurred, and what sharpens them, if there are many.
fn note_new_components(start: &SavedRun, merged: &SavedRun, output: &Path) {
    let count = |run: &SavedRun| match &run.content.model {
        StoredModel::Scene(scene) if scene.photometric.is_some() => scene.seeds.len() as f64,
        _ => 0.0,
    };
    let new = 1.0 - count(start) / count(merged);
    if new > MANY_NEW {
        note!(
            "note: {:.0} % of the components are not in the start, and those that several runs created are blurred; a second pass over the photographs sharpens them (train DATASET --resume {} --set passes=2 --out DIR), a start with more frames avoids them",
            100.0 * new,
            output.display()
        );
    }
}

/// Warns that fusing scenes without a common start blurs surfaces. Returns the runs unchanged.
fn warn_about_fusing(runs: Vec<SavedRun>) -> Vec<SavedRun> {
    if runs.first().is_some_and(|run| run.config.method.scene().is_some()) {
        note!(
            "warning: expected runs with a common start, found none: surfaces seen by several runs will be blurred; resume all of them from one short run (train --resume START --shard K/N) and merge with --start START"
        );
    }
    runs
}
