//! The result, as data and for people.

use super::value::CalibratedValue;
use crate::dataset::calibration::Calibration;
use crate::eval::table;
use serde::Serialize;

/// How well the views agree under a calibration.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Agreement {
    /// Mean square of how colours differ between two views of the same place, weighed, channels in `[0, 1]`
    /// added up.
    pub color_variance: f64,
    /// Number of components born: surfaces that come apart bear more.
    pub births: usize,
    /// Number of components that several views see.
    pub components: usize,
}

/// The result of a calibration: values before and after, and the calibration to save.
#[derive(Clone, Debug, Serialize)]
pub struct Calibrated {
    /// Name of the dataset.
    pub dataset: String,
    /// Name of the split.
    pub split: String,
    /// Frames looked at.
    pub frames: usize,
    /// Under the calibration that the search began with.
    pub before: Agreement,
    /// Under the one that is found.
    pub after: Agreement,
    /// Every number that was searched for.
    pub values: Vec<CalibratedValue>,
    /// What there is to say beside them.
    pub notes: Vec<String>,
    /// What is found; what the data does not determine is as it was.
    pub calibration: Calibration,
    /// Whether it differs from the one before.
    pub changed: bool,
    /// Frames that could not be read, with the reason.
    pub skipped: Vec<String>,
}

impl Calibrated {
    /// How well the views agree before and after, every value, and what else there is to say.
    pub fn text(&self) -> String {
        let Self { before, after, .. } = self;
        let (frames, split) = (self.frames, &self.split);
        let seen = format!(
            "{frames} frames of `{split}`, {} surface patches seen by several of them",
            after.components
        );
        let rows = [
            (
                "colour variance between views",
                [digits(before.color_variance), digits(after.color_variance)],
            ),
            ("components born", [before.births.to_string(), after.births.to_string()]),
        ];
        let rows = rows.map(|(name, [before, after])| [name.to_owned(), before, after]);
        let agreement = table::text(["", "before", "after"], &rows);
        let rows: Vec<_> = self.values.iter().map(row).collect();
        let header = ["value", "before", "after", "best", "standard error", ""];
        let notes = self.notes.iter().cloned().chain((!self.changed).then(|| UNCHANGED.to_owned()));
        let notes = notes.map(|note| format!("{note}\n")).collect::<String>();
        format!("{seen}\n\n{agreement}\n\n{}\n\n{notes}", table::text(header, &rows))
            // Without notes the text would end in empty lines.
            .trim_end()
            .to_owned()
    }
}

const UNCHANGED: &str = "nothing was changed: the file holds the calibration as it was";

fn row(value: &CalibratedValue) -> [String; 6] {
    let verdict = match value.determined {
        true => "determined",
        false if value.after != value.before => "not determined by itself",
        false => "not determined by this data",
    };
    let reason = value.reason.as_ref().map_or_else(String::new, |reason| format!(": {reason}"));
    let [before, after, best, error] =
        [value.before, value.after, value.best, value.standard_error].map(digits);
    [value.name.to_owned(), before, after, best, error, format!("{verdict}{reason}")]
}

/// Four digits behind the point, or enough for two of a small number.
fn digits(value: f64) -> String {
    match value.abs() {
        0.0 => "0".to_owned(),
        size if size >= 100.0 => format!("{value:.2}"),
        size if size >= 0.001 => format!("{value:.4}"),
        _ => format!("{value:.1e}"),
    }
}
