//! Settings from files and from the command line.

use super::runner::Scratch;
use std::fs;

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
    let config = config_of(
        &scratch,
        "--config all.ron --set seed=9 --set candidates=dense --set init=random",
    );
    assert_eq!(config["seed"], 9);
    assert_eq!(config["candidates"], "dense");
    assert_eq!(config["init"], "random");
    assert_eq!(config["components"], 700, "other settings are unchanged");
    fs::write(scratch.path("dense.ron"), "(candidates: \"dense\", components: 500)").unwrap();
    assert_eq!(config_of(&scratch, "--config dense.ron")["candidates"], "dense");
    // A file takes the names of the command line as well as those it is written with.
    for name in ["legacy-cov", "legacy-cholesky"] {
        fs::write(scratch.path("form.ron"), format!("(covariance_form: r#{name})")).unwrap();
        let config = config_of(&scratch, "--config form.ron");
        assert_eq!(config["conversion"]["form"], "legacy-cholesky");
    }
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
        (b"(components: 0)", 2, &["components", "expected 1 to 20000000", "found 0"]),
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
    let note = "the published calibration of the Kinect's colour camera is used";
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
    let run = scratch.run("train room --out out --preset paper --set components=500").succeeds();
    assert!(!run.stderr.contains(note), "{}", run.stderr);
}

fn scene_config_of(scratch: &Scratch, options: &str) -> serde_json::Value {
    scratch.run(&format!("train room --out out --max-frames 1 {options}")).succeeds();
    scratch.json("out/report.json")["config"].clone()
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
    assert_eq!(
        config_of(&scratch, "--config paper --set components=500")["seed"],
        7,
        "a file wins"
    );
}

#[test]
fn plain_splats_have_nothing_native() {
    let scratch = Scratch::with_room();
    for part in ["gradient", "crack_filling"] {
        let run =
            scratch.run(&format!("train room --out out --set splats=plain --set {part}=true"));
        run.fails(2, &["splats", &format!("expected native with {part}"), "found plain"]);
    }
    let run = scratch.run("train room --out out --max-frames 2 --set splats=plane");
    run.fails(2, &["splats", "plane"]);
    scratch.run("train room --out out --max-frames 2 --set splats=plain").succeeds();
    let run = scratch.run("export out/checkpoint.vbgs -o b.ply --export-split 2").succeeds();
    assert!(run.stderr.contains("has no effect"), "{}", run.stderr);
}

#[test]
fn options_of_the_other_preset_are_wrong_usage() {
    let scratch = Scratch::with_room();
    for (options, option, preset) in [
        ("--set components=5", "components", "--preset paper"),
        ("--set covariance_form=right", "covariance_form", "--preset paper"),
        ("--preset paper --budget 5", "budget (`--budget`)", "--preset scene"),
        ("--preset paper --set align=false", "align", "--preset scene"),
    ] {
        let run = scratch.run(&format!("train room --out out {options}"));
        run.fails(2, &[&format!("{option}: expected `{preset}` with it")]);
    }
}

#[test]
fn help_is_short_and_names_what_sets_the_rest() {
    let scratch = Scratch::empty();
    for (command, most) in [("train", 24), ("eval", 10)] {
        let help = scratch.run(&format!("{command} --help")).succeeds().stdout;
        let is_option = |line: &&str| line.trim_start().starts_with("--");
        let options: Vec<&str> = help.lines().filter(is_option).collect();
        assert!(options.len() <= most, "{command} has {} options: {options:#?}", options.len());
    }
    let help = scratch.run("train --help").succeeds().stdout;
    assert!(help.contains("--confidence and --geometry-only, as in `info`"), "{help}");
    assert!(help.contains("--set <NAME=VALUE>") && help.contains("docs/reference/settings.md"));
    let help = scratch.run("eval --help").succeeds().stdout;
    assert!(help.contains("--depth-scale, --depth-range") && !help.contains("<UNITS>"), "{help}");
}

#[test]
fn settings_are_set_by_name() {
    let scratch = Scratch::with_room();
    let config = scene_config_of(&scratch, "--set seed=3 --set seed=4 --set flying-pixels=false");
    assert_eq!((&config["seed"], &config["surface"]["flying_pixels"]), (&4.into(), &false.into()));
    for (assignment, parts) in [
        ("colour=3", &["--set colour: no such setting", "settings.md"][..]),
        ("seed", &["--set seed: expected NAME=VALUE"]),
        ("seed=many", &["--set seed: "]),
        ("order=random", &["--set order: expected sequential or shuffled, found `random`"]),
        ("autosave=0s", &["--set autosave: expected a number of seconds above 0"]),
        ("stride=0", &["--set stride: expected a whole number, 1 or more"]),
        ("confidence=1", &["--set confidence: no such setting"]),
    ] {
        scratch.run(&format!("train room --out no --set {assignment}")).fails(2, parts);
    }
    assert!(!scratch.path("no").exists(), "nothing is made");
}
