//! The recipe for many machines (`examples/distributed`), run on this one.

use super::common::skip::skip;
use super::runner::{Run, Scratch};
use std::path::Path;
use std::process::Command;
use vbgs_studio::pipeline::checkpoint::SavedRun;

/// Runs the recipe with the tested binary; `None` if Python is missing and not required.
fn distribute(scratch: &Scratch, arguments: &str) -> Option<Run> {
    if Command::new("python3").arg("--version").output().is_err() {
        return skip("no python3", "install it");
    }
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/distributed/distribute.py");
    let mut command = Command::new("python3");
    command.arg(script).args(["--local", "--program", env!("CARGO_BIN_EXE_vbgs-studio")]);
    command.args(arguments.split_whitespace()).current_dir(scratch.path("."));
    Some(Run::from(command.output().unwrap()))
}

#[test]
fn shards_and_their_tree_of_merges_are_one_run() {
    let scratch = Scratch::with_room();
    let paper = "--preset paper --set components=500 --set reassign=off";
    let recipe = "room --out tree --shards 5 --fan-in 2 --workers 2 --threads 1";
    let Some(run) = distribute(&scratch, &format!("{recipe} -- {paper}")) else { return };
    let said = run.succeeds().stdout;
    assert!(said.contains("5 shards, 3 levels of merges by 2"), "{said}");
    scratch.run(&format!("train room --out whole {paper}")).succeeds();
    assert!(scratch.bytes("tree/scene.ply") == scratch.bytes("whole/scene.ply"), "other splats");
    let read = |name: &str| SavedRun::read(&scratch.path(name)).unwrap().content;
    let (tree, whole) = (read("tree/checkpoint.vbgs"), read("whole/checkpoint.vbgs"));
    assert!(tree.model == whole.model, "different bits");
    assert_eq!((tree.config, tree.cursor.frames), (whole.config, whole.cursor.frames));
}

#[test]
fn one_shard_needs_no_merge_and_options_go_to_every_shard() {
    let scratch = Scratch::with_room();
    let options = "--preset paper --set components=500 --max-frames 3";
    let Some(run) = distribute(&scratch, &format!("room --out one --shards 1 -- {options}")) else {
        return;
    };
    run.succeeds();
    scratch.run(&format!("train room --out whole {options}")).succeeds();
    assert!(scratch.bytes("one/scene.ply") == scratch.bytes("whole/scene.ply"));
}

/// Shards of a scene resume from one common start, which is counted once.
#[test]
fn shards_of_the_default_scene_go_on_from_one_start() {
    let scratch = Scratch::with_room();
    let recipe = "room --out tree --shards 3 --start 4 --fan-in 2 --threads 1";
    let Some(run) = distribute(&scratch, recipe) else { return };
    assert!(run.succeeds().stdout.contains("3 shards, 2 levels"));
    scratch.run("train room --out whole").succeeds();
    let read = |name: &str| SavedRun::read(&scratch.path(name)).unwrap();
    let (tree, whole) = (read("tree/checkpoint.vbgs"), read("whole/checkpoint.vbgs"));
    let (ours, theirs) = (&tree.content.cursor, &whole.content.cursor);
    assert_eq!((ours.frames, ours.points), (theirs.frames, theirs.points));
    let mut visited = ours.visited.clone();
    visited.sort_unstable();
    assert_eq!((visited, tree.config), (theirs.visited.clone(), whole.config));
    let [n, expected] =
        ["tree", "whole"].map(|name| scratch.model(&format!("{name}/scene.ply")).splats.len());
    assert!(n * 10 >= expected * 9 && n * 10 <= expected * 12, "{n} splats, {expected} of one run");
}

#[test]
fn what_a_shard_says_is_what_the_recipe_says() {
    let scratch = Scratch::with_room();
    for (arguments, parts) in [
        ("nowhere --out tree --shards 2", ["train", "nowhere"]),
        (
            "room --out tree --shards 2 -- --preset paper --set components=500",
            ["merge", "reassign=off"],
        ),
    ] {
        let Some(run) = distribute(&scratch, arguments) else { return };
        run.fails(1, &parts);
        assert!(!scratch.path("tree/checkpoint.vbgs").exists());
    }
}
