//! Settings of `train`: options of both presets from the library's tables, `--set NAME=VALUE` for all others,
//! and the settings file.
//!
//! Given values are stored as text, because the preset, and thus their type, is known only after all
//! options (and a checkpoint to resume) have been read. The texts are nevertheless checked at once.

use super::{TrainArgs, parse_count, parse_passes, parse_seconds};
use crate::cli::failure::Failure;
use anyhow::anyhow;
use clap::builder::{OsStringValueParser, PossibleValue, PossibleValuesParser, TypedValueParser};
use clap::error::ErrorKind;
use clap::{Arg, ArgAction, ArgMatches, Args, Command, FromArgMatches};
use serde::de::DeserializeOwned;
use std::ffi::{OsStr, OsString};
use std::path::Path;
use vbgs_studio::dataset::read_settings;
use vbgs_studio::pipeline::autosave::AutosaveInterval;
use vbgs_studio::pipeline::checkpoint::ResumeRequest;
use vbgs_studio::pipeline::plan::{Order, Selection};
use vbgs_studio::pipeline::settings::method::MethodRequest;
use vbgs_studio::pipeline::settings::scene::SceneOverrides;
use vbgs_studio::pipeline::settings::{GivenSettings, preset_file};
use vbgs_studio::train::paper::config::PaperOverrides;
use vbgs_studio::train::setting::Preset;
use vbgs_studio::train::setting::table::{About, SettingLayer, Spelling};
use vbgs_studio::train::setting::value::ValueError;

pub struct SettingsArgs {
    given: Vec<(&'static str, OsString)>,
    pub run: RunSettings,
}

/// Settings of a run that apply to both presets and have no command-line option.
#[derive(Clone, Copy, Default)]
pub struct RunSettings {
    pub order: Option<Order>,
    pub passes: Option<usize>,
    pub stride: Option<usize>,
    /// `None` is the default interval.
    pub autosave: Option<AutosaveInterval>,
}

type SetRun = fn(&mut RunSettings, &str) -> Result<(), String>;

/// Names of [`RunSettings`] for `--set`, each with its description and the function that sets it.
const RUN_SETTINGS: [(&str, &str, SetRun); 4] = [
    ("order", "order of the frames: sequential (default) or shuffled", |run, text| {
        let order = text.parse();
        let wrong = |_| format!("expected sequential or shuffled, found `{text}`");
        run.order = Some(order.map_err(wrong)?);
        Ok(())
    }),
    (
        "passes",
        "times the frames are used; from the second on only photographs train. With --resume earlier passes count",
        |run, text| parse_passes(text).map(|n| run.passes = Some(n)),
    ),
    ("stride", "use every N-th frame", |run, text| parse_count(text).map(|n| run.stride = Some(n))),
    (
        "autosave",
        "save the checkpoint every N frames, or every Ns seconds (default 30s), or off; the previous one is kept as checkpoint.vbgs.bak",
        |run, text| {
            let interval = run.autosave.get_or_insert_default();
            match (text, text.strip_suffix('s')) {
                ("off", _) => *interval = AutosaveInterval::default(),
                (_, Some(seconds)) => interval.time = Some(parse_seconds(seconds)?),
                (_, None) => interval.frames = Some(parse_count(text)?),
            }
            Ok(())
        },
    ),
];

impl SettingsArgs {
    pub fn layer<L: SettingLayer>(&self) -> Result<L, ValueError> {
        let mut layer = L::default();
        for setting in L::TABLE {
            if let Some(text) = self.given(setting.about.field) {
                (setting.parse)(&mut layer, text)?;
            }
        }
        Ok(layer)
    }

    /// Returns the text given for a setting, identified by its name in files. The last value given takes
    /// precedence.
    pub fn given(&self, field: &str) -> Option<&OsStr> {
        let mut given = self.given.iter().rev();
        given.find(|(name, _)| *name == field).map(|(_, text)| text.as_os_str())
    }

    fn set(&mut self, assignment: &str) -> Result<(), String> {
        let (name, text) = assignment
            .split_once('=')
            .ok_or_else(|| format!("--set {assignment}: expected NAME=VALUE, such as seed=3"))?;
        // Options contain hyphens, files underscores; both spellings name the same setting.
        let name = name.trim().replace('-', "_");
        if let Some((_, _, set)) = RUN_SETTINGS.iter().find(|(run, ..)| *run == name) {
            return set(&mut self.run, text).map_err(|wrong| format!("--set {name}: {wrong}"));
        }
        // Both presets may have a setting of this name, with different values.
        let mut wrong = None;
        for about in all_settings().filter(|about| about.field == name) {
            match (about.check_text)(OsStr::new(text)) {
                Ok(()) => {
                    self.given.push((about.field, text.into()));
                    return Ok(());
                }
                Err(error) => wrong = Some(format!("--set {name}: {error}")),
            }
        }
        Err(wrong.unwrap_or_else(|| {
            format!(
                "--set {name}: no such setting; docs/reference/settings.md and `--config scene` list them"
            )
        }))
    }
}

fn all_settings() -> impl Iterator<Item = &'static About> {
    let of_scene = SceneOverrides::TABLE.iter().map(|setting| &setting.about);
    of_scene.chain(PaperOverrides::TABLE.iter().map(|setting| &setting.about))
}

fn options() -> impl Iterator<Item = (&'static About, &'static str, &'static str)> {
    // No option belongs to both presets.
    all_settings().filter_map(|about| match about.spelling {
        Spelling::Option(option, placeholder) => {
            Some((about, option.trim_start_matches('-'), placeholder))
        }
        Spelling::Name => None,
    })
}

fn option((about, id, placeholder): (&'static About, &'static str, &'static str)) -> Arg {
    let help = format!("{} [default: {}]", about.help(), about.default);
    let arg = Arg::new(id).long(id).value_name(placeholder).help(help).action(ArgAction::Set);
    // Listed values appear in the help and in errors.
    let choices = (about.choices)();
    if !choices.is_empty() {
        let values = choices.iter().map(|choice| match choice.help {
            "" => PossibleValue::new(choice.name),
            help => PossibleValue::new(choice.name).help(help),
        });
        return arg.value_parser(PossibleValuesParser::new(values).map(OsString::from));
    }
    // Otherwise clap reports `-5` as an unknown option.
    let arg = arg.allow_negative_numbers(true);
    // Files are read later: a damaged one is not wrong usage and has another exit status.
    if about.is_in_file {
        return arg.value_parser(OsStringValueParser::new());
    }
    let check = about.check_text;
    arg.value_parser(OsStringValueParser::new().try_map(move |text| check(&text).map(|()| text)))
}

impl Args for SettingsArgs {
    fn augment_args(command: Command) -> Command {
        let command = options().map(option).fold(command, Command::arg);
        let of_run = RUN_SETTINGS.map(|(name, meaning, _)| format!("  {name}: {meaning}\n"));
        let help = format!(
            "Set any other setting by its name, such as `--set seed=3` or `--set refine=false`; \
             docs/reference/settings.md lists those of the presets. Of the run:\n{}",
            of_run.concat()
        );
        let set = Arg::new("set").long("set").value_name("NAME=VALUE").help(help);
        command.arg(set.action(ArgAction::Append).value_parser(OsStringValueParser::new()))
    }

    fn augment_args_for_update(command: Command) -> Command {
        Self::augment_args(command)
    }
}

impl FromArgMatches for SettingsArgs {
    fn from_arg_matches(matches: &ArgMatches) -> Result<Self, clap::Error> {
        let given = options().filter_map(|(about, id, _)| {
            let text: &OsString = matches.get_one(id)?;
            Some((about.field, text.clone()))
        });
        let mut args = Self { given: given.collect(), run: RunSettings::default() };
        // Behind the options, over which `--set` takes precedence.
        for assignment in matches.get_many::<OsString>("set").into_iter().flatten() {
            args.set(&assignment.to_string_lossy())
                // A raw error lacks the final newline of clap's other errors.
                .map_err(|message| clap::Error::raw(ErrorKind::ValueValidation, message + "\n"))?;
        }
        Ok(args)
    }

    fn update_from_arg_matches(&mut self, matches: &ArgMatches) -> Result<(), clap::Error> {
        *self = Self::from_arg_matches(matches)?;
        Ok(())
    }
}

pub fn selection(args: &TrainArgs) -> Selection {
    let (everything, run) = (Selection::all_frames(), args.settings.run);
    Selection {
        split: args.split.clone(),
        order: run.order.unwrap_or(everything.order),
        stride: run.stride.unwrap_or(everything.stride),
        shard: args.shard,
        start_frames: everything.start_frames,
        followed_split: None,
        max_frames: args.max_frames,
        passes: run.passes.unwrap_or(everything.passes),
        follow: args.follow,
        hold_out: args.hold_out.unwrap_or(everything.hold_out),
    }
}

/// Returns all settings given for a run, on the command line and in the settings file. `preset` is the
/// preset of the run.
pub fn resume_request(args: &TrainArgs, preset: Preset) -> Result<ResumeRequest, Failure> {
    Ok(ResumeRequest {
        preset: args.preset,
        model: GivenSettings { paper: layer(args, preset)?, scene: layer(args, preset)? },
        split: args.split.clone(),
        order: args.settings.run.order,
        stride: args.settings.run.stride,
        shard: args.shard,
        load: args.reading.load_options(),
        max_frames: args.max_frames,
        passes: args.settings.run.passes,
        follow: args.follow,
        hold_out: args.hold_out,
    })
}

pub fn method_request(args: &TrainArgs) -> Result<MethodRequest, Failure> {
    let preset = args.preset.unwrap_or(Preset::Scene);
    let given = resume_request(args, preset)?.model;
    // A setting of the other preset would have no effect.
    let Some((setting, _)) = given.foreign_to(preset) else { return Ok(given.request(preset)?) };
    let other = if preset == Preset::Scene { Preset::Paper } else { Preset::Scene };
    Err(usage!("{setting}: expected `--preset {other}` with it, found the preset {preset}"))
}

pub fn calibration_file(args: &TrainArgs) -> Option<&Path> {
    // The error then names the file that contains the calibration.
    let given = args.settings.given("calibration").map(Path::new);
    given.or(args.resume.as_deref()).or(args.config.as_deref())
}

/// Combines the command-line settings for the preset of `L` with those of the settings file. The file is
/// read only if `meant` is this preset.
fn layer<L: SettingLayer + DeserializeOwned>(
    args: &TrainArgs,
    meant: Preset,
) -> Result<L, Failure> {
    let said: L = args.settings.layer()?;
    match &args.config {
        // The file would not parse as settings of the other preset.
        Some(path) if meant == L::PRESET => Ok(said.or(read_config(path)?)),
        Some(_) | None => Ok(said),
    }
}

/// Reads settings from a file. If there is no such file and `path` is the name of a preset, returns the
/// preset's defaults.
fn read_config<L: SettingLayer + DeserializeOwned>(path: &Path) -> Result<L, Failure> {
    // An existing file takes precedence over a preset of the same name.
    let by_name = path.to_str().filter(|_| !path.exists()).and_then(|name| name.parse().ok());
    let text = match by_name {
        Some(preset) => preset_file(preset).to_owned(),
        None => read_settings(path).map_err(|found| {
            anyhow!(
                "{}: expected a RON file with settings, found: {found}; check the path and its permissions",
                path.display()
            )
        })?,
    };
    let options =
        // Files contain `seed: 7` instead of `seed: Some(7)`.
        ron::Options::default().with_default_extension(ron::extensions::Extensions::IMPLICIT_SOME);
    Ok(options.from_str(&text).map_err(|found| {
        anyhow!(
            "{}: expected settings such as {}, found: {found}; correct this place",
            path.display(),
            L::EXAMPLE
        )
    })?)
}
