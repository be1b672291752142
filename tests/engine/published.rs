//! The preset files and the reference of settings are generated from the settings tables of the code.

use super::checkpoint::room_of;
use serde::de::DeserializeOwned;
use std::fs;
use std::path::{Path, PathBuf};
use vbgs_studio::pipeline::plan::{Plan, Selection};
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
    let room = room_of(2, 4);
    let plan = Plan::new(&room, &Selection::all_frames(), 0).unwrap();
    let scene: SceneOverrides = embedded(Preset::Scene);
    let plain = SceneRun::new(&room, &plan, &SceneOverrides::default()).unwrap();
    let asked = SceneRun::new(&room, &plan, &scene).unwrap();
    assert_eq!(scene.conflict(&plain), None);
    assert_eq!(SceneRun { budget: None, ..asked }, plain);
}

#[test]
fn the_tables_say_a_scenes_defaults() {
    let room = room_of(2, 4);
    let plan = Plan::new(&room, &Selection::all_frames(), 0).unwrap();
    let run = SceneRun::new(&room, &plan, &SceneOverrides::default()).unwrap();
    for setting in SceneOverrides::TABLE.iter().filter(|s| s.about.is_default_fixed) {
        let layer = layer_of(setting);
        assert_eq!(setting.conflict(&layer, &run), None, "{}", setting.about.field);
        let mut changed = run.clone();
        (setting.apply)(&layer, &mut changed);
        assert_eq!(setting.conflict(&layer, &changed), None, "{}", setting.about.field);
    }
}

fn row<L: SettingLayer>(setting: &Setting<L>) -> String {
    let about = &setting.about;
    let option = match about.spelling {
        Spelling::Option(option, value) => format!("`{option} {value}`"),
        Spelling::Name => format!("`--set {}=…`", about.field),
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
    let head = "| option | in files | default | meaning |\n|---|---|---|---|\n";
    L::TABLE.iter().fold(head.to_owned(), |text, setting| text + &row(setting))
}

#[test]
fn the_reference_lists_every_setting() {
    let scene = table_of::<SceneOverrides>();
    let paper = table_of::<PaperOverrides>();
    let text = format!(
        "# Settings\n\nGenerated from the settings tables of the code by `{WRITE}=1 cargo test --release --test engine published`; do not \
         edit.\nA settings file (`--config FILE.ron`) names any of them, as in [`assets/presets`](../../assets/presets).\n\n\
         ## Preset `scene`\n\n{scene}\n## Preset `paper`\n\n{paper}"
    );
    hold("docs/reference/settings.md", &text);
}
