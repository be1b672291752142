//! Arguments of `render`.

use super::parse::{choice, parse_color, parse_count, parse_size};
use super::renderer::RendererArgs;
use clap::{Args, ValueEnum};
use std::path::PathBuf;
use vbgs_studio::render::Exposing;
use vbgs_studio::render::Lens;

#[derive(Args)]
pub struct RenderArgs {
    /// Model: checkpoint, .ply, .glb, .gltf, .spz or .splat
    pub model: PathBuf,
    /// PNG file to write; a folder with --turntable; a folder or a video (.mp4, .webm, .webp, by the ffmpeg
    /// on the path) with --path. With --renderer both the two pictures of a view
    /// are called NAME-projected.png and NAME-exact.png
    #[arg(short, long, value_name = "IMG.png")]
    pub output: PathBuf,
    /// Take the camera from this dataset, that of its photographs
    #[arg(long, value_name = "DIR", conflicts_with_all = ["orbit", "turntable", "path", "size", "lens", "fov", "up"])]
    pub dataset: Option<PathBuf>,
    /// Position of the view in its split
    #[arg(long, requires = "dataset", default_value_t = 0)]
    pub view: usize,
    /// Split of the view [default: val or eval, or the training split]
    #[arg(long, requires = "dataset")]
    pub split: Option<String>,
    /// Azimuth and elevation in degrees, distance in world units, about the scene's centre
    // Hyphens, not negative numbers: `-30,20,4` is no number to clap.
    #[arg(long, value_name = "AZ,EL,DIST", value_parser = parse_orbit, allow_hyphen_values = true)]
    pub orbit: Option<[f64; 3]>,
    /// N views once around the scene, written as 000.png, 001.png, …
    #[arg(long, value_name = "N", value_parser = parse_count, allow_negative_numbers = true)]
    pub turntable: Option<usize>,
    /// Pictures along a camera path, written as 00000.png, 00001.png, … or as a video
    #[arg(long, value_name = "FILE.json", conflicts_with_all = ["orbit", "turntable", "lens", "fov"])]
    pub path: Option<PathBuf>,
    /// Width and height in pixels
    #[arg(long, value_name = "WxH", default_value = "1280x720", value_parser = parse_size)]
    pub size: [u32; 2],
    /// How pixels map to rays; a fisheye keeps angles and needs --renderer exact
    #[arg(long, value_parser = choice::<Lens>(), default_value = "pinhole")]
    pub lens: Lens,
    /// Horizontal field of view in degrees: less than 170, with --lens fisheye up to 360
    #[arg(long, value_name = "DEG", default_value_t = 60.0, allow_negative_numbers = true)]
    pub fov: f64,
    /// World axis that points up [default: what the model says, else z]
    #[arg(long, value_enum, allow_hyphen_values = true)]
    pub up: Option<AxisName>,
    /// Colour behind the splats: black, white or #rrggbb
    #[arg(long, default_value = "black", value_parser = parse_color)]
    pub background: [f32; 3],
    /// How bright a scene is drawn whose cameras exposed by themselves: as the first frames were, or
    /// as those recorded around the view [default: recorded for a view of --dataset, else neutral]
    #[arg(long, value_parser = choice::<Exposing>())]
    pub exposure: Option<Exposing>,
    #[command(flatten)]
    pub renderer: RendererArgs,
    /// What the splats' colours show
    #[arg(long, value_enum, default_value = "colour")]
    pub paint: PaintName,
}

#[derive(Clone, Copy, ValueEnum)]
pub enum PaintName {
    /// Their own colours
    Colour,
    /// Their distance from the camera, over the depth of the scene
    Depth,
    /// The direction of their shortest axis
    Normal,
}

#[derive(Clone, Copy, ValueEnum)]
pub enum AxisName {
    X,
    Y,
    Z,
    #[value(name = "-x")]
    NegX,
    #[value(name = "-y")]
    NegY,
    #[value(name = "-z")]
    NegZ,
}

fn parse_orbit(text: &str) -> Result<[f64; 3], String> {
    let numbers: Option<Vec<f64>> = text.split(',').map(|n| n.trim().parse().ok()).collect();
    match numbers.as_deref() {
        Some(&[azimuth, elevation, distance])
            if azimuth.is_finite()
                && elevation.is_finite()
                && distance.is_finite()
                && distance > 0.0 =>
        {
            Ok([azimuth, elevation, distance])
        }
        _ => Err("expected AZIMUTH,ELEVATION,DISTANCE with a positive distance, such as 30,20,4"
            .to_owned()),
    }
}
