//! The options of both presets' settings, as the tables of the library declare them.
//!
//! `clap` is told of every row of the tables, and what the user said is kept as text: which preset
//! is meant, and so what a text becomes, is known only when all options (and a checkpoint to go on
//! with) are. Texts are checked at once all the same.

use clap::builder::{OsStringValueParser, PossibleValue, PossibleValuesParser, TypedValueParser};
use clap::error::ErrorKind;
use clap::{Arg, ArgAction, ArgMatches, Args, Command, FromArgMatches};
use std::ffi::{OsStr, OsString};
use vbgs_studio::pipeline::settings::scene::SceneOverrides;
use vbgs_studio::train::paper::config::PaperOverrides;
use vbgs_studio::train::setting::table::{About, SettingLayer, Spelling};
use vbgs_studio::train::setting::value::ValueError;

/// What the command line says of settings.
pub struct SettingsArgs {
    given: Vec<(&'static str, OsString)>,
    with: Vec<String>,
    without: Vec<String>,
}

impl SettingsArgs {
    /// What is said of the settings of one preset.
    ///
    /// # Errors
    /// [`ValueError::File`] if a file that an option names cannot be used.
    pub fn layer<L: SettingLayer>(&self) -> Result<L, ValueError> {
        let mut layer = L::default();
        for setting in L::TABLE {
            if let Some(text) = self.text(&setting.about) {
                (setting.parse)(&mut layer, text)?;
            }
        }
        Ok(layer)
    }

    /// What the command line says of an option, by its name with dashes.
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

/// Headings of the options that only one preset has.
const PAPER: &str = "Paper preset";
const SCENE: &str = "Scene preset";

/// Every setting with an option of its own, and its heading in the help: none if both presets have
/// it.
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

/// An option without its dashes.
fn id(about: &'static About) -> &'static str {
    about.key().trim_start_matches('-')
}

fn option(about: &'static About, stands_for: &'static str) -> Arg {
    let help = format!("{} [default: {}]", about.help(), about.default);
    let arg = Arg::new(id(about)).long(id(about)).value_name(stands_for).help(help);
    let arg = arg.aliases(about.old).action(ArgAction::Set);
    let choices = (about.choices)();
    if !choices.is_empty() {
        let values = choices.iter().map(|choice| match choice.help {
            "" => PossibleValue::new(choice.name),
            help => PossibleValue::new(choice.name).help(help),
        });
        return arg.value_parser(PossibleValuesParser::new(values).map(OsString::from));
    }
    let arg = arg.allow_negative_numbers(true);
    // Files are read later: a damaged one is no wrong usage and must not end with its status.
    if about.is_in_file {
        return arg.value_parser(OsStringValueParser::new());
    }
    let check = about.check_text;
    arg.value_parser(OsStringValueParser::new().try_map(move |text| check(&text).map(|()| text)))
}

/// `--with` and `--without`.
fn parts(name: &'static str, help: &'static str) -> Arg {
    let parts = SceneOverrides::TABLE.iter().filter_map(|setting| {
        let about = &setting.about;
        let Spelling::Part(part) = about.spelling else { return None };
        let value = PossibleValue::new(part).help(about.help());
        Some(match about.old {
            Some(old) => value.alias(old),
            None => value,
        })
    });
    let arg = Arg::new(name).long(name).value_name("PART").help(help).help_heading(SCENE);
    let arg = arg.value_delimiter(',').action(ArgAction::Append);
    // clap hands over what was typed, be it an alias.
    arg.value_parser(PossibleValuesParser::new(parts).map(|given| current_name(&given).to_owned()))
}

/// What a part that was given by its old name is called now.
fn current_name(given: &str) -> &str {
    let parts = SceneOverrides::TABLE.iter().map(|setting| &setting.about);
    let named_so = |about: &&About| about.old == Some(given);
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
        let with = "Ask for parts that this dataset or birth rule leaves out";
        command.arg(parts("without", "Leave parts out")).arg(parts("with", with))
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
