//! Runs every fuzz target (`fuzz/README.md`) on inputs that fuzzing found, on valid inputs and on seeded
//! mutations of these: no panic, no hang, no impossible result.

use crate::common::mutation::mutate;
use crate::entries::checkpoint::sealed;
use crate::entries::{TARGETS, Target};
use flate2::read::GzDecoder;
use std::fs;
use std::io::Read;
use std::path::Path;
use std::time::Instant;
use tar::Archive;
use vbgs_studio::export::checkpoint::parse;
use vbgs_studio::math::rng::{Purpose, Rng};

/// Time limit per input, seconds: far above the slowest input in a debug build, so only a hang exceeds it.
const MAX_SECONDS: f64 = 60.0;
/// Mutated inputs per target, unless `VBGS_FUZZ_ROUNDS` sets their number.
const ROUNDS: u64 = 40;

fn feed(target: &Target, input: &[u8], what: &str) {
    let start = Instant::now();
    // The test harness reports the failed test but not the input.
    let caught = std::panic::catch_unwind(|| (target.run)(input));
    let seconds = start.elapsed().as_secs_f64();
    assert!(caught.is_ok(), "{}: panic on {what}", target.name);
    assert!(seconds < MAX_SECONDS, "{}: {what} takes {seconds:.1} s", target.name);
}

#[test]
fn nothing_breaks_on_what_was_found() {
    let found = Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz/found");
    for target in &TARGETS {
        for file in fs::read_dir(found.join(target.name)).into_iter().flatten() {
            let path = file.unwrap().path();
            feed(target, &fs::read(&path).unwrap(), &path.display().to_string());
        }
    }
    // The inputs of a folder without a target would never run.
    for folder in fs::read_dir(found).into_iter().flatten() {
        let name = folder.unwrap().file_name();
        assert!(TARGETS.iter().any(|target| *target.name == *name), "{name:?} is not a target");
    }
}

/// The corpus holds inputs that reach different code, as found by coverage (`fuzz/keep.sh`).
#[test]
fn nothing_breaks_on_the_corpus() {
    let packed = Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz/corpus.tar.gz");
    let mut archive = Archive::new(GzDecoder::new(fs::File::open(packed).unwrap()));
    let mut n_inputs = 0;
    for entry in archive.entries().unwrap() {
        let mut entry = entry.unwrap();
        let path = entry.path().unwrap().display().to_string();
        let of = |target: &&Target| path.split('/').next() == Some(target.name);
        let target = TARGETS.iter().find(of).unwrap_or_else(|| panic!("{path} has no target"));
        let mut input = Vec::new();
        entry.read_to_end(&mut input).unwrap();
        feed(target, &input, &path);
        n_inputs += 1;
    }
    assert!(n_inputs > 1000, "{n_inputs} inputs");
}

#[test]
fn nothing_breaks_on_damaged_inputs() {
    let rounds = std::env::var("VBGS_FUZZ_ROUNDS").ok().and_then(|n| n.parse().ok());
    let only = std::env::var("VBGS_FUZZ_TARGET").ok();
    for (target, stream) in TARGETS.iter().zip(0..) {
        if only.as_ref().is_some_and(|only| only != target.name) {
            continue;
        }
        let sound = (target.seeds)();
        assert!(!sound.is_empty(), "{}: no valid inputs", target.name);
        let start = Instant::now();
        sound.iter().enumerate().for_each(|(i, input)| feed(target, input, &format!("seed {i}")));
        for round in 0..rounds.unwrap_or(ROUNDS) {
            let mut rng = Rng::new(round, Purpose::Synthetic, stream);
            let input = mutate(&sound[round as usize % sound.len()], &mut rng);
            feed(target, &input, &format!("round {round}"));
        }
        eprintln!("{}: {} seeds, {:.1} s", target.name, sound.len(), start.elapsed().as_secs_f64());
    }
}

/// `sealed` must restore the checksums: otherwise every mutation fails there and never reaches the parser.
#[test]
fn checksums_are_put_where_checkpoints_have_them() {
    let target = TARGETS.iter().find(|target| target.name == "checkpoint").unwrap();
    for sound in (target.seeds)() {
        assert_eq!(sealed(&sound), sound);
        let mut wrong = sound.clone();
        // Checksum of the first section in the table.
        wrong[48] ^= 1;
        assert!(parse(&wrong).is_err());
        assert_eq!(sealed(&wrong), sound);
    }
}
