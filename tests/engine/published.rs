//! The preset files and the settings tables of the README agree with the settings tables in the code.

use serde::de::DeserializeOwned;
use std::fs;
use std::path::{Path, PathBuf};
use vbgs_studio::dataset::synthetic::{SyntheticParams, dataset};
use vbgs_studio::pipeline::plan::{Plan, Selection};
use vbgs_studio::pipeline::settings::method::Method;
use vbgs_studio::pipeline::settings::preset_file;
use vbgs_studio::pipeline::settings::scene::{SceneOverrides, SceneRun};
use vbgs_studio::train::paper::config::{PaperConfig, PaperOverrides};
use vbgs_studio::train::setting::Preset;
use vbgs_studio::train::setting::table::{About, Setting, SettingLayer, Spelling};

/// Environment variable that makes the tests write the files before comparing them.
const WRITE: &str = "VBGS_WRITE_SETTINGS";

fn in_tree(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(path)
}

fn hold(path: &str, expected: &str) {
    if std::env::var_os(WRITE).is_some() {
        fs::write(in_tree(path), expected).unwrap();
    }
    let found = fs::read_to_string(in_tree(path)).unwrap();
    assert!(
        found == expected,
        "{path} differs from the settings tables; `{WRITE}=1 cargo test --test engine published` rewrites it"
    );
}

fn layer_of<L: SettingLayer>(setting: &Setting<L>) -> L {
    let mut layer = L::default();
    (setting.parse)(&mut layer, setting.about.default.as_ref()).unwrap();
    layer
}

fn ron_of<L: SettingLayer>(head: &str) -> String {
    let mut text =
        format!("// {head}\n// A file that names only some of them changes only those.\n(\n");
    for setting in L::TABLE {
        let About { field, default, is_default_fixed, .. } = setting.about;
        text += &format!("    // {}\n", setting.about.help());
        text += &match is_default_fixed {
            true => {
                let value = (setting.ron)(&layer_of(setting)).unwrap().unwrap();
                format!("    {field}: {value},\n")
            }
            false => format!("    // {field}: by default {default}\n"),
        };
    }
    text + ")\n"
}

#[test]
fn preset_files_are_the_tables() {
    let scene = "Settings of the scene preset with their defaults, for `--config`.";
    hold("assets/presets/scene.ron", &ron_of::<SceneOverrides>(scene));
    let paper = "Settings of the paper preset with their defaults, for `--config`.";
    hold("assets/presets/paper.ron", &ron_of::<PaperOverrides>(paper));
}

fn embedded<L: DeserializeOwned>(preset: Preset) -> L {
    let extensions = ron::extensions::Extensions::IMPLICIT_SOME;
    let options = ron::Options::default().with_default_extension(extensions);
    options.from_str(preset_file(preset)).unwrap()
}

#[test]
fn embedded_presets_change_nothing() {
    let paper: PaperOverrides = embedded(Preset::Paper);
    assert_eq!(PaperConfig::paper().with(&paper), Ok(PaperConfig::paper()));
    let room = dataset(&ROOM).unwrap();
    let plan = Plan::new(&room, &Selection::all_frames(), 0).unwrap();
    let scene: SceneOverrides = embedded(Preset::Scene);
    let plain = SceneRun::new(&room, &plan, &SceneOverrides::default()).unwrap();
    let asked = SceneRun::new(&room, &plan, &scene).unwrap();
    assert_eq!(scene.conflict(&plain), None);
    assert_eq!(SceneRun { budget: None, ..asked }, plain);
}

const ROOM: SyntheticParams = SyntheticParams {
    width: 64,
    height: 48,
    n_train: 2,
    n_eval: 1,
    seed: 4,
    depth_noise: 0.0,
    ..SyntheticParams::demo()
};

#[test]
fn the_tables_say_a_scenes_defaults() {
    let room = dataset(&ROOM).unwrap();
    let plan = Plan::new(&room, &Selection::all_frames(), 0).unwrap();
    let run = SceneRun::new(&room, &plan, &SceneOverrides::default()).unwrap();
    for setting in SceneOverrides::TABLE.iter().filter(|s| s.about.is_default_fixed) {
        let layer = layer_of(setting);
        assert_eq!((setting.differs)(&layer, &run), None, "{}", setting.about.field);
        let mut changed = run.clone();
        (setting.apply)(&layer, &mut changed);
        assert_eq!((setting.differs)(&layer, &changed), None, "{}", setting.about.field);
    }
}

fn row<L: SettingLayer>(setting: &Setting<L>) -> String {
    let about = &setting.about;
    let option = match about.spelling {
        Spelling::Option(option, value) => format!("`{option} {value}`"),
        Spelling::Part(part) => format!("`--without {part}`"),
        Spelling::File => String::new(),
    };
    let choices: Vec<&str> = (about.choices)().iter().map(|choice| choice.name).collect();
    let values = match (choices.is_empty(), about.range) {
        (false, _) => format!(" ({})", choices.join(", ")),
        (true, Some(range)) => format!(" ({})", range()),
        (true, None) => String::new(),
    };
    let default = if about.default == "true" { "on" } else { about.default };
    format!("| {option} | `{}` | {default} | {}{values} |\n", about.field, about.help())
}

fn table_of<L: SettingLayer>() -> String {
    let head = "| option | in files | default | what it says |\n|---|---|---|---|\n";
    L::TABLE.iter().fold(head.to_owned(), |text, setting| text + &row(setting))
}

/// Replaces the text between the two markers of a preset.
fn with_table(text: &str, preset: Preset, table: &str) -> String {
    let begin = format!("<!-- settings of {preset} -->\n");
    let (before, rest) = text.split_once(&begin).unwrap();
    let (_, after) = rest.split_once("<!-- end -->").unwrap();
    format!("{before}{begin}{table}<!-- end -->{after}")
}

#[test]
fn the_readme_shows_the_tables() {
    let readme = fs::read_to_string(in_tree("README.md")).unwrap();
    let scene = with_table(&readme, Preset::Scene, &table_of::<SceneOverrides>());
    hold("README.md", &with_table(&scene, Preset::Paper, &table_of::<PaperOverrides>()));
}

/// Settings of a scene in a checkpoint of version 0.1.0.
const STORED_BY_0_1: &str = r#"{"preset": "scene", "seed": 0, "scale": "2.5px", "budget": "5000", "births": "seeds", "h":
    0.020206111948937178, "refine": true, "align": false, "gain": false, "looks": "projected",
    "sums": "mixed", "most": 5000, "native": {"opacity": {"tau": 3.2, "rho0": 0.7, "doubt": 20.0,
    "least": 0.3}, "least_points": 5.0, "scale": 1.12, "closing": 0.9, "least_scale": 0.05,
    "prior_scale": 0.3, "prior_points": 2.0, "gradient": true, "gradient_ridge": 0.005,
    "directional": true, "directional_ridge": [0.01, 0.2]}, "surface": {"sensor": "inverse8-ray",
    "thresholds": null, "plane_fit": true, "flying_pixels": true, "cosine": true, "calibration":
    null, "origin": [0.0, 3.0, 3.0]}}"#;

#[test]
fn stored_settings_of_version_0_1_are_compared_by_value() {
    let Method::Scene(run) = serde_json::from_str(STORED_BY_0_1).unwrap() else {
        panic!("expected the scene preset")
    };
    let options =
        ron::Options::default().with_default_extension(ron::extensions::Extensions::IMPLICIT_SOME);
    let asked = |text| -> SceneOverrides { options.from_str(text).unwrap() };
    let same = "(seed: 0, scale: \"2.5px\", budget: \"5000\", looks: projected, closing: true, \
                sums: mixed, cosine: true, gain: false, sensor: r#inverse8-ray)";
    assert_eq!(asked(same).conflict(&run), None);
    for (other, setting, stored) in [
        ("(closing: false)", "--with or --without crack-filling", Some("true")),
        ("(visibility: returned)", "--visibility", Some("projected")),
        ("(sums: f64)", "--precision", Some("mixed")),
        ("(calibration: ())", "--calibration", None),
        ("(plane_fit: false)", "--with or --without plane-fit", Some("true")),
    ] {
        let conflict = asked(other).conflict(&run).expect(other);
        assert_eq!((conflict.setting.as_str(), conflict.stored.as_deref()), (setting, stored));
    }
}

#[test]
fn every_row_is_declared_whole() {
    fn check<L: SettingLayer>() {
        for Setting { about, .. } in L::TABLE {
            assert!(!about.help().is_empty() && !about.help().ends_with('.'), "{}", about.field);
            assert!(!about.default.is_empty(), "{}", about.field);
            let same = L::TABLE.iter().filter(|other| other.about.key() == about.key());
            assert_eq!(same.count(), 1, "{}", about.field);
        }
    }
    check::<SceneOverrides>();
    check::<PaperOverrides>();
}
