//! Values of settings, as the command line says them.

use serde::Serialize;
use std::ffi::OsStr;
use std::fmt::Debug;

/// One of the few values a setting may have.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Choice {
    /// As the command line spells it.
    pub name: &'static str,
    /// As the window calls it.
    pub label: &'static str,
    /// What it means, one sentence without a full stop; empty where the name says it.
    pub help: &'static str,
}

/// Why a text is no value of a setting.
#[derive(Debug, thiserror::Error)]
pub enum ValueError {
    /// What was expected and found.
    #[error("{0}")]
    Text(String),
    /// The value is in a file, which is at fault.
    #[error(transparent)]
    File(Box<dyn std::error::Error + Send + Sync>),
}

/// A value that an option of the command line can have.
pub trait SettingValue: Clone + PartialEq + Debug + Serialize {
    /// Whether the option names a file that holds the value.
    const IS_FILE: bool = false;

    /// All values, where they are few and have names.
    fn choices() -> Vec<Choice> {
        Vec::new()
    }

    /// Reads the text after an option.
    ///
    /// # Errors
    /// [`ValueError`] says what is expected.
    fn parse(text: &OsStr) -> Result<Self, ValueError>;

    /// The same slot, if it is that of something that is on or off.
    fn flag(_: &mut Option<Self>) -> Option<&mut Option<bool>> {
        None
    }
}

/// A value as messages show it: as JSON has it, words without quotes, numbers as short as they are
/// exact. What JSON has no word for (no number) is said as Rust does.
pub fn text_of(value: &(impl Serialize + Debug)) -> String {
    match serde_json::to_value(value) {
        Ok(serde_json::Value::String(text)) => text,
        Ok(serde_json::Value::Null) => format!("{value:?}"),
        Ok(serde_json::Value::Number(number)) => number
            .as_f64()
            .filter(|_| number.is_f64())
            .map_or(number.to_string(), |x| x.to_string()),
        Ok(other) => other.to_string(),
        Err(_) => format!("{value:?}"),
    }
}

/// Values whose text says by itself what is wrong with it.
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

/// Makes types whose [`std::str::FromStr`] knows them by text into values; with `by name` those that
/// `strum` gives names, each with what it is called in the window and what it means where that is said.
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
                // `strum` names variants that it does not read, too: nobody can ask for those.
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
