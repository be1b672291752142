//! Samples some frames before training: pixel footprint, depth range and plausibility of depth.

use super::{Preparer, SurfaceSettings};
use crate::dataset::Dataset;
use crate::dataset::entry::map_photographs;
use crate::dataset::opened::with_retry;
use crate::observation::surface::Observation;

/// Quantile of the pixel footprints that is stored as [`FrameSample::footprint`].
const NEARER_SHARE: f64 = 0.95;
/// Number of evenly spaced frames that are sampled before training.
const SAMPLED_FRAMES: usize = 8;
/// Step between the sampled points of a frame.
const SAMPLED_POINTS: usize = 7;

/// Depth of one frame, measured and as points.
struct DepthSample {
    /// Open interval of lengths that training uses, world units.
    trusted: [f64; 2],
    /// Maximum correction of a point along its ray, world units.
    tolerance: f64,
    looked_at: usize,
    seen: Vec<f64>,
    footprints: Vec<f64>,
    depths: Vec<f64>,
}

impl DepthSample {
    /// Samples a frame; `None` if it has no depth. The error describes a frame that cannot be read.
    fn of(
        dataset: &Dataset,
        split: usize,
        index: usize,
        surface: &SurfaceSettings,
    ) -> Result<Option<Self>, String> {
        let frame = with_retry(|| dataset.load(split, index)).map_err(|error| error.to_string())?;
        let Some(depth) = &frame.depth else { return Ok(None) };
        let (width, height) = depth.size();
        let pixels = (0..width * height).step_by(SAMPLED_POINTS);
        let mut observation = Observation::empty();
        // Fails only without depth.
        Preparer::new().prepare(&frame, surface, &mut observation).map_err(|e| e.to_string())?;
        let points = observation.points.iter().step_by(SAMPLED_POINTS);
        Ok(Some(Self {
            trusted: depth.trusted,
            tolerance: f64::from(observation.tolerance.refinement),
            looked_at: pixels.len(),
            seen: pixels.filter_map(|i| depth.value_at(i % width, i / width)).collect(),
            footprints: points.clone().map(|p| f64::from(p.footprint)).collect(),
            depths: points.map(|p| f64::from(p.range)).collect(),
        }))
    }
}

/// Statistics of some frames of a split.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FrameSample {
    /// Width of a pixel on the surface (95 % quantile), world units.
    pub footprint: f64,
    /// Maximum correction of a point along its ray, world units.
    pub tolerance: f64,
    /// 5 % and 95 % quantiles of the distances from the camera to points, world units.
    pub depths: [f64; 2],
}

impl FrameSample {
    /// Samples frames of a split. They are converted to points as for training.
    ///
    /// # Errors
    /// [`NoUsableDepth`] if no sampled frame has a usable pixel.
    pub fn of(
        dataset: &Dataset,
        split: usize,
        frames: &[usize],
        surface: &SurfaceSettings,
    ) -> Result<Self, NoUsableDepth> {
        let order: Vec<usize> = sampled(frames).collect();
        let entries = dataset.splits.get(split).map_or(&[][..], |split| &split.frames);
        let (mut samples, mut unreadable, mut next) = (Vec::new(), None, 0);
        // Further frames only replace unreadable ones.
        while samples.len() < SAMPLED_FRAMES && next < order.len() {
            let part = next..order.len().min(next + SAMPLED_FRAMES - samples.len());
            next = part.end;
            let one = |at: usize| Some(DepthSample::of(dataset, split, *order.get(at)?, surface));
            for sample in map_photographs(entries, part, one) {
                match sample {
                    Ok(sample) => samples.extend(sample),
                    Err(error) => drop(unreadable.get_or_insert(error)),
                }
            }
        }
        let n = samples.len();
        let looked_at = samples.iter().map(|sample| sample.looked_at).sum();
        let last = samples.last().map(|last| (last.trusted, last.tolerance));
        let (trusted, tolerance) = last.unwrap_or_default();
        let (mut footprints, mut depths, mut seen) = (Vec::new(), Vec::new(), Vec::new());
        for sample in samples {
            footprints.extend(sample.footprints);
            depths.extend(sample.depths);
            seen.extend(sample.seen);
        }
        // Quantiles, not extremes: a few wrong depths would decide the scale of a scene.
        match (quantile(&mut footprints, NEARER_SHARE), quantile(&mut depths, 0.05)) {
            (Some(footprint), Some(near)) => {
                let far = quantile(&mut depths, 0.95).unwrap_or(near);
                Ok(Self { footprint, tolerance, depths: [near, far] })
            }
            _ => {
                let error = no_points(dataset, trusted, (&mut seen, looked_at), n);
                // If any frame was read, its depth is the problem, not the file error.
                match unreadable.filter(|_| n == 0) {
                    Some(found) => Err(NoUsableDepth { found, ..error }),
                    None => Err(error),
                }
            }
        }
    }
}

/// Error: no pixel of the sampled frames yields a point.
#[derive(Clone, Debug, PartialEq)]
pub struct NoUsableDepth {
    /// Name of the dataset.
    pub dataset: String,
    /// Trusted interval of lengths, world units, as text.
    pub trusted: String,
    /// Range of the measured depth, world units, as text. If no frame could be read, the first error.
    pub found: String,
    /// Number of sampled frames.
    pub frames: usize,
    /// Advice to the user.
    pub advice: String,
}

impl std::error::Error for NoUsableDepth {}

impl std::fmt::Display for NoUsableDepth {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { dataset, trusted, found, frames, advice } = self;
        if *frames == 0 {
            return write!(
                f,
                "{dataset}: expected at least one frame with depth, found none that can be read; the first problem: {found}"
            );
        }
        write!(
            f,
            "{dataset}: expected depth within the trusted {trusted}, found {found} in {frames} sampled frames without a usable pixel; {advice}"
        )
    }
}

/// Returns all given frames, starting with evenly spaced ones. The others replace frames that cannot be
/// read.
fn sampled(frames: &[usize]) -> impl Iterator<Item = usize> {
    let n = frames.len().min(SAMPLED_FRAMES);
    let is_chosen = move |at: &usize| (0..n).any(|i| i * frames.len() / n == *at);
    let chosen = (0..frames.len()).filter(is_chosen);
    chosen.chain((0..frames.len()).filter(move |at| !is_chosen(at))).map(|at| frames[at])
}

fn quantile(values: &mut [f64], share: f64) -> Option<f64> {
    let last = values.len().checked_sub(1)?;
    Some(*values.select_nth_unstable_by((last as f64 * share) as usize, f64::total_cmp).1)
}

/// Share of pixels with depth below which a plane finds too few neighbours.
const SPARSE: f64 = 0.3;

fn no_points(
    dataset: &Dataset,
    trusted: [f64; 2],
    (seen, looked_at): (&mut [f64], usize),
    frames: usize,
) -> NoUsableDepth {
    let interval = |[a, b]: [f64; 2]| match b.is_finite() {
        true => format!("range {} to {}", length(a), length(b)),
        false => format!("range from {} on", length(a)),
    };
    let (near, far) = (quantile(seen, 0.05), quantile(seen, 0.95));
    let found = match (near, far) {
        (Some(near), Some(far)) => interval([near, far]),
        _ => "no depth".to_owned(),
    };
    let share = seen.len() as f64 / looked_at.max(1) as f64;
    let advice = match quantile(seen, 0.5) {
        None => "check that the depth images belong to this dataset".to_owned(),
        Some(_) if share < SPARSE => format!(
            "only {:.0} % of the pixels have depth: give depth in which neighbouring pixels have values, since surfaces are fitted to them",
            100.0 * share
        ),
        Some(middle) => unit_advice(trusted, middle),
    };
    let (dataset, trusted) = (dataset.name.clone(), interval(trusted));
    NoUsableDepth { dataset, trusted, found, frames, advice }
}

fn length(value: f64) -> String {
    match value == 0.0 || (1e-3..1e6).contains(&value) {
        true => format!("{value:.3}"),
        false => format!("{value:.3e}"),
    }
}

/// Returns advice for depth that yields no point. It names the power of ten that moves the depth
/// `middle` into the trusted interval.
fn unit_advice(trusted: [f64; 2], middle: f64) -> String {
    // In order of likelihood: most sensors store millimetres.
    let factors = [
        (1e-3, "millimetres"),
        (1e3, "kilometres"),
        (1e-2, "centimetres"),
        (1e-4, "tenths of millimetres"),
    ];
    let is_trusted = |depth: f64| (trusted[0]..trusted[1]).contains(&depth);
    if is_trusted(middle) {
        return "depth lies in that range: check the depth scale (`--depth-scale`), the intrinsics (`--intrinsics`), and that depth is not only noise".to_owned();
    }
    match factors.iter().find(|(factor, _)| is_trusted(middle * factor)) {
        Some((factor, unit)) => format!(
            "the depth appears to be in {unit} instead of metres: multiply the depth scale (`--depth-scale`) by {factor}, or widen the depth range (`--depth-range`)"
        ),
        None => "set the depth scale (`--depth-scale`) to its unit, or widen the depth range (`--depth-range`)".to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_frame_is_sampled_once_the_evenly_spaced_first() {
        let frames: Vec<usize> = (100..120).collect();
        let order: Vec<usize> = sampled(&frames).collect();
        assert_eq!(order[..8], [100, 102, 105, 107, 110, 112, 115, 117]);
        assert_eq!(order[8..11], [101, 103, 104]);
        let mut sorted = order.clone();
        sorted.sort_unstable();
        assert_eq!(sorted, frames);
        assert_eq!(sampled(&frames[..3]).collect::<Vec<_>>(), frames[..3]);
        assert_eq!(sampled(&[]).count(), 0);
    }

    #[test]
    fn a_wrong_unit_is_guessed() {
        let text = unit_advice([0.3, 4.0], 1500.0);
        assert!(text.contains("in millimetres instead of metres"), "{text}");
        assert!(text.contains("depth scale (`--depth-scale`) by 0.001"), "{text}");
        assert!(text.ends_with("depth range (`--depth-range`)"), "{text}");
        assert!(unit_advice([0.3, 4.0], 1e9).starts_with("set the depth scale"));
        // Depth inside the range has the right unit; an unbounded range gives no hint.
        for (trusted, middle) in [([0.3, 4.0], 2.0), ([0.0, f64::INFINITY], 1e33)] {
            assert!(unit_advice(trusted, middle).starts_with("depth lies in that range"));
        }
    }
}
