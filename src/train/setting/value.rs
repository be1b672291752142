//! Values of settings, and how they are parsed from text.

use serde::{Deserialize, Serialize};
use std::ffi::OsStr;
use std::fmt::Debug;
use strum::{Display, EnumString, VariantNames};

/// A named value of a setting.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Choice {
    /// Name of the value on the command line.
    pub name: &'static str,
    /// Label of the value in the window.
    pub label: &'static str,
    /// Meaning of the value, one sentence without a full stop; empty if the name suffices.
    pub help: &'static str,
}

/// Error of parsing a setting's value.
#[derive(Debug, thiserror::Error)]
pub enum ValueError {
    /// Message with the expected and the found value.
    #[error("{0}")]
    Text(String),
    /// Error in the file that the option names.
    #[error(transparent)]
    File(Box<dyn std::error::Error + Send + Sync>),
}

/// Type of the value of a setting, as parsed from a command-line option.
pub trait SettingValue: Clone + PartialEq + Debug + Serialize {
    /// True if the option names a file that holds the value.
    const IS_FILE: bool = false;

    /// Returns all values, if they are few and named.
    fn choices() -> Vec<Choice> {
        Vec::new()
    }

    /// Parses the text after an option.
    ///
    /// # Errors
    /// [`ValueError`] states what was expected.
    fn parse(text: &OsStr) -> Result<Self, ValueError>;

    /// Returns `slot` itself if its type is a boolean; `None` for other types.
    fn flag(_: &mut Option<Self>) -> Option<&mut Option<bool>> {
        None
    }
}

/// Formats a value for messages: as JSON, with strings unquoted, and numbers in the shortest exact form.
/// Values without a JSON form (NaN) use Rust's debug format.
pub fn text_of(value: &(impl Serialize + Debug)) -> String {
    match serde_json::to_value(value) {
        Ok(serde_json::Value::String(text)) => text,
        Ok(serde_json::Value::Null) => format!("{value:?}"),
        Ok(serde_json::Value::Number(number)) => number
            .as_f64()
            // `serde_json` writes 1.0 where a user writes 1.
            .filter(|_| number.is_f64())
            .map_or(number.to_string(), |x| x.to_string()),
        Ok(other) => other.to_string(),
        Err(_) => format!("{value:?}"),
    }
}

/// Implements [`SettingValue`] for number types, using [`std::str::FromStr`].
macro_rules! parsed_values {
    ($($value:ty, $expected:literal;)+) => {$(
        impl SettingValue for $value {
            fn parse(text: &OsStr) -> Result<Self, ValueError> {
                let value = text.to_str().and_then(|text| text.parse().ok());
                value.ok_or_else(|| {
                    let found = text.display();
                    ValueError::Text(format!("expected {}, found `{found}`", $expected))
                })
            }
        }
    )+};
}

parsed_values! {
    u64, "a whole number";
    usize, "a whole number";
    f64, "a number";
}

impl SettingValue for bool {
    fn parse(text: &OsStr) -> Result<Self, ValueError> {
        let value = text.to_str().and_then(|text| text.parse().ok());
        value.ok_or_else(|| ValueError::Text("expected true or false".to_owned()))
    }

    fn flag(slot: &mut Option<Self>) -> Option<&mut Option<bool>> {
        Some(slot)
    }
}

/// Implements [`SettingValue`], using [`std::str::FromStr`]. With `by name`, it also lists the named
/// values, either from `strum` or with a label and help for each.
macro_rules! named_values {
    (by text $($value:ty),+) => {$(
        impl $crate::train::setting::value::SettingValue for $value {
            fn parse(
                text: &std::ffi::OsStr,
            ) -> Result<Self, $crate::train::setting::value::ValueError> {
                text.to_string_lossy().parse().map_err($crate::train::setting::value::ValueError::Text)
            }
        }
    )+};
    (by name $($value:ty),+) => {$(
        impl $crate::train::setting::value::SettingValue for $value {
            fn choices() -> Vec<$crate::train::setting::value::Choice> {
                // `strum` also lists disabled variants, which cannot be parsed.
                let names = <$value as strum::VariantNames>::VARIANTS.iter();
                let names = names.filter(|name| name.parse::<$value>().is_ok());
                names.map(|name| $crate::train::setting::value::Choice { name, label: name, help: "" }).collect()
            }

            $crate::train::setting::value::named_values!(@parse);
        }
    )+};
    (by name $value:ty { $($name:literal $label:literal $help:literal;)+ }) => {
        impl $crate::train::setting::value::SettingValue for $value {
            fn choices() -> Vec<$crate::train::setting::value::Choice> {
                vec![$($crate::train::setting::value::Choice {
                    name: $name,
                    label: $label,
                    help: $help,
                }),+]
            }

            $crate::train::setting::value::named_values!(@parse);
        }
    };
    (@parse) => {
        fn parse(
            text: &std::ffi::OsStr,
        ) -> Result<Self, $crate::train::setting::value::ValueError> {
            text.to_string_lossy().parse().map_err(|_| {
                let names: Vec<&str> = Self::choices().iter().map(|choice| choice.name).collect();
                let (names, text) = (names.join(", "), text.display());
                $crate::train::setting::value::ValueError::Text(
                    format!("expected one of {names}, found `{text}`")
                )
            })
        }
    };
}
pub(crate) use named_values;

/// A named set of default settings, and the kind of learner that uses them.
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Display, EnumString, VariantNames,
)]
#[serde(rename_all = "kebab-case")]
#[strum(serialize_all = "kebab-case")]
pub enum Preset {
    /// The published algorithm, with a fixed number of components.
    Paper,
    /// Scene reconstruction, which creates components as needed.
    Scene,
}

/// Error of a setting that is out of its range.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{setting}: expected {expected}, found {found}")]
pub struct ConfigError {
    /// Name of the setting: as in settings files, with its option if it has one.
    pub setting: &'static str,
    /// Permitted range of the setting.
    pub expected: String,
    /// Value found for the setting.
    pub found: String,
}

/// Maximum number of components of a model; their indices are stored as `i32`.
pub const MAX_COMPONENTS: usize = 20_000_000;
