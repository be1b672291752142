//! `render`: one view, or a turntable.

use super::args::{AxisName, RenderArgs};
use super::failure::Failure;
use super::{model, output, progress};
use anyhow::anyhow;
use glam::DVec3;
use std::path::Path;
use vbgs_studio::dataset::{self, LoadOptions};
use vbgs_studio::math::camera::{Camera, Intrinsics};
use vbgs_studio::math::orbit::Orbit;
use vbgs_studio::model::splats::{Splat, framing};
use vbgs_studio::render::cpu::CpuRenderer;
use vbgs_studio::render::{Method, RenderOptions};

/// Elevation of views that do not say otherwise, degrees.
const DEFAULT_ELEVATION: f64 = 25.0;

/// Renders as asked.
pub fn run(args: &RenderArgs) -> Result<(), Failure> {
    if !(args.fov > 1.0 && args.fov < 170.0) {
        return Err(Failure::Usage(format!(
            "--fov: expected more than 1 and less than 170 degrees, found {}",
            args.fov
        )));
    }
    if args.turntable.is_none() && !is_png(&args.output) {
        return Err(Failure::Usage(format!(
            "--output: expected a name ending in .png, found {}",
            args.output.display()
        )));
    }
    let model = model::load(&args.model)?;
    if let Some(dataset) = &args.dataset {
        return render_view(&model.splats, dataset, args);
    }
    let up = args.up.map(axis).or(model.up).unwrap_or(DVec3::Z);
    let start = orbit(&model.splats, up, args)?;
    let intrinsics =
        Intrinsics::from_horizontal_fov(args.size[0], args.size[1], args.fov.to_radians());
    let radius = framing(&model.splats).map_or(1.0, |f| f.radius);
    let options = RenderOptions::viewport(Method::PROJECTED, args.background, radius);
    let mut renderer = CpuRenderer::new();
    let mut draw = |orbit: &Orbit, path: &Path| {
        let camera = Camera { intrinsics, pose: orbit.pose() };
        output::write_png(path, &renderer.render(&model.splats, &camera, &options).color)
    };
    let Some(n) = args.turntable else {
        draw(&start, &args.output)?;
        output::line(format!("wrote {}", args.output.display()));
        return Ok(());
    };
    output::create_folder(&args.output)?;
    let bar = progress::bar(n, "view");
    for i in 0..n {
        let turned =
            Orbit { azimuth: start.azimuth + i as f64 / n as f64 * std::f64::consts::TAU, ..start };
        draw(&turned, &args.output.join(format!("{i:03}.png")))?;
        bar.inc(1);
    }
    bar.finish_and_clear();
    output::line(format!("wrote {n} views to {}", args.output.display()));
    Ok(())
}

fn render_view(splats: &[Splat], path: &Path, args: &RenderArgs) -> Result<(), Failure> {
    let dataset = dataset::open(path, &LoadOptions::default())?;
    let split = match &args.split {
        Some(name) => dataset.split_named(name)?,
        None => dataset.evaluation(dataset.training_split().unwrap_or(0)).split,
    };
    let split = &dataset.splits[split];
    let Some(entry) = split.frames.get(args.view) else {
        return Err(Failure::Usage(format!(
            "--view: expected 0 to {} for the split `{}`, found {}",
            split.frames.len() - 1,
            split.name,
            args.view
        )));
    };
    let options = RenderOptions::evaluation(Method::PROJECTED, args.background);
    let image = CpuRenderer::new().render(splats, &entry.camera, &options).color;
    output::write_png(&args.output, &image)?;
    output::line(format!("wrote {} ({} of `{}`)", args.output.display(), entry.name, split.name));
    Ok(())
}

fn orbit(splats: &[Splat], up: DVec3, args: &RenderArgs) -> Result<Orbit, Failure> {
    let framing = framing(splats).ok_or_else(|| {
        anyhow!(
            "{}: expected splats to look at, found none that can be drawn",
            args.model.display()
        )
    })?;
    // The narrower of the two angles of view must hold the scene.
    let tall = args.size[1] as f64 / args.size[0] as f64;
    let half = (0.5 * args.fov.to_radians()).tan() * tall.min(1.0);
    let fov = 2.0 * half.atan();
    let [azimuth, elevation, distance] =
        args.orbit.unwrap_or([0.0, DEFAULT_ELEVATION, framing.distance(fov)]);
    Ok(Orbit {
        target: framing.centre,
        up,
        azimuth: azimuth.to_radians(),
        elevation: elevation.to_radians(),
        distance,
    })
}

fn is_png(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("png"))
}

fn axis(name: AxisName) -> DVec3 {
    match name {
        AxisName::X => DVec3::X,
        AxisName::Y => DVec3::Y,
        AxisName::Z => DVec3::Z,
        AxisName::NegX => DVec3::NEG_X,
        AxisName::NegY => DVec3::NEG_Y,
        AxisName::NegZ => DVec3::NEG_Z,
    }
}
