//! Validation of values: a checkpoint with correct checksums may still hold an impossible model.

mod mixture;
mod scene;

use super::error::{Defect, tag_text};
use super::sections;
use crate::math::measured_pixel::Normalization;

pub(super) use mixture::check_mixture;
pub(super) use scene::{check_buffered_views, check_depth_scales, check_scene};

const AXES: [&str; 3] = ["x", "y", "z"];

pub(super) fn check_normalization(normalization: &Normalization) -> Result<(), Defect> {
    let Normalization { offset, scale } = normalization;
    // The transform must be invertible.
    let sound =
        offset.iter().all(|v| v.is_finite()) && scale.iter().all(|v| v.is_finite() && *v > 0.0);
    if sound {
        return Ok(());
    }
    let expected = "a finite offset and a positive scale";
    let found = format!("{offset:?} and {scale:?}");
    Err(Defect::malformed(tag_text(sections::NORMALIZATION), expected, found))
}

pub(super) fn check_prior(numbers: &[f64]) -> Result<(), Defect> {
    // Negated, so that NaN is refused as well.
    match numbers.iter().find(|v| !(v.is_finite() && **v > 0.0)) {
        None => Ok(()),
        Some(found) => {
            Err(Defect::malformed(tag_text(sections::PRIOR), "positive numbers", found.to_string()))
        }
    }
}

pub(super) fn check_visited(frames: &[u64], learned: u64) -> Result<Vec<u32>, Defect> {
    let refuse = |expected: &str, found: String| {
        Err(Defect::malformed(tag_text(sections::CURSOR), expected, found))
    };
    // Skipped frames are visited as well, so there may be more visits than trained frames.
    if learned > frames.len() as u64 {
        return refuse(&format!("at most {} trained frames", frames.len()), learned.to_string());
    }
    let ids: Option<Vec<u32>> = frames.iter().map(|&frame| u32::try_from(frame).ok()).collect();
    ids.map_or_else(|| refuse("frame numbers of 32 bits", "larger ones".to_owned()), Ok)
}

pub(super) fn check_ascending(
    tag: [u8; 4],
    ids: impl Iterator<Item = u32> + Clone,
    components: usize,
) -> Result<(), Defect> {
    // Strictly, because a component that occurs twice would have two values.
    if !ids.clone().is_sorted_by(|a, b| a < b) {
        let expected = "components in ascending order";
        return Err(Defect::malformed(tag_text(tag), expected, "another order"));
    }
    match ids.max().filter(|id| *id as usize >= components) {
        Some(id) => {
            let expected = format!("components below {components}");
            Err(Defect::malformed(tag_text(tag), expected, id.to_string()))
        }
        None => Ok(()),
    }
}

pub(super) fn value_defect(
    tag: [u8; 4],
    k: usize,
    axis: &str,
    expected: &str,
    found: f64,
) -> Defect {
    Defect::malformed(
        format!("{}[component {k}, {axis}]", tag_text(tag)),
        expected,
        found.to_string(),
    )
}
