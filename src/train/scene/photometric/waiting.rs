//! Photographs on their way into the shuffle buffer and out of it (`photometric.md`, Order).

use super::comparers::LearntView;
use super::noise::DRAWN_CONTRADICTION;
use crate::math::image::Image;
use crate::math::rng::{Purpose, Rng};
use crate::model::scene::waiting::{PhotographView, UNKNOWN_COVERAGE, WaitingPhotograph};
use crate::render::cpu::photometric::RowChoice;

/// Levels of a colour, and of a coverage that is known.
const COLOR_LEVELS: f32 = 255.0;
const COVERAGE_LEVELS: f32 = (UNKNOWN_COVERAGE - 1) as f32;

/// A photograph before exposure, as it waits: the rows that are to be learnt, in 8 bits.
pub fn packed(view: PhotographView, pixels: &Image<[f32; 4]>) -> WaitingPhotograph {
    let level = |x: f32, levels: f32| (x.clamp(0.0, 1.0) * levels).round() as u8;
    let pixel = |&[r, g, b, covered]: &[f32; 4]| {
        let [r, g, b] = [r, g, b].map(|x| level(x, COLOR_LEVELS));
        let is_known = !covered.is_nan();
        [r, g, b, if is_known { level(covered, COVERAGE_LEVELS) } else { UNKNOWN_COVERAGE }]
    };
    let rows = view.kept_rows().flat_map(|row| &pixels.data[row * pixels.width..][..pixels.width]);
    WaitingPhotograph { view, pixels: rows.map(pixel).collect() }
}

/// How a photograph that waited is looked at, and its pixels in the scene's exposure; rows that it lacks
/// stay as they are in `image`. `None` for a pose that is none, which files are refused for.
pub fn unpacked(waiting: &WaitingPhotograph, image: &mut Image<[f32; 4]>) -> Option<LearntView> {
    // Rebuilt from its numbers whether or not they were in a file meanwhile: the same bits.
    let camera = waiting.view.camera().ok()?;
    let [width, height] = [camera.intrinsics.width, camera.intrinsics.height].map(|n| n as usize);
    if (image.width, image.height) != (width, height) {
        *image = Image::filled(width, height, [0.0; 4]);
    }
    let gain = waiting.view.gain.map(|gain| gain as f32);
    let pixel = |&[r, g, b, covered]: &[u8; 4]| {
        let exposed = |x: u8, gain: f32| f32::from(x) / COLOR_LEVELS * gain;
        let known = f32::from(covered) / COVERAGE_LEVELS;
        let covered = if covered == UNKNOWN_COVERAGE { f32::NAN } else { known };
        [exposed(r, gain[0]), exposed(g, gain[1]), exposed(b, gain[2]), covered]
    };
    for (row, kept) in waiting.view.kept_rows().zip(waiting.pixels.chunks_exact(width.max(1))) {
        let pixels = image.data[row * width..][..width].iter_mut();
        pixels.zip(kept).for_each(|(out, kept)| *out = pixel(kept));
    }
    let [every, first] = waiting.view.rows;
    let rows = RowChoice::new(every as u32, first as u64);
    let (near, contradicts_from) = (waiting.view.near, DRAWN_CONTRADICTION);
    Some(LearntView { camera, near, rows, contradicts_from })
}

/// Draws photographs out of those that wait now. By the newest of them alone, so that a run that goes
/// on draws as one that never stopped.
pub fn draws(waiting: &[WaitingPhotograph]) -> Rng {
    let newest = waiting.iter().map(|waiting| waiting.view.frame as u64).max();
    Rng::new(0, Purpose::Photographs, newest.unwrap_or(0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::camera::{Camera, Intrinsics};
    use crate::math::pose::Pose;

    #[test]
    fn photographs_come_out_as_they_went_in() {
        let intrinsics = Intrinsics::from_horizontal_fov(5, 9, 0.8);
        let camera = Camera { intrinsics, pose: Pose::IDENTITY };
        let pixel = |i: usize| {
            let covered = [0.0, 0.5, 1.0, f32::NAN][i % 4];
            [i as f32 / 255.0, 1.0, 0.5, covered]
        };
        let photograph = Image::from_vec(5, 9, (0..45).map(pixel).collect());
        let view = PhotographView::new(3, &camera, [2.0, 1.0, 0.5], 0.0, [4, 1]);
        let waiting = packed(view, &photograph);
        assert_eq!(waiting.pixels.len(), view.n_pixels());
        let mut image = Image::filled(1, 1, [0.0; 4]);
        let learnt = unpacked(&waiting, &mut image).unwrap();
        for (i, found) in image.data.iter().enumerate() {
            let [r, g, b, covered] = if matches!(i / 5, 1 | 5) { pixel(i) } else { [0.0; 4] };
            let expected = [2.0 * r, g, 0.5 * b, covered];
            let is_near =
                |(a, b): (&f32, f32)| (a - b).abs() < 1.0 / 254.0 || a.is_nan() && b.is_nan();
            assert!(found.iter().zip(expected).all(is_near), "{i}: {found:?} for {expected:?}");
        }
        assert_eq!((learnt.rows.every(), learnt.rows.first()), (4, 1));
    }
}
