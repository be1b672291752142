//! Sections of frames retained for a second pose correction (`KEPT` and related tags).

use super::container::Section;
use super::error::Defect;
use super::sections::Sections;
use super::{check, sections};
use crate::model::scene::kept::{ComponentObservation, FrameContribution, StoredFrame};
use crate::model::scene::sums::N_SUMS;
use glam::DVec3;

/// Numbers per frame: index among the trained frames, index among the corrected poses, standard deviation of
/// the position, number of components shown, number of components updated.
const N_FRAME: usize = 5;
/// Numbers per shown component: position, colour, depth noise.
const N_SHOWN: usize = 7;

pub(super) fn retained_sections(frames: &[StoredFrame]) -> Vec<Section<'_>> {
    if frames.is_empty() {
        return Vec::new();
    }
    let numbers = |kept: &StoredFrame| {
        let [shown, taught] = [kept.shown.len(), kept.taught.ids.len()].map(|n| n as f64);
        [kept.frame as f64, kept.log_index as f64, kept.deviation, shown, taught]
    };
    let shown = || frames.iter().flat_map(|kept| &kept.shown);
    let means = |shown: &ComponentObservation| {
        let ([x, y, z], [r, g, b]) = (shown.position.to_array(), shown.color.to_array());
        [x, y, z, r, g, b, shown.noise]
    };
    let ids = frames.iter().map(|kept| bytemuck::cast_slice(&kept.taught.ids));
    let sums = frames.iter().map(|kept| bytemuck::cast_slice(&kept.taught.sums));
    vec![
        Section::owned::<f64>(sections::RETAINED, frames.iter().flat_map(numbers).collect()),
        Section::owned::<u32>(
            sections::KEPT_SHOWN_IDS,
            shown().map(|shown| shown.component).collect(),
        ),
        Section::owned::<f64>(sections::RETAINED_MEANS, shown().flat_map(means).collect()),
        Section::from_runs::<u32>(sections::KEPT_IDS, ids),
        Section::from_runs::<i32>(sections::KEPT_SUMS, sums),
    ]
}

pub(super) fn read(sections: &Sections) -> Result<Vec<StoredFrame>, Defect> {
    if !sections.has(sections::RETAINED) {
        return Ok(Vec::new());
    }
    let frames = sections.rows::<f64, N_FRAME>(sections::RETAINED, None)?;
    check::check_retained_numbers(&frames)?;
    let [n_shown, n_taught] = frames.iter().fold([0usize; 2], |[a, b], &[.., shown, taught]| {
        [a.saturating_add(shown as usize), b.saturating_add(taught as usize)]
    });
    let shown_ids: Vec<u32> = sections.elements(sections::KEPT_SHOWN_IDS, Some(n_shown))?;
    let means = sections.rows::<f64, N_SHOWN>(sections::RETAINED_MEANS, Some(n_shown))?;
    let ids: Vec<u32> = sections.elements(sections::KEPT_IDS, Some(n_taught))?;
    let sums = sections.rows::<i32, N_SUMS>(sections::KEPT_SUMS, Some(n_taught))?;
    let shown = |(component, [x, y, z, r, g, b, noise]): (u32, [f64; N_SHOWN])| {
        let (place, color) = (DVec3::new(x, y, z), DVec3::new(r, g, b));
        ComponentObservation { component, position: place, color, noise }
    };
    let mut shown = shown_ids.into_iter().zip(means).map(shown);
    let (mut ids, mut sums) = (ids.into_iter(), sums.into_iter());
    let kept = |&[frame, logged, deviation, n_shown, n_taught]: &[f64; N_FRAME]| StoredFrame {
        frame: frame as u64,
        log_index: logged as u64,
        deviation,
        shown: shown.by_ref().take(n_shown as usize).collect(),
        taught: FrameContribution {
            ids: ids.by_ref().take(n_taught as usize).collect(),
            sums: sums.by_ref().take(n_taught as usize).collect(),
        },
    };
    Ok(frames.iter().map(kept).collect())
}
