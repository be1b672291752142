//! Parses and formats camera matrices.

use super::error::FrameProblem;
use glam::{DMat4, DVec4};
use serde_json::Value;

/// Parses exactly `N` numbers separated by whitespace or commas. Accepts `nan` and `inf`: the pose check
/// reports them with row and column.
pub(super) fn parse_numbers<const N: usize>(text: &str) -> Result<[f64; N], String> {
    let mut values = [0.0; N];
    let mut count = 0;
    let is_separator = |c: char| c.is_whitespace() || c == ',';
    for token in text.split(is_separator).filter(|t| !t.is_empty()) {
        let value = token.parse().map_err(|_| format!("`{}`", shorten(token)))?;
        // Counted to the end, so that the message can state the number found.
        if let Some(slot) = values.get_mut(count) {
            *slot = value;
        }
        count += 1;
    }
    if count == N { Ok(values) } else { Err(format!("{count} numbers")) }
}

pub(super) fn from_text(text: &str) -> Result<DMat4, FrameProblem> {
    let values = parse_numbers::<16>(text).map_err(FrameProblem::PoseShape)?;
    Ok(from_rows(&values))
}

pub(super) fn from_json(value: Option<&Value>) -> Result<DMat4, FrameProblem> {
    let wrong = |found: String| Err(FrameProblem::PoseShape(found));
    let Some(value) = value else {
        return wrong("no `transform_matrix`".to_owned());
    };
    let Some(rows) = value.as_array().filter(|rows| rows.len() == 4 || rows.len() == 3) else {
        return wrong(describe_json(value));
    };
    let mut values = [0.0; 16];
    // Three rows are an affine matrix without its last row.
    values[15] = 1.0;
    for (i, (row, values)) in rows.iter().zip(values.as_chunks_mut::<4>().0).enumerate() {
        let Some(row) = row.as_array().filter(|row| row.len() == 4) else {
            return wrong(format!("{} as row {i}", describe_json(row)));
        };
        for (j, (cell, value)) in row.iter().zip(values).enumerate() {
            match cell.as_f64() {
                Some(number) => *value = number,
                None => return wrong(format!("{} at row {i}, column {j}", describe_json(cell))),
            }
        }
    }
    Ok(from_rows(&values))
}

pub(super) fn describe_json(value: &Value) -> String {
    match value {
        Value::Null => "null".to_owned(),
        Value::Bool(b) => b.to_string(),
        Value::Number(n) => n.to_string(),
        Value::String(s) => format!("the text \"{}\"", shorten(s)),
        Value::Array(items) => format!("an array of {}", items.len()),
        Value::Object(fields) => {
            let keys: Vec<String> = fields.keys().take(4).map(|k| shorten(k)).collect();
            format!("an object with {} keys ({})", fields.len(), keys.join(", "))
        }
    }
}

pub(super) fn shorten(text: &str) -> String {
    // A message must not reproduce a damaged file.
    text.chars().take(24).collect()
}

/// Creates a matrix from its first three rows.
pub(super) fn from_three_rows(rows: [f64; 12]) -> DMat4 {
    let mut m = [0.0; 16];
    m[..12].copy_from_slice(&rows);
    m[15] = 1.0;
    from_rows(&m)
}

fn from_rows(values: &[f64; 16]) -> DMat4 {
    // Files store rows, glam takes columns.
    DMat4::from_cols_array(values).transpose()
}

/// Formats a matrix row by row, one row per line, without loss.
pub(super) fn to_text(matrix: &DMat4) -> String {
    // `{:e}` writes the fewest digits that parse to the same number.
    let row = |r: DVec4| format!("{:e} {:e} {:e} {:e}\n", r.x, r.y, r.z, r.w);
    (0..4).map(|i| row(matrix.row(i))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_round_trips_to_the_last_bit() {
        let m =
            DMat4::from_rotation_z(0.123456789) * DMat4::from_translation([1.0, -2e-9, 7.0].into());
        assert_eq!(from_text(&to_text(&m)).ok(), Some(m));
    }

    #[test]
    fn shapes_that_are_no_matrix_are_described() {
        for (json, found) in [
            ("[[1,2],[3]]", "an array of 2"),
            ("[[1,0,0,0],[0,1,0,\"NaN\"],[0,0,1,0]]", "the text \"NaN\" at row 1, column 3"),
            ("[[1,0,0,0],[0,1,0,0],7,[0,0,0,1]]", "7 as row 2"),
        ] {
            let value: Value = serde_json::from_str(json).unwrap_or_default();
            let message = from_json(Some(&value)).map_err(|e| e.to_string());
            assert!(matches!(&message, Err(m) if m.contains(found)), "{json}: {message:?}");
        }
    }
}
