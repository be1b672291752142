//! `bench peers` with a script in place of the other programs.
#![cfg(unix)]

use super::runner::{Run, Scratch};

const STAND_IN: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/fixtures/peer.sh");

fn peers(scratch: &Scratch, more: &[&str]) -> Run {
    let common = ["bench", "peers", "room", "--quick", "--components", "200", "--out", "found"];
    scratch.run_args(&[&common[..], more].concat())
}

#[test]
fn other_programs_learn_the_same_frames_in_turns() {
    let scratch = Scratch::with_room();
    let own = format!("mine={STAND_IN} 50");
    let more = ["--python", STAND_IN, "--open3d", "--published", "checkout", "--peer", &own];
    let run = peers(&scratch, &more).succeeds();
    assert!(
        run.stdout.contains("ratio") && run.stdout.contains("wrote peers.json"),
        "{}",
        run.stdout
    );
    let json = scratch.json("found/peers.json");
    let rows = json["rows"].as_array().unwrap();
    let names: Vec<&str> = rows.iter().map(|row| row["name"].as_str().unwrap()).collect();
    let expected =
        ["vbgs-studio", "vbgs-studio, padded", "published, dense", "Open3D TSDF", "mine"];
    assert_eq!(names, expected);
    // Times that the script prints: for the script alone, then without or with a checkout, then for a folder.
    let ms: Vec<f64> = rows[2..].iter().map(|row| row["ms"].as_f64().unwrap()).collect();
    assert_eq!(ms, [400.0, 300.0, 50.0]);
    for row in rows {
        assert_eq!(row["frames"], 3, "the first of four frames is a warm-up");
    }
    assert_eq!(rows[0]["ratio"], 1.0);
    let [published, mine] = [&rows[2], &rows[4]].map(|row| row["ratio"].as_f64().unwrap());
    assert!((published / mine - 8.0).abs() < 1e-9, "{published} and {mine} on the same frames");
}

#[test]
fn programs_that_are_not_there_are_named() {
    let scratch = Scratch::with_room();
    peers(&scratch, &[]).fails(2, &["--published, --open3d or --peer"]);
    peers(&scratch, &["--peer", "mine"]).fails(2, &["mine=./mine"]);
    let absent = ["--open3d", "--python", "./nowhere"];
    peers(&scratch, &absent).fails(1, &["Open3D TSDF", "`./nowhere` does not start"]);
    let refusing = format!("mine={STAND_IN} refuses");
    peers(&scratch, &["--peer", &refusing]).fails(1, &["mine: no licence today"]);
    peers(&scratch, &["--peer", "mine=true"]).fails(1, &["mine: expected", "end of its output"]);
    let lost = format!("mine={STAND_IN} -1");
    peers(&scratch, &["--peer", &lost]).fails(1, &["{\"ms\": 12.5}", "Ms(-1.0)"]);
}
