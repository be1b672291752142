//! Packing and unpacking of photographs for the shuffle buffer (`photographs.md`, Shuffle buffer).

use super::agreement::FrameAgreement;
use super::comparers::TrainingView;
use crate::math::image::{Image, unit_to_byte};
use crate::math::measured_pixel::{MASKED, MeasuredPixel};
use crate::math::rng::{Purpose, Rng};
use crate::model::scene::photometric::PhotometricState;
use crate::model::scene::waiting::{
    BufferedDepths, BufferedPhotograph, DepthScale, PhotographView, UNKNOWN_COVERAGE,
};
use crate::observation::surface::Photograph;
use crate::render::cpu::photometric::RowSubset;
use crate::train::outcome::{OutlierReason, PhotographOutcome};
use rayon::prelude::*;

const COLOR_LEVELS: f32 = 255.0;
const COVERAGE_LEVELS: f32 = (UNKNOWN_COVERAGE - 1) as f32;

/// Packs the selected rows of a photograph for the shuffle buffer. Colours take 8 bits per channel,
/// before exposure correction, and depths 16 bits. A surface within `margin` of a measured depth counts
/// as the measured surface.
pub fn packed(
    view: PhotographView,
    photograph: &Photograph,
    margin: [f32; 2],
) -> BufferedPhotograph {
    let level = |pixel: &MeasuredPixel| match pixel.coverage.is_nan() {
        true => UNKNOWN_COVERAGE,
        // Half a level rounds to the nearest, as the cast truncates.
        false => (pixel.coverage.clamp(0.0, 1.0) * COVERAGE_LEVELS + 0.5) as u8,
    };
    let scale = DepthScale::new(margin);
    let steps = |pixel: &MeasuredPixel| match pixel.per_tolerance > 0.0 {
        true => scale.steps(pixel.depth),
        false => 0,
    };
    let (mut colors, mut depths) = (vec![[0; 4]; view.n_pixels()], vec![0; view.n_pixels()]);
    let line = photograph.colors.width.max(1);
    let rows: Vec<usize> = view.stored_rows().collect();
    let out = colors.par_chunks_mut(line).zip(depths.par_chunks_mut(line));
    out.zip(rows).for_each(|((colors, depths), row)| {
        let pixels = photograph.measured_row(row, 0..photograph.colors.width, margin);
        for ((color, depth), pixel) in colors.iter_mut().zip(depths).zip(pixels) {
            let [r, g, b] = pixel.color.map(unit_to_byte);
            let is_left_out = pixel.coverage < 0.0;
            let stored = if is_left_out { MASKED } else { [r, g, b, level(&pixel)] };
            (*color, *depth) = (stored, steps(&pixel));
        }
    });
    // A margin of 0 gives no step to store depths in.
    let depths = scale.defect().is_none().then(|| BufferedDepths { scale, steps: depths.into() });
    BufferedPhotograph { view, pixels: colors.into(), depths }
}

/// Unpacks a photograph into `image`, with colours in the scene's exposure. Rows that were not stored
/// keep their content. `None` if the pose is invalid; loaded files contain no invalid pose.
pub fn unpacked(
    photograph: &BufferedPhotograph,
    image: &mut Image<MeasuredPixel>,
) -> Option<TrainingView> {
    // Rebuilt from its numbers even if never written to a file, so that the bits are the same.
    let camera = photograph.view.camera().ok()?;
    let [width, height] = [camera.intrinsics.width, camera.intrinsics.height].map(|n| n as usize);
    if (image.width, image.height) != (width, height) {
        *image = Image::filled(width, height, MeasuredPixel::UNKNOWN);
    }
    let gain = photograph.view.gain.map(|gain| gain as f32);
    let pixel = |stored: &[u8; 4]| {
        if *stored == MASKED {
            return MeasuredPixel::LEFT_OUT;
        }
        let [r, g, b, covered] = *stored;
        let exposed = |x: u8, gain: f32| f32::from(x) / COLOR_LEVELS * gain;
        let known = f32::from(covered) / COVERAGE_LEVELS;
        let covered = if covered == UNKNOWN_COVERAGE { f32::NAN } else { known };
        let [r, g, b] = [exposed(r, gain[0]), exposed(g, gain[1]), exposed(b, gain[2])];
        MeasuredPixel::without_depth([r, g, b, covered])
    };
    let [every, first] = photograph.view.rows.map(|n| n as usize);
    let line = width.max(1);
    let rows = image.data.par_chunks_mut(line).skip(first).step_by(every.max(1)).enumerate();
    rows.zip(photograph.pixels.par_chunks_exact(line)).for_each(|((row, pixels), stored)| {
        pixels.iter_mut().zip(stored).for_each(|(out, stored)| *out = pixel(stored));
        let Some(BufferedDepths { scale, steps }) = &photograph.depths else { return };
        let margin = scale.margin.map(|length| length as f32);
        let steps = steps.get(row * line..).unwrap_or_default();
        // Steps of 0 are unknown depths.
        let known = pixels.iter_mut().zip(steps).filter(|(_, steps)| **steps > 0);
        known.for_each(|(out, &steps)| *out = out.with_depth(scale.depth(steps), margin));
    });
    let rows = RowSubset::new(every as u32, first as u64);
    let PhotographView { near, per_depth_pixel, .. } = photograph.view;
    let outlier_factor = DRAWN_CONTRADICTION;
    let frame = photograph.view.frame as u64;
    Some(TrainingView { camera, near, rows, outlier_factor, per_depth_pixel, frame })
}

/// Returns the random number generator that draws photographs from the buffer. Its seed depends only on
/// the newest photograph, so that a resumed run draws the same photographs.
pub fn buffer_rng(buffered: &[BufferedPhotograph]) -> Rng {
    let newest = buffered.iter().map(|photograph| photograph.view.frame as u64).max();
    Rng::new(0, Purpose::ShuffleBuffer, newest.unwrap_or(0))
}

/// Weight of the newest frame in a running mean over many frames.
const SHARE: f64 = 0.05;
// Residual assumed before the first frame, colour units: typical of a scene's first frames.
const FIRST: f64 = 0.1;
// Minimum residual, colour units: half a level of 8 bits.
const LEAST: f64 = 0.002;
/// Number of frames after which a running mean is used for outlier tests.
pub const SETTLED: f64 = 8.0;
/// A frame is an outlier if its mean square residual exceeds the usual one by more than this factor.
pub const CONTRADICTION: f64 = 6.0;
/// The same factor as [`CONTRADICTION`], but for photographs from the shuffle buffer. Residuals of
/// photographs in random order have no trend, so the factor is smaller.
pub const DRAWN_CONTRADICTION: f64 = 4.0;
/// Limits on the share of components that a frame sees through. A frame is an outlier if its share
/// exceeds both the first value times the usual share, and the second value.
const SEEN_THROUGH: [f64; 2] = [4.0, 0.2];

/// Returns the mean squared error per pixel and channel. `None` if there are no pixels or the error is
/// infinite.
pub fn difference(squared_error: f64, pixels: f64) -> Option<f64> {
    // One infinite residual would spoil the running mean for good.
    (pixels > 0.0 && squared_error.is_finite()).then(|| squared_error / (3.0 * pixels))
}

/// True if the running mean includes at least one value.
pub fn is_known(noise: &[f64; 2]) -> bool {
    noise[1] > 0.0
}

/// Initialises the running mean with the median of a few squared residuals, which is robust against
/// outliers.
pub fn init_running_mean(noise: &mut [f64; 2], mut differences: Vec<f64>) {
    differences.sort_unstable_by(f64::total_cmp);
    if let Some(&median) = differences.get(differences.len() / 2) {
        *noise = [median, SETTLED];
    }
}

/// Updates the running mean square residual and its weight, `noise`, with the residual of a frame.
/// `squared_error` is summed over `pixels` pixels and three channels. The outcome marks an outlier if
/// the frame's mean square exceeds `most` times the running mean. `None` if there are no pixels.
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

/// Updates the running means with the agreement of a frame's points. Returns an outcome only if the
/// frame is an outlier.
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

/// Updates a running mean and its weight with the value of a frame. Returns true if the value exceeds
/// `most` and the mean includes enough frames.
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

/// Returns the usual residual: the square root of the running mean square, colour units. Before the
/// first frame, this is a typical value.
pub fn usual(noise: &[f64; 2]) -> f64 {
    let root = if noise[1] > 0.0 { noise[0].sqrt() } else { FIRST };
    root.max(LEAST)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::camera::{Camera, Intrinsics};
    use crate::math::pose::Pose;
    use glam::{DQuat, DVec3};

    #[test]
    fn photographs_come_out_as_they_went_in() {
        let intrinsics = Intrinsics::from_horizontal_fov(5, 9, 0.8);
        let camera = Camera { intrinsics, pose: Pose::IDENTITY };
        let margin = [0.03, 0.02];
        // Unknown, known and out-of-range depths.
        let depth = |i: usize| [0.0, 1.0 + 0.1 * i as f32, 1e4][i % 3];
        let color = |i: usize| [i as u8, 255, 128, [0, 127, 255][i % 3]];
        let photograph = Photograph {
            intrinsics,
            offset: DVec3::ZERO,
            rotation: DQuat::IDENTITY,
            colors: Image::from_vec(5, 9, (0..45).map(color).collect()).into(),
            gain: [1.0, 0.5, 1.0],
            depths: Image::from_vec(5, 9, (0..45).map(depth).collect()),
            has_coverage: true,
        };
        let expected = photograph.measured_pixels([2.0, 1.0, 0.5], margin);
        let view = PhotographView::new(3, &camera, [2.0, 1.0, 0.5], 0.0, [4, 1]);
        let waiting = packed(view, &photograph, margin);
        assert_eq!(waiting.pixels.len(), view.n_pixels());
        let mut image = Image::filled(1, 1, MeasuredPixel::UNKNOWN);
        let learnt = unpacked(&waiting, &mut image).unwrap();
        for (i, found) in image.data.iter().enumerate() {
            if !matches!(i / 5, 1 | 5) {
                assert_eq!((found.color, found.per_tolerance), ([0.0; 3], 0.0), "{i}");
                continue;
            }
            let expected = expected.data[i];
            let pairs = found.color.iter().zip(expected.color);
            let is_near = pairs.into_iter().all(|(a, b)| (a - b).abs() < 1.0 / 254.0);
            let coverages = [found.coverage, expected.coverage];
            let is_covered = coverages.iter().all(|x| x.is_nan())
                || (coverages[0] - coverages[1]).abs() < 1.0 / 254.0;
            assert!(is_near && is_covered, "{i}: {found:?} for {expected:?}");
            let depth = if i % 3 == 1 { expected.depth } else { 0.0 };
            assert!((found.depth - depth).abs() < 0.03 / 16.0, "{i}: {found:?} for {expected:?}");
            assert_eq!(found.per_tolerance > 0.0, i % 3 == 1, "{i}");
        }
        assert_eq!((learnt.rows.stride(), learnt.rows.first()), (4, 1));
    }
}

#[cfg(test)]
mod noise_tests {
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
