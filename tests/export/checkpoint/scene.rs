//! Checkpoints of scenes: layout, and values that are refused.

use super::raw::{self, edited};
use super::{N, assert_refused, checkpoint, fixed64, means_f32};
use crate::allocations::largest_during;
use std::sync::Arc;
use vbgs_studio::export::checkpoint::{self, Checkpoint, StoredModel, VERSION, parse, to_bytes};
use vbgs_studio::math::camera::{Camera, Intrinsics};
use vbgs_studio::math::pose::Pose;
use vbgs_studio::math::rng::{Purpose, Rng};
use vbgs_studio::model::scene::photometric::PhotometricState;
use vbgs_studio::model::scene::state::{
    QUANTUM, SceneState, StoredSums, VisibilityCounts, WideRow,
};
use vbgs_studio::model::scene::sums::{N_SUMS, terms};
use vbgs_studio::model::scene::texels::{Observed, TexelSums, TextureSums};
use vbgs_studio::model::scene::waiting::{
    BufferedDepths, BufferedPhotograph, DepthScale, PhotographView,
};
use vbgs_studio::model::splat::pose_log::FrameExposure;
use vbgs_studio::model::splat::pose_log::FramePose;
use vbgs_studio::model::splat::splats::Splat;
use vbgs_studio::model::splat::texture::{ABSENT, Lattice};
use vbgs_studio::model::splat::viewpoint::Viewpoint;

/// Components of the sample whose sums overflow a narrow row.
const WIDE: [usize; 2] = [5, 11];

/// Sums in quanta over a few points per component; the first component has none.
fn quanta() -> Vec<[i64; N_SUMS]> {
    let mut rng = Rng::new(10, Purpose::Synthetic, 0);
    let mut row = |k: usize| {
        let mut row = [0; N_SUMS];
        for _ in 0..k {
            let mut numbers = |lo: f64| [0; 3].map(|_| rng.range(lo, 1.0) as f32);
            let (normal, direction) = (unit(numbers(-1.0)), unit(numbers(-1.0)));
            let terms: [f32; N_SUMS] = terms(numbers(-1.0), numbers(0.0), normal, direction);
            let quanta = terms.map(|term| (f64::from(term) / QUANTUM).round() as i64);
            row.iter_mut().zip(quanta).for_each(|(sum, quanta)| *sum += quanta);
        }
        row
    };
    let mut rows: Vec<_> = (0..N).map(&mut row).collect();
    WIDE.iter().for_each(|&k| rows[k].iter_mut().for_each(|sum| *sum *= 1000));
    rows
}

fn unit([x, y, z]: [f32; 3]) -> [f32; 3] {
    let length = (x * x + y * y + z * z).sqrt();
    [x / length, y / length, z / length]
}

fn value(quanta: i64) -> f64 {
    quanta as f64 * QUANTUM
}

pub fn mixed() -> StoredSums {
    let quanta = quanta();
    let row = |(k, row): (usize, &[i64; N_SUMS])| match WIDE.contains(&k) {
        true => [0; N_SUMS],
        false => row.map(|v| v as i32),
    };
    let wide = |&k: &usize| WideRow { id: k as u32, sums: quanta[k].map(value) };
    StoredSums {
        rows: quanta.iter().enumerate().map(row).collect(),
        wide: WIDE.iter().map(wide).collect(),
    }
}

pub fn sample(sums: StoredSums) -> Checkpoint {
    let mut rng = Rng::new(11, Purpose::Synthetic, 0);
    let seeds = (0..N).map(|_| [0; 3].map(|_| rng.range(-2.0, 2.0) as f32)).collect();
    let look = |k: u32| VisibilityCounts { expected: 640 * k, hits: k as u16, misses: 3 };
    let visibility = (0..N as u32).map(look).collect();
    checkpoint(StoredModel::Scene(SceneState {
        origin: [1.0, -2.0, 0.5],
        coarsening_steps: 0,
        seeds,
        shares: None,
        components: None,
        sums,
        visibility,
        exposures: Vec::new(),
        poses: Vec::new(),
        trajectory: Vec::new(),
        photometric: None,
    }))
}

/// Checkpoint with three buffered photographs of 6 × 5 pixels, each with its second and fourth row.
fn photographed() -> Vec<u8> {
    let mut sample = sample(mixed());
    let StoredModel::Scene(state) = &mut sample.model else { unreachable!() };
    let intrinsics = Intrinsics::from_horizontal_fov(6, 5, 0.8);
    let camera = Camera { intrinsics, pose: Pose::IDENTITY };
    let waiting = |frame: u8| BufferedPhotograph {
        view: PhotographView::new(frame.into(), &camera, [1.0, 1.1, 0.9], 0.1, [2, 1]),
        pixels: (0..12).map(|i| [frame, i, 200, 255 - i]).collect(),
        depths: Some(BufferedDepths {
            scale: DepthScale::new([0.03, 0.02]),
            steps: (0..12).map(|i| 1000 * i + u16::from(frame)).collect(),
        }),
    };
    // The third photograph has no depths.
    let waiting = vec![waiting(7), waiting(3), BufferedPhotograph { depths: None, ..waiting(5) }];
    let mut photometric = PhotometricState { buffered: waiting, ..PhotometricState::default() };
    photometric.grow(N);
    state.photometric = Some(photometric);
    to_bytes(&sample)
}

#[test]
fn photographs_that_wait_come_back_or_are_refused() {
    let bytes = photographed();
    let read = parse(&bytes).unwrap();
    let StoredModel::Scene(state) = &read.checkpoint.model else { unreachable!() };
    let waiting = &state.photometric.as_ref().unwrap().buffered;
    assert_eq!((waiting[1].view.frame, waiting[1].pixels[5]), (3.0, [3, 5, 200, 250]));
    let depths = waiting[1].depths.as_ref().unwrap();
    assert_eq!((depths.steps[5], depths.scale.margin), (5003, [0.03f32, 0.02].map(f64::from)));
    assert!((depths.scale.depth(5003) - 5003.0 * 0.03 / 16.0).abs() < 1e-5);
    assert!(waiting[2].depths.is_none());
    assert!(to_bytes(&read.checkpoint) == bytes);
    let numbers = size_of::<PhotographView>() / 8;
    // Places in a stored row: frame, size, pinhole, pose, gain, near, rows.
    let places = [
        (0, "frame"),
        (1, "size"),
        (3, "focal length"),
        (5, "centre"),
        (7, "pose"),
        (23, "gain"),
        (26, "near"),
        (27, "rows"),
        (28, "first row"),
    ];
    for (place, name) in places {
        let damaged = edited(&bytes, b"PHWA", |s| {
            let at = 8 * (numbers + place);
            s.content[at..at + 8].copy_from_slice(&f64::NAN.to_le_bytes());
        });
        assert_refused(&damaged, &["PHWA[component 1", name, "NaN"]);
    }
    // An invalid row step that selects the same number of pixels, so that only the step is wrong.
    let odd = edited(&bytes, b"PHWA", |s| {
        let at = 8 * (numbers + 27);
        s.content[at..at + 8].copy_from_slice(&3f64.to_le_bytes());
    });
    assert_refused(&odd, &["PHWA[component 1, rows]", "a power of two up to 16", "found 3"]);
    // A size that needs more pixels than are stored is refused before memory is allocated.
    let larger = edited(&bytes, b"PHWA", |s| {
        let at = 8 * (numbers + 1);
        s.content[at..at + 8].copy_from_slice(&65536f64.to_le_bytes());
    });
    assert_refused(&larger, &["PHPX", "131096 elements", "36"]);
    let short = edited(&bytes, b"PHPX", |s| s.content.truncate(4 * 35));
    assert_refused(&short, &["PHPX", "36 elements", "35"]);
    let part = edited(&bytes, b"PHWA", |s| s.content.truncate(8 * numbers - 8));
    assert_refused(&part, &["PHWA", "whole rows"]);
}

#[test]
fn depths_of_photographs_that_wait_are_refused_where_they_are_none() {
    let bytes = photographed();
    for (place, name) in [(0, "step"), (1, "margin"), (2, "margin")] {
        let damaged = edited(&bytes, b"PHDS", |s| {
            let at = 8 * (3 + place);
            s.content[at..at + 8].copy_from_slice(&f64::NAN.to_le_bytes());
        });
        assert_refused(&damaged, &["PHDS[component 1", name, "NaN"]);
    }
    let fewer = edited(&bytes, b"PHDS", |s| s.content.truncate(8 * 6));
    assert_refused(&fewer, &["PHDS", "9 elements", "6"]);
    let short = edited(&bytes, b"PHDP", |s| s.content.truncate(2 * 23));
    assert_refused(&short, &["PHDP", "24 elements", "23"]);
    // Files of versions before depth comparison lack both sections.
    let mut sections = raw::sections(&bytes);
    sections.retain(|section| section.tag != *b"PHDS" && section.tag != *b"PHDP");
    let before = parse(&raw::file(&sections, VERSION)).unwrap();
    let StoredModel::Scene(state) = &before.checkpoint.model else { unreachable!() };
    let waiting = &state.photometric.as_ref().unwrap().buffered;
    assert!(waiting.len() == 3 && waiting.iter().all(|waiting| waiting.depths.is_none()));
}

/// Checkpoint with textures of levels 0, 2 and 1 for components 2, 7 and 19. The second has two former lattices.
fn textured() -> Checkpoint {
    let mut sample = sample(mixed());
    let StoredModel::Scene(state) = &mut sample.model else { unreachable!() };
    let mut photometric = PhotometricState { texture_steps: 3, ..PhotometricState::default() };
    photometric.grow(N);
    photometric.textures.resize(N, None);
    let mut rng = Rng::new(12, Purpose::Synthetic, 0);
    for (id, level) in [(2, 0), (7, 2), (19, 1)] {
        let splat =
            Splat { mean: [id as f32, 0.5, 1.0], scale: [0.1, 0.2, 0.01], ..Splat::default() };
        let mut texture = TextureSums::new(&splat, 0.25);
        texture.refine(level);
        let side = texture.lattice.side();
        for _ in 0..40 {
            texture.open().add(&Observed {
                texel: (rng.below(side / 2) * side + rng.below(side)) as u16,
                weight: 1 + rng.below(256) as u16,
                color: [0; 3].map(|_| rng.below(4097) as i16 - 2048),
            });
        }
        let former = [0, 1].map(|level| Lattice { level, half: 0.5, ..texture.lattice });
        texture.former.extend(former.iter().filter(|_| id == 7));
        photometric.textures[id] = Some(Arc::new(texture));
    }
    state.photometric = Some(photometric);
    sample
}

fn photometric(checkpoint: &mut Checkpoint) -> &mut PhotometricState {
    let StoredModel::Scene(state) = &mut checkpoint.model else { unreachable!() };
    state.photometric.as_mut().unwrap()
}

#[test]
fn textures_come_back_and_scenes_without_have_no_section() {
    let mut textured = textured();
    let bytes = to_bytes(&textured);
    let read = parse(&bytes).unwrap().checkpoint;
    assert_eq!(read, textured);
    assert!(to_bytes(&read) == bytes);
    let sections = raw::sections(&bytes);
    let length = |tag: &[u8; 4]| sections.iter().find(|s| s.tag == *tag).unwrap().content.len();
    let state = photometric(&mut textured);
    let textures = || state.textures.iter().flatten();
    let n_patches: usize = textures().map(|texture| texture.patches.len()).sum();
    assert!(n_patches > 6 && textures().any(|t| t.index.contains(&ABSENT)));
    let sizes = [(b"TXID", 12), (b"TXLA", 120), (b"TXSI", 24), (b"TXPR", 96), (b"TXST", 4)];
    sizes.iter().for_each(|(tag, size)| assert_eq!(length(tag), *size));
    assert_eq!([length(b"TXFO"), length(b"TXFL")], [16, 80]);
    assert_eq!([length(b"TXIX"), length(b"TXEL")], [2 * 21, 256 * n_patches]);
    state.textures.clear();
    state.texture_steps = 0;
    let sections = raw::sections(&to_bytes(&textured));
    assert!(sections.iter().all(|section| !section.tag.starts_with(b"TX")));
}

#[test]
fn textures_that_no_scene_has_are_refused() {
    let bytes = to_bytes(&textured());
    let with = |tag: &[u8; 4], at: usize, value: &[u8], parts: &[&str]| {
        let damaged =
            edited(&bytes, tag, |s| s.content[at..at + value.len()].copy_from_slice(value));
        assert_refused(&damaged, parts);
    };
    let word = |value: u32| value.to_le_bytes();
    let float = |value: f32| value.to_le_bytes();
    with(b"TXID", 4, &word(2), &["TXID", "ascending order"]);
    with(b"TXID", 8, &word(20), &["TXID", "components below 20", "found 20"]);
    with(b"TXST", 0, &word(u32::MAX), &["TXST", "at most 65536"]);
    for wild in [f32::NAN, f32::INFINITY] {
        with(b"TXLA", 44, &float(wild), &["TXLA[component 7, anchor]", "finite"]);
        with(b"TXLA", 36, &float(wild), &["TXLA[component 2, half]", "positive"]);
        with(b"TXLA", 12, &float(wild), &["TXLA[component 2, axis]", "unit vector"]);
    }
    with(b"TXLA", 76, &float(0.0), &["TXLA[component 7, half]", "a positive number", "found 0"]);
    with(b"TXLA", 52, &float(0.5), &["TXLA[component 7, axis]", "a unit vector"]);
    // Both axes alike.
    let lattice = &raw::sections(&bytes).into_iter().find(|s| s.tag == *b"TXLA").unwrap().content;
    with(b"TXLA", 24, &lattice[12..24], &["TXLA[component 2, axes]", "perpendicular", "found 1"]);
    with(b"TXSI", 8, &word(6), &["TXSI[component 7, level]", "at most 5", "found 6"]);
    with(b"TXSI", 4, &word(2), &["TXSI[component 2, patches]", "at most 1 at level 0"]);
    // Lengths that the other sections do not have, refused before memory is taken.
    with(b"TXSI", 8, &word(5), &["TXIX", "expected 1029 elements", "found 21"]);
    with(b"TXSI", 12, &word(0), &["TXEL", "elements"]);
    with(b"TXFO", 8, &word(3), &["TXFO", "components with textures", "found 3"]);
    with(b"TXFO", 12, &word(1 << 8), &["TXFO[component 7, level]", "at most 5", "found 255"]);
    with(b"TXFL", 44, &float(f32::NAN), &["TXFL[component 7, anchor]", "finite"]);
    let many = edited(&bytes, b"TXFO", |s| s.content = s.content.repeat(40));
    let many = edited(&many, b"TXFL", |s| s.content = s.content.repeat(40));
    assert_refused(&many, &["TXFO", "each at most 64 times", "found 7"]);
    let long = |value: i64| value.to_le_bytes();
    with(b"TXPR", 16, &long(i64::MIN), &["TXPR[component 2, prediction]", "at most 2^62"]);
    with(b"TXPR", 40, &long(-1), &["TXPR[component 7, square]", "0 or more", "found -1"]);
    let patch =
        |at: usize, value: u16, parts: &[&str]| with(b"TXIX", at, &value.to_le_bytes(), parts);
    patch(0, 1, &["TXIX[component 2, patch]", "each of 1 patches once", "found 1"]);
    patch(0, ABSENT, &["TXIX[component 2, unused patch]", "a place for every patch"]);
    let index = &raw::sections(&bytes).into_iter().find(|s| s.tag == *b"TXIX").unwrap().content;
    with(b"TXIX", 2, &index[4..6], &["TXIX[component 7, patch]", "once"]);
    for weight in [524_289, u32::MAX] {
        with(b"TXEL", 0, &word(weight), &["TXEL[component 2, weight]", "0 to 524288"]);
    }
    for color in [i32::MIN, i32::MAX] {
        let parts = ["TXEL[component 2, colour]", "at most 2048 per weight"];
        with(b"TXEL", 12, &color.to_le_bytes(), &parts);
    }
    for tag in [b"TXLA", b"TXSI", b"TXPR", b"TXIX", b"TXEL", b"TXFL"] {
        let mut sections = raw::sections(&bytes);
        sections.retain(|section| section.tag != *tag);
        let name = std::str::from_utf8(tag).unwrap();
        assert_refused(&raw::file(&sections, VERSION), &[name, "this section"]);
        for change in [-4isize, 4] {
            let resized = edited(&bytes, tag, |s| {
                s.content.resize(s.content.len().strict_add_signed(2 * change), 0);
            });
            assert_refused(&resized, &[name]);
        }
        assert!(parse(&edited(&bytes, tag, |s| s.element = 6)).is_err());
    }
    // Without ids no texture is read.
    let mut sections = raw::sections(&bytes);
    sections.retain(|section| section.tag != *b"TXID");
    let mut none = parse(&raw::file(&sections, VERSION)).unwrap().checkpoint;
    assert!(photometric(&mut none).textures.is_empty());
}

/// Every value of the sections of textures may be arbitrary: reading refuses it or reads it, in little memory.
#[test]
fn arbitrary_textures_take_no_memory() {
    let bytes = to_bytes(&textured());
    let tags = [b"TXID", b"TXLA", b"TXSI", b"TXPR", b"TXIX", b"TXEL", b"TXST", b"TXFO", b"TXFL"];
    let mut rng = Rng::new(13, Purpose::Synthetic, 0);
    for _ in 0..3000 {
        let damaged = edited(&bytes, tags[rng.below(tags.len())], |s| {
            let at = rng.below(s.content.len());
            s.content[at] ^= 1 << rng.below(8);
        });
        let (read, largest) = largest_during(|| parse(&damaged));
        assert!(largest < 1 << 20, "{largest} bytes");
        if let Ok(read) = read {
            assert!(parse(&to_bytes(&read.checkpoint)).unwrap().checkpoint == read.checkpoint);
        }
    }
}

/// Textures may take hundreds of megabytes, so writing must not copy them.
#[test]
fn textures_are_written_without_a_copy_and_only_if_they_can_be_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.vbgs");
    let mut large = textured();
    let lattice = photometric(&mut large).textures[2].as_ref().unwrap().lattice;
    let mut texture = TextureSums {
        lattice: Lattice { level: 5, ..lattice },
        former: Vec::new(),
        predicted: [[0; 2]; 2],
        index: (0..1024).collect(),
        patches: Arc::new(vec![[TexelSums { weight: 1, color: [9; 3] }; 16]; 1024]),
    };
    photometric(&mut large).textures = (0..N).map(|_| Some(Arc::new(texture.clone()))).collect();
    let bytes = photometric(&mut large).texture_bytes();
    let (written, largest) = largest_during(|| checkpoint::write(&path, &large));
    written.unwrap();
    assert!(largest < bytes / 2, "{largest} bytes at once, beside {bytes} of textures");
    assert_eq!(checkpoint::read(&path).unwrap().checkpoint, large);
    texture.index[7] = 8;
    photometric(&mut large).textures[3] = Some(Arc::new(texture));
    let error = checkpoint::write(&path, &large).unwrap_err().to_string();
    assert!(error.contains("TXIX[component 3, patch]"), "{error}");
}

/// The buffer may hold 64 MB, so writing must not copy it.
#[test]
fn photographs_that_wait_are_written_without_a_copy() {
    let mut photographed = parse(&photographed()).unwrap().checkpoint;
    let StoredModel::Scene(state) = &mut photographed.model else { unreachable!() };
    let waiting = &mut state.photometric.as_mut().unwrap().buffered[0];
    waiting.view.size = [4096.0, 512.0];
    waiting.pixels = vec![[1, 2, 3, 4]; waiting.view.n_pixels()].into();
    waiting.depths.as_mut().unwrap().steps = vec![7; waiting.view.n_pixels()].into();
    let pixels = size_of_val(&waiting.pixels[..]);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.vbgs");
    let (written, largest) = largest_during(|| checkpoint::write(&path, &photographed));
    written.unwrap();
    assert!(largest < pixels / 2, "{largest} bytes at once, beside {pixels} of pixels");
    assert_eq!(checkpoint::read(&path).unwrap().checkpoint, photographed);
}

/// An unreadable file must not replace a valid one.
#[test]
fn photographs_that_no_file_may_have_are_not_written() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.vbgs");
    let refused = |change: fn(&mut BufferedPhotograph)| {
        let mut photographed = parse(&photographed()).unwrap().checkpoint;
        let StoredModel::Scene(state) = &mut photographed.model else { unreachable!() };
        change(&mut state.photometric.as_mut().unwrap().buffered[1]);
        let error = checkpoint::write(&path, &photographed).unwrap_err().to_string();
        assert!(!path.exists());
        error
    };
    let gain = refused(|waiting| waiting.view.gain[1] = 0.0);
    assert!(gain.contains("PHWA[component 1, gain]"), "{gain}");
    let pixels = refused(|waiting| waiting.pixels = vec![[0; 4]; 11].into());
    assert!(pixels.contains("PHWA[component 1, size]: expected 12 pixels, found 11"), "{pixels}");
    let steps = refused(|waiting| waiting.depths.as_mut().unwrap().steps = vec![1; 13].into());
    assert!(steps.contains("PHDP[component 1, size]: expected 12 depths, found 13"), "{steps}");
    let scale = refused(|waiting| waiting.depths.as_mut().unwrap().scale.step = -1.0);
    assert!(scale.contains("PHDS[component 1, step]"), "{scale}");
}

pub fn nothing() -> SceneState {
    let sums = StoredSums { rows: Vec::new(), wide: Vec::new() };
    SceneState {
        origin: [0.0; 3],
        coarsening_steps: 0,
        seeds: Vec::new(),
        shares: None,
        components: None,
        sums,
        visibility: Vec::new(),
        exposures: Vec::new(),
        poses: Vec::new(),
        trajectory: Vec::new(),
        photometric: None,
    }
}

fn good() -> Vec<u8> {
    to_bytes(&sample(mixed()))
}

#[test]
fn the_sections_are_laid_out_as_the_format_says() {
    let bytes = good();
    let sections = raw::sections(&bytes);
    assert!(raw::file(&sections, VERSION) == bytes);
    let tags: Vec<_> = sections.iter().map(|s| std::str::from_utf8(&s.tag).unwrap()).collect();
    let expected = ["CONF", "META", "NUMX", "CURS", "ORIG", "SEED", "SUMS", "WIDI", "WIDE", "LOOK"];
    assert_eq!(tags, [&expected[..], &["HIST"]].concat());
    let content = |tag: &str| &sections.iter().find(|s| s.tag == tag.as_bytes()).unwrap().content;
    let word = |tag: &str, at: usize| {
        u32::from_le_bytes(content(tag)[4 * at..4 * at + 4].try_into().unwrap())
    };
    let quanta = quanta();
    for (i, &sum) in quanta[17].iter().enumerate() {
        assert_eq!(word("SUMS", N_SUMS * 17 + i) as i32, sum as i32);
        assert_eq!(word("SUMS", N_SUMS * 5 + i), 0);
        let wide = &content("WIDE")[8 * i..8 * i + 8];
        assert_eq!(f64::from_le_bytes(wide.try_into().unwrap()), value(quanta[5][i]));
    }
    assert_eq!([word("WIDI", 0), word("WIDI", 1)], [5, 11]);
    assert_eq!([word("LOOK", 2 * 17), word("LOOK", 2 * 17 + 1)], [640 * 17, 3 << 16 | 17]);
    let columns = [("SEED", 12), ("SUMS", 168), ("LOOK", 8)];
    columns.iter().for_each(|(tag, size)| assert_eq!(content(tag).len(), size * N, "{tag}"));
}

#[test]
fn sections_must_be_there_once_and_of_the_right_type_and_size() {
    let bytes = good();
    let sections = raw::sections(&bytes);
    for tag in ["ORIG", "SEED", "SUMS", "WIDI", "WIDE", "LOOK"] {
        let rest: Vec<_> = sections.iter().filter(|s| s.tag != tag.as_bytes()).cloned().collect();
        let message = parse(&raw::file(&rest, VERSION)).unwrap_err().to_string();
        assert!(message.contains(tag) && message.contains("this section"), "{tag}: {message}");
        let tag: [u8; 4] = tag.as_bytes().try_into().unwrap();
        let other = edited(&bytes, &tag, |s| s.element = if s.element == 1 { 4 } else { 1 });
        let message = parse(&other).unwrap_err().to_string();
        assert!(message.contains("elements"), "{message}");
        let unsigned = edited(&bytes, &tag, |s| s.element = 6);
        assert!(parse(&unsigned).is_err());
        for change in [-8isize, 8] {
            let resized = edited(&bytes, &tag, |s| {
                s.content.resize(s.content.len().strict_add_signed(change), 0);
            });
            assert!(parse(&resized).is_err(), "{tag:?} by {change}");
        }
    }
    let row = edited(&bytes, b"SEED", |s| s.content.truncate(12 * (N - 1)));
    assert_refused(&row, &["LOOK", "expected 38 elements", "found 40"]);
    let part = edited(&bytes, b"SEED", |s| s.content.truncate(12 * N - 4));
    assert_refused(&part, &["SEED", "whole rows of 3 elements", "found 59"]);
}

#[test]
fn no_model_is_of_both_kinds() {
    let mixture = raw::sections(&to_bytes(&super::sample(means_f32(), fixed64())));
    let scene = raw::sections(&good());
    for section in mixture.iter().filter(|s| scene.iter().all(|other| other.tag != s.tag)) {
        let both = [&scene[..], std::slice::from_ref(section)].concat();
        let tag = std::str::from_utf8(&section.tag).unwrap();
        assert_refused(&raw::file(&both, VERSION), &[tag, "no such section in a scene"]);
    }
    for section in scene.iter().filter(|s| mixture.iter().all(|other| other.tag != s.tag)) {
        let both = [&mixture[..], std::slice::from_ref(section)].concat();
        assert!(parse(&raw::file(&both, VERSION)).is_err());
    }
}

fn refused(sums: StoredSums, edit: impl FnOnce(&mut SceneState), parts: &[&str]) {
    let mut checkpoint = sample(sums);
    let StoredModel::Scene(state) = &mut checkpoint.model else { unreachable!() };
    edit(state);
    assert_refused(&to_bytes(&checkpoint), parts);
}

#[test]
fn origin_and_seeds() {
    for wild in [f32::NAN, f32::INFINITY] {
        let parts = ["SEED[component 17, z]", "a finite number", &wild.to_string()];
        refused(mixed(), |scene| scene.seeds[17][2] = wild, &parts);
    }
    let parts = ["ORIG", "finite numbers", "NaN"];
    refused(mixed(), |scene| scene.origin[1] = f64::NAN, &parts);
}

#[test]
fn sums_that_no_points_have() {
    let with = |row: usize, i: usize, quanta: i32, parts: &[&str]| {
        let edit = |scene: &mut SceneState| {
            let StoredSums { rows, .. } = &mut scene.sums;
            rows[row][i] = quanta;
        };
        refused(mixed(), edit, parts);
    };
    with(12, 0, -32768, &["SUMS[component 12, N]: expected 0 or more, found -1"]);
    with(12, 9, -1, &["SUMS[component 12, zz]: expected 0 or more"]);
    with(12, 31, -1, &["SUMS[component 12, view yy]: expected 0 or more"]);
    with(12, 8, 20 * 32768, &["component 12, yz]: expected at most the mean of the two axes'"]);
    with(12, 29, 11 * 32768, &["component 12, view xy]: expected at most the mean"]);
    with(12, 32, -11 * 32768, &["component 12, view yz]: expected at most the mean"]);
    with(12, 28, 12 * 32768, &["component 12, view y", "expected at most"]);
    with(
        12,
        22,
        95 * 32768,
        &["component 12, normal x]: expected at most 7.84 per point, for 12 points"],
    );
    with(0, 10, 1, &["SUMS[component 0, red]: expected at most 7.84 per point, for 0 points"]);
    with(12, 0, 4096 * 32768, &["component 12, N]: expected fewer than 4096 points", "found 4096"]);
}

#[test]
fn seeds_may_share_components() {
    let mut checkpoint = sample(mixed());
    let StoredModel::Scene(state) = &mut checkpoint.model else { unreachable!() };
    let n = state.visibility.len() as u32;
    state.seeds.push([0.5; 3]);
    state.components = Some((0..n).chain([7]).collect());
    let bytes = to_bytes(&checkpoint);
    assert_eq!(parse(&bytes).unwrap().checkpoint, checkpoint);
    let beyond = edited(&bytes, b"COMP", |s| s.content[..4].copy_from_slice(&n.to_le_bytes()));
    assert_refused(&beyond, &["COMP[component 0, seed]", "a component below 20", "found 20"]);
    let short = edited(&bytes, b"COMP", |s| s.content.truncate(4 * n as usize));
    assert_refused(&short, &["COMP", "21 elements", "found 20"]);
}

#[test]
fn seeds_may_have_shares_of_the_scale() {
    let mut checkpoint = sample(mixed());
    let StoredModel::Scene(state) = &mut checkpoint.model else { unreachable!() };
    state.shares = Some((0..state.seeds.len()).map(|seed| 1 + (seed % 64) as u8).collect());
    let bytes = to_bytes(&checkpoint);
    assert_eq!(parse(&bytes).unwrap().checkpoint, checkpoint);
    for wrong in [0_u32, 65, 1 << 20] {
        let damaged = edited(&bytes, b"SHAR", |s| {
            s.content[4..8].copy_from_slice(&wrong.to_le_bytes());
        });
        let found = format!("found {wrong}");
        assert_refused(&damaged, &["SHAR[component 1, share]", "from 1 to 64", &found]);
    }
    let short = edited(&bytes, b"SHAR", |s| s.content.truncate(4 * 19));
    assert_refused(&short, &["SHAR", "20 elements", "found 19"]);
}

pub const VIEWPOINT: Viewpoint = Viewpoint { centre: [3.0, -1.0, 0.5], forward: [0.0, 0.6, 0.8] };

#[test]
fn frames_may_have_corrected_poses() {
    let mut checkpoint = sample(mixed());
    let StoredModel::Scene(state) = &mut checkpoint.model else { unreachable!() };
    let (turn, shift) = ([0.01, 0.0, -0.02], [0.1, 0.2, 0.3]);
    let pose = FramePose { recorded: VIEWPOINT, rotation: [0.6, 0.0, 0.0, 0.8], turn, shift };
    state.poses = vec![pose, FramePose { shift: [0.0; 3], ..pose }];
    let bytes = to_bytes(&checkpoint);
    assert_eq!(parse(&bytes).unwrap().checkpoint, checkpoint);
    let with = |at: usize, value: f64| {
        edited(&bytes, b"POSE", |s| {
            s.content[8 * at..8 * at + 8].copy_from_slice(&value.to_le_bytes());
        })
    };
    assert_refused(&with(18, f64::NAN), &["POSE[component 1, correction]", "a finite number"]);
    assert_refused(&with(3, 1.0), &["POSE[component 0, direction]", "a unit vector"]);
    assert_refused(&with(12, f64::INFINITY), &["POSE[component 1, centre]", "finite"]);
    for wrong in [0.9f64, f64::NAN] {
        let turned =
            edited(&bytes, b"POSR", |s| s.content[..8].copy_from_slice(&wrong.to_le_bytes()));
        assert_refused(&turned, &["POSR[component 0, rotation]", "a unit quaternion"]);
    }
}

#[test]
fn photographs_may_have_poses_of_their_own() {
    let mut checkpoint = textured();
    let (turn, shift) = ([0.001, 0.0, -0.002], [0.01, 0.02, 0.03]);
    let pose = FramePose { recorded: VIEWPOINT, rotation: [0.6, 0.0, 0.0, 0.8], turn, shift };
    photometric(&mut checkpoint).photograph_poses =
        vec![pose, FramePose { turn: [0.0; 3], ..pose }];
    let bytes = to_bytes(&checkpoint);
    assert_eq!(parse(&bytes).unwrap().checkpoint, checkpoint);
    let with = |at: usize, value: f64| {
        edited(&bytes, b"PHPS", |s| {
            s.content[8 * at..8 * at + 8].copy_from_slice(&value.to_le_bytes());
        })
    };
    assert_refused(&with(10, f64::NAN), &["PHPS[component 0, correction]", "a finite number"]);
    assert_refused(&with(19, 1.0), &["PHPS[component 1, direction]", "a unit vector"]);
    assert_refused(&with(22, 0.9), &["PHPS[component 1, rotation]", "a unit quaternion"]);
    let part = edited(&bytes, b"PHPS", |s| s.content.truncate(8 * 17));
    assert_refused(&part, &["PHPS", "whole rows of 16 elements"]);
}

#[test]
fn frames_may_have_gains() {
    let mut checkpoint = sample(mixed());
    let StoredModel::Scene(state) = &mut checkpoint.model else { unreachable!() };
    let exposure = |gain| FrameExposure { viewpoint: VIEWPOINT, gain };
    state.exposures = vec![exposure([1.0; 3]), exposure([0.5, 1.25, 2.0])];
    let bytes = to_bytes(&checkpoint);
    assert_eq!(parse(&bytes).unwrap().checkpoint, checkpoint);
    let with = |frame: usize, at: usize, value: f64| {
        edited(&bytes, b"EXPO", |s| {
            let first = 8 * (9 * frame + at);
            s.content[first..first + 8].copy_from_slice(&value.to_le_bytes());
        })
    };
    let parts = ["EXPO[component 1, gain]", "a positive number"];
    for gain in [0.0, -1.0, f64::NAN] {
        assert_refused(&with(1, 7, gain), &parts);
    }
    assert_refused(&with(0, 4, 2.0), &["EXPO[component 0, direction]", "a unit vector"]);
    assert_refused(&with(0, 0, f64::INFINITY), &["EXPO[component 0, centre]", "finite"]);
    let part = edited(&bytes, b"EXPO", |s| s.content.truncate(8 * 17));
    assert_refused(&part, &["EXPO", "whole rows of 9 elements"]);
}

#[test]
fn view_directions_longer_than_one() {
    let edit = |scene: &mut SceneState| {
        let StoredSums { rows, .. } = &mut scene.sums;
        (rows[12][28], rows[12][31]) = (12 * 32768, 1000);
        [29, 30, 32].iter().for_each(|&i| rows[12][i] = 0);
    };
    refused(
        mixed(),
        edit,
        &["component 12, view yy]: expected at most the remainder of N after `view xx`"],
    );
}

#[test]
fn wide_sums() {
    type Edit<'a> = dyn Fn(&mut Vec<[i32; N_SUMS]>, &mut Vec<WideRow>) + 'a;
    let with = |edit: &Edit<'_>, parts: &[&str]| {
        let edit = |scene: &mut SceneState| {
            let StoredSums { rows, wide } = &mut scene.sums;
            edit(rows, wide);
        };
        refused(mixed(), edit, parts);
    };
    with(&|_, wide| wide.swap(0, 1), &["WIDI", "ascending order"]);
    with(&|_, wide| wide[0].id = 11, &["WIDI", "ascending order"]);
    with(&|_, wide| wide[1].id = 20, &["WIDI", "components below 20", "found 20"]);
    with(
        &|_, wide| wide[0].sums[0] = 4095.0,
        &["WIDE[component 5, N]: expected 4096 points or more"],
    );
    let whole = "a whole multiple of 2^-15 up to 2^38";
    with(&|_, wide| wide[0].sums[13] = 0.1, &["WIDE[component 5, red x]", whole, "found 0.1"]);
    for wild in [f64::NAN, f64::INFINITY, 2f64.powi(39)] {
        with(&|_, wide| wide[1].sums[2] = wild, &["WIDE[component 11, y]", whole]);
    }
    with(&|_, wide| wide[1].sums[4] = -1.0, &["WIDE[component 11, xx]: expected 0 or more"]);
    with(&|rows, _| rows[5][7] = 3, &["SUMS[component 5, yy]", "0 beside sums in `WIDE`"]);
}

/// The same point with the largest possible terms, many times.
#[test]
fn rounding_is_no_defect() {
    let s = 0.5f32.sqrt();
    for (direction, offset) in
        [([s, s, 0.0], [2.0, 2.0, -2.0]), ([0.0, 1.0, 0.0], [1e-4, -1e-4, 1e-4])]
    {
        let terms: [f32; N_SUMS] = terms(offset, [1.0; 3], direction, direction);
        let quanta = terms.map(|term| (f64::from(term) / QUANTUM).round() as i32);
        let mut sums = mixed();
        sums.rows[3] = quanta.map(|q| 4000 * q);
        let checkpoint = sample(sums);
        assert_eq!(parse(&to_bytes(&checkpoint)).unwrap().checkpoint, checkpoint);
    }
}
