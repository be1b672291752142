//! Running residuals between photographs and the pictures drawn before training on them. They give the noise
//! of a pixel and the outlier test for frames (`photometric.md`, Noise).

use super::agreement::FrameAgreement;
use crate::model::scene::photometric::PhotometricState;
use crate::train::outcome::{OutlierReason, PhotographOutcome};

/// Weight of the newest frame in the running mean.
const SHARE: f64 = 0.05;
/// Residual assumed before the first frame, colour units: typical of a scene's first frames.
const FIRST: f64 = 0.1;
/// Minimum residual, colour units: half a level of 8 bits.
const LEAST: f64 = 0.002;
/// Number of frames after which the running mean is used for outlier tests.
pub const SETTLED: f64 = 8.0;
/// Factor on the usual mean square above which a frame is an outlier. The second applies to photographs drawn
/// at random, whose residuals have no trend.
pub const CONTRADICTION: f64 = 6.0;
pub const DRAWN_CONTRADICTION: f64 = 4.0;
/// Factor on the usual share of surfaces seen through above which a frame's depth is an outlier, and the
/// minimum share.
const SEEN_THROUGH: [f64; 2] = [4.0, 0.2];

/// Mean squared difference over `pixels` pixels of three channels; `None` without pixels.
pub fn difference(squared_error: f64, pixels: f64) -> Option<f64> {
    (pixels > 0.0 && squared_error.is_finite()).then(|| squared_error / (3.0 * pixels))
}

/// True once a value has been recorded.
pub fn is_known(noise: &[f64; 2]) -> bool {
    noise[1] > 0.0
}

/// Initialises the running mean with the median of a few residuals, which is robust against outliers among
/// them.
pub fn init_running_mean(noise: &mut [f64; 2], mut differences: Vec<f64>) {
    differences.sort_unstable_by(f64::total_cmp);
    if let Some(&median) = differences.get(differences.len() / 2) {
        *noise = [median, SETTLED];
    }
}

/// Updates the running mean square and its weight, `noise`, with a frame's squared difference over `pixels`
/// pixels of three channels. The frame is an outlier above `most` times the mean. `None` without pixels.
pub fn judge(
    noise: &mut [f64; 2],
    squared_error: f64,
    pixels: f64,
    most: f64,
) -> Option<PhotographOutcome> {
    let (of_frame, usual) = (difference(squared_error, pixels)?, usual(noise));
    let contradicts = update_running_mean(noise, of_frame, most * usual * usual);
    let contradiction = contradicts.then_some(OutlierReason::Picture);
    Some(PhotographOutcome { difference: of_frame.sqrt(), usual, contradiction })
}

/// Updates the running means with the agreement of a frame's points; returns an outcome only if the frame is
/// an outlier.
pub fn update_point_residuals(
    state: &mut PhotometricState,
    agreement: &FrameAgreement,
) -> Option<PhotographOutcome> {
    let FrameAgreement { squared_error, points, in_view, seen_through } = *agreement;
    let colors = judge(&mut state.points, squared_error, points, CONTRADICTION)
        .filter(|outcome| outcome.contradiction.is_some())
        .map(|outcome| PhotographOutcome { contradiction: Some(OutlierReason::Colors), ..outcome });
    let usual = state.seen_through[0];
    let difference = if in_view > 0.0 { seen_through / in_view } else { return colors };
    let [times, least] = SEEN_THROUGH;
    let is_through =
        update_running_mean(&mut state.seen_through, difference, (times * usual).max(least));
    let contradiction = is_through.then_some(OutlierReason::Depth);
    colors.or(contradiction.map(|_| PhotographOutcome { difference, usual, contradiction }))
}

/// Updates a running mean and its weight with a frame's value; returns true if the mean has settled and the
/// value exceeds `most`.
fn update_running_mean([mean, weight]: &mut [f64; 2], of_frame: f64, most: f64) -> bool {
    let contradicts = *weight >= SETTLED && of_frame > most;
    // A plain mean over the first frames, then an exponential one.
    let share = (1.0 / (*weight + 1.0)).max(SHARE);
    // An outlier counts as the limit, so that a scene that has really changed is accepted after some frames.
    let counted = if contradicts { most } else { of_frame };
    *mean += share * (counted - *mean);
    *weight += 1.0;
    contradicts
}

/// Square root of the running mean square, colour units.
pub fn usual(noise: &[f64; 2]) -> f64 {
    let root = if noise[1] > 0.0 { noise[0].sqrt() } else { FIRST };
    root.max(LEAST)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_contradiction_is_told_until_it_is_the_rule() {
        let mut noise = [0.0, 0.0];
        let mut judge = |difference: f64| {
            judge(&mut noise, 300.0 * difference * difference, 100.0, CONTRADICTION)
                .unwrap()
                .contradiction
                .is_some()
        };
        assert!((0..20).all(|_| !judge(0.05)), "what is usual does not contradict");
        assert!(judge(0.3) && !judge(0.06), "one frame that differs changes little");
        let refused = (0..100).take_while(|_| judge(0.3)).count();
        assert!((3..40).contains(&refused), "{refused} frames of a scene that has changed");
        assert!(!judge(0.3));
    }

    #[test]
    fn a_few_that_differ_do_not_change_what_is_usual_at_first() {
        let mut noise = [0.0, 0.0];
        init_running_mean(&mut noise, Vec::new());
        assert!(!is_known(&noise));
        init_running_mean(
            &mut noise,
            vec![0.09, 0.0024, 0.0026, 0.0025, 0.08, 0.0025, 0.07, 0.0025],
        );
        assert!(is_known(&noise) && (usual(&noise) - 0.05).abs() < 0.002, "{noise:?}");
        assert!(
            judge(&mut noise, 27.0, 100.0, DRAWN_CONTRADICTION).unwrap().contradiction.is_some()
        );
        assert!(
            judge(&mut noise, 0.8, 100.0, DRAWN_CONTRADICTION).unwrap().contradiction.is_none()
        );
    }

    #[test]
    fn nothing_to_compare_says_nothing() {
        let mut noise = [0.01, 3.0];
        assert!(judge(&mut noise, 0.0, 0.0, CONTRADICTION).is_none());
        assert!(judge(&mut noise, f64::NAN, 5.0, CONTRADICTION).is_none());
        assert_eq!(noise, [0.01, 3.0]);
        assert_eq!(usual(&[0.0, 0.0]), FIRST);
    }
}
