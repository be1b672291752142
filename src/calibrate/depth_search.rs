//! The search for depth bias and scale.

use super::depth::DepthFit;
use super::matches::Matches;
use super::value::Value;
use super::{COARSE, Ground, LEAST_RISE};
use crate::dataset::error::FrameError;

/// Structural scales of the rounds, times the scene's: surfaces that stand apart must first be seen
/// as one.
const ROUNDS: [f64; 4] = [COARSE, 2.0, 1.0, 1.0];
/// Standard errors by which a value must differ from the one before. Poses are often fitted to the
/// same depth and share its errors, which views do not tell of.
const SIGNIFICANT: f64 = 4.0;

/// Moves the calibration's depth to where surfaces are thinnest, as far as the data says.
pub(super) fn search(ground: &mut Ground) -> Result<Vec<Value>, FrameError> {
    let before = depth_of(ground);
    let mut free = vec![0, 1];
    let names = ["depth offset, world units", "depth scale"];
    let value = |i| Value::determined(names[i], before[i], before[i], f64::INFINITY);
    let mut values = [0, 1].map(value);
    while !free.is_empty() {
        set_depth(ground, before);
        let fit = thin_surfaces(ground, &free)?;
        let (after, errors) = (depth_of(ground), fit.errors(&free));
        for &i in &free {
            values[i] = Value::determined(names[i], before[i], after[i], errors[i]);
        }
        let certainty = |i: usize| (after[i] - before[i]).abs() / errors[i];
        let least = free.iter().copied().min_by(|&a, &b| certainty(a).total_cmp(&certainty(b)));
        let Some(i) = least else { break };
        let rise = fit.rise(i, after[i] - before[i], &free);
        if certainty(i) >= SIGNIFICANT && rise >= LEAST_RISE {
            break;
        }
        values[i].keep(match certainty(i) < SIGNIFICANT {
            true => format!("the best is only {:.1} standard errors away", certainty(i)),
            false => format!("with it surfaces are {:.1} % thicker at most", 50.0 * rise),
        });
        free.retain(|&other| other != i);
        set_depth(ground, before);
    }
    Ok(values.to_vec())
}

/// Offset and scale.
fn depth_of(ground: &Ground) -> [f64; 2] {
    [ground.calibration.depth_offset, ground.calibration.depth_scale]
}

fn set_depth(ground: &mut Ground, [offset, scale]: [f64; 2]) {
    (ground.calibration.depth_offset, ground.calibration.depth_scale) = (offset, scale);
}

/// Moves the `free` ones to the minimum; what was fitted there.
fn thin_surfaces(ground: &mut Ground, free: &[usize]) -> Result<DepthFit, FrameError> {
    for factor in ROUNDS {
        let [change, growth] = fit(ground, factor)?.change(free);
        let [offset, scale] = depth_of(ground);
        set_depth(ground, [offset * (1.0 + growth) + change, scale * (1.0 + growth)]);
    }
    fit(ground, 1.0)
}

fn fit(ground: &Ground, factor: f64) -> Result<DepthFit, FrameError> {
    // Colour does not matter here, and points that the colour camera does not see count too.
    let settings = ground.settings(None);
    let matches = Matches::new(&ground.frames, &settings, factor * ground.h, ground.step)?;
    Ok(DepthFit::new(&matches, ground.along_z))
}
