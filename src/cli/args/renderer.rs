//! Which renderers draw, and how: shared by everything that makes or measures pictures.

use super::parse::choice;
use crate::cli::failure::Failure;
use clap::{Args, ValueEnum};
use vbgs_studio::render::{Antialias, ExactOptions, Lens, RenderMethod, Response};

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum RendererName {
    /// The covariance projected to the image, as every viewer of splats does
    Projected,
    /// The response along each pixel's true ray
    Exact,
    /// One after the other
    Both,
}

#[derive(Args)]
pub struct RendererArgs {
    /// Renderer
    #[arg(long, value_enum, default_value = "projected")]
    pub renderer: RendererName,
    /// What the exact renderer does about splats thinner than a pixel [default: footprint]
    #[arg(long, value_parser = choice::<Antialias>())]
    // No default here: a setting given beside the projected renderer is refused, one left out not.
    pub antialias: Option<Antialias>,
    /// Where the exact renderer looks for a splat: from the camera on, or behind it too as the
    /// published one does [default: ray]
    #[arg(long, value_parser = choice::<Response>())]
    pub response: Option<Response>,
}

impl RendererArgs {
    /// The renderers asked for, at least one, none twice.
    pub fn methods(&self, lens: Lens) -> Result<Vec<RenderMethod>, Failure> {
        let Self { renderer, antialias, response } = *self;
        let of_exact = [("--antialias", antialias.is_some()), ("--response", response.is_some())];
        if let Some((option, _)) = of_exact.iter().find(|(_, is_said)| *is_said)
            && renderer == RendererName::Projected
        {
            return Err(Failure::Usage(format!(
                "{option}: a setting of the exact renderer, found beside the projected one; add --renderer exact or both"
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
