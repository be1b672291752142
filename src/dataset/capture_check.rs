//! Capture quality from photographs and timestamps: motion blur, brightness jumps, gaps in time.
//!
//! Each frame is compared with its neighbours only, because typical values differ between cameras and
//! rooms. Of long recordings, evenly spaced runs of consecutive frames are decoded; timestamps, which cost
//! nothing, are checked in all frames.

use super::entry::{DatasetSplit, FrameEntry, map_photographs};
use super::range::median;
use crate::math::image::Image;
use serde::Serialize;
use std::ops::Range;

/// Largest number of decoded photographs. Decoding that many photographs of a phone takes two to three
/// seconds on two cores.
const MAX_FRAMES: usize = 160;
// Long enough for a frame with `REACH` neighbours on both sides.
const RUN: usize = 8;
/// Number of neighbours on each side with which a frame's sharpness is compared.
const REACH: usize = 3;
/// Minimum number of neighbours with measured sharpness for a comparison.
const MIN_NEIGHBOURS: usize = 3;
/// Upper limit for the sharpness of a blurred frame, as a share of the neighbours' median. Of 400 test
/// photographs (Lego, a chair, two Kinect offices), one is below the limit, and it shows camera shake.
const BLURRED: f64 = 0.5;
/// Minimum ratio between the brightness of consecutive frames that counts as a jump, up or down.
const JUMP: f64 = 1.15;
/// Minimum brightness step that counts as a jump, in multiples of the median step. A step is the
/// logarithm of the brightness ratio of consecutive frames.
const JUMP_PER_MEDIAN: f64 = 5.0;
/// Lower limit for a time gap, in multiples of the median time step. At least two frames are missing in
/// such a gap.
const GAP: f64 = 2.5;

/// Findings on the capture quality of one split.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CaptureCheck {
    /// Number of frames whose photographs were decoded.
    pub looked_at: usize,
    /// Number of frames of the split.
    pub frames: usize,
    /// Frames much blurrier than their neighbours.
    pub blurred: Vec<BlurredFrame>,
    /// Frames much brighter or darker than the previous frame.
    pub brightness_jumps: Vec<BrightnessJump>,
    /// Median time between frames, seconds; `None` if there are no timestamps.
    pub usual_step_s: Option<f64>,
    /// Frames recorded much later than the previous frame, or earlier than it.
    pub gaps: Vec<TimeGap>,
}

/// A frame much blurrier than its neighbours.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct BlurredFrame {
    /// Name within the split.
    pub frame: String,
    /// Sharpness relative to the neighbours' median.
    pub share: f64,
}

/// A frame much brighter or darker than the frame before.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct BrightnessJump {
    /// Name within the split.
    pub frame: String,
    /// Brightness of the frame divided by the brightness of the frame before.
    pub factor: f64,
}

/// A frame much later than the frame before, or earlier than it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TimeGap {
    /// Name within the split.
    pub frame: String,
    /// Seconds since the frame before; negative if time goes backwards.
    pub seconds: f64,
}

/// Searches a split for blurred frames, brightness jumps and time gaps. Frames without a readable
/// photograph are skipped; loading such a frame reports the defect.
///
/// ```
/// use vbgs_studio::dataset::capture_check;
///
/// let room = vbgs_studio::dataset::synthetic::demo()?;
/// let check = capture_check::check(&room.splits[0]);
/// assert!(check.blurred.is_empty() && check.gaps.is_empty(), "{check:?}");
/// assert_eq!(check.looked_at, room.splits[0].frames.len());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn check(split: &DatasetSplit) -> CaptureCheck {
    let frames = &split.frames;
    let runs: Vec<Vec<MeasuredFrame>> =
        runs(frames.len()).into_iter().map(|run| measure_frames(frames, run)).collect();
    let jumps = find_brightness_jumps(&runs);
    let (usual_step_s, gaps) = find_time_gaps(frames);
    CaptureCheck {
        looked_at: runs.iter().map(Vec::len).sum(),
        frames: frames.len(),
        blurred: runs.iter().flat_map(|run| find_blurred(run)).collect(),
        brightness_jumps: jumps,
        usual_step_s,
        gaps,
    }
}

struct MeasuredFrame<'a> {
    index: usize,
    name: &'a str,
    measure: PhotoQuality,
}

fn runs(n: usize) -> Vec<Range<usize>> {
    if n <= MAX_FRAMES {
        return std::iter::once(0..n).collect();
    }
    let n_runs = MAX_FRAMES / RUN;
    // The last run ends with the recording.
    (0..n_runs).map(|i| i * (n - RUN) / (n_runs - 1)).map(|first| first..first + RUN).collect()
}

fn measure_frames(frames: &[FrameEntry], run: Range<usize>) -> Vec<MeasuredFrame<'_>> {
    let one = |index: usize| {
        let frame = frames.get(index).filter(|frame| frame.has_photograph())?;
        let color = frame.load_color().ok()?;
        Some(MeasuredFrame { index, name: &frame.name, measure: PhotoQuality::of(&color) })
    };
    map_photographs(frames, run, one)
}

fn find_blurred(run: &[MeasuredFrame]) -> Vec<BlurredFrame> {
    let one = |(i, look): (usize, &MeasuredFrame)| {
        let sharpness = look.measure.sharpness?;
        let near = run.iter().enumerate().take(i + REACH + 1).skip(i.saturating_sub(REACH));
        let others = near.filter(|(j, _)| *j != i).filter_map(|(_, look)| look.measure.sharpness);
        let others: Vec<f64> = others.collect();
        let is_enough = others.len() >= MIN_NEIGHBOURS;
        // Relative to the median: one shaken neighbour does not hide the blur of the frame.
        let share = sharpness / median(others).filter(|_| is_enough)?;
        (share < BLURRED).then(|| BlurredFrame { frame: look.name.to_owned(), share })
    };
    run.iter().enumerate().filter_map(one).collect()
}

fn find_brightness_jumps(runs: &[Vec<MeasuredFrame>]) -> Vec<BrightnessJump> {
    let steps = runs.iter().flat_map(|run| run.windows(2)).filter_map(|pair| match pair {
        // An unreadable frame in between breaks the pair.
        [before, here] if here.index == before.index + 1 => {
            // Black frames have no ratio; half a code of 255 keeps it finite.
            let lifted = |look: &MeasuredFrame| look.measure.brightness + 0.5 / 255.0;
            Some((here.name, lifted(here) / lifted(before)))
        }
        _ => None,
    });
    let steps: Vec<(&str, f64)> = steps.collect();
    // Logarithms, so that a fall by a factor counts like a rise.
    let usual = median(steps.iter().map(|(_, factor)| factor.ln().abs()).collect());
    let limit = JUMP.ln().max(JUMP_PER_MEDIAN * usual.unwrap_or(0.0));
    let far = steps.into_iter().filter(|(_, factor)| factor.ln().abs() > limit);
    far.map(|(frame, factor)| BrightnessJump { frame: frame.to_owned(), factor }).collect()
}

fn find_time_gaps(frames: &[FrameEntry]) -> (Option<f64>, Vec<TimeGap>) {
    let steps: Vec<(&str, f64)> = frames
        .array_windows()
        .filter_map(|[before, here]| Some((here.name.as_str(), here.time? - before.time?)))
        .collect();
    let usual = median(steps.iter().map(|(_, seconds)| *seconds).collect());
    // Frames that all have the same time have no usual step.
    let Some(usual) = usual.filter(|usual| *usual > 0.0) else { return (None, Vec::new()) };
    let odd = steps.into_iter().filter(|(_, seconds)| *seconds < 0.0 || *seconds > GAP * usual);
    let gaps = odd.map(|(frame, seconds)| TimeGap { frame: frame.to_owned(), seconds });
    (Some(usual), gaps.collect())
}

/// Largest width at which a photograph is measured, pixels; wider ones are averaged down. Phones smooth
/// images at full size, which hides blur, and smaller images are faster.
const MAX_COLUMNS: usize = 640;
/// Side, in pixels, of the blocks whose mean values are compared for the coarse detail of a photograph.
const COARSE: usize = 4;

struct PhotoQuality {
    /// Mean squared difference between neighbouring pixels, relative to that between blocks of side
    /// [`COARSE`]. Comparable only within one camera. `None` if the photograph has no detail.
    sharpness: Option<f64>,
    /// Mean encoded luma over opaque pixels, 0 to 1.
    brightness: f64,
}

impl PhotoQuality {
    /// Measures a photograph. For sharpness, transparent pixels are treated as black.
    fn of(photograph: &Image<[u8; 4]>) -> Self {
        let opaque: f64 = photograph.data.iter().map(|pixel| f64::from(pixel[3]) / 255.0).sum();
        let total: f64 = photograph.data.iter().map(|pixel| f64::from(luma(pixel))).sum();
        let fine = reduced_luma(photograph, MAX_COLUMNS);
        let [energy, coarse] = [energy(&fine), energy(&blocks(&fine, COARSE, |v| *v))];
        // A step of a hundredth of a code: anything below is rounding, not detail.
        let has_detail = coarse > 1e-9;
        // A fully transparent photograph has brightness 0, not NaN.
        Self { sharpness: has_detail.then(|| energy / coarse), brightness: total / opaque.max(1.0) }
    }
}

/// Returns the luma of a photograph, averaged down to at most `columns` columns.
pub(super) fn reduced_luma(photograph: &Image<[u8; 4]>, columns: usize) -> Image<f32> {
    blocks(photograph, photograph.width.div_ceil(columns).max(1), luma)
}

fn luma(&[r, g, b, a]: &[u8; 4]) -> f32 {
    // Weights of Rec. 601 luma.
    let luma = 0.299 * f32::from(r) + 0.587 * f32::from(g) + 0.114 * f32::from(b);
    luma / 255.0 * f32::from(a) / 255.0
}

fn blocks<T>(picture: &Image<T>, side: usize, value: impl Fn(&T) -> f32) -> Image<f32> {
    if side == 1 {
        return picture.map(value);
    }
    let (width, height) = (picture.width / side, picture.height / side);
    let mut small = Image::filled(width, height, 0.0f32);
    for (i, mean) in small.data.iter_mut().enumerate() {
        let (x, y) = (i % width * side, i / width * side);
        let rows = (y..y + side).map(|row| &picture.data[row * picture.width + x..][..side]);
        *mean = rows.flatten().map(&value).sum::<f32>() / (side * side) as f32;
    }
    small
}

fn energy(picture: &Image<f32>) -> f64 {
    let Image { width, height, data } = picture;
    let (mut sum, mut n) = (0.0, 0usize);
    for y in 1..*height {
        for x in 1..*width {
            let here = data[y * width + x];
            let (left, above) = (data[y * width + x - 1], data[(y - 1) * width + x]);
            sum += f64::from((here - left).powi(2) + (here - above).powi(2));
            n += 1;
        }
    }
    // An image of a single row or column has no differences in both directions.
    if n == 0 { 0.0 } else { sum / n as f64 }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn run_of(measures: &[(f64, f64)]) -> Vec<MeasuredFrame<'static>> {
        let names = ["0", "1", "2", "3", "4", "5", "6", "7"];
        let look = |(index, &(sharpness, brightness)): (usize, &(f64, f64))| MeasuredFrame {
            index,
            name: names[index],
            measure: PhotoQuality { sharpness: Some(sharpness), brightness },
        };
        measures.iter().enumerate().map(look).collect()
    }

    #[test]
    fn long_recordings_are_sampled_from_end_to_end() {
        assert_eq!(runs(5).as_slice(), std::slice::from_ref(&(0..5)));
        assert_eq!(runs(MAX_FRAMES).as_slice(), std::slice::from_ref(&(0..MAX_FRAMES)));
        let many = runs(10_000);
        assert_eq!((many.len(), many[0].clone()), (20, 0..8));
        assert_eq!(many[19], 9_992..10_000);
        assert!(runs(MAX_FRAMES + 1).iter().all(|run| run.len() == RUN && run.end <= 161));
    }

    #[test]
    fn frames_are_judged_by_their_neighbours() {
        let falling = [1.0, 0.95, 0.9, 0.8, 0.45, 0.7, 0.65, 0.6].map(|s| (s, 0.5));
        assert_eq!(find_blurred(&run_of(&falling)), [], "more than half of 0.8");
        let shaken = [1.0, 1.0, 0.2, 0.3, 1.0, 1.0, 1.0, 1.0].map(|s| (s, 0.5));
        let found: Vec<String> =
            find_blurred(&run_of(&shaken)).into_iter().map(|b| b.frame).collect();
        assert_eq!(found, ["2", "3"], "two in a row as well");
        assert_eq!(find_blurred(&run_of(&[(1.0, 0.5), (0.1, 0.5)])), [], "too few to compare with");
    }

    #[test]
    fn jumps_stand_out_from_what_is_usual() {
        let calm = [0.5, 0.51, 0.5, 0.75, 0.76, 0.75, 0.74, 0.75].map(|b| (1.0, b));
        let found = find_brightness_jumps(&[run_of(&calm)]);
        assert_eq!(found.len(), 1, "{found:?}");
        assert!(found[0].frame == "3" && (found[0].factor - 1.5).abs() < 0.01, "{found:?}");
        let wild = [0.3, 0.6, 0.25, 0.7, 0.3, 0.5, 0.2, 0.6].map(|b| (1.0, b));
        assert_eq!(
            find_brightness_jumps(&[run_of(&wild)]),
            [],
            "views all around have no neighbours"
        );
        let apart = vec![run_of(&[(1.0, 0.2)]), run_of(&[(1.0, 0.8)])];
        assert_eq!(find_brightness_jumps(&apart), [], "runs are far from each other");
    }

    fn textured(scale: f64) -> Image<[u8; 4]> {
        let value = |i: usize| {
            let (x, y) = ((i % 160) as f64, (i / 160) as f64);
            let wave = (x / 0.9).sin() * (y / 1.1).cos() + (x / 23.0).sin() + (y / 17.0).cos();
            (scale * (128.0 + 30.0 * wave)) as u8
        };
        let pixel = |i| [value(i), value(i), value(i), 255];
        Image::from_vec(160, 120, (0..160 * 120).map(pixel).collect())
    }

    fn sharpness(picture: &Image<[u8; 4]>) -> f64 {
        PhotoQuality::of(picture).sharpness.unwrap()
    }

    #[test]
    fn blur_lowers_sharpness_and_exposure_does_not() {
        let sharp = textured(1.0);
        let mean = |i: usize| {
            let (x, y) = (i % 160, i / 160);
            let of = |x: usize, y: usize| u32::from(sharp.at(x.min(159), y.min(119))[0]);
            let sum: u32 = (0..5)
                .flat_map(|j| (0..5).map(move |i| (i, j)))
                .map(|(i, j)| of(x + i, y + j))
                .sum();
            [(sum / 25) as u8; 3]
        };
        let pixel = |i| {
            let [r, g, b] = mean(i);
            [r, g, b, 255]
        };
        let blurred = Image::from_vec(160, 120, (0..160 * 120).map(pixel).collect());
        assert!(sharpness(&blurred) < 0.5 * sharpness(&sharp));
        let dim = textured(0.6);
        assert!((sharpness(&dim) / sharpness(&sharp) - 1.0).abs() < 0.1);
        let ratio = PhotoQuality::of(&dim).brightness / PhotoQuality::of(&sharp).brightness;
        assert!((ratio - 0.6).abs() < 0.01, "{ratio}");
    }

    #[test]
    fn a_picture_without_detail_is_neither_sharp_nor_blurred() {
        for (width, height) in [(64, 48), (3, 2), (1, 1)] {
            let grey = Image::filled(width, height, [128, 128, 128, 255]);
            let measure = PhotoQuality::of(&grey);
            assert_eq!(measure.sharpness, None);
            assert!((measure.brightness - 128.0 / 255.0).abs() < 1e-3);
        }
    }

    #[test]
    fn only_opaque_pixels_have_a_brightness() {
        let mut half = Image::filled(8, 8, [200, 200, 200, 255]);
        half.data[..32].fill([255, 255, 255, 0]);
        let found = PhotoQuality::of(&half).brightness;
        assert!((found - 200.0 / 255.0).abs() < 1e-3, "{found}");
    }
}
