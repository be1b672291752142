//! Names of public types, which a reader meets on hover and in messages of the compiler: each means
//! one thing.

use crate::tokens::{shipped, text, tokens};
use std::collections::BTreeMap;

/// Every `pub` struct, enum, trait, union or type alias of a file, with its line.
pub fn public_types(source: &str) -> Vec<(String, usize)> {
    let tokens = shipped(tokens(source));
    let kinds = ["struct", "enum", "trait", "type", "union"];
    let mut found = Vec::new();
    for i in 0..tokens.len() {
        let is_public = tokens[i].text == "pub" && kinds.contains(&text(&tokens, i + 1));
        let is_unsafe = tokens[i].text == "pub" && text(&tokens, i + 1) == "unsafe";
        if is_public || (is_unsafe && text(&tokens, i + 2) == "trait") {
            let name = text(&tokens, i + if is_unsafe { 3 } else { 2 });
            // The name that a macro gives is its caller's, `$name` none yet.
            if name != "$" {
                found.push((name.to_owned(), tokens[i].line));
            }
        }
    }
    found
}

/// Names that more than one place defines, with `file:line` of each.
pub fn duplicates(sources: &[(String, String)]) -> BTreeMap<String, Vec<String>> {
    let mut places: BTreeMap<String, Vec<String>> = BTreeMap::new();
    for (file, source) in sources {
        for (name, line) in public_types(source) {
            places.entry(name).or_default().push(format!("{file}:{line}"));
        }
    }
    places.retain(|_, places| places.len() > 1);
    places
}

#[test]
fn duplicates_are_found() {
    let source = |file: &str, text: &str| (file.to_owned(), text.to_owned());
    let sources = [
        source(
            "a.rs",
            "pub struct A; pub(crate) struct B; pub enum C {} fn f() {}\npub type D = u8;",
        ),
        source(
            "b.rs",
            "pub trait A {} pub struct $a; pub struct $b; pub struct B; #[cfg(test)] mod tests { pub struct C; }",
        ),
        source(
            "c.rs",
            "//! pub struct B;\npub union D {} pub unsafe trait E {} pub trait F { type A; }",
        ),
    ];
    let found = duplicates(&sources);
    let found: Vec<_> =
        found.iter().map(|(name, places)| (name.as_str(), places.join(" "))).collect();
    assert_eq!(found, [("A", "a.rs:1 b.rs:1".into()), ("D", "a.rs:2 c.rs:2".into())]);
}
