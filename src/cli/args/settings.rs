//! Options for the settings of both presets, from the library's tables.
//!
//! Given values are stored as text, because the preset, and thus their type, is known only after all
//! options (and a checkpoint to resume) have been read. The texts are nevertheless checked at once.

use clap::builder::{OsStringValueParser, PossibleValue, PossibleValuesParser, TypedValueParser};
use clap::error::ErrorKind;
use clap::{Arg, ArgAction, ArgMatches, Args, Command, FromArgMatches};
use std::ffi::{OsStr, OsString};
use vbgs_studio::pipeline::settings::scene::SceneOverrides;
use vbgs_studio::train::paper::config::PaperOverrides;
use vbgs_studio::train::setting::table::{About, SettingLayer, Spelling};
use vbgs_studio::train::setting::value::ValueError;

/// Settings given on the command line.
pub struct SettingsArgs {
    given: Vec<(&'static str, OsString)>,
    with: Vec<String>,
    without: Vec<String>,
}

impl SettingsArgs {
    /// Returns the given settings of one preset.
    ///
    /// # Errors
    /// [`ValueError::File`] if a file named by an option cannot be used.
    pub fn layer<L: SettingLayer>(&self) -> Result<L, ValueError> {
        let mut layer = L::default();
        for setting in L::TABLE {
            if let Some(text) = self.text(&setting.about) {
                (setting.parse)(&mut layer, text)?;
            }
        }
        Ok(layer)
    }

    /// Returns the text given for an option such as `--seed`.
    pub fn given(&self, option: &str) -> Option<&OsStr> {
        self.given.iter().find(|(given, _)| *given == option).map(|(_, text)| text.as_os_str())
    }

    fn text(&self, about: &About) -> Option<&OsStr> {
        match about.spelling {
            Spelling::Option(option, _) => self.given(option),
            Spelling::Part(part) => {
                let is_in = |parts: &[String]| parts.iter().any(|given| given == part);
                let with = is_in(&self.with).then_some("true");
                with.or(is_in(&self.without).then_some("false")).map(OsStr::new)
            }
            Spelling::File => None,
        }
    }
}

/// Help headings of options specific to one preset.
const PAPER: &str = "Paper preset";
const SCENE: &str = "Scene preset";

/// All settings with an option, with their help heading (`None` if shared by both presets).
fn options() -> Vec<(&'static About, Option<&'static str>)> {
    let (paper, scene) = (with_option::<PaperOverrides>(), with_option::<SceneOverrides>());
    let is_in = |abouts: &[&About], key| abouts.iter().any(|about| about.key() == key);
    let of_paper = paper.iter().map(|about| {
        let is_shared = is_in(&scene, about.key());
        (*about, (!is_shared).then_some(PAPER))
    });
    let of_scene = scene.iter().filter(|about| !is_in(&paper, about.key()));
    of_paper.chain(of_scene.map(|about| (*about, Some(SCENE)))).collect()
}

fn with_option<L: SettingLayer>() -> Vec<&'static About> {
    let abouts = L::TABLE.iter().map(|setting| &setting.about);
    abouts.filter(|about| matches!(about.spelling, Spelling::Option(..))).collect()
}

/// Option name without dashes.
fn id(about: &'static About) -> &'static str {
    about.key().trim_start_matches('-')
}

fn option(about: &'static About, stands_for: &'static str) -> Arg {
    let help = format!("{} [default: {}]", about.help(), about.default);
    let arg = Arg::new(id(about)).long(id(about)).value_name(stands_for).help(help);
    let arg = arg.aliases(about.former_name).action(ArgAction::Set);
    let choices = (about.choices)();
    if !choices.is_empty() {
        let values = choices.iter().map(|choice| match choice.help {
            "" => PossibleValue::new(choice.name),
            help => PossibleValue::new(choice.name).help(help),
        });
        return arg.value_parser(PossibleValuesParser::new(values).map(OsString::from));
    }
    let arg = arg.allow_negative_numbers(true);
    // Files are read later: a damaged one is not wrong usage and has another exit status.
    if about.is_in_file {
        return arg.value_parser(OsStringValueParser::new());
    }
    let check = about.check_text;
    arg.value_parser(OsStringValueParser::new().try_map(move |text| check(&text).map(|()| text)))
}

/// Defines `--with` or `--without`.
fn parts(name: &'static str, help: &'static str) -> Arg {
    let parts = SceneOverrides::TABLE.iter().filter_map(|setting| {
        let about = &setting.about;
        let Spelling::Part(part) = about.spelling else { return None };
        let value = PossibleValue::new(part).help(about.help());
        Some(match about.former_name {
            Some(old) => value.alias(old),
            None => value,
        })
    });
    let arg = Arg::new(name).long(name).value_name("PART").help(help).help_heading(SCENE);
    let arg = arg.value_delimiter(',').action(ArgAction::Append);
    // clap passes aliases as typed.
    arg.value_parser(PossibleValuesParser::new(parts).map(|given| current_name(&given).to_owned()))
}

/// Returns the current name of a part given by its old name.
fn current_name(given: &str) -> &str {
    let parts = SceneOverrides::TABLE.iter().map(|setting| &setting.about);
    let named_so = |about: &&About| about.former_name == Some(given);
    match parts.filter(named_so).map(|about| about.spelling).next() {
        Some(Spelling::Part(part)) => part,
        _ => given,
    }
}

impl Args for SettingsArgs {
    fn augment_args(command: Command) -> Command {
        let command =
            options().into_iter().fold(command, |command, (about, heading)| match about.spelling {
                Spelling::Option(_, stands_for) => {
                    command.arg(option(about, stands_for).help_heading(heading))
                }
                Spelling::Part(_) | Spelling::File => command,
            });
        let with = "Enable parts that are off by default for this dataset or birth rule";
        command.arg(parts("without", "Disable parts")).arg(parts("with", with))
    }

    fn augment_args_for_update(command: Command) -> Command {
        Self::augment_args(command)
    }
}

impl FromArgMatches for SettingsArgs {
    fn from_arg_matches(matches: &ArgMatches) -> Result<Self, clap::Error> {
        let given = options().into_iter().filter_map(|(about, _)| {
            let text: &OsString = matches.get_one(id(about))?;
            Some((about.key(), text.clone()))
        });
        let parts =
            |name| matches.get_many::<String>(name).into_iter().flatten().cloned().collect();
        let (with, without): (Vec<String>, Vec<String>) = (parts("with"), parts("without"));
        if let Some(part) = with.iter().find(|part| without.contains(part)) {
            let message = format!(
                "--with {part}: expected one of --with and --without, found both; leave one out"
            );
            return Err(clap::Error::raw(ErrorKind::ArgumentConflict, message));
        }
        Ok(Self { given: given.collect(), with, without })
    }

    fn update_from_arg_matches(&mut self, matches: &ArgMatches) -> Result<(), clap::Error> {
        *self = Self::from_arg_matches(matches)?;
        Ok(())
    }
}
