//! The table of a preset's settings: every option is declared once.
//!
//! `settings!` makes of one declaration the struct of what a user asks for (read from RON files,
//! layered by [`SettingLayer::or`]), and a constant table whose rows know how to read a value from
//! the command line, put it into a run's settings, check its range and compare it with a stored
//! run's. Everything that speaks of settings walks that table: the arguments and their help, the
//! refusal of the other preset's options, the check of a run that goes on, the window's panel, the
//! preset files and the tables of the README. A row holds functions, not values, so that settings
//! keep their own types and comparisons are typed; only messages are text.

use super::preset::Preset;
use super::range::ConfigError;
use super::value::{Choice, ValueError};
use std::ffi::OsStr;

/// How the command line says a setting.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Spelling {
    /// An option and what stands for its value in help texts.
    Option(&'static str, &'static str),
    /// A part of the preset, left out by `--without` and asked for by `--with`.
    Part(&'static str),
    /// Not at all: it is only in files.
    File,
}

/// Says whether a text is a value of some setting.
pub type TextCheck = fn(&OsStr) -> Result<(), ValueError>;

/// A run's value of a setting, if it has one, and the value asked for, as messages show them.
pub type StoredAndAsked = (Option<String>, String);

/// What there is to say of a setting, whatever its type.
#[derive(Clone, Copy)]
pub struct About {
    /// Name in files.
    pub field: &'static str,
    /// Its name in older versions, one word: files and options of that name are understood.
    pub old: Option<&'static str>,
    /// On the command line.
    pub spelling: Spelling,
    /// In the window; `None` if it is not there.
    pub label: Option<&'static str>,
    /// The value that it has if nobody sets it, or what that depends on.
    pub default: &'static str,
    /// Whether the default is one value, whatever the dataset and the other settings.
    pub is_default_fixed: bool,
    /// Legal values where not every value of the type is.
    pub range: Option<fn() -> String>,
    /// All values, where they are few and have names.
    pub choices: fn() -> Vec<Choice>,
    /// Whether the option names a file that holds the value.
    pub is_in_file: bool,
    /// Whether a text is a value, before it is known which preset is meant.
    pub check_text: TextCheck,
    doc: &'static str,
}

impl About {
    #[doc(hidden)]
    #[expect(clippy::too_many_arguments, reason = "called by `settings!` alone, in this order")]
    pub const fn new(
        field: &'static str,
        old: Option<&'static str>,
        spelling: Spelling,
        label: Option<&'static str>,
        (default, is_default_fixed): (&'static str, bool),
        range: Option<fn() -> String>,
        choices: fn() -> Vec<Choice>,
        (is_in_file, check_text): (bool, TextCheck),
        doc: &'static str,
    ) -> Self {
        Self {
            field,
            old,
            spelling,
            label,
            default,
            is_default_fixed,
            range,
            choices,
            is_in_file,
            check_text,
            doc,
        }
    }

    /// What it does: sentences, the last without its full stop.
    pub fn help(&self) -> &'static str {
        let doc = self.doc.trim();
        doc.strip_suffix('.').unwrap_or(doc)
    }

    /// As messages name it.
    pub fn name(&self) -> String {
        match self.spelling {
            Spelling::Option(option, _) => option.to_owned(),
            Spelling::Part(part) => format!("--with or --without {part}"),
            Spelling::File => self.field.to_owned(),
        }
    }

    /// Its option, or its name in files where it has none of its own.
    pub fn key(&self) -> &'static str {
        match self.spelling {
            Spelling::Option(option, _) => option,
            Spelling::Part(_) | Spelling::File => self.field,
        }
    }
}

/// A value asked for that is not the one that a run was begun with.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Conflict {
    /// The setting, as messages name it.
    pub setting: String,
    /// The run's value, if it has any.
    pub stored: Option<String>,
    /// The value asked for.
    pub asked: String,
}

/// One setting of the layer `L`.
pub struct Setting<L: SettingLayer> {
    /// What there is to say of it.
    pub about: About,
    /// The value that a layer gives it, as text.
    pub given: fn(&L) -> Option<String>,
    /// The same as a preset file has it.
    pub ron: fn(&L) -> Result<Option<String>, ron::Error>,
    /// Gives it the value that a text says.
    pub parse: fn(&mut L, &OsStr) -> Result<(), ValueError>,
    /// Leaves it to the layer below.
    pub clear: fn(&mut L),
    /// Its slot in a layer, if it is on or off.
    pub flag: fn(&mut L) -> Option<&mut Option<bool>>,
    /// Puts the value, if one is given, into a run's settings.
    pub apply: fn(&L, &mut L::Run),
    /// Its range and its value in a run, if that is outside.
    pub outside: fn(&L::Run) -> Option<(String, String)>,
    /// A value asked for that is not a run's: the run's, if it has any, and the one asked for.
    pub differs: fn(&L, &L::Run) -> Option<StoredAndAsked>,
}

/// What a user asks for of the settings of one preset; what is not given is as the layer below has
/// it.
pub trait SettingLayer: Default + Sized + 'static {
    /// All settings of a run.
    type Run;
    /// Every setting, in the order in which they are applied and listed.
    const TABLE: &'static [Setting<Self>];

    /// The preset whose settings they are.
    const PRESET: Preset;
    /// An example of a file with some of them, for messages.
    const EXAMPLE: &'static str;

    /// These settings where given, `fallback`'s elsewhere.
    fn or(self, fallback: Self) -> Self;

    /// Puts what is given into a run's settings.
    fn apply(&self, run: &mut Self::Run) {
        Self::TABLE.iter().for_each(|setting| (setting.apply)(self, run));
    }

    /// The first setting of a run that is out of its range.
    ///
    /// # Errors
    /// [`ConfigError`] names the setting as files do.
    fn check(run: &Self::Run) -> Result<(), ConfigError> {
        Self::TABLE.iter().try_for_each(|setting| match (setting.outside)(run) {
            None => Ok(()),
            Some((expected, found)) => {
                Err(ConfigError { setting: setting.about.field, expected, found })
            }
        })
    }

    /// The first setting given that is not as a run has it.
    fn conflict(&self, run: &Self::Run) -> Option<Conflict> {
        Self::TABLE.iter().find_map(|setting| {
            let (stored, asked) = (setting.differs)(self, run)?;
            Some(Conflict { setting: setting.about.name(), stored, asked })
        })
    }

    /// The first setting given that `Other` has no option for, and its value.
    fn foreign_to<Other: SettingLayer>(&self) -> Option<(&'static About, String)> {
        Self::TABLE.iter().find_map(|setting| {
            let key = setting.about.key();
            let is_shared = Other::TABLE.iter().any(|other| other.about.key() == key);
            let value = (setting.given)(self).filter(|_| !is_shared)?;
            Some((&setting.about, value))
        })
    }
}

/// Declares the settings of a preset: a [`SettingLayer`] with an example of a file that gives some, and
/// its table. Of every setting:
///
/// * its doc comment is its help everywhere;
/// * `option "--name" "VALUE"`, `part "name"` or `file` is how the command line says it;
/// * `was "word"` is its name in older files and on older command lines;
/// * `label "Name"` puts it into the window;
/// * `default "text"` is the value of a run in which nobody sets it, `default by "text"` says what
///   that value depends on;
/// * `range "text", |value| test` is what a value must be;
/// * `below other` leaves a lower layer's value out where this one gives `other`;
/// * `at |run| place` is where a run's settings hold it, or `get` and `set` are how.
macro_rules! settings {
    (
        $(#[$meta:meta])*
        pub struct $layer:ident of $run:ty, $preset:expr, such as $example:literal;
        $(
            $(#[doc = $doc:literal])+
            $field:ident: $value:ty {
                $(option $option:literal $stands:literal;)?
                $(part $part:literal;)?
                $(file;)?
                $(was $old:literal;)?
                $(label $label:literal;)?
                $(default $default:literal;)?
                $(default by $depends:literal;)?
                $(range $range:literal, |$tested:ident| $test:expr;)?
                $(below $above:ident;)?
                $(at |$at:ident| $place:expr;)?
                $(get |$got:ident| $get:expr; set |$set_in:ident, $new:ident| $set:expr;)?
            }
        )+
    ) => {
        #[derive(Clone, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
        $(#[$meta])*
        #[serde(default, deny_unknown_fields)]
        pub struct $layer {
            $(
                $(#[doc = $doc])+
                $(#[serde(alias = $old)])?
                pub $field: Option<$value>,
            )+
        }

        impl $crate::train::setting::table::SettingLayer for $layer {
            type Run = $run;
            const TABLE: &'static [$crate::train::setting::table::Setting<Self>] = &[
                $($crate::train::setting::table::Setting {
                    about: $crate::train::setting::table::About::new(
                        stringify!($field),
                        settings!(@optional $($old)?),
                        settings!(@spelling $($option $stands)? $(part $part)?),
                        settings!(@optional $($label)?),
                        settings!(@default $($default)? $(by $depends)?),
                        settings!(@optional $(|| format!($range))?),
                        <$value as $crate::train::setting::value::SettingValue>::choices,
                        (
                            <$value as $crate::train::setting::value::SettingValue>::IS_FILE,
                            |text| {
                                <$value as $crate::train::setting::value::SettingValue>::parse(text)
                                    .map(drop)
                            },
                        ),
                        concat!($($doc),+),
                    ),
                    given: |layer| layer.$field.as_ref().map($crate::train::setting::value::text_of),
                    ron: |layer| layer.$field.as_ref().map(ron::to_string).transpose(),
                    parse: |layer, text| {
                        layer.$field =
                            Some($crate::train::setting::value::SettingValue::parse(text)?);
                        Ok(())
                    },
                    clear: |layer| layer.$field = None,
                    flag: |layer| {
                        $crate::train::setting::value::SettingValue::flag(&mut layer.$field)
                    },
                    apply: |layer, run| {
                        if let Some(value) = layer.$field.clone() {
                            $(let $at = run; $place = value;)?
                            $(let ($set_in, $new) = (run, value); $set;)?
                        }
                    },
                    outside: |_run| {
                        let _value: Option<$value> = {
                            $(let $at = _run; Some(Clone::clone(&$place)))?
                            $(let $got = _run; $get)?
                        };
                        $(
                            if let Some($tested) = &_value && !$test {
                                let found = $crate::train::setting::value::text_of($tested);
                                return Some((format!($range), found));
                            }
                        )?
                        None
                    },
                    differs: |layer, run| {
                        let asked = layer.$field.as_ref()?;
                        let stored: Option<$value> = {
                            $(let $at = run; Some(Clone::clone(&$place)))?
                            $(let $got = run; $get)?
                        };
                        let text = $crate::train::setting::value::text_of;
                        (stored.as_ref() != Some(asked))
                            .then(|| (stored.as_ref().map(text), text(asked)))
                    },
                },)+
            ];

            const PRESET: $crate::train::setting::Preset = $preset;
            const EXAMPLE: &'static str = $example;

            fn or(self, fallback: Self) -> Self {
                Self {
                    $($field: self.$field.clone().or(
                        fallback.$field$(.filter(|_| self.$above.is_none()))?
                    ),)+
                }
            }
        }
    };
    (@optional) => { None };
    (@optional $value:expr) => { Some($value) };
    (@spelling) => { $crate::train::setting::table::Spelling::File };
    (@spelling $option:literal $stands:literal) => {
        $crate::train::setting::table::Spelling::Option($option, $stands)
    };
    (@spelling part $part:literal) => { $crate::train::setting::table::Spelling::Part($part) };
    (@default $default:literal) => { ($default, true) };
    (@default by $depends:literal) => { ($depends, false) };
}
pub(crate) use settings;
