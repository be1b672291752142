//! Disk errors while a recording or a model is read. A preloaded library (`failing_disk.c`) makes
//! the binary's system calls fail. Each failure is reported or leaves the result unchanged.
#![cfg(target_os = "linux")]

use super::runner::{Run, Scratch};
use crate::common::layouts::TestLayout;
use rayon::prelude::*;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;
use tempfile::TempDir;

const LAYOUTS: [&str; 16] = [
    "blender",
    "seven-scenes",
    "tum",
    "open3d",
    "replica",
    "scannet",
    "nerfstudio",
    "record3d",
    "record3d-archive",
    "stray-scanner",
    "arkit",
    "rtab-map",
    "polycam",
    "scanner3d",
    "arkit-scenes",
    "scannet-pp",
];
/// One thread, so that the calls come in the same order every time.
const TRAIN: &str = "train room --out out --threads 1";
const EIO: i32 = 5;
const EINTR: i32 = 4;
const EMFILE: i32 = 24;

/// System calls that fail: one kind of call on the files of one folder.
#[derive(Clone, Copy)]
struct Failing {
    call: &'static str,
    from: Option<usize>,
    until: Option<usize>,
    every: usize,
    /// An errno, or 0 for short reads.
    by: i32,
}

impl Failing {
    /// No call fails; calls are only counted.
    const fn not(call: &'static str) -> Self {
        Self { call, from: None, until: None, every: 1, by: 0 }
    }

    const fn at(call: &'static str, at: usize, by: i32) -> Self {
        Self { call, from: Some(at), until: Some(at + 1), every: 1, by }
    }

    const fn from(call: &'static str, at: usize, by: i32) -> Self {
        Self { call, from: Some(at), until: None, every: 1, by }
    }

    const fn every(call: &'static str, every: usize, by: i32) -> Self {
        Self { call, from: Some(0), until: None, every, by }
    }
}

/// Builds the LD_PRELOAD library once.
fn library() -> &'static Path {
    static BUILT: OnceLock<(TempDir, PathBuf)> = OnceLock::new();
    let built = BUILT.get_or_init(|| {
        let folder = tempfile::tempdir().unwrap();
        let library = folder.path().join("failing_disk.so");
        let source = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/cli/failing_disk.c");
        let mut compiler = Command::new("cc");
        compiler.args(["-shared", "-fPIC", "-O2", source, "-ldl", "-o"]).arg(&library);
        assert!(compiler.status().unwrap().success(), "{compiler:?}");
        (folder, library)
    });
    &built.1
}

/// Result of a run: the process, the number of matching calls, and the file of the first failed call.
struct Ended {
    run: Run,
    calls: usize,
    file: String,
}

fn run(scratch: &Scratch, under: &str, failing: Failing, arguments: &str) -> Ended {
    let told = scratch.path("told");
    let mut command = scratch.command(&arguments.split_whitespace().collect::<Vec<_>>());
    command
        .env("LD_PRELOAD", library())
        .env("FAILING_UNDER", scratch.path(under).canonicalize().unwrap())
        .env("FAILING_CALL", failing.call)
        .env("FAILING_EVERY", failing.every.to_string())
        .env("FAILING_BY", failing.by.to_string())
        .env("FAILING_SHORT", "7")
        .env("FAILING_TOLD", &told);
    for (name, call) in [("FAILING_FROM", failing.from), ("FAILING_UNTIL", failing.until)] {
        call.map(|call| command.env(name, call.to_string()));
    }
    let run = Run::from(command.output().unwrap());
    let told = std::fs::read_to_string(&told).unwrap();
    let (calls, file) = told.split_once('\n').unwrap();
    let name = Path::new(file.trim()).file_name().unwrap_or_default();
    Ended { run, calls: calls.parse().unwrap(), file: name.to_str().unwrap().to_owned() }
}

/// Records four frames and one held-out frame, and trains the reference scene without disk errors.
fn recorded(layout: &str) -> (Scratch, Vec<u8>) {
    let scratch = Scratch::empty();
    scratch.record("room", TestLayout::named(layout), 4, 1);
    scratch.run(TRAIN).succeeds();
    let scene = scratch.bytes("out/scene.ply");
    (scratch, scene)
}

#[test]
fn reads_that_give_little_or_are_interrupted_give_the_same_scene() {
    for layout in LAYOUTS {
        let (scratch, scene) = recorded(layout);
        for failing in [Failing::every("read", 1, 0), Failing::every("read", 2, EINTR)] {
            let ended = run(&scratch, "room", failing, TRAIN);
            assert!(!ended.file.is_empty(), "{layout}: no read was shortened");
            ended.run.succeeds();
            assert!(
                scratch.bytes("out/scene.ply") == scene,
                "{layout}, {}: the scene differs",
                failing.by
            );
        }
    }
}

/// Trains while calls fail. Either stderr names the file that cannot be read, or the scene is unchanged.
fn told_or_harmless(layout: &str, (scratch, scene): &(Scratch, Vec<u8>), failing: Failing) {
    let _ = std::fs::remove_dir_all(scratch.path("out"));
    let Ended { run, file, .. } = run(scratch, "room", failing, TRAIN);
    let said = format!(
        "{layout}, {} {:?} to {:?} of {file}, errno {}: exit {}, {}",
        failing.call, failing.from, failing.until, failing.by, run.code, run.stderr
    );
    assert!(!run.stderr.contains("panicked"), "{said}");
    let errors: Vec<&str> = run.stderr.lines().filter(|line| line.starts_with("error: ")).collect();
    match run.code {
        0 => {
            // If every call from here on fails, the first may be a `stat` for the modification
            // time. That failure has no message; the next file read is named instead.
            let reason = format!("(os error {})", failing.by);
            let is_named = |line: &str| line.starts_with("warning: ") && line.contains(&reason);
            let is_told = run.stderr.contains(&file)
                || failing.until.is_none() && run.stderr.lines().any(is_named);
            let is_same = scratch.bytes("out/scene.ply") == *scene;
            assert!(is_told || is_same, "the scene differs without a warning; {said}");
        }
        1 => {
            assert!(errors.len() == 1 && errors[0].contains("room"), "{said}");
            assert!(!scratch.path("out/scene.ply").exists(), "a scene was written; {said}");
        }
        _ => panic!("{said}"),
    }
}

/// Makes evenly spaced calls fail: each one alone, and each one with all later calls.
fn fail_some(calls: &[(&'static str, i32)], most: usize) {
    LAYOUTS.par_iter().for_each(|layout| {
        let recorded = recorded(layout);
        for &(call, by) in calls {
            let n = run(&recorded.0, "room", Failing::not(call), TRAIN).calls;
            assert!(n > 0, "{layout}: no {call} at all");
            let tried = n.min(most);
            for at in (0..tried).map(|i| i * n / tried) {
                told_or_harmless(layout, &recorded, Failing::at(call, at, by));
                told_or_harmless(layout, &recorded, Failing::from(call, at, by));
            }
        }
    });
}

/// Three calls of each kind. With `VBGS_EVERY_CALL` every call fails once: about 8,000 runs, half an
/// hour on one core.
#[test]
fn whichever_file_cannot_be_read_it_is_told_or_changes_nothing() {
    match std::env::var_os("VBGS_EVERY_CALL") {
        Some(_) => fail_some(&[("read", EIO), ("open", EMFILE), ("stat", EIO)], usize::MAX),
        None => fail_some(&[("read", EIO), ("open", EMFILE)], 3),
    }
}

#[test]
fn a_model_that_cannot_be_read_to_its_end_is_none() {
    let scratch = Scratch::with_scene();
    for (arguments, whole) in [
        ("export out/scene.ply -o new/scene.glb", "new/scene.glb"),
        ("train room --out new --resume out/checkpoint.vbgs --threads 1", "new/scene.ply"),
    ] {
        let begin = || {
            let _ = std::fs::remove_dir_all(scratch.path("new"));
            std::fs::create_dir(scratch.path("new")).unwrap();
        };
        begin();
        let clean = run(&scratch, "out", Failing::not("read"), arguments);
        clean.run.succeeds();
        let scene = scratch.bytes(whole);
        for at in 0..clean.calls {
            begin();
            let ended = run(&scratch, "out", Failing::from("read", at, EIO), arguments);
            let file = ended.file;
            ended.run.fails(1, &[&file]);
            assert!(!scratch.path(whole).exists(), "{arguments}: read {at} of {}", clean.calls);
        }
        begin();
        run(&scratch, "out", Failing::every("read", 1, 0), arguments).run.succeeds();
        assert!(scratch.bytes(whole) == scene, "{arguments}: short reads change the output");
    }
}
