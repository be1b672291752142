//! Renderer options, shared by all commands that draw or measure images.

use super::parse::choice;
use crate::cli::failure::Failure;
use clap::{Args, ValueEnum};
use vbgs_studio::render::{Antialias, ExactOptions, Lens, RenderMethod, Response};

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum RendererName {
    /// Gaussians projected to the image plane, as in common splat viewers
    Projected,
    /// Gaussian response along each pixel's ray
    Exact,
    /// Both in turn
    Both,
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
    /// Returns the requested renderers: at least one, without duplicates.
    pub fn methods(&self, lens: Lens) -> Result<Vec<RenderMethod>, Failure> {
        let Self { renderer, antialias, response } = *self;
        let of_exact = [("--antialias", antialias.is_some()), ("--response", response.is_some())];
        if let Some((option, _)) = of_exact.iter().find(|(_, is_said)| *is_said)
            && renderer == RendererName::Projected
        {
            return Err(Failure::Usage(format!(
                "{option}: applies only to the exact renderer, found the projected one; add --renderer exact or both"
            )));
        }
        if lens == Lens::Fisheye && renderer != RendererName::Exact {
            return Err(Failure::Usage(
                "--lens: the projected renderer has no fisheye; add --renderer exact".to_owned(),
            ));
        }
        let exact = RenderMethod::Exact(ExactOptions {
            response: response.unwrap_or(Response::Ray),
            antialias: antialias.unwrap_or(Antialias::Footprint),
            lens,
        });
        Ok(match renderer {
            RendererName::Projected => vec![RenderMethod::PROJECTED],
            RendererName::Exact => vec![exact],
            RendererName::Both => vec![RenderMethod::PROJECTED, exact],
        })
    }
}
