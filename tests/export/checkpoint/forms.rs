//! Checkpoints read back bit for bit and are written again as the same bytes.

use super::{N, fixed64, means_f32, mixture, raw, sample, samples};
use std::path::Path;
use vbgs_studio::export::checkpoint::{VERSION, parse, read, to_bytes, write};
use vbgs_studio::model::paper::state::{Carry, Totals};

#[test]
fn every_form_comes_back_and_is_written_alike_again() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("checkpoint.vbgs");
    for checkpoint in samples() {
        let bytes = to_bytes(&checkpoint);
        assert_eq!(write(&path, &checkpoint).unwrap(), bytes.len() as u64);
        assert!(std::fs::read(&path).unwrap() == bytes);
        let loaded = read(&path).unwrap();
        assert_eq!(loaded.checkpoint, checkpoint);
        assert_eq!((loaded.version, loaded.bytes), (VERSION, bytes.len() as u64));
        assert!(to_bytes(&loaded.checkpoint) == bytes);
    }
}

#[test]
fn a_mixed_component_takes_136_bytes() {
    let without = |checkpoint: &vbgs_studio::export::checkpoint::Checkpoint| {
        let sections = raw::sections(&to_bytes(checkpoint));
        let per_component = [b"MINI", b"DIRI", b"STAN", b"STA1", b"STA2"];
        let columns = sections.iter().filter(|s| per_component.contains(&&s.tag));
        columns.map(|s| s.content.len()).sum::<usize>()
    };
    assert_eq!(without(&sample(means_f32(), fixed64())), 136 * N);
}

#[test]
fn a_carry_that_came_and_went_leaves_no_trace() {
    let bytes = to_bytes(&sample(means_f32(), fixed64()));
    let Totals::Fixed64 { rows, mut carries } = fixed64() else { unreachable!() };
    carries.insert(1, Carry { id: 7, limbs: [0; 13] });
    assert!(to_bytes(&sample(means_f32(), Totals::Fixed64 { rows, carries })) == bytes);
}

#[test]
fn the_file_is_laid_out_as_the_format_says() {
    let mut checkpoint = sample(means_f32(), fixed64());
    let bytes = to_bytes(&checkpoint);
    let sections = raw::sections(&bytes);
    // An independent writer makes the same file from the sections.
    assert!(raw::file(&sections, VERSION) == bytes);
    let tags: Vec<_> = sections.iter().map(|s| std::str::from_utf8(&s.tag).unwrap()).collect();
    assert_eq!(
        tags,
        [
            "CONF", "META", "NUMX", "CURS", "NORM", "PRIR", "DIRI", "MINI", "STAN", "STA1", "STA2",
            "CARI", "CARL", "HIST"
        ]
    );
    let content = |tag: &str| &sections.iter().find(|s| s.tag == tag.as_bytes()).unwrap().content;
    assert_eq!(content("CURS")[..24], [3u64, 1234, 4].map(u64::to_le_bytes).concat());
    let Totals::Fixed64 { rows, .. } = &mixture(&mut checkpoint).2.totals else { unreachable!() };
    let row = rows[17];
    let at = |tag, element: usize| {
        let bytes = &content(tag)[8 * element..8 * element + 8];
        i64::from_le_bytes(bytes.try_into().unwrap())
    };
    assert_eq!(at("STAN", 17), row[0]);
    assert_eq!([0, 1, 2, 3, 4, 5].map(|i| at("STA1", 6 * 17 + i))[..3], row[1..4]);
    assert_eq!([3, 4, 5].map(|i| at("STA1", 6 * 17 + i)), row[10..13]);
    assert_eq!([0, 1, 2, 3, 4, 5].map(|i| at("STA2", 6 * 17 + i)), row[4..10]);
}

/// The fixture was written by version 1.0 and is never regenerated. Every later version must read it and,
/// as long as the format of mixtures is unchanged, write the same sections.
#[test]
fn the_fixture_of_version_1_0_reads_and_is_written_alike() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures/fixed64_1_0.vbgs");
    let bytes = std::fs::read(path).unwrap();
    let checkpoint = sample(means_f32(), fixed64());
    assert_eq!(parse(&bytes).unwrap().checkpoint, checkpoint);
    assert!(raw::file(&raw::sections(&to_bytes(&checkpoint)), (1, 0)) == bytes);
}
