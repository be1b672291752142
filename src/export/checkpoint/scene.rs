//! Sections of a scene.

use super::check;
use super::container::{Container, Section};
use super::error::{Defect, tag_text};
use super::sections::*;
use super::textures;
use crate::model::scene::photometric::PhotometricState;
use crate::model::scene::state::{
    MAX_COARSENING_STEPS, SceneState, StoredSums, TrackedPose, VisibilityCounts, WHOLE, WideRow,
};
use crate::model::scene::sums::N_SUMS;
use crate::model::scene::waiting::{
    BufferedDepths, BufferedPhotograph, DepthScale, PhotographView,
};
use crate::model::splat::appearance::Appearance;
use crate::model::splat::pose_log::{FrameExposure, FramePose};
use crate::model::splat::splats::Splat;
use crate::model::splat::viewpoint::Viewpoint;

const N_VISIBILITY: usize = size_of::<VisibilityCounts>() / size_of::<u32>();

const N_EXPOSURE: usize = size_of::<FrameExposure>() / size_of::<f64>();
/// Number of stored values of a corrected camera pose, without its rotation.
// Older files do not store the rotation, so it has a section of its own.
const N_POSE: usize = 12;
const N_PHOTO_POSE: usize = size_of::<FramePose>() / size_of::<f64>();
const N_VIEW: usize = size_of::<PhotographView>() / size_of::<f64>();
const N_SCALE: usize = size_of::<DepthScale>() / size_of::<f64>();
/// Depth scale that marks a photograph without depths.
const NO_SCALE: DepthScale = DepthScale { step: 0.0, margin: [0.0; 2] };
const N_TRACKED: usize = size_of::<TrackedPose>() / size_of::<f64>();

const N_SPLAT: usize = size_of::<Splat>() / size_of::<f32>();
/// Number of stored values of an appearance: nine of the colour gradient and nine of the directional
/// colour.
// The observed directions follow from the component's sums.
const N_APPEARANCE: usize = 18;

pub(super) fn sections(state: &SceneState) -> Vec<Section<'_>> {
    let mut sections =
        vec![Section::new(ORIGIN, &state.origin), Section::new(SEEDS, state.seeds.as_flattened())];
    let StoredSums { rows, wide } = &state.sums;
    sections.push(Section::new(SUMS, rows.as_flattened()));
    // Only large components are stored wide; without any, the sections are omitted.
    if !wide.is_empty() {
        let ids = wide.iter().map(|row| row.id).collect();
        let sums = wide.iter().flat_map(|row| row.sums).collect();
        sections.push(Section::owned::<u32>(WIDE_IDS, ids));
        sections.push(Section::owned::<f64>(WIDE_SUMS, sums));
    }
    // Omitted if the component budget sufficed, so that such files keep their earlier bytes.
    if state.coarsening_steps > 0 {
        sections.push(Section::owned::<u32>(COARSENED, vec![state.coarsening_steps]));
    }
    if let Some(shares) = &state.shares {
        let words = shares.iter().map(|&share| share.into()).collect();
        sections.push(Section::owned::<u32>(SHARES, words));
    }
    let components = state.components.as_ref();
    sections.extend(components.map(|c| Section::new(COMPONENTS, c.as_slice())));
    // Pairs of u16 as one word: on little-endian machines hits are in the low half.
    sections.push(Section::new::<u32>(VISIBILITY, bytemuck::cast_slice(&state.visibility)));
    // Omitted without fitted gains, so that such files keep their earlier bytes.
    if !state.exposures.is_empty() {
        let numbers = bytemuck::cast_slice(&state.exposures);
        sections.push(Section::new::<f64>(EXPOSURES, numbers));
    }
    if !state.poses.is_empty() {
        sections.extend(pose_sections(&state.poses));
    }
    if !state.trajectory.is_empty() {
        let numbers = bytemuck::cast_slice(&state.trajectory);
        sections.push(Section::new::<f64>(TRAJECTORY, numbers));
    }
    sections.extend(state.photometric.iter().flat_map(photometric_sections));
    sections
}

fn pose_sections(poses: &[FramePose]) -> [Section<'_>; 2] {
    let numbers = |pose: &FramePose| {
        let FramePose { recorded: Viewpoint { centre, forward }, turn, shift, .. } = *pose;
        [centre, forward, turn, shift]
    };
    let numbers: Vec<[f64; 3]> = poses.iter().flat_map(numbers).collect();
    let rotations: Vec<[f64; 4]> = poses.iter().map(|pose| pose.rotation).collect();
    [
        Section::owned::<f64>(POSES, numbers.into_flattened()),
        Section::owned::<f64>(POSE_ROTATIONS, rotations.into_flattened()),
    ]
}

fn photometric_sections(photometric: &PhotometricState) -> Vec<Section<'_>> {
    let slopes = photometric.appearance.iter();
    let slopes = slopes.flat_map(|look| look.gradient.into_iter().chain(look.directional));
    let mut sections = vec![
        Section::new::<f32>(PHOTO_SPLATS, bytemuck::cast_slice(&photometric.splats)),
        Section::owned::<f32>(PHOTO_APPEARANCE, slopes.flatten().collect()),
        Section::new(PHOTO_SHAPE_PRECISION, photometric.form.as_flattened()),
        Section::new(PHOTO_COLOR, photometric.color.as_flattened()),
        Section::new(PHOTO_NOISE, &photometric.noise),
        Section::new(PHOTO_POINTS, &photometric.points),
        Section::new(PHOTO_SEEN_THROUGH, &photometric.seen_through),
    ];
    if !photometric.photograph_poses.is_empty() {
        let numbers = bytemuck::cast_slice(&photometric.photograph_poses);
        sections.push(Section::new::<f64>(PHOTO_POSES, numbers));
    }
    // Omitted if no photographs are buffered, so that such files keep their earlier bytes.
    if !photometric.buffered.is_empty() {
        let views: Vec<PhotographView> = photometric.buffered.iter().map(|w| w.view).collect();
        // One word per pixel, borrowed: the buffer may hold 64 MB.
        let pixels = photometric.buffered.iter().map(|waiting| waiting.pixels.as_flattened());
        sections.push(Section::owned::<f64>(PHOTO_BUFFER, bytemuck::cast_slice(&views).to_vec()));
        sections.push(Section::from_runs::<u32>(PHOTO_PIXELS, pixels));
        sections.extend(depth_sections(&photometric.buffered));
    }
    sections.extend(textures::sections(photometric));
    sections
}

/// Returns the sections for the depths of buffered photographs: a depth scale for each photograph, and
/// the quantised depths of photographs that have depths. Returns none if no photograph has depths.
fn depth_sections(waiting: &[BufferedPhotograph]) -> Vec<Section<'_>> {
    let depths = || waiting.iter().map(|waiting| waiting.depths.as_ref());
    if depths().all(|depths| depths.is_none()) {
        return Vec::new();
    }
    let scale = |depths: Option<&BufferedDepths>| depths.map_or(NO_SCALE, |depths| depths.scale);
    let scales: Vec<DepthScale> = depths().map(scale).collect();
    let steps = depths().flatten().map(|depths| bytemuck::cast_slice(&depths.steps));
    vec![
        Section::owned::<f64>(PHOTO_SCALES, bytemuck::cast_slice(&scales).to_vec()),
        Section::from_runs::<u16>(PHOTO_DEPTHS, steps),
    ]
}

pub(super) fn read(sections: &Container) -> Result<SceneState, Defect> {
    if let Some(tag) = OF_MIXTURES.iter().find(|tag| sections.has(**tag)) {
        return Err(Defect::malformed(tag_text(*tag), "no such section in a scene", "one"));
    }
    let seeds = sections.rows::<f32, 3>(SEEDS, None)?;
    // Zero seeds are valid: a run may be saved before any frame had points.
    check_size(SEEDS, 0, seeds.len())?;
    let shares = sections.optional(SHARES, || shares(sections, seeds.len()).map(Some))?;
    let components = sections.optional(COMPONENTS, || {
        sections.elements::<u32>(COMPONENTS, Some(seeds.len())).map(Some)
    })?;
    // Without shared components, each seed has its own.
    let n = components.is_none().then_some(seeds.len());
    let visibility = sections.rows::<u32, N_VISIBILITY>(VISIBILITY, n)?;
    let n = visibility.len();
    check_size(VISIBILITY, 0, n)?;
    let state = SceneState {
        origin: sections.read_numbers(ORIGIN)?,
        coarsening_steps: sections.optional(COARSENED, || coarsened(sections))?,
        seeds,
        shares,
        components,
        sums: sums(sections, n)?,
        visibility: bytemuck::cast_vec(visibility),
        exposures: bytemuck::cast_vec(
            sections.optional(EXPOSURES, || sections.rows::<f64, N_EXPOSURE>(EXPOSURES, None))?,
        ),
        poses: sections.optional(POSES, || poses(sections))?,
        trajectory: bytemuck::cast_vec(
            sections.optional(TRAJECTORY, || sections.rows::<f64, N_TRACKED>(TRAJECTORY, None))?,
        ),
        photometric: sections.optional(PHOTO_SPLATS, || photometric(sections, n).map(Some))?,
    };
    check::check_scene(&state)?;
    Ok(state)
}

fn poses(sections: &Container) -> Result<Vec<FramePose>, Defect> {
    let rows = sections.rows::<f64, N_POSE>(POSES, None)?;
    let rotations = match sections.has(POSE_ROTATIONS) {
        true => sections.rows::<f64, 4>(POSE_ROTATIONS, Some(rows.len()))?,
        // Older files lack the rotations.
        false => vec![[0.0; 4]; rows.len()],
    };
    let pose = |([x, y, z, u, v, w, a, b, c, i, j, k], rotation): ([f64; N_POSE], [f64; 4])| {
        let recorded = Viewpoint { centre: [x, y, z], forward: [u, v, w] };
        FramePose { recorded, rotation, turn: [a, b, c], shift: [i, j, k] }
    };
    Ok(rows.into_iter().zip(rotations).map(pose).collect())
}

fn coarsened(sections: &Container) -> Result<u32, Defect> {
    let steps = sections.elements::<u32>(COARSENED, Some(1))?;
    match steps.first().copied().unwrap_or(0) {
        steps @ 1..=MAX_COARSENING_STEPS => Ok(steps),
        steps => {
            let expected = format!("a whole number from 1 to {MAX_COARSENING_STEPS}");
            Err(check::value_defect(COARSENED, 0, "steps", &expected, steps.into()))
        }
    }
}

fn shares(sections: &Container, n: usize) -> Result<Vec<u8>, Defect> {
    let words: Vec<u32> = sections.elements(SHARES, Some(n))?;
    let share = |(at, word): (usize, u32)| match u8::try_from(word) {
        Ok(share @ 1..=WHOLE) => Ok(share),
        _ => Err(check::value_defect(
            SHARES,
            at,
            "share",
            "a whole number from 1 to 64",
            word.into(),
        )),
    };
    words.into_iter().enumerate().map(share).collect()
}

fn appearance_of(stored: [f32; N_APPEARANCE]) -> Appearance {
    let [gradient, directional] = bytemuck::cast(stored);
    Appearance { gradient, directional, ..Appearance::default() }
}

fn photometric(sections: &Container, n: usize) -> Result<PhotometricState, Defect> {
    let splats = sections.rows::<f32, N_SPLAT>(PHOTO_SPLATS, Some(n))?;
    let appearance = sections.rows::<f32, N_APPEARANCE>(PHOTO_APPEARANCE, Some(n))?;
    // Older files have neither section.
    let pair = |tag| sections.optional(tag, || sections.read_numbers::<2>(tag));
    Ok(PhotometricState {
        splats: bytemuck::cast_vec(splats),
        appearance: appearance.into_iter().map(appearance_of).collect(),
        form: sections.rows(PHOTO_SHAPE_PRECISION, Some(n))?,
        color: sections.rows(PHOTO_COLOR, Some(n))?,
        textures: textures::read(sections, n)?,
        texture_steps: textures::read_steps(sections)?,
        noise: sections.read_numbers(PHOTO_NOISE)?,
        points: pair(PHOTO_POINTS)?,
        seen_through: pair(PHOTO_SEEN_THROUGH)?,
        photograph_poses: bytemuck::cast_vec(
            sections
                .optional(PHOTO_POSES, || sections.rows::<f64, N_PHOTO_POSE>(PHOTO_POSES, None))?,
        ),
        buffered: sections.optional(PHOTO_BUFFER, || read_buffered_photographs(sections))?,
    })
}

/// Reads buffered photographs. The number of pixels of each photograph follows from its view.
fn read_buffered_photographs(sections: &Container) -> Result<Vec<BufferedPhotograph>, Defect> {
    let views = sections.rows::<f64, N_VIEW>(PHOTO_BUFFER, None)?;
    let views: Vec<PhotographView> = bytemuck::cast_vec(views);
    // Views are checked before they determine the number of pixels.
    check::check_buffered_views(views.iter())?;
    // Saturating: an impossible sum then fails the check of the section's size.
    let n = views.iter().map(PhotographView::n_pixels).fold(0, usize::saturating_add);
    let words: Vec<u32> = sections.elements(PHOTO_PIXELS, Some(n))?;
    let mut pixels = words.into_iter().map(u32::to_le_bytes);
    let depths = read_depths(sections, &views)?;
    let of = |(view, depths): (PhotographView, Option<BufferedDepths>)| {
        let pixels = pixels.by_ref().take(view.n_pixels()).collect();
        BufferedPhotograph { view, pixels, depths }
    };
    Ok(views.into_iter().zip(depths).map(of).collect())
}

fn read_depths(
    sections: &Container,
    views: &[PhotographView],
) -> Result<Vec<Option<BufferedDepths>>, Defect> {
    // Older files have no depths.
    if !sections.has(PHOTO_SCALES) {
        return Ok(vec![None; views.len()]);
    }
    let scales = sections.rows::<f64, N_SCALE>(PHOTO_SCALES, Some(views.len()))?;
    let scales: Vec<DepthScale> = bytemuck::cast_vec(scales);
    let has_depths = |scale: &DepthScale| *scale != NO_SCALE;
    check::check_depth_scales(scales.iter().filter(|scale| has_depths(scale)))?;
    let pixels = views.iter().zip(&scales).filter(|(_, scale)| has_depths(scale));
    let n = pixels.map(|(view, _)| view.n_pixels()).fold(0, usize::saturating_add);
    let steps: Vec<u16> = sections.elements(PHOTO_DEPTHS, Some(n))?;
    let mut steps = steps.into_iter();
    let of = |(view, scale): (&PhotographView, DepthScale)| {
        has_depths(&scale).then(|| {
            let steps = steps.by_ref().take(view.n_pixels()).collect();
            BufferedDepths { scale, steps }
        })
    };
    Ok(views.iter().zip(scales).map(of).collect())
}

fn sums(sections: &Container, n: usize) -> Result<StoredSums, Defect> {
    let rows = sections.rows(SUMS, Some(n))?;
    // Either section requires the other.
    let has_wide = [WIDE_IDS, WIDE_SUMS].iter().any(|tag| sections.has(*tag));
    let wide = if has_wide { wide_rows(sections)? } else { Vec::new() };
    Ok(StoredSums { rows, wide })
}

fn wide_rows(sections: &Container) -> Result<Vec<WideRow>, Defect> {
    let ids: Vec<u32> = sections.elements(WIDE_IDS, None)?;
    let sums = sections.rows::<f64, N_SUMS>(WIDE_SUMS, Some(ids.len()))?;
    Ok(ids.into_iter().zip(sums).map(|(id, sums)| WideRow { id, sums }).collect())
}
