//! What fuzzing found, sound inputs of every kind, and seeded damage to these, through the functions that
//! are fuzzed (`fuzz/README.md`): no panic, no hang, nothing that cannot be right.

use crate::common::mutation::mutate;
use crate::entries::checkpoint::sealed;
use crate::entries::{TARGETS, Target};
use std::fs;
use std::path::Path;
use std::time::Instant;
use vbgs_studio::export::checkpoint::parse;
use vbgs_studio::math::rng::{Purpose, Rng};

/// Far more than the slowest input takes without optimisation, seconds: a hang, not a slow machine.
const MAX_SECONDS: f64 = 60.0;
/// Damaged inputs of a target, unless `VBGS_FUZZ_ROUNDS` says how many.
const ROUNDS: u64 = 40;

fn feed(target: &Target, input: &[u8], what: &str) {
    let start = Instant::now();
    // The harness tells which test failed, not on what.
    let caught = std::panic::catch_unwind(|| (target.run)(input));
    let seconds = start.elapsed().as_secs_f64();
    assert!(caught.is_ok(), "{}: {what} breaks it", target.name);
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
    // A folder that belongs to no target is replayed by nobody.
    for folder in fs::read_dir(found).into_iter().flatten() {
        let name = folder.unwrap().file_name();
        assert!(TARGETS.iter().any(|target| *target.name == *name), "{name:?} is no target");
    }
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
        assert!(!sound.is_empty(), "{}: nothing to begin with", target.name);
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

/// Else damaged checkpoints would be refused for their checksums alone.
#[test]
fn checksums_are_put_where_checkpoints_have_them() {
    let target = TARGETS.iter().find(|target| target.name == "checkpoint").unwrap();
    for sound in (target.seeds)() {
        assert_eq!(sealed(&sound), sound);
        let mut wrong = sound.clone();
        // The first section's checksum, as the table names it.
        wrong[48] ^= 1;
        assert!(parse(&wrong).is_err());
        assert_eq!(sealed(&wrong), sound);
    }
}
