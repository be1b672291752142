//! The search for depth bias and scale.

use super::depth::DepthFit;
use super::input::{COARSE, CalibrationInput};
use super::matches::Matches;
use super::value::{CalibratedValue, MIN_RISE};
use crate::dataset::error::FrameError;

/// Structural scales of the rounds, times the scene's: surfaces that stand apart must first be seen
/// as one.
const ROUNDS: [f64; 4] = [COARSE, 2.0, 1.0, 1.0];
/// Standard errors by which a value must differ from the one before. Poses are often fitted to the
/// same depth and share its errors, which views do not tell of.
const SIGNIFICANT: f64 = 4.0;

/// Moves the calibration's depth to where surfaces are thinnest, as far as the data says.
pub(super) fn search(input: &mut CalibrationInput) -> Result<Vec<CalibratedValue>, FrameError> {
    let before = depth_of(input);
    let mut free = vec![0, 1];
    let names = ["depth offset, world units", "depth scale"];
    let value = |i| CalibratedValue::determined(names[i], before[i], before[i], f64::INFINITY);
    let mut values = [0, 1].map(value);
    while !free.is_empty() {
        // From the start again: what was found beside a value now given up leans on it.
        set_depth(input, before);
        let fit = thin_surfaces(input, &free)?;
        let (after, errors) = (depth_of(input), fit.errors(&free));
        for &i in &free {
            values[i] = CalibratedValue::determined(names[i], before[i], after[i], errors[i]);
        }
        let certainty = |i: usize| (after[i] - before[i]).abs() / errors[i];
        // The less certain first: without it the other may become certain.
        let least = free.iter().copied().min_by(|&a, &b| certainty(a).total_cmp(&certainty(b)));
        let Some(i) = least else { break };
        let rise = fit.rise(i, after[i] - before[i], &free);
        if certainty(i) >= SIGNIFICANT && rise >= MIN_RISE {
            break;
        }
        values[i].keep(match certainty(i) < SIGNIFICANT {
            true => format!("the best is only {:.1} standard errors away", certainty(i)),
            false => format!("with it surfaces are {:.1} % thicker at most", 50.0 * rise),
        });
        free.retain(|&other| other != i);
        set_depth(input, before);
    }
    Ok(values.to_vec())
}

/// Offset and scale.
fn depth_of(input: &CalibrationInput) -> [f64; 2] {
    [input.calibration.depth_offset, input.calibration.depth_scale]
}

fn set_depth(input: &mut CalibrationInput, [offset, scale]: [f64; 2]) {
    (input.calibration.depth_offset, input.calibration.depth_scale) = (offset, scale);
}

/// Moves the `free` ones to the minimum; what was fitted there.
fn thin_surfaces(input: &mut CalibrationInput, free: &[usize]) -> Result<DepthFit, FrameError> {
    for factor in ROUNDS {
        let [change, growth] = fit(input, factor)?.change(free);
        // `growth` is of the range as corrected so far, which holds the offset too.
        let [offset, scale] = depth_of(input);
        set_depth(input, [offset * (1.0 + growth) + change, scale * (1.0 + growth)]);
    }
    fit(input, 1.0)
}

fn fit(input: &CalibrationInput, factor: f64) -> Result<DepthFit, FrameError> {
    // Colour does not matter here, and points that the colour camera does not see count too.
    let settings = input.settings(None);
    let matches = Matches::new(&input.frames, &settings, factor * input.h, input.step)?;
    Ok(DepthFit::new(&matches, input.along_z))
}
