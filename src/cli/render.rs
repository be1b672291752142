//! `render`: draws a view, a turntable or a camera path with each requested renderer.

use super::args::{PaintName, RenderArgs};
use super::failure::Failure;
use super::model::Model;
use super::train::print_dataset_notes;
use super::{model, output, tracked};
use anyhow::anyhow;
use glam::DVec3;
use std::f64::consts::PI;
use std::path::{Path, PathBuf};
use vbgs_studio::dataset::{Dataset, LoadOptions};
use vbgs_studio::eval::near::{NearRule, near_plane};
use vbgs_studio::eval::report;
use vbgs_studio::export::camera_path::PacedPath;
use vbgs_studio::export::video::{FilmWriter, is_video, too_large, write_png};
use vbgs_studio::math::camera::{Camera, Intrinsics};
use vbgs_studio::math::image::RgbImage;
use vbgs_studio::math::orbit::Orbit;
use vbgs_studio::model::splat::appearance::SplatView;
use vbgs_studio::model::splat::framing::{Framing, framing};
use vbgs_studio::pipeline::settings::method::Method;
use vbgs_studio::render::cpu::CpuRenderer;
use vbgs_studio::render::{DisplayStyle, Lens, Paint, RenderMethod, RenderOptions};

/// Default elevation of views, degrees.
const DEFAULT_ELEVATION: f64 = 25.0;

pub fn run(args: &RenderArgs) -> Result<(), Failure> {
    let methods = args.renderer.methods(args.lens)?;
    check_fov(args)?;
    // Checked before the model is read, which takes longer.
    let is_png = args.output.extension().is_some_and(|end| end.eq_ignore_ascii_case("png"));
    if args.turntable.is_none() && args.path.is_none() && !is_png {
        return Err(usage!(
            "--output: expected a name ending in .png, found {}",
            args.output.display()
        ));
    }
    // A view of a dataset has the size of its photograph.
    if args.dataset.is_none() {
        check_size(args)?;
    }
    let mut model = model::load(&args.model)?;
    let dataset = args.dataset.as_deref();
    let dataset =
        dataset.map(|path| model.open_dataset(path, LoadOptions::default())).transpose()?;
    let mut painter = Painter {
        framing: framing(model.splats.iter()),
        splats: model.splats.view(),
        paint: args.paint,
        methods,
        renderer: CpuRenderer::new(),
    };
    if let Some(dataset) = &dataset {
        return render_view(&mut painter, &model, dataset, args);
    }
    let framing = painter.framing.ok_or_else(|| {
        anyhow!("{}: expected at least one drawable splat, found none", args.model.display())
    })?;
    let up = args.up.or(model.up).unwrap_or(DVec3::Z);
    if let Some(file) = &args.path {
        return render_path(&mut painter, &PacedPath::read(file, up)?, framing.radius, args);
    }
    render_orbit(&mut painter, &orbit(&framing, up, args), framing.radius, args)
}

fn render_orbit(
    painter: &mut Painter,
    start: &Orbit,
    radius: f64,
    args: &RenderArgs,
) -> Result<(), Failure> {
    let intrinsics = intrinsics(args);
    let options = viewport_options(args, radius);
    let mut draw = |orbit: Orbit, path: &Path| {
        painter.draw(&Camera { intrinsics, pose: orbit.pose() }, &options, path)
    };
    let Some(n) = args.turntable else {
        let names = draw(*start, &args.output)?;
        out!("wrote {names}");
        return Ok(());
    };
    output::create_folder(&args.output)?;
    let bar = output::bar(n, "view");
    for i in 0..n {
        let azimuth = start.azimuth + i as f64 / n as f64 * std::f64::consts::TAU;
        draw(Orbit { azimuth, ..*start }, &args.output.join(format!("{i:03}.png")))?;
        bar.inc(1);
    }
    bar.finish_and_clear();
    painter.print_written(n, "views", &args.output);
    Ok(())
}

fn render_path(
    painter: &mut Painter,
    paced: &PacedPath,
    radius: f64,
    args: &RenderArgs,
) -> Result<(), Failure> {
    let options = viewport_options(args, radius);
    let methods = painter.methods.clone();
    if is_video(&args.output) && methods.len() > 1 {
        return Err(usage!(
            "--renderer: expected one for a video, found both; take a folder for --output"
        ));
    }
    let film = |method: &RenderMethod| match methods.len() {
        1 => FilmWriter::new(&args.output, args.size, paced.fps),
        // The suffix keeps one renderer from overwriting the pictures of the other.
        _ => FilmWriter::pictures(&args.output, &format!("-{}", method.renderer())),
    };
    let mut films = methods.iter().map(film).collect::<Result<Vec<_>, _>>()?;
    let cameras = paced.cameras(args.size);
    let n = cameras.len();
    let bar = output::bar(n, "picture");
    'film: for camera in cameras {
        for (film, &method) in films.iter_mut().zip(&methods) {
            // If it fails, `finish` reports the reason.
            if !film.push(&painter.picture(&camera, method, &options))? {
                break 'film;
            }
        }
        bar.inc(1);
    }
    films.into_iter().try_for_each(FilmWriter::finish)?;
    bar.finish_and_clear();
    painter.print_written(n, "pictures", &args.output);
    Ok(())
}

/// Returns a function that creates the render options of views that are not from a dataset.
fn viewport_options(args: &RenderArgs, radius: f64) -> impl Fn(RenderMethod) -> RenderOptions {
    let (background, exposure) = (args.background, args.exposure);
    move |method| {
        let plain = RenderOptions::viewport(method, background, radius);
        RenderOptions { exposure_mode: exposure.unwrap_or(plain.exposure_mode), ..plain }
    }
}

fn render_view(
    painter: &mut Painter,
    model: &Model,
    dataset: &Dataset,
    args: &RenderArgs,
) -> Result<(), Failure> {
    print_dataset_notes(dataset);
    let photographed = model.color_camera(dataset);
    let split = match &args.split {
        Some(name) => dataset.split_named(name)?,
        // Without depth there is no training split, but any split has cameras.
        None => dataset.evaluation(dataset.training_split().unwrap_or(0)).new_views.split,
    };
    let placed = match model.tracked() {
        // A wrong index is refused below, with the number of views.
        Some((method, poses)) if args.view < dataset.splits[split].frames.len() => {
            tracked::place(dataset, method, &model.splats, poses, (split, &[args.view]))?
        }
        _ => None,
    };
    let split = &placed.as_ref().map_or(dataset, |placed| &placed.dataset).splits[split];
    let Some(entry) = split.frames.get(args.view) else {
        return Err(usage!(
            "--view: expected 0 to {} for the split `{}`, found {}",
            split.frames.len() - 1,
            split.name,
            args.view
        ));
    };
    let cameras: Vec<Camera> = split.frames.iter().map(|frame| frame.camera).collect();
    let rule = NearRule::of(model.method.as_ref().map(Method::preset));
    let near = near_plane(painter.splats, &cameras, rule);
    let options = |method| {
        // Unlike in the viewport: this image equals the one that `eval` scores.
        let plain = RenderOptions::evaluation(method, args.background);
        RenderOptions { exposure_mode: args.exposure.unwrap_or(plain.exposure_mode), near, ..plain }
    };
    // As `eval` does: a held-out pose has the error that training corrected in its neighbours.
    let scene = painter.splats.finishing();
    let pose = scene.corrected_pose(&entry.camera.pose);
    let camera = scene.photograph_camera(entry.photo_camera_at(pose, photographed.as_ref()));
    let names = painter.draw(&camera, &options, &args.output)?;
    out!("wrote {names} ({} of `{}`)", entry.name, split.name);
    Ok(())
}

struct Painter<'a> {
    splats: SplatView<'a>,
    framing: Option<Framing>,
    paint: PaintName,
    methods: Vec<RenderMethod>,
    renderer: CpuRenderer,
}

impl Painter<'_> {
    fn print_written(&self, n: usize, what: &str, output: &Path) {
        let each = if self.methods.len() > 1 { ", each by both renderers," } else { "" };
        out!("wrote {n} {what}{each} to {}", output.display());
    }

    /// Draws a view and writes one image per renderer. Returns the file names for a message.
    fn draw(
        &mut self,
        camera: &Camera,
        options: &impl Fn(RenderMethod) -> RenderOptions,
        path: &Path,
    ) -> Result<String, Failure> {
        let mut names = Vec::with_capacity(self.methods.len());
        // Cloned, because drawing borrows the painter mutably.
        for method in self.methods.clone() {
            let image = self.picture(camera, method, options);
            let path = if self.methods.len() > 1 { named(path, method) } else { path.to_owned() };
            write_png(&path, &image)?;
            names.push(path.display().to_string());
        }
        Ok(names.join(" and "))
    }

    fn picture(
        &mut self,
        camera: &Camera,
        method: RenderMethod,
        options: &impl Fn(RenderMethod) -> RenderOptions,
    ) -> RgbImage {
        let look = DisplayStyle { paint: self.paint(camera), ..DisplayStyle::PLAIN };
        let options = RenderOptions { style: look, ..options(method) };
        self.renderer.render(self.splats, camera, &options).color
    }

    fn paint(&self, camera: &Camera) -> Paint {
        match (self.paint, self.framing) {
            (PaintName::Normal, _) => Paint::Normal,
            (PaintName::Depth, Some(Framing { centre, radius })) => {
                let distance = camera.pose.centre().distance(centre);
                // The camera may be inside the scene.
                Paint::Depth([(distance - radius).max(0.0), distance + radius].map(|d| d as f32))
            }
            // Without splats there is no depth to show.
            (PaintName::Colour | PaintName::Depth, _) => Paint::Stored,
        }
    }
}

/// Adds the renderer to a file name: `view.png` becomes `view-exact.png`.
fn named(path: &Path, method: RenderMethod) -> PathBuf {
    let mut name = path.file_stem().unwrap_or_default().to_owned();
    name.push(format!("-{}.png", method.renderer()));
    path.with_file_name(name)
}

fn check_fov(args: &RenderArgs) -> Result<(), Failure> {
    let (is_fine, most) = match args.lens {
        // Towards 180 degrees the image plane of a pinhole grows without bound.
        Lens::Pinhole => (args.fov < 170.0, "less than 170"),
        // An equidistant fisheye maps angles linearly, up to the direction behind it.
        Lens::Fisheye => (args.fov <= 360.0, "at most 360"),
    };
    if args.fov > 1.0 && is_fine {
        return Ok(());
    }
    Err(usage!(
        "--fov: expected more than 1 and {most} degrees for a {} lens, found {}",
        args.lens,
        args.fov
    ))
}

/// Rejects image sizes that do not fit in memory, because a failed allocation would abort the program.
fn check_size(args: &RenderArgs) -> Result<(), Failure> {
    let found = report::available_bytes().and_then(|available| too_large(args.size, available));
    found.map_or(Ok(()), |found| Err(failed!(format!("--size: {found}"))))
}

fn intrinsics(args: &RenderArgs) -> Intrinsics {
    let ([width, height], fov) = (args.size, args.fov.to_radians());
    match args.lens {
        Lens::Pinhole => Intrinsics::from_horizontal_fov(width, height, fov),
        Lens::Fisheye => Intrinsics::fisheye(width, height, fov),
    }
}

fn orbit(framing: &Framing, up: DVec3, args: &RenderArgs) -> Orbit {
    let [azimuth, elevation, distance] =
        args.orbit.unwrap_or([0.0, DEFAULT_ELEVATION, framing.distance(narrower_fov(args))]);
    Orbit {
        target: framing.centre,
        up,
        azimuth: azimuth.to_radians(),
        elevation: elevation.to_radians(),
        distance,
    }
}

/// Returns the field of view in radians along the narrower side of the image, into which the scene must
/// fit. It is at most π, beyond which a camera's distance from the scene is undefined.
fn narrower_fov(args: &RenderArgs) -> f64 {
    let (fov, tall) = (args.fov.to_radians(), args.size[1] as f64 / args.size[0] as f64);
    // A pinhole maps tangents of angles linearly, a fisheye the angles.
    let share = tall.min(1.0);
    match args.lens {
        Lens::Pinhole => 2.0 * ((0.5 * fov).tan() * share).atan(),
        Lens::Fisheye => (fov * share).min(PI),
    }
}
