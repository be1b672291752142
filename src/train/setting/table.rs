//! Table of a preset's settings: every option is declared once.
//!
//! From one declaration, `settings!` creates a struct of optional values (read from RON files, layered
//! by [`SettingLayer::or`]) and a constant table. Its rows parse a value from the command line and
//! apply it to a run's settings. They also check its range, and format both values for comparison. The
//! table defines command-line arguments and help, the rejection of the other preset's options, and
//! checks of resumed runs. It also defines the window's panel, preset files and the reference of
//! settings. Rows hold functions instead of values, so that settings retain their types; only messages
//! and comparisons are text.

use super::value::{Choice, ConfigError, Preset, ValueError};
use std::ffi::OsStr;

/// How a setting is given on the command line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Spelling {
    /// By its own option. The first text is the option, the second the placeholder of its value in help
    /// texts.
    Option(&'static str, &'static str),
    /// By its name with `--set NAME=VALUE`.
    Name,
}

/// Description of a setting, independent of its type.
#[derive(Clone, Copy)]
pub struct About {
    /// Name of the setting in files.
    pub field: &'static str,
    /// Name in messages, followed by the setting's option if it has one.
    pub name: &'static str,
    /// How the setting is given on the command line.
    pub spelling: Spelling,
    /// Label in the window; `None` if the setting is not shown there.
    pub label: Option<&'static str>,
    /// Default value, or a description of what the default depends on.
    pub default: &'static str,
    /// True if the default depends neither on the dataset nor on other settings.
    pub is_default_fixed: bool,
    /// Returns a description of the permitted values; `None` if all values of the type are permitted.
    pub range: Option<fn() -> String>,
    /// Returns all values, if they are few and named.
    pub choices: fn() -> Vec<Choice>,
    /// True if the option names a file that holds the value.
    pub is_in_file: bool,
    /// Checks that a text is a valid value; used before the preset is known.
    pub check_text: fn(&OsStr) -> Result<(), ValueError>,
    #[doc(hidden)]
    pub doc: &'static str,
}

impl About {
    /// Returns the help text. It consists of sentences; the last one has no full stop.
    pub fn help(&self) -> &'static str {
        let doc = self.doc.trim();
        doc.strip_suffix('.').unwrap_or(doc)
    }
}

/// A difference between a requested value and that of a stored run.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Conflict {
    /// Name of the setting in messages.
    pub setting: &'static str,
    /// Value of the stored run, if any.
    pub stored: Option<String>,
    /// Requested value.
    pub requested: String,
}

/// Table row of one setting of the layer (a set of user-specified settings) `L`.
pub struct Setting<L: SettingLayer> {
    /// Description of the setting, independent of its type.
    pub about: About,
    /// Returns the layer's value as text, if it is set.
    pub given: fn(&L) -> Option<String>,
    /// Returns the layer's value in the format of preset files, if it is set.
    pub ron: fn(&L) -> Result<Option<String>, ron::Error>,
    /// Sets the layer's value from text.
    pub parse: fn(&mut L, &OsStr) -> Result<(), ValueError>,
    /// Removes the layer's value, so that the layer below applies.
    pub clear: fn(&mut L),
    /// Returns a mutable reference to the layer's value if the setting is a boolean.
    pub flag: fn(&mut L) -> Option<&mut Option<bool>>,
    /// Writes the layer's value, if any, to a run's settings.
    pub apply: fn(&L, &mut L::Run),
    /// Returns a run's value as text, if any.
    pub stored: fn(&L::Run) -> Option<String>,
    /// True if a run's value is within the permitted range.
    pub is_in_range: fn(&L::Run) -> bool,
}

impl<L: SettingLayer> Setting<L> {
    /// Returns a conflict if the layer's value is set and differs from the run's.
    pub fn conflict(&self, layer: &L, run: &L::Run) -> Option<Conflict> {
        let (stored, requested) = ((self.stored)(run), (self.given)(layer)?);
        let setting = self.about.name;
        (stored.as_ref() != Some(&requested)).then_some(Conflict { setting, stored, requested })
    }
}

/// User-specified settings of one preset. A setting that is not set is taken from the next layer.
pub trait SettingLayer: Default + Sized + 'static {
    /// Settings of a run after all layers have been applied.
    type Run;
    /// Table of all settings, in the order in which they are applied and listed.
    const TABLE: &'static [Setting<Self>];

    /// Preset that the settings belong to.
    const PRESET: Preset;
    /// Example of a settings file, for messages.
    const EXAMPLE: &'static str;

    /// Combines two layers: values of `self` if set, else of `fallback`.
    fn or(self, fallback: Self) -> Self;

    /// Writes all set values to a run's settings.
    fn apply(&self, run: &mut Self::Run) {
        Self::TABLE.iter().for_each(|setting| (setting.apply)(self, run));
    }

    /// Checks the ranges of all settings of a run.
    ///
    /// # Errors
    /// [`ConfigError`] for the first setting out of range.
    fn check(run: &Self::Run) -> Result<(), ConfigError> {
        match Self::TABLE.iter().find(|setting| !(setting.is_in_range)(run)) {
            None => Ok(()),
            Some(Setting { about, stored, .. }) => Err(ConfigError {
                setting: about.name,
                expected: about.range.map_or_else(String::new, |range| range()),
                found: stored(run).unwrap_or_default(),
            }),
        }
    }

    /// Returns the first conflict: a value that is set in this layer and differs from the run's.
    fn conflict(&self, run: &Self::Run) -> Option<Conflict> {
        Self::TABLE.iter().find_map(|setting| setting.conflict(self, run))
    }

    /// Returns the name and value of the first setting that has a value here but does not exist in `Other`.
    fn first_unsupported_by<Other: SettingLayer>(&self) -> Option<(&'static str, String)> {
        let is_shared = |field| Other::TABLE.iter().any(|other| other.about.field == field);
        let mut own = Self::TABLE.iter().filter(|setting| !is_shared(setting.about.field));
        own.find_map(|setting| Some((setting.about.name, (setting.given)(self)?)))
    }
}

/// Declares the settings of a preset: a [`SettingLayer`] with an example file, and its table. For each
/// setting:
///
/// * the doc comment is its help text;
/// * `option "--name" "VALUE"` gives it an option of its own; others are set by `--set NAME=VALUE`;
/// * `label "Name"` shows it in the window;
/// * `default "text"` is the default value, `default by "text"` describes what it depends on;
/// * `range "text", |value| test` restricts its values;
/// * `below other` drops a lower layer's value if this layer sets `other`;
/// * `at |run| place`, or `get` and `set`, access it in a run's settings.
macro_rules! settings {
    (
        $(#[$meta:meta])*
        pub struct $layer:ident of $run:ty, $preset:expr, such as $example:literal;
        $(
            $(#[doc = $doc:literal])+
            $field:ident: $value:ty {
                $(option $option:literal $stands:literal;)?
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
                pub $field: Option<$value>,
            )+
        }

        impl $crate::train::setting::table::SettingLayer for $layer {
            type Run = $run;
            const TABLE: &'static [$crate::train::setting::table::Setting<Self>] = {
                use $crate::train::setting::table::{About, Setting};
                use $crate::train::setting::value::{SettingValue, text_of};
                &[$(Setting {
                    about: About {
                        field: stringify!($field),
                        name: settings!(@name $field $($option)?),
                        spelling: settings!(@spelling $($option $stands)?),
                        label: settings!(@optional $($label)?),
                        default: concat!($($default)? $($depends)?),
                        is_default_fixed: settings!(@is_given $($default)?),
                        range: settings!(@optional $(|| format!($range))?),
                        choices: <$value as SettingValue>::choices,
                        is_in_file: <$value as SettingValue>::IS_FILE,
                        check_text: |text| <$value as SettingValue>::parse(text).map(drop),
                        doc: concat!($($doc),+),
                    },
                    given: |layer| layer.$field.as_ref().map(text_of),
                    ron: |layer| layer.$field.as_ref().map(ron::to_string).transpose(),
                    parse: |layer, text| {
                        layer.$field = Some(SettingValue::parse(text)?);
                        Ok(())
                    },
                    clear: |layer| layer.$field = None,
                    flag: |layer| SettingValue::flag(&mut layer.$field),
                    apply: |layer, run| {
                        if let Some(value) = layer.$field.clone() {
                            $(let $at = run; $place = value;)?
                            $(let ($set_in, $new) = (run, value); $set;)?
                        }
                    },
                    stored: |run| {
                        let value: Option<$value> = {
                            $(let $at = run; Some(Clone::clone(&$place)))?
                            $(let $got = run; $get)?
                        };
                        value.as_ref().map(text_of)
                    },
                    // Settings without a range use neither name, hence the underscores.
                    is_in_range: |_run| {
                        let _value: Option<$value> = {
                            $(let $at = _run; Some(Clone::clone(&$place)))?
                            $(let $got = _run; $get)?
                        };
                        $(if let Some($tested) = &_value {
                            return $test;
                        })?
                        true
                    },
                },)+]
            };

            const PRESET: $crate::train::setting::Preset = $preset;
            const EXAMPLE: &'static str = $example;

            fn or(self, fallback: Self) -> Self {
                Self {
                    // Cloned, since the rule `below` reads another field of `self`.
                    $($field: self.$field.clone().or(
                        fallback.$field$(.filter(|_| self.$above.is_none()))?
                    ),)+
                }
            }
        }
    };
    (@optional) => { None };
    (@optional $value:expr) => { Some($value) };
    (@name $field:ident) => { stringify!($field) };
    (@name $field:ident $option:literal) => { concat!(stringify!($field), " (`", $option, "`)") };
    (@spelling) => { $crate::train::setting::table::Spelling::Name };
    (@spelling $option:literal $stands:literal) => {
        $crate::train::setting::table::Spelling::Option($option, $stands)
    };
    (@is_given) => { false };
    (@is_given $default:literal) => { true };
}
pub(crate) use settings;
