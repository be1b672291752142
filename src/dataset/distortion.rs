//! Lenses that bend straight lines, made straight when a frame is loaded.
//!
//! Everything behind a frame is a pinhole, and stays one: the image is resampled to the pinhole of
//! the same intrinsics, colours by the mean of four texels, depth by the nearest, since the mean of
//! two surfaces is neither. Radial and tangential terms are those of Brown and Conrady as OpenCV
//! has them: `r² = x² + y²`, `x' = x(1 + k₁r² + k₂r⁴ + k₃r⁶) + 2p₁xy + p₂(r² + 2x²)`.

use crate::math::camera::Intrinsics;
use crate::math::image::Image;
use glam::DVec2;

/// Coefficients of a lens, for slopes (pixels over focal length).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Distortion {
    /// `k₁`, `k₂`, `k₃`.
    pub radial: [f64; 3],
    /// `p₁`, `p₂`.
    pub tangential: [f64; 2],
}

impl Distortion {
    /// Whether it bends nothing.
    pub fn is_none(&self) -> bool {
        *self == Self::default()
    }

    /// Where the lens puts what a pinhole sees at a slope.
    pub fn apply(&self, slope: DVec2) -> DVec2 {
        let DVec2 { x, y } = slope;
        let ([k1, k2, k3], [p1, p2]) = (self.radial, self.tangential);
        let r2 = slope.length_squared();
        let radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
        slope * radial
            + DVec2::new(
                2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
                p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
            )
    }

    /// The colours that the pinhole `k` sees, transparent where the lens saw nothing.
    pub fn straighten_color(&self, k: &Intrinsics, image: &Image<[u8; 4]>) -> Image<[u8; 4]> {
        self.resample(k, image, [0; 4], |at| {
            let corner = at - 0.5;
            let last = DVec2::new(image.width as f64 - 1.0, image.height as f64 - 1.0);
            let corner = corner.clamp(DVec2::ZERO, last);
            let (x, y) = (corner.x as usize, corner.y as usize);
            let t = corner - corner.floor();
            let (right, below) = ((x + 1).min(image.width - 1), (y + 1).min(image.height - 1));
            let four = [[x, y], [right, y], [x, below], [right, below]];
            let weights =
                [(1.0 - t.x) * (1.0 - t.y), t.x * (1.0 - t.y), (1.0 - t.x) * t.y, t.x * t.y];
            std::array::from_fn(|channel| {
                let texels = four.iter().map(|&[x, y]| f64::from(image.at(x, y)[channel]));
                texels.zip(weights).map(|(v, w)| v * w).sum::<f64>().round() as u8
            })
        })
    }

    /// The nearest values that the pinhole `k` sees, `hole` where the lens saw nothing.
    pub fn straighten_nearest<T: Copy>(
        &self,
        k: &Intrinsics,
        image: &Image<T>,
        hole: T,
    ) -> Image<T> {
        self.resample(k, image, hole, |at| *image.at(at.x as usize, at.y as usize))
    }

    fn resample<T: Copy>(
        &self,
        k: &Intrinsics,
        image: &Image<T>,
        hole: T,
        value: impl Fn(DVec2) -> T,
    ) -> Image<T> {
        let (focal, principal) = (DVec2::new(k.fx, k.fy), DVec2::new(k.cx, k.cy));
        let size = DVec2::new(image.width as f64, image.height as f64);
        let mut out = Image::filled(image.width, image.height, hole);
        for (i, out) in out.data.iter_mut().enumerate() {
            let slope = k.ray(i % image.width, i / image.width).truncate();
            let at = self.apply(slope) * focal + principal;
            // Negated, so that NaN is outside.
            if at.cmpge(DVec2::ZERO).all() && at.cmplt(size).all() {
                *out = value(at);
            }
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_lens_without_terms_changes_nothing() {
        let k = Intrinsics::from_horizontal_fov(16, 12, 1.0);
        let pixels = (0..16 * 12).map(|i| [i as u8, 7, 9, 255]).collect();
        let image = Image::from_vec(16, 12, pixels);
        let none = Distortion::default();
        assert!(none.is_none());
        assert_eq!(none.straighten_color(&k, &image), image);
        assert_eq!(none.straighten_nearest(&k, &image, [0; 4]), image);
    }

    /// OpenCV's documentation, worked by hand at (0.2, −0.1).
    #[test]
    fn terms_are_those_of_opencv() {
        let lens = Distortion { radial: [0.1, -0.02, 0.003], tangential: [0.001, -0.002] };
        let found = lens.apply(DVec2::new(0.2, -0.1));
        let radial = 1.0 + 0.1 * 0.05 - 0.02 * 0.0025 + 0.003 * 0.000125;
        let x = 0.2 * radial + 2.0 * 0.001 * -0.02 - 0.002 * (0.05 + 0.08);
        let y = -0.1 * radial + 0.001 * (0.05 + 0.02) + 2.0 * -0.002 * -0.02;
        assert!((found - DVec2::new(x, y)).length() < 1e-15);
    }
}
