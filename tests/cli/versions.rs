//! Files of the last version. They were written by its program and are never made again: this version reads them.
//!
//! | file | made by version 0.1.0 in the room of `synth room --size 32x24 --frames 4 --eval-frames 1` |
//! |---|---|
//! | `scene_0_1_0.vbgs` | `train room --max-frames 3 --set shuffle_buffer=1 --scale 1.5 --set align=true --set gain=true` |
//! | `paper_0_1_0.vbgs` | `train room --max-frames 3 --preset paper --config paper_0_1_0.ron` |
//! | `*_0_1_0.ron` | by hand, and read by that version |

use super::runner::Scratch;
use std::fs;
use std::path::Path;

/// The room of the checkpoints, and the files themselves.
fn room() -> Scratch {
    let scratch = Scratch::empty();
    scratch.run("synth room --size 32x24 --frames 4 --eval-frames 1").succeeds();
    let fixtures = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures");
    for name in ["scene_0_1_0.vbgs", "paper_0_1_0.vbgs", "scene_0_1_0.ron", "paper_0_1_0.ron"] {
        fs::copy(fixtures.join(name), scratch.path(name)).unwrap();
    }
    scratch
}

#[test]
fn checkpoints_of_the_last_version_are_read_resumed_and_exported() {
    let scratch = room();
    for (preset, components, drawn) in [("scene", 19, 18), ("paper", 12, 12)] {
        let file = format!("{preset}_0_1_0.vbgs");
        let info = scratch.run(&format!("info {file} --json")).succeeds().json();
        assert_eq!(info["program"], "vbgs-studio 0.1.0");
        assert_eq!((&info["version"], &info["frames"]), (&"1.2".into(), &3.into()));
        assert_eq!((&info["components"], &info["drawn"]), (&components.into(), &drawn.into()));
        assert!(info.get("registration").is_none(), "{info}");
        let export = format!("export {file} -o {preset}.glb --export-detail 0");
        scratch.run(&export).succeeds();
        assert_eq!(scratch.model(&format!("{preset}.glb")).splats.len(), drawn);
        scratch.run(&format!("eval {file} room")).succeeds();
        let resumed = format!("train room --resume {file} --out {preset} --max-frames 4");
        scratch.run(&resumed).succeeds();
        let info = scratch.run(&format!("info {preset}/checkpoint.vbgs --json")).succeeds().json();
        assert_eq!(info["frames"], 4);
        scratch.run(&format!("register {file} --scale-by 0,0,0 1,0,0 2m")).succeeds();
        let info = scratch.run(&format!("info {file} --json")).succeeds().json();
        assert_eq!(
            (&info["components"], &info["registration"]["scale"]),
            (&components.into(), &2.0.into())
        );
    }
}

#[test]
fn settings_of_the_last_version_are_read() {
    let scratch = room();
    let config = |preset: &str| {
        let train = format!("train room --out {preset} --preset {preset} --max-frames 1");
        scratch.run(&format!("{train} --config {preset}_0_1_0.ron")).succeeds();
        scratch.json(&format!("{preset}/report.json"))["config"].clone()
    };
    let scene = config("scene");
    for (name, value) in [("seed", "7"), ("scale", "\"1.5\""), ("budget", "\"40\"")] {
        assert_eq!(scene[name].to_string(), value, "{name}: {scene}");
    }
    let paper = config("paper");
    for (name, value) in [
        ("seed", "7"),
        ("components", "12"),
        ("candidates", "3"),
        ("init", "\"data\""),
        ("reassign", "\"forwarded\""),
        ("reassign_fraction", "0.5"),
        ("precision", "\"f64\""),
    ] {
        assert_eq!(paper[name].to_string(), value, "{name}: {paper}");
    }
}
