//! The GPU combines two images as `render::compare` does.

use super::fixture::Fixture;
use super::readback;
use vbgs_studio::math::image::{Image, RgbImage};
use vbgs_studio::render::compare::{Area, Combination, combine};
use vbgs_studio::render::finish::Finish;
use vbgs_studio::render::gpu::composite::PhotoTexture;
use vbgs_studio::render::gpu::composite::{Compositor, SecondImage};
use vbgs_studio::render::gpu::renderer::SplatTarget;

/// Composes a splat image of this size from `first` and `second`.
fn composed(
    gpu: &Fixture,
    size: [u32; 2],
    first: &SplatTarget,
    background: [f32; 3],
    second: Option<SecondImage<'_>>,
) -> SplatTarget {
    let window = SplatTarget::new(&gpu.device, size[0], size[1]).unwrap();
    let mut compositor = Compositor::new(&gpu.device, wgpu::TextureFormat::Rgba16Float);
    compositor.prepare(&gpu.device, &gpu.queue, first, background, second);
    readback::draw(&gpu.device, &gpu.queue, window.view(), |pass| compositor.draw(pass));
    window
}

/// A splat image that shows a picture with full coverage.
fn target(gpu: &Fixture, picture: &RgbImage) -> SplatTarget {
    let size = [picture.width as u32, picture.height as u32];
    let photo = PhotoTexture::new(&gpu.device, &gpu.queue, picture).unwrap();
    let empty = SplatTarget::new(&gpu.device, size[0], size[1]).unwrap();
    let how = Combination::Wipe(0.0);
    let second = SecondImage { view: photo.view(), finish: Finish::NONE, area: Area::FULL, how };
    composed(gpu, size, &empty, [0.0; 3], Some(second))
}

fn rgb_of(gpu: &Fixture, image: &SplatTarget) -> RgbImage {
    readback::premultiplied(&gpu.device, &gpu.queue, image).map(|&[r, g, b, _]| [r, g, b])
}

/// A picture of bytes in which neighbouring pixels differ.
fn picture(width: usize, height: usize, seed: usize) -> RgbImage {
    let value = |i: usize| ((seed + 89 * i + 31 * (i / 7)) % 256) as f32 / 255.0;
    let data = (0..width * height).map(|i| [value(3 * i), value(3 * i + 1), value(3 * i + 2)]);
    Image::from_vec(width, height, data.collect())
}

fn largest_difference(a: &RgbImage, b: &RgbImage) -> f32 {
    assert_eq!((a.width, a.height), (b.width, b.height));
    let pairs = a.data.iter().flatten().zip(b.data.iter().flatten());
    pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
}

const COMBINATIONS: [Combination; 5] = [
    Combination::Wipe(0.0),
    Combination::Wipe(0.3),
    Combination::Wipe(1.0),
    Combination::Difference(1.0),
    Combination::Difference(6.0),
];

/// Half-float rounding near 1.
const HALF_FLOAT: f32 = 1e-3;

#[test]
fn two_splat_images_are_combined_as_on_the_cpu() {
    let Some(gpu) = Fixture::shared() else { return };
    let (first, second) = (target(&gpu, &picture(24, 16, 5)), target(&gpu, &picture(24, 16, 77)));
    let (first_shown, second_shown) = (rgb_of(&gpu, &first), rgb_of(&gpu, &second));
    assert!(largest_difference(&first_shown, &picture(24, 16, 5)) < HALF_FLOAT);
    for how in COMBINATIONS {
        let pair = SecondImage { view: second.view(), finish: Finish::NONE, area: Area::FULL, how };
        let found = rgb_of(&gpu, &composed(&gpu, [24, 16], &first, [0.0; 3], Some(pair)));
        let mut expected = first_shown.clone();
        combine(&mut expected, &second_shown, Area::FULL, how);
        assert!(largest_difference(&found, &expected) < HALF_FLOAT, "{how:?}");
    }
}

#[test]
fn a_photograph_fills_its_area_as_on_the_cpu() {
    let Some(gpu) = Fixture::shared() else { return };
    let first = target(&gpu, &picture(24, 16, 5));
    let first_shown = rgb_of(&gpu, &first);
    let photo = picture(7, 5, 200);
    let texture = PhotoTexture::new(&gpu.device, &gpu.queue, &photo).unwrap();
    let area = Area { min: [0.2, 0.1], max: [0.7, 0.9] };
    for how in COMBINATIONS {
        let pair = SecondImage { view: texture.view(), finish: Finish::NONE, area, how };
        let found = rgb_of(&gpu, &composed(&gpu, [24, 16], &first, [0.0; 3], Some(pair)));
        let mut expected = first_shown.clone();
        combine(&mut expected, &photo, area, how);
        // Sampler weights have eight bits, in both directions.
        let gain = if let Combination::Difference(gain) = how { gain } else { 1.0 };
        let tolerance = HALF_FLOAT + gain * 2.0 / 256.0;
        assert!(largest_difference(&found, &expected) < tolerance, "{how:?}");
    }
}

#[test]
fn both_pictures_lie_over_the_same_background() {
    let Some(gpu) = Fixture::shared() else { return };
    let empty = SplatTarget::new(&gpu.device, 4, 4).unwrap();
    let other = SplatTarget::new(&gpu.device, 4, 4).unwrap();
    let background = [0.25, 0.5, 0.75];
    let shown = |how| {
        let pair = SecondImage { view: other.view(), finish: Finish::NONE, area: Area::FULL, how };
        rgb_of(&gpu, &composed(&gpu, [4, 4], &empty, background, Some(pair)))
    };
    let wiped = shown(Combination::Wipe(0.5));
    assert!(wiped.data.iter().all(|p| *p == background), "{wiped:?}");
    let difference = shown(Combination::Difference(64.0));
    assert!(difference.data.iter().all(|p| *p == [0.0; 3]), "{difference:?}");
}

#[test]
fn each_picture_is_finished_by_itself() {
    let Some(gpu) = Fixture::shared() else { return };
    // A picture keeps its colour at full coverage if nothing is drawn over it.
    let (first, second) = (target(&gpu, &picture(24, 16, 5)), target(&gpu, &picture(24, 16, 77)));
    let finish = Finish { exposure: [0.5, 0.25, 1.0], ..Finish::NONE };
    let how = Combination::Wipe(0.0);
    let pair = SecondImage { view: second.view(), finish, area: Area::FULL, how };
    let found = rgb_of(&gpu, &composed(&gpu, [24, 16], &first, [0.0; 3], Some(pair)));
    let [plain, other] = [&second, &first].map(|image| rgb_of(&gpu, image));
    let dimmed = plain.map(|&[r, g, b]| [0.5 * r, 0.25 * g, b]);
    assert!(largest_difference(&found, &dimmed) < HALF_FLOAT);
    let pair =
        SecondImage { view: second.view(), finish, area: Area::FULL, how: Combination::Wipe(1.0) };
    let found = rgb_of(&gpu, &composed(&gpu, [24, 16], &first, [0.0; 3], Some(pair)));
    assert!(largest_difference(&found, &other) < HALF_FLOAT);
}
