//! The exact renderer (`rendering.md`, Exact renderer): response along each true ray, by the defining
//! formula.

use super::Contribution;
use super::shade::Shade;
use super::splat::Placed;
use glam::{DMat3, DVec2, DVec3};
use std::f64::consts::PI;
use vbgs_studio::math::camera::Intrinsics;
use vbgs_studio::render::{
    ALPHA_CAP, Antialias, ExactOptions as Settings, FOOTPRINT_PX2, Lens, REFERENCE_VARIANCE,
    Response,
};

/// A splat relative to the camera.
#[derive(Clone, Copy, Debug)]
pub(super) struct Exact {
    number: usize,
    /// Distance of the mean from the camera.
    pub distance: f64,
    mean: DVec3,
    /// `M = diag(1/s)·(RQ)ᵀ`: maps camera space to a space in which the splat is a unit ball.
    whitening: DMat3,
    opacity: f64,
    response: Response,
    shade: Shade,
}

impl Exact {
    pub(super) fn new(splat: &Placed, k: &Intrinsics, settings: Settings) -> Self {
        let (scale, opacity) = antialiased(splat, k, settings.antialias);
        Self {
            number: splat.number,
            distance: splat.mean.length(),
            mean: splat.mean,
            whitening: DMat3::from_diagonal(scale.recip()) * splat.axes.transpose(),
            opacity,
            response: settings.response,
            shade: splat.shade,
        }
    }

    /// Contribution along a ray from the camera; the ray may have any length.
    pub(super) fn along(&self, ray: DVec3) -> Contribution {
        let (p, g) = (self.whitening * self.mean, self.whitening * ray);
        let peak = g.dot(p) / g.dot(g);
        let (t, distance2) = if peak >= 0.0 || self.response == Response::Line {
            (peak, g.cross(p).length_squared() / g.dot(g))
        } else {
            (0.0, p.dot(p))
        };
        Contribution {
            number: self.number,
            alpha: ALPHA_CAP.min(self.opacity * (-0.5 * distance2).exp()),
            depth: t * ray.length(),
            color: self.shade.at(ray * t - self.mean),
        }
    }
}

/// Standard deviations and opacity after antialiasing. Splats that `Reference` fades below the cut need no
/// check here, since no alpha exceeds the opacity.
fn antialiased(splat: &Placed, k: &Intrinsics, setting: Antialias) -> (DVec3, f64) {
    let variances = splat.scale * splat.scale;
    match setting {
        Antialias::None => (splat.scale, splat.opacity),
        Antialias::Footprint => {
            let footprint = FOOTPRINT_PX2 * splat.mean.length_squared() / (k.fx * k.fy);
            ((variances + footprint).sqrt(), splat.opacity)
        }
        Antialias::Reference => {
            let scale = (variances + REFERENCE_VARIANCE).sqrt();
            (scale, splat.opacity * (splat.scale / scale).element_product())
        }
    }
}

/// Ray in camera space through a point of the image; `None` outside a fisheye's image.
pub(super) fn ray(lens: Lens, k: &Intrinsics, point: DVec2) -> Option<DVec3> {
    let rho = (point - DVec2::new(k.cx, k.cy)) / DVec2::new(k.fx, k.fy);
    match lens {
        Lens::Pinhole => Some(rho.extend(1.0)),
        Lens::Fisheye => {
            let theta = rho.length();
            let sideways = if theta > 0.0 { rho * (theta.sin() / theta) } else { DVec2::ZERO };
            (theta <= PI).then(|| sideways.extend(theta.cos()))
        }
    }
}
