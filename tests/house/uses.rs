//! Paths in Rust source: what is imported, and what code names.

use crate::tokens::{Token, text};
use std::collections::BTreeSet;

/// A path from the root of the crate.
pub type Path = Vec<String>;

/// One name that a `use` brings in.
#[derive(Debug, PartialEq)]
pub struct Import {
    /// What it is called here, `*` for everything of a module.
    pub name: String,
    /// What it stands for, from the root of the crate.
    pub path: Path,
    /// Whether others see it: `pub use`.
    pub is_public: bool,
    pub line: usize,
}

/// A path in code.
#[derive(Debug, PartialEq)]
pub struct Named {
    /// The module that a `crate`, `self` or `super` at its front stands for.
    pub base: Option<Path>,
    /// What follows; never empty.
    pub segments: Vec<String>,
    pub line: usize,
}

/// What a file imports from this crate, `path` being its own module.
pub fn imports(path: &Path, tokens: &[Token], known: &BTreeSet<Path>) -> Vec<Import> {
    let mut found = Vec::new();
    for (at, module) in statements(path, tokens) {
        let is_public = at > 0 && is_visibility(tokens, at - 1);
        let mut leaves = Vec::new();
        tree(tokens, at + 1, &mut Vec::new(), &mut leaves);
        for (segments, name, line) in leaves {
            let Some((base, rest)) = based(&module, &segments).or_else(|| {
                let below = [module.as_slice(), &segments[..1]].concat();
                known.contains(&below).then(|| (module.clone(), &segments[..]))
            }) else {
                continue;
            };
            let path = [base.as_slice(), rest].concat();
            found.push(Import { name, path, is_public, line });
        }
    }
    found
}

/// Paths outside of imports, and words that may be names of types or functions.
pub fn paths(path: &Path, tokens: &[Token]) -> Vec<Named> {
    let mut found = Vec::new();
    let mut in_use = false;
    for (i, module) in walk(path, tokens) {
        let Token { line, text: word } = tokens[i];
        match word {
            "use" => in_use = true,
            ";" => in_use = false,
            _ => {}
        }
        let follows = i > 0 && ["::", ".", "mod", "fn", "'"].contains(&tokens[i - 1].text);
        if in_use || follows || !is_name(word) {
            continue;
        }
        let mut segments = vec![word.to_owned()];
        let mut next = i + 1;
        while text(tokens, next) == "::" && is_name(text(tokens, next + 1)) {
            segments.push(text(tokens, next + 1).to_owned());
            next += 2;
        }
        let names_item = word.starts_with(char::is_uppercase) || text(tokens, i + 1) == "(";
        if let Some((base, rest)) = based(&module, &segments) {
            if !rest.is_empty() {
                found.push(Named { base: Some(base), segments: rest.to_vec(), line });
            }
        } else if segments.len() > 1 || names_item {
            found.push(Named { base: None, segments, line });
        }
    }
    found
}

/// The module at the front of a path by keywords, and what follows.
fn based<'a>(module: &Path, segments: &'a [String]) -> Option<(Path, &'a [String])> {
    match segments[0].as_str() {
        "crate" | "vbgs_studio" => Some((Vec::new(), &segments[1..])),
        "self" => Some((module.clone(), &segments[1..])),
        "super" => {
            let climbs = segments.iter().take_while(|s| *s == "super").count();
            let base = module[..module.len().saturating_sub(climbs)].to_vec();
            Some((base, &segments[climbs..]))
        }
        _ => None,
    }
}

/// Each `use` with the module it stands in.
fn statements(path: &Path, tokens: &[Token]) -> Vec<(usize, Path)> {
    walk(path, tokens).filter(|(i, _)| tokens[*i].text == "use").collect()
}

/// Every token with the module it stands in.
fn walk<'a>(path: &Path, tokens: &'a [Token]) -> impl Iterator<Item = (usize, Path)> + use<'a> {
    let mut module = path.clone();
    let mut braces: Vec<bool> = Vec::new(); // of each open brace: does it open a module?
    (0..tokens.len()).map(move |i| {
        match tokens[i].text {
            "{" => {
                let opens = i >= 2 && tokens[i - 2].text == "mod";
                if opens {
                    module.push(tokens[i - 1].text.to_owned());
                }
                braces.push(opens);
            }
            "}" if braces.pop() == Some(true) => drop(module.pop()),
            _ => {}
        }
        (i, module.clone())
    })
}

/// Leaves of the tree of a `use` from `at` on, each with its name here; returns where it ends.
fn tree(
    tokens: &[Token],
    mut at: usize,
    front: &mut Path,
    leaves: &mut Vec<(Path, String, usize)>,
) -> usize {
    let length = front.len();
    loop {
        let word = text(tokens, at);
        if word == "{" {
            at += 1;
            while !["}", ""].contains(&text(tokens, at)) {
                at = tree(tokens, at, front, leaves);
                at += usize::from(text(tokens, at) == ",");
            }
            at += 1;
            break;
        }
        if word != "::" {
            // `a::{self, B}` names `a`.
            if word != "self" || front.is_empty() {
                front.push(word.to_owned());
            }
            if text(tokens, at + 1) != "::" {
                let line = tokens.get(at).map_or(0, |t| t.line);
                let is_renamed = text(tokens, at + 1) == "as";
                let own = || front.last().cloned().unwrap_or_default();
                let name = if is_renamed { text(tokens, at + 2).to_owned() } else { own() };
                let path =
                    if word == "*" { front[..front.len() - 1].to_vec() } else { front.clone() };
                leaves.push((path, name, line));
                at += if is_renamed { 3 } else { 1 };
                break;
            }
        }
        at += 1;
    }
    front.truncate(length);
    at
}

/// Whether a visibility ends at a token: `pub` or `pub(…)`.
fn is_visibility(tokens: &[Token], at: usize) -> bool {
    text(tokens, at) == "pub"
        || (text(tokens, at) == ")" && {
            let open = (0..at).rev().find(|&i| tokens[i].text == "(");
            open.is_some_and(|open| open > 0 && tokens[open - 1].text == "pub")
        })
}

fn is_name(word: &str) -> bool {
    word.starts_with(|c: char| c.is_alphabetic() || c == '_')
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tokens::tokens;

    fn path(text: &str) -> Path {
        text.split("::").filter(|s| !s.is_empty()).map(str::to_owned).collect()
    }

    #[test]
    fn imports_are_read() {
        let known = ["a", "a::b", "a::b::c"].map(path).into();
        let cases: [(&str, &[(&str, &str)]); 8] = [
            ("use crate::x::Y;", &[("Y", "x::Y")]),
            (
                "use super::{d::{D, E as F}, g};",
                &[("D", "a::d::D"), ("F", "a::d::E"), ("g", "a::g")],
            ),
            ("use crate::x::{self, Y};", &[("x", "x"), ("Y", "x::Y")]),
            ("use c::C;", &[("C", "a::b::c::C")]),
            ("use std::fmt; use serde::Serialize;", &[]),
            ("use crate::x::*;", &[("*", "x")]),
            ("mod m { use super::N; use super::super::P; }", &[("N", "a::b::N"), ("P", "a::P")]),
            ("use vbgs_studio::{x::{Y}, z::Z,};", &[("Y", "x::Y"), ("Z", "z::Z")]),
        ];
        for (source, expected) in cases {
            let found = imports(&path("a::b"), &tokens(source), &known);
            let found: Vec<(String, Path)> = found.into_iter().map(|i| (i.name, i.path)).collect();
            let expected: Vec<(String, Path)> =
                expected.iter().map(|(name, to)| ((*name).to_owned(), path(to))).collect();
            assert_eq!(found, expected, "{source}");
        }
        let public = |source| imports(&path("a::b"), &tokens(source), &known)[0].is_public;
        assert!(public("pub use c::C;") && public("pub(crate) use c::C;") && !public("use c::C;"));
    }
}
