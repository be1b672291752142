//! Validation of scenes.

use super::super::error::{Defect, tag_text};
use super::super::sections::*;
use super::super::textures;
use super::{AXES, check_ascending, value_defect};
use crate::model::scene::photometric::{N_COLOR, N_FORM, PhotometricState};
use crate::model::scene::state::{MAX_SUM, QUANTUM, SceneState, StoredSums, WIDE_POINTS, WideRow};
use crate::model::scene::sums::{
    MAX_TERM, N_SUMS, RELATIVE_SLACK, SLACK_PER_POINT, SQUARES, first_violated_moment,
};
use crate::model::scene::waiting::{BufferedPhotograph, DepthScale, NumberDefect, PhotographView};
use crate::model::splat::pose_log::FramePose;
use crate::model::splat::viewpoint::Viewpoint;

#[rustfmt::skip]
const NAMES: [&str; N_SUMS] = [
    "N", "x", "y", "z", "xx", "xy", "xz", "yy", "yz", "zz",
    "red", "green", "blue",
    "red x", "red y", "red z", "green x", "green y", "green z", "blue x", "blue y", "blue z",
    "normal x", "normal y", "normal z",
    "view x", "view y", "view z", "view xx", "view xy", "view xz", "view yy", "view yz",
    "red view x", "red view y", "red view z", "green view x", "green view y", "green view z",
    "blue view x", "blue view y", "blue view z",
];

pub(in super::super) fn check_scene(state: &SceneState) -> Result<(), Defect> {
    if !state.origin.iter().all(|x| x.is_finite()) {
        let found = format!("{:?}", state.origin);
        return Err(Defect::malformed(tag_text(ORIGIN), "finite numbers", found));
    }
    let numbers = state.seeds.as_flattened().iter().enumerate().zip(AXES.into_iter().cycle());
    if let Some(((at, &found), axis)) = numbers.into_iter().find(|((_, x), _)| !x.is_finite()) {
        return Err(value_defect(SEEDS, at / 3, axis, "a finite number", found.into()));
    }
    for (at, frame) in state.exposures.iter().enumerate() {
        check_viewpoint(EXPOSURES, at, &frame.viewpoint)?;
        if let Some(&found) = frame.gain.iter().find(|g| !(**g > 0.0 && g.is_finite())) {
            return Err(value_defect(EXPOSURES, at, "gain", "a positive number", found));
        }
    }
    for (at, frame) in state.poses.iter().enumerate() {
        check_correction(POSES, at, frame)?;
        // Older files lack rotations, which are read as zeros.
        if frame.rotation != [0.0; 4] && frame.poses().is_none() {
            let [x, ..] = frame.rotation;
            return Err(value_defect(POSE_ROTATIONS, at, "rotation", "a unit quaternion", x));
        }
    }
    let mut tracked = state.trajectory.iter().enumerate();
    if let Some((at, unplaced)) = tracked.find(|(_, tracked)| tracked.pose().is_none()) {
        let found = unplaced.rotation[3];
        return Err(value_defect(TRAJECTORY, at, "rotation", "a unit quaternion", found));
    }
    if let Some(photometric) = &state.photometric {
        check_photometric(photometric)?;
    }
    let n = state.visibility.len();
    let mut components = state.components.iter().flatten().enumerate();
    if let Some((at, &found)) = components.find(|(_, id)| **id as usize >= n) {
        let expected = format!("a component below {n}");
        return Err(value_defect(COMPONENTS, at, "seed", &expected, found.into()));
    }
    let StoredSums { rows, wide } = &state.sums;
    check_wide_rows(wide, rows)?;
    rows.iter().enumerate().try_for_each(|(k, row)| {
        let row = row.map(|quanta| f64::from(quanta) * QUANTUM);
        // Narrow sums of more points could overflow.
        if row[0] >= f64::from(WIDE_POINTS) {
            let expected =
                format!("fewer than {WIDE_POINTS} points; larger components are stored wide");
            return Err(value_defect(SUMS, k, NAMES[0], &expected, row[0]));
        }
        check_sums(SUMS, k, &row)
    })
}

fn check_correction(tag: [u8; 4], at: usize, frame: &FramePose) -> Result<(), Defect> {
    check_viewpoint(tag, at, &frame.recorded)?;
    match frame.turn.iter().chain(&frame.shift).find(|x| !x.is_finite()) {
        Some(&found) => Err(value_defect(tag, at, "correction", "a finite number", found)),
        None => Ok(()),
    }
}

fn check_viewpoint(tag: [u8; 4], at: usize, viewpoint: &Viewpoint) -> Result<(), Defect> {
    if let Some(&found) = viewpoint.centre.iter().find(|x| !x.is_finite()) {
        return Err(value_defect(tag, at, "centre", "a finite number", found));
    }
    let length = viewpoint.forward.iter().map(|x| x * x).sum::<f64>().sqrt();
    // NaN would pass the comparison.
    if length.is_nan() || (length - 1.0).abs() > 1e-3 {
        return Err(value_defect(tag, at, "direction", "a unit vector", length));
    }
    Ok(())
}

pub(in super::super) fn check_buffered_views<'a>(
    views: impl Iterator<Item = &'a PhotographView>,
) -> Result<(), Defect> {
    no_defects(PHOTO_BUFFER, views.map(PhotographView::first_invalid_number))
}

pub(in super::super) fn check_depth_scales<'a>(
    scales: impl Iterator<Item = &'a DepthScale>,
) -> Result<(), Defect> {
    no_defects(PHOTO_SCALES, scales.map(DepthScale::defect))
}

fn no_defects(
    tag: [u8; 4],
    defects: impl Iterator<Item = Option<NumberDefect>>,
) -> Result<(), Defect> {
    let mut found = defects.enumerate().filter_map(|(at, defect)| Some((at, defect?)));
    match found.next() {
        None => Ok(()),
        Some((at, (name, expected, found))) => Err(value_defect(tag, at, name, &expected, found)),
    }
}

fn check_photometric(state: &PhotometricState) -> Result<(), Defect> {
    for (at, frame) in state.photograph_poses.iter().enumerate() {
        check_correction(PHOTO_POSES, at, frame)?;
        if frame.poses().is_none() {
            let [x, ..] = frame.rotation;
            return Err(value_defect(PHOTO_POSES, at, "rotation", "a unit quaternion", x));
        }
    }
    // Views first: `n_pixels` below needs valid sizes.
    check_buffered_views(state.buffered.iter().map(|waiting| &waiting.view))?;
    let mut all = state.buffered.iter().enumerate();
    if let Some((at, odd)) = all.find(|(_, w)| w.pixels.len() != w.view.n_pixels()) {
        let expected = format!("{} pixels", odd.view.n_pixels());
        return Err(value_defect(PHOTO_BUFFER, at, "size", &expected, odd.pixels.len() as f64));
    }
    let depths = || state.buffered.iter().filter_map(|waiting| waiting.depths.as_ref());
    check_depth_scales(depths().map(|depths| &depths.scale))?;
    let steps = |waiting: &BufferedPhotograph| waiting.depths.as_ref().map(|d| d.steps.len());
    let mut all = state.buffered.iter().filter_map(|w| Some((w, steps(w)?))).enumerate();
    if let Some((at, (odd, n))) = all.find(|(_, (w, n))| *n != w.view.n_pixels()) {
        let expected = format!("{} depths", odd.view.n_pixels());
        return Err(value_defect(PHOTO_DEPTHS, at, "size", &expected, n as f64));
    }
    let looks = state.splats.iter().zip(&state.appearance);
    let precisions = state.form.iter().zip(&state.color);
    let all = looks.zip(precisions).enumerate();
    // Rows with opacity 0 hold no splat, and thus no precision.
    for (at, ((splat, appearance), (form, color))) in
        all.filter(|(_, ((s, _), _))| s.opacity != 0.0)
    {
        if !(splat.is_drawable() && appearance.is_valid()) {
            let found = f64::from(splat.opacity);
            return Err(value_defect(
                PHOTO_SPLATS,
                at,
                "splat",
                "a splat that can be drawn",
                found,
            ));
        }
        // Diagonal entries of the packed lower triangles.
        let form = (0..N_FORM).filter_map(|i| form.get(i * (i + 3) / 2));
        let color = (0..N_COLOR).filter_map(|i| color.get(i * (i + 3) / 2));
        if let Some(found) = form.chain(color).copied().find(|x| !(*x > 0.0 && x.is_finite())) {
            let expected = "a positive number";
            return Err(value_defect(
                PHOTO_SHAPE_PRECISION,
                at,
                "precision",
                expected,
                f64::from(found),
            ));
        }
    }
    textures::check(state)?;
    let usual = [
        (PHOTO_NOISE, state.noise),
        (PHOTO_POINTS, state.points),
        (PHOTO_SEEN_THROUGH, state.seen_through),
    ];
    usual.into_iter().try_for_each(|(tag, numbers)| {
        match numbers.into_iter().find(|x| !(x.is_finite() && *x >= 0.0)) {
            Some(found) => Err(value_defect(tag, 0, "noise", "a number of 0 or more", found)),
            None => Ok(()),
        }
    })
}

/// Checks the `f64` sums of components with `WIDE_POINTS` points or more. Ids must ascend, sums must be
/// whole multiples of 2⁻¹⁵, and the component's `i32` sums in `rows` must be zero.
#[expect(clippy::indexing_slicing, reason = "ids index rows, positions index sums")]
fn check_wide_rows(wide: &[WideRow], rows: &[[i32; N_SUMS]]) -> Result<(), Defect> {
    check_ascending(WIDE_IDS, wide.iter().map(|row| row.id), rows.len())?;
    for row in wide {
        let k = row.id as usize;
        let refuse = |i: usize, expected: &str| {
            Err(value_defect(WIDE_SUMS, k, NAMES[i], expected, row.sums[i]))
        };
        // Exact, since the quantum is a power of two.
        let is_odd = |v: &f64| !(v.abs() <= MAX_SUM && (v / QUANTUM).fract() == 0.0);
        if let Some(i) = row.sums.iter().position(is_odd) {
            return refuse(i, "a whole multiple of 2^-15 up to 2^38");
        }
        if row.sums[0] < f64::from(WIDE_POINTS) {
            return refuse(0, &format!("{WIDE_POINTS} points or more"));
        }
        check_sums(WIDE_SUMS, k, &row.sums)?;
        if let Some(i) = rows[k].iter().position(|quanta| *quanta != 0) {
            let expected = format!("0 beside sums in `{}`", tag_text(WIDE_SUMS));
            let found = f64::from(rows[k][i]) * QUANTUM;
            return Err(value_defect(SUMS, k, NAMES[i], &expected, found));
        }
    }
    Ok(())
}

/// Checks that the sums of component `k` are finite, with no negative count or diagonal moment. No sum
/// may exceed `MAX_TERM` per point. The magnitude of each mixed second moment must be at most the mean
/// of the two axes' diagonal moments.
#[expect(clippy::indexing_slicing, reason = "indices from the table, or found among the sums")]
fn check_sums(tag: [u8; 4], k: usize, row: &[f64; N_SUMS]) -> Result<(), Defect> {
    let n = row[0];
    let refuse = |i: usize, expected: &str| Err(value_defect(tag, k, NAMES[i], expected, row[i]));
    if let Some(i) = row.iter().position(|v| !v.is_finite()) {
        return refuse(i, "a finite number");
    }
    if let Some(&i) = [0].iter().chain(&SQUARES).find(|&&i| row[i] < 0.0) {
        return refuse(i, "0 or more");
    }
    // Each point contributes at most `MAX_TERM`.
    let most = MAX_TERM * n * (1.0 + RELATIVE_SLACK);
    if let Some(i) = row.iter().position(|v| v.abs() > most) {
        return refuse(i, &format!("at most {MAX_TERM} per point, for {n} points"));
    }
    if let Some((i, _)) = first_violated_moment(row) {
        return refuse(i, "at most the mean of the two axes' second moments");
    }
    // Directions are unit vectors: `view zz` is not stored but follows from N, `xx` and `yy`.
    if n - row[28] - row[31] < -(RELATIVE_SLACK + SLACK_PER_POINT) * n {
        return refuse(31, &format!("at most the remainder of N after `{}`", NAMES[28]));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::splat::splats::Splat;

    fn sums(values: &[(usize, f64)]) -> [f64; N_SUMS] {
        let mut row = [0.0; N_SUMS];
        values.iter().for_each(|&(i, value)| row[i] = value);
        row
    }

    #[test]
    fn bounds_of_sums_are_exact() {
        let check = |values: &[(usize, f64)]| check_sums(SUMS, 3, &sums(values));
        check(&[(0, 2.0), (10, 2.0 * MAX_TERM)]).unwrap();
        assert!(check(&[(0, 2.0), (10, 2.1 * MAX_TERM)]).is_err());
        // The slack grows with the number of points: 0.0926 for 1,000.
        check(&[(0, 1000.0), (28, 1000.0), (31, 0.09)]).unwrap();
        let found = check(&[(0, 1000.0), (28, 1000.0), (31, 0.1)]).unwrap_err().to_string();
        assert!(
            found.contains("[component 3, view yy]: expected at most the remainder"),
            "{found}"
        );
    }

    #[test]
    fn wide_sums_begin_at_their_number_of_points_and_stand_alone() {
        let wide = [WideRow { id: 0, sums: sums(&[(0, f64::from(WIDE_POINTS))]) }];
        let mut rows = [[0; N_SUMS]];
        check_wide_rows(&wide, &rows).unwrap();
        rows[0][7] = 3;
        let found = check_wide_rows(&wide, &rows).unwrap_err().to_string();
        assert!(found.contains("[component 0, yy]: expected 0 beside sums"), "{found}");
        assert!(found.contains("found 0.000091552734375"), "{found}");
    }

    #[test]
    fn splats_precisions_and_noise_are_checked() {
        let mut sound = PhotometricState::default();
        sound.grow(1);
        sound.splats[0] = Splat { opacity: 0.5, scale: [0.1; 3], ..Splat::default() };
        (0..N_FORM).for_each(|i| sound.form[0][i * (i + 3) / 2] = 1.0);
        (0..N_COLOR).for_each(|i| sound.color[0][i * (i + 3) / 2] = 1.0);
        check_photometric(&sound).unwrap();
        let last = |n: usize| n * (n + 1) / 2 - 1;
        let found = |edit: &dyn Fn(&mut PhotometricState)| {
            let mut state = sound.clone();
            edit(&mut state);
            check_photometric(&state).unwrap_err().to_string()
        };
        let precision = "[component 0, precision]: expected a positive number, found";
        for (found, expected) in [
            (found(&|s| s.form[0][last(N_FORM)] = 0.0), format!("{precision} 0")),
            (found(&|s| s.form[0][0] = f32::INFINITY), format!("{precision} inf")),
            (found(&|s| s.color[0][last(N_COLOR)] = -1.0), format!("{precision} -1")),
            (found(&|s| s.appearance[0].directional[0][0] = f32::NAN), "can be drawn".to_owned()),
            (found(&|s| s.noise[0] = f64::INFINITY), "0 or more, found inf".to_owned()),
            (found(&|s| s.points[1] = -1.0), "0 or more, found -1".to_owned()),
        ] {
            assert!(found.contains(&expected), "{expected}: {found}");
        }
    }
}
