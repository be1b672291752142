//! Text tables.

/// Formats columns padded to their widest cell: text left-aligned, numbers right-aligned.
pub fn text<const N: usize>(header: [&str; N], rows: &[[String; N]]) -> String {
    let lines: Vec<[String; N]> =
        std::iter::once(header.map(str::to_owned)).chain(rows.iter().cloned()).collect();
    // In characters, as `format!` pads.
    let width = |i: usize| lines.iter().map(|l| l[i].chars().count()).max().unwrap_or(0);
    let widths: [usize; N] = std::array::from_fn(width);
    let starts_a_word = |cell: &String| cell.starts_with(|c: char| c.is_alphabetic() || c == '+');
    let has_words = |i: usize| rows.iter().any(|row| starts_a_word(&row[i]));
    let line = |cells: &[String; N]| {
        let padded = cells.iter().zip(widths).enumerate().map(|(i, (cell, width))| {
            if has_words(i) { format!("{cell:width$}") } else { format!("{cell:>width$}") }
        });
        padded.collect::<Vec<_>>().join("  ").trim_end().to_owned()
    };
    lines.iter().map(line).collect::<Vec<_>>().join("\n")
}

/// Formats an error with two significant digits; `0` for zero.
pub fn error(value: f64) -> String {
    if value == 0.0 { "0".to_owned() } else { format!("{value:.1e}") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_line_up() {
        let rows = [["a".to_owned(), "10".to_owned()], ["long".to_owned(), "5".to_owned()]];
        assert_eq!(text(["", "ms"], &rows), "      ms\na     10\nlong   5");
    }
}
