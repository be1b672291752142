//! Plot axes with round numbers at readable distances.

use eframe::egui::AsIdSalt;
use egui_plot::{GridInput, GridMark, Plot, uniform_grid_spacer};

/// Minimum distance between two labels in x and y, in multiples of a plot's smallest grid spacing (8
/// points). Labels are wide but not high.
const MIN_LABEL_DISTANCE: [f64; 2] = [10.0, 4.0];

/// Creates a plot of height `height` (points). Gestures are disabled, so that the wheel scrolls the panel
/// and the bounds follow the newest values.
pub fn plot<'a>(id: impl AsIdSalt, [x, y]: [&'a str; 2], height: f32) -> Plot<'a> {
    Plot::new(id)
        .height(height)
        .allow_drag(false)
        .allow_zoom(false)
        .allow_scroll(false)
        .allow_boxed_zoom(false)
        .x_axis_label(x)
        .y_axis_label(y)
        .x_grid_spacer(uniform_grid_spacer(|input| steps(&input, MIN_LABEL_DISTANCE[0])))
        .y_grid_spacer(uniform_grid_spacer(|input| steps(&input, MIN_LABEL_DISTANCE[1])))
        .x_axis_formatter(|mark, _| number(&mark))
        .y_axis_formatter(|mark, _| number(&mark))
}

/// Returns grid steps whose smallest is 1, 2 or 5 times a power of ten. With powers of ten alone, a low
/// plot might have a single label.
fn steps(input: &GridInput, apart: f64) -> [f64; 3] {
    let least = apart * input.base_step_size;
    let power = 10f64.powf(least.log10().floor());
    let round = [1.0, 2.0, 5.0].map(|n| n * power).into_iter().find(|step| *step >= least);
    let step = round.unwrap_or(10.0 * power);
    [step, 10.0 * step, 100.0 * step]
}

fn number(mark: &GridMark) -> String {
    let decimals = (-mark.step_size.log10()).ceil().max(0.0) as usize;
    format!("{:.decimals$}", mark.value)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_round_and_apart() {
        for (base, expected) in [(0.011, 0.05), (0.4, 2.0), (1.0, 5.0), (2.4, 10.0), (19.0, 100.0)]
        {
            let input = GridInput { bounds: (0.0, 20.0 * base), base_step_size: base };
            let [step, ..] = steps(&input, 4.0);
            assert!((step - expected).abs() < 1e-9 * expected, "{base}: {step}");
        }
        let said = |value, step_size| number(&GridMark { value, step_size });
        assert_eq!([said(0.5, 0.5), said(20.0, 20.0), said(0.05, 0.05)], ["0.5", "20", "0.05"]);
    }
}
