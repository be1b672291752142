//! Result of a calibration as data and as text.

use super::unknowns::CalibratedValue;
use crate::dataset::calibration::Calibration;
use crate::eval::report;
use serde::Serialize;

/// Agreement of the views under a calibration.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Agreement {
    /// Weighted mean of the squared colour difference between two views of the same place. Squares are
    /// summed over channels in `[0, 1]`.
    pub color_variance: f64,
    /// Number of components created. Misaligned surfaces increase it.
    pub births: usize,
    /// Number of components seen by several views.
    pub components: usize,
}

/// Result of a calibration: values before and after it, and the calibration to save.
#[derive(Clone, Debug, Serialize)]
pub struct Calibrated {
    /// Name of the dataset.
    pub dataset: String,
    /// Name of the split.
    pub split: String,
    /// Number of frames used.
    pub frames: usize,
    /// Agreement under the initial calibration.
    pub before: Agreement,
    /// Agreement under the final calibration.
    pub after: Agreement,
    /// Every value that was estimated.
    pub values: Vec<CalibratedValue>,
    /// Additional notes.
    pub notes: Vec<String>,
    /// Final calibration; undetermined values are unchanged.
    pub calibration: Calibration,
    /// True if the final calibration differs from the initial one.
    pub changed: bool,
    /// Names of the frames that could not be read, with the reasons.
    pub skipped: Vec<String>,
}

impl Calibrated {
    /// Formats the agreement before and after the calibration, all values and the notes as text.
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
        let agreement = report::text(["", "before", "after"], &rows);
        let rows: Vec<_> = self.values.iter().map(row).collect();
        let header = ["value", "before", "after", "best", "standard error", ""];
        let notes = self.notes.iter().cloned().chain((!self.changed).then(|| UNCHANGED.to_owned()));
        let notes = notes.map(|note| format!("{note}\n")).collect::<String>();
        format!("{seen}\n\n{agreement}\n\n{}\n\n{notes}", report::text(header, &rows))
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

/// Formats a value with two to four decimals, or with two significant digits if it is small.
fn digits(value: f64) -> String {
    match value.abs() {
        0.0 => "0".to_owned(),
        // Focal lengths and principal points, in pixels.
        size if size >= 100.0 => format!("{value:.2}"),
        size if size >= 0.001 => format!("{value:.4}"),
        _ => format!("{value:.1e}"),
    }
}
