//! Arguments of `render`.

use crate::cli::args::{axis, choice, parse_color, parse_count, parse_numbers, parse_size};
use crate::cli::failure::Failure;
use clap::{Args, ValueEnum};
use glam::DVec3;
use std::path::PathBuf;
use vbgs_studio::render::{
    Antialias, ExactOptions, Exposing, Lens, RenderMethod, Renderer, Response,
};

#[derive(Args)]
pub struct RenderArgs {
    /// Model: checkpoint, .ply, .glb, .gltf, .spz, .sog or .splat
    pub model: PathBuf,
    /// PNG file; with --turntable a folder; with --path a folder, an animated .gif, or a video (.mp4, .webm,
    /// .webp; requires ffmpeg). --renderer both writes NAME-projected.png and NAME-exact.png
    #[arg(short, long, value_name = "IMG.png")]
    pub output: PathBuf,
    /// Use a photograph's camera from this dataset
    #[arg(long, value_name = "DIR", conflicts_with_all = ["orbit", "turntable", "path", "size", "lens", "fov", "up"])]
    pub dataset: Option<PathBuf>,
    /// Index of the view in its split
    #[arg(long, requires = "dataset", default_value_t = 0)]
    pub view: usize,
    /// Split of the view [default: val or eval, or the training split]
    #[arg(long, requires = "dataset")]
    pub split: Option<String>,
    /// Azimuth and elevation in degrees and distance in world units, around the scene's centre
    // Hyphens instead of negative numbers: clap does not accept `-30,20,4` as a number.
    #[arg(long, value_name = "AZ,EL,DIST", value_parser = parse_orbit, allow_hyphen_values = true)]
    pub orbit: Option<[f64; 3]>,
    /// Render N views around the scene to 000.png, 001.png, …
    #[arg(long, value_name = "N", value_parser = parse_count, allow_negative_numbers = true)]
    pub turntable: Option<usize>,
    /// Render along a camera path to 00000.png, 00001.png, … or to a film
    #[arg(long, value_name = "FILE.json", conflicts_with_all = ["orbit", "turntable", "lens", "fov"])]
    pub path: Option<PathBuf>,
    /// Width and height in pixels
    #[arg(long, value_name = "WxH", default_value = "1280x720", value_parser = parse_size)]
    pub size: [u32; 2],
    /// Lens model; `fisheye` is equidistant and needs --renderer exact
    #[arg(long, value_parser = choice::<Lens>(), default_value = "pinhole")]
    pub lens: Lens,
    /// Horizontal field of view in degrees: below 170, with --lens fisheye up to 360
    #[arg(long, value_name = "DEG", default_value_t = 60.0, allow_negative_numbers = true)]
    pub fov: f64,
    /// Up axis of the world [default: that of the model, else z]
    #[arg(long, value_parser = axis(), allow_hyphen_values = true)]
    pub up: Option<DVec3>,
    /// Colour behind the splats: black, white or #rrggbb
    #[arg(long, default_value = "black", value_parser = parse_color)]
    pub background: [f32; 3],
    /// Brightness of scenes with auto-exposure: that of the first frames, or that recorded around the view
    /// [default: recorded for a view of --dataset, else neutral]
    #[arg(long, value_parser = choice::<Exposing>())]
    pub exposure: Option<Exposing>,
    #[command(flatten)]
    pub renderer: RendererArgs,
    /// Quantity shown as colour
    #[arg(long, value_enum, default_value = "colour")]
    pub paint: PaintName,
}

#[derive(Clone, Copy, ValueEnum)]
pub enum PaintName {
    /// Colours of the splats
    Colour,
    /// Distance from the camera, relative to the depth of the scene
    Depth,
    /// Direction of the shortest axis
    Normal,
}

fn parse_orbit(text: &str) -> Result<[f64; 3], String> {
    match parse_numbers(text) {
        // From farther away, positions differ from the camera's by less than their rounding.
        Some([azimuth, elevation, distance])
            if [azimuth, elevation].iter().all(|angle| angle.abs() <= 360.0)
                && (0.0..=1e9).contains(&distance)
                && distance > 0.0 =>
        {
            Ok([azimuth, elevation, distance])
        }
        _ => Err("expected AZIMUTH,ELEVATION,DISTANCE with angles up to 360 and a positive distance of at most 1e9, such as 30,20,4".to_owned()),
    }
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum RendererName {
    /// Gaussians projected to the image plane, as in common splat viewers
    Projected,
    /// Gaussian response along each pixel's ray
    Exact,
    /// Both, one after the other
    Both,
}

impl RendererName {
    /// Returns the requested renderers: at least one, without duplicates.
    pub fn renderers(self) -> &'static [Renderer] {
        match self {
            Self::Projected => &[Renderer::Projected],
            Self::Exact => &[Renderer::Exact],
            Self::Both => &[Renderer::Projected, Renderer::Exact],
        }
    }
}

#[derive(Args)]
pub struct RendererArgs {
    /// Renderer
    #[arg(long, value_enum, default_value = "projected")]
    pub renderer: RendererName,
    /// Antialiasing of splats thinner than a pixel in the exact renderer [default: footprint]
    #[arg(long, value_parser = choice::<Antialias>())]
    // No default: an option given with the projected renderer is an error, an omitted one is not.
    pub antialias: Option<Antialias>,
    /// Range of the exact renderer along a ray: in front of the camera, or also behind it as in the published
    /// renderer [default: ray]
    #[arg(long, value_parser = choice::<Response>())]
    pub response: Option<Response>,
}

impl RendererArgs {
    /// Returns the requested renderers with their options: at least one, without duplicates.
    pub fn methods(&self, lens: Lens) -> Result<Vec<RenderMethod>, Failure> {
        let Self { renderer, antialias, response } = *self;
        let of_exact = [("--antialias", antialias.is_some()), ("--response", response.is_some())];
        // Refused rather than ignored: the picture would not be the requested one.
        if let Some((option, _)) = of_exact.iter().find(|(_, is_said)| *is_said)
            && renderer == RendererName::Projected
        {
            return Err(usage!(
                "{option}: applies only to the exact renderer, found the projected one; add --renderer exact or both"
            ));
        }
        // Projection is linearised on an image plane, which a fisheye does not have.
        if lens == Lens::Fisheye && renderer != RendererName::Exact {
            return Err(usage!(
                "--lens: the projected renderer has no fisheye; add --renderer exact"
            ));
        }
        let exact = RenderMethod::Exact(ExactOptions {
            response: response.unwrap_or(Response::Ray),
            antialias: antialias.unwrap_or(Antialias::Footprint),
            lens,
        });
        let method = |renderer: &Renderer| match renderer {
            Renderer::Projected => RenderMethod::PROJECTED,
            Renderer::Exact => exact,
        };
        Ok(renderer.renderers().iter().map(method).collect())
    }
}
