//! What breaks a rule today. Every list must shrink: an entry that no longer breaks its rule fails
//! the test until it is taken out, and nothing may be added.

use std::collections::BTreeSet;

/// Files that depend on each other, the members of a circle in the order of their names.
pub const CIRCLES: &[&[&str]] = &[];

/// Public type names that more than one place defines.
pub const DUPLICATE_TYPES: &[&str] = &[];

/// Functions that are too long, by file and name.
pub const LONG_FUNCTIONS: &[&str] = &[];

/// Files that are too long.
pub const LONG_FILES: &[&str] = &[];

/// What is wrong where a list is not exactly what was found; `why` explains a new entry.
pub fn compare(
    found: &BTreeSet<String>,
    known: &[&str],
    why: impl Fn(&str) -> Vec<String>,
) -> String {
    let mut complaint = String::new();
    for new in found.iter().filter(|entry| !known.contains(&entry.as_str())) {
        complaint += &format!("  new: {new:?}\n");
        why(new).iter().for_each(|line| complaint += &format!("    {line}\n"));
    }
    for gone in known.iter().filter(|entry| !found.contains(**entry)) {
        complaint += &format!("  mended, take it out of tests/house/known.rs: {gone:?}\n");
    }
    complaint
}

#[test]
fn lists_must_be_exact() {
    let found = ["a".to_owned(), "b".to_owned()].into();
    let why = |entry: &str| vec![format!("because of {entry}")];
    assert_eq!(compare(&found, &["a", "b"], why), "");
    assert_eq!(compare(&found, &["a"], why), "  new: \"b\"\n    because of b\n");
    assert!(compare(&found, &["a", "b", "c"], why).contains("mended"));
}

#[test]
fn lists_are_in_order_and_without_repeats() {
    for list in [DUPLICATE_TYPES, LONG_FUNCTIONS, LONG_FILES].iter().chain(CIRCLES) {
        assert!(list.is_sorted_by(|a, b| a < b), "{list:?}");
    }
    assert!(CIRCLES.is_sorted_by(|a, b| a < b), "{CIRCLES:?}");
}
