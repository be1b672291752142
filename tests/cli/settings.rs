//! Settings from files and from the command line.

use super::runner::Scratch;
use std::fs;
use vbgs_studio::pipeline::settings::scene::SceneOverrides;
use vbgs_studio::train::paper::config::PaperOverrides;
use vbgs_studio::train::setting::table::{About, SettingLayer, Spelling};

fn config_of(scratch: &Scratch, options: &str) -> serde_json::Value {
    scratch
        .run(&format!("train room --out out --preset paper --max-frames 1 {options}"))
        .succeeds();
    scratch.json("out/report.json")["config"].clone()
}

#[test]
fn a_file_sets_and_the_command_line_wins() {
    let scratch = Scratch::with_room();
    let file = "(seed: 7, components: 700, candidates: 3, init: data, reassign: forwarded, \
                reassign_fraction: 0.5, precision: f64, covariance_form: legacy_cholesky, \
                scale_factor: 1.2)";
    let file = file.replace("legacy_cholesky", "r#legacy-cholesky");
    fs::write(scratch.path("all.ron"), file).unwrap();
    let config = config_of(&scratch, "--config all.ron");
    assert_eq!(config["seed"], 7);
    assert_eq!(config["components"], 700);
    assert_eq!(config["candidates"], 3);
    assert_eq!(config["init"], "data");
    assert_eq!(config["reassign"], "forwarded");
    assert_eq!(config["reassign_fraction"], 0.5);
    assert_eq!(config["precision"], "f64");
    assert_eq!(config["conversion"]["form"], "legacy-cholesky");
    assert_eq!(config["conversion"]["scale_factor"], 1.2);
    let config = config_of(&scratch, "--config all.ron --seed 9 --candidates dense --init random");
    assert_eq!(config["seed"], 9);
    assert_eq!(config["candidates"], "dense");
    assert_eq!(config["init"], "random");
    assert_eq!(config["components"], 700, "other settings are unchanged");
    fs::write(scratch.path("dense.ron"), "(candidates: \"dense\", components: 500)").unwrap();
    assert_eq!(config_of(&scratch, "--config dense.ron")["candidates"], "dense");
}

#[test]
fn defaults_are_the_papers() {
    let scratch = Scratch::with_room();
    let config = config_of(&scratch, "");
    assert_eq!(config["preset"], "paper");
    assert_eq!(config["components"], 100_000);
    assert_eq!(config["candidates"], 4);
    assert_eq!(config["init"], "random");
    assert_eq!(config["reassign"], "padded");
    assert_eq!(config["reassign_fraction"], 0.05);
    assert_eq!(config["precision"], "mixed");
}

#[test]
fn files_that_are_no_settings_are_refused() {
    let scratch = Scratch::with_room();
    let cases: [(&[u8], i32, &[&str]); 6] = [
        (b"(componets: 5)", 1, &["x.ron", "`componets`", "`components`"]),
        (b"components = 5", 1, &["x.ron", "expected settings such as (components"]),
        (b"", 1, &["x.ron", "expected settings such as"]),
        (b"(seed: -1)", 1, &["x.ron", "expected settings such as"]),
        (b"\xff\xfe", 1, &["x.ron", "expected a RON file", "UTF-8"]),
        (b"(components: 0)", 2, &["--components", "expected 1 to 20000000", "found 0"]),
    ];
    for (content, code, parts) in cases {
        fs::write(scratch.path("x.ron"), content).unwrap();
        scratch.run("train room --out out --preset paper --config x.ron").fails(code, parts);
    }
    let parts = ["none.ron", "expected a RON file", "No such file"];
    scratch.run("train room --out out --config none.ron").fails(1, &parts);
    assert!(!scratch.path("out").exists(), "no output before the settings are valid");
}

#[test]
fn the_kinects_calibration_is_taken_unless_another_is_given() {
    let scratch = Scratch::empty();
    let synth = "synth room --layout seven-scenes --size 640x480 --frames 1 --eval-frames 1";
    scratch.run(synth).succeeds();
    // The published intrinsics apply if the folder has none.
    fs::remove_file(scratch.path("room/camera-intrinsics.txt")).unwrap();
    let note = "the published Kinect's colour camera";
    let focal = || {
        let config = scratch.json("out/report.json")["config"].clone();
        config["surface"]["calibration"]["color_camera"]["focal"][0].as_f64()
    };
    let run = scratch.run("train room --out out").succeeds();
    assert!(run.stderr.contains(note), "{}", run.stderr);
    assert_eq!(focal(), Some(522.0));
    fs::write(scratch.path("none.ron"), "()").unwrap();
    let run = scratch.run("train room --out out --calibration none.ron").succeeds();
    assert!(!run.stderr.contains(note), "{}", run.stderr);
    assert_eq!(focal(), None);
    let run = scratch.run("train room --out out --preset paper --components 500").succeeds();
    assert!(!run.stderr.contains(note), "{}", run.stderr);
}

fn scene_config_of(scratch: &Scratch, options: &str) -> serde_json::Value {
    scratch.run(&format!("train room --out out --max-frames 1 {options}")).succeeds();
    scratch.json("out/report.json")["config"].clone()
}

#[test]
fn names_of_older_versions_are_understood() {
    let scratch = Scratch::with_room();
    fs::write(scratch.path("old.ron"), "(looks: returned, closing: false)").unwrap();
    fs::write(scratch.path("new.ron"), "(visibility: returned, crack_filling: false)").unwrap();
    let new = scene_config_of(&scratch, "--visibility returned --without crack-filling");
    assert_eq!((&new["looks"], &new["native"]["closing"]), (&"returned".into(), &1.0.into()));
    for options in ["--looks returned --without closing", "--config old.ron", "--config new.ron"] {
        assert_eq!(scene_config_of(&scratch, options), new, "{options}");
    }
    let both = "(looks: returned, visibility: returned)";
    fs::write(scratch.path("both.ron"), both).unwrap();
    scratch.run("train room --out no --config both.ron").fails(1, &["both.ron", "visibility"]);
}

#[test]
fn a_preset_is_a_file_by_its_name() {
    let scratch = Scratch::with_room();
    let plain = scene_config_of(&scratch, "");
    let mut named = scene_config_of(&scratch, "--config scene");
    assert_eq!(named["budget"], "2000000");
    named["budget"] = plain["budget"].clone();
    assert_eq!(named, plain);
    assert_eq!(config_of(&scratch, "--config paper"), config_of(&scratch, ""));
    fs::write(scratch.path("paper"), "(seed: 7)").unwrap();
    assert_eq!(config_of(&scratch, "--config paper --components 500")["seed"], 7, "a file wins");
}

#[test]
fn plain_splats_have_nothing_native() {
    let scratch = Scratch::with_room();
    for part in ["gradient", "crack-filling"] {
        let run = scratch.run(&format!("train room --out out --splats plain --with {part}"));
        run.fails(2, &["--splats", &format!("expected native with {part}"), "found plain"]);
    }
    let run = scratch.run("train room --out out --max-frames 2 --splats plane");
    run.fails(2, &["--splats", "plane"]);
    scratch.run("train room --out out --max-frames 2 --splats plain").succeeds();
    let run = scratch.run("export out/checkpoint.vbgs -o b.ply --export-split 2").succeeds();
    assert!(run.stderr.contains("has no effect"), "{}", run.stderr);
}

#[test]
fn options_of_the_other_preset_are_wrong_usage() {
    let scratch = Scratch::with_room();
    for (options, option, preset) in [
        ("--components 5", "--components", "--preset paper"),
        ("--conversion right", "--conversion", "--preset paper"),
        ("--preset paper --budget 5", "--budget", "--preset scene"),
        ("--preset paper --without align", "--with or --without align", "--preset scene"),
    ] {
        let run = scratch.run(&format!("train room --out out {options}"));
        run.fails(2, &[&format!("{option}: expected {preset} with it")]);
    }
}

#[test]
fn help_lists_every_setting_with_its_default() {
    let scratch = Scratch::empty();
    let help = scratch.run("train --help").succeeds().stdout;
    let help = help.split_whitespace().collect::<Vec<_>>().join(" ");
    let abouts = |abouts: &mut dyn Iterator<Item = &About>| {
        for about in abouts {
            let listed = match about.spelling {
                Spelling::Option(option, value) => format!("{option} <{value}>"),
                Spelling::Part(part) => format!("{part}: {}", about.help()),
                Spelling::File => continue,
            };
            assert!(help.contains(&listed), "`{listed}` is missing in {help}");
            assert!(help.contains(about.help()), "{}", about.field);
        }
    };
    abouts(&mut SceneOverrides::TABLE.iter().map(|setting| &setting.about).filter(|about| {
        // An option of both presets shows the help of the paper preset.
        PaperOverrides::TABLE.iter().all(|other| other.about.key() != about.key())
    }));
    abouts(&mut PaperOverrides::TABLE.iter().map(|setting| &setting.about));
}
