//! Repeated round trips through a format do not change splats any further.

use super::round_trip::assert_same;
use super::{distance, random_splats, read_bytes, set, written_as};
use crate::common::scenes::random_appearance;
use proptest::prelude::*;
use vbgs_studio::export::ModelFormat;
use vbgs_studio::model::splat::appearance::{Appearance, SplatSet};
use vbgs_studio::model::splat::splats::Splat;

/// Further round trips.
const AGAIN: usize = 4;

/// Splats that every format can hold; `odd` sets the first one to a limit value.
fn splats(n: usize, seed: u64, odd: u8) -> Vec<Splat> {
    let mut splats = random_splats(n, seed);
    for splat in &mut splats {
        splat.scale = splat.scale.map(|s| s.clamp(1e-4, 100.0));
        // Smaller opacities become a byte of 0, which is not drawn.
        splat.opacity = splat.opacity.max(1.0 / 255.0);
    }
    let first = &mut splats[0];
    match odd {
        0 => first.opacity = 1.0,
        1 => first.color = [0.0, 1.0, 2.0],
        2 => first.scale = [1e-4; 3],
        3 => first.rotation = [0.0, 0.0, 0.0, -1.0],
        4 => first.mean = [0.0, -0.0, 49.999],
        _ => {}
    }
    splats
}

/// Writes splats and reads the file back.
fn back(format: ModelFormat, splats: &SplatSet) -> (Vec<u8>, SplatSet) {
    let bytes = written_as(format, splats);
    let model = read_bytes(&bytes).unwrap();
    assert_eq!(model.skipped, 0, "{format}");
    (bytes, model.splats)
}

fn appearance(splats: &SplatSet) -> Vec<Appearance> {
    splats.view().appearance().to_vec()
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 40, failure_persistence: None, ..ProptestConfig::default() })]

    /// SPZ files are equal to the byte; other formats stay within the rounding of a single conversion.
    #[test]
    fn files_of_what_was_read_say_the_same_however_often(
        n in 1..40usize,
        seed in any::<u64>(),
        odd in 0..8u8,
        is_directed in any::<bool>(),
        format in prop_oneof![Just(ModelFormat::Ply), Just(ModelFormat::Glb), Just(ModelFormat::Spz)],
    ) {
        let splats = splats(n, seed, odd);
        let plain = |a: Appearance| Appearance { gradient: [[0.0; 3]; 3], ..a };
        let of: Vec<Appearance> = match is_directed {
            true => random_appearance(&splats, seed).into_iter().map(plain).collect(),
            false => vec![Appearance::default(); n],
        };
        let (_, first) = back(format, &set(&splats, &of));
        prop_assert_eq!(first.len(), n);
        let (_, second) = back(format, &first);
        let (bytes, mut last) = back(format, &second);
        for _ in 1..AGAIN {
            let (again, next) = back(format, &last);
            if format == ModelFormat::Spz {
                prop_assert!(again == bytes, "writing the splats that were read changed the file");
            }
            last = next;
        }
        for (a, b) in first.iter().zip(last.iter()) {
            prop_assert_eq!(a.mean, b.mean);
            assert_same(a, b, format.name());
        }
        let (a, b) = (appearance(&first), appearance(&last));
        prop_assert_eq!(a.len(), b.len());
        for (a, b) in a.iter().zip(&b) {
            for (a, b) in a.directional.iter().zip(b.directional) {
                prop_assert!(distance(*a, b) <= 1e-5, "{a:?} {b:?}");
            }
        }
    }
}
