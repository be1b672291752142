//! Validation of retained frames (`KEPT` sections).

use super::super::error::Defect;
use super::super::sections;
use super::scene::check_sums;
use super::{check_ascending, check_below, value_defect};
use crate::model::scene::kept::{StoredFrame, quanta_to_values};
use crate::model::scene::state::SceneState;
use crate::model::scene::sums::MIXED;

const NAMES: [&str; 5] = ["frame", "pose", "deviation", "components shown", "components updated"];
/// Largest whole number that f64 represents exactly.
const MOST: f64 = (1u64 << 53) as f64;

/// Checks the numbers of all frames before any of them is used as a count.
pub(in super::super) fn check_retained_numbers(frames: &[[f64; 5]]) -> Result<(), Defect> {
    let numbers = |frame: &[f64; 5]| NAMES.into_iter().zip(*frame).collect::<Vec<_>>();
    for (at, frame) in frames.iter().enumerate() {
        for (name, number) in numbers(frame) {
            let (expected, is_one) = match name {
                "deviation" => ("a positive number", number > 0.0 && number.is_finite()),
                _ => {
                    let is_whole = (0.0..=MOST).contains(&number) && number.fract() == 0.0;
                    ("a whole number of 0 or more", is_whole)
                }
            };
            if !is_one {
                return Err(value_defect(sections::RETAINED, at, name, expected, number));
            }
        }
    }
    Ok(())
}

pub(in super::super) fn check_retained_frames(state: &SceneState) -> Result<(), Defect> {
    let (n_poses, n) = (state.poses.len() as u64, state.visibility.len());
    for (at, StoredFrame { log_index: logged, shown, taught, .. }) in
        state.stored_frames.iter().enumerate()
    {
        if *logged >= n_poses {
            let expected = format!("an index below the {n_poses} corrected poses");
            return Err(value_defect(sections::RETAINED, at, NAMES[1], &expected, *logged as f64));
        }
        check_below(sections::KEPT_SHOWN_IDS, shown.iter().map(|shown| shown.component), n)?;
        check_ascending(sections::KEPT_IDS, taught.ids.iter().copied(), n)?;
        for shown in shown {
            let numbers = shown.position.to_array().into_iter().chain(shown.color.to_array());
            let mut numbers = numbers.chain([shown.noise]);
            if let Some(found) = numbers.find(|x| !x.is_finite()) {
                return Err(value_defect(
                    sections::RETAINED_MEANS,
                    at,
                    "mean",
                    "a finite number",
                    found,
                ));
            }
        }
        for (id, row) in taught.iter() {
            check_sums(sections::KEPT_SUMS, id as usize, &quanta_to_values(row), MIXED)?;
        }
    }
    Ok(())
}
