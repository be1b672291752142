//! Treatment of partially covered pixels (`eval.md`, Partial coverage).

use super::comparison::COVERED;
use crate::math::image::{Image, RgbImage};
use crate::render::cpu::Rendered;

/// Colours of the splats without the background, where coverage is at least [`COVERED`].
pub(super) fn divide_by_coverage(rendered: &Rendered, background: [f32; 3]) -> RgbImage {
    let (color, coverage) = (&rendered.color, &rendered.coverage);
    let pixel = |(color, &coverage): (&[f32; 3], &f32)| {
        // With less coverage the colour is too uncertain to divide.
        if coverage < COVERED {
            return *color;
        }
        let behind = background.map(|b| (1.0 - coverage) * b);
        std::array::from_fn(|i| ((color[i] - behind[i]) / coverage).clamp(0.0, 1.0))
    };
    let pixels = color.data.iter().zip(&coverage.data).map(pixel);
    Image::from_vec(color.width, color.height, pixels.collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn coverage_is_divided_out_where_it_is_known() {
        let background = [0.5, 0.0, 1.0];
        let color = [0.4, 0.2, 0.6];
        let over = |coverage: f32| -> [f32; 3] {
            std::array::from_fn(|i| coverage * color[i] + (1.0 - coverage) * background[i])
        };
        let shares = [1.0, 0.75, 0.5, 0.25];
        let image = Rendered {
            color: Image::from_vec(4, 1, shares.map(over).to_vec()),
            coverage: Image::from_vec(4, 1, shares.to_vec()),
            depth: Image::filled(4, 1, 0.0),
            n_invalid: 0,
        };
        let found = divide_by_coverage(&image, background).data;
        let near = |a: [f32; 3], b: [f32; 3]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-6);
        assert!(found[..3].iter().all(|&pixel| near(pixel, color)), "{found:?}");
        assert!(near(found[3], over(0.25)));
    }
}
