//! Which file of `src` uses which, and the circles among them.
//!
//! A file uses another if it names something that is defined there. Names that a parent only hands
//! on count for the file that defines them, and handing on is no use: a `mod.rs` that declares and
//! re-exports its children does not depend on them, and a child that takes a sibling's type through
//! `super` depends on the sibling. Code of unit tests does not count.

use crate::tokens::{Token, shipped, tokens};
use crate::uses::{Import, Path, imports, paths};
use std::collections::{BTreeMap, BTreeSet};

/// Re-exports of re-exports that are followed.
const MAX_STEPS: usize = 8;

/// Files by name and what each uses, with the first line that says so.
pub struct Graph {
    uses: BTreeMap<String, BTreeMap<String, usize>>,
}

struct Module<'a> {
    file: &'a str,
    tokens: Vec<Token<'a>>,
    imports: Vec<Import>,
    /// What a name that is imported stands for.
    names: BTreeMap<String, Path>,
}

type Modules<'a> = BTreeMap<Path, Module<'a>>;

impl Graph {
    /// Of files by their path under `src` and their text.
    pub fn new(sources: &[(String, String)]) -> Self {
        let mut modules: Modules = sources
            .iter()
            .map(|(file, source)| {
                let tokens = shipped(tokens(source));
                let module = Module { file, tokens, imports: vec![], names: BTreeMap::new() };
                (module_path(file), module)
            })
            .collect();
        let known: BTreeSet<Path> = modules.keys().cloned().collect();
        for (path, module) in &mut modules {
            module.imports = imports(path, &module.tokens, &known);
            let named = module.imports.iter().filter(|import| import.name != "*");
            module.names = named.map(|i| (i.name.clone(), i.path.clone())).collect();
        }
        let mut uses: BTreeMap<_, BTreeMap<String, usize>> = BTreeMap::new();
        for (path, module) in &modules {
            let found = uses.entry(module.file.to_owned()).or_default();
            for (used, line) in used_by(path, module, &known) {
                if let Some(file) = defining_file(&modules, &used, MAX_STEPS)
                    && file != module.file
                {
                    found.entry(file.to_owned()).or_insert(line);
                }
            }
        }
        Self { uses }
    }

    /// Pairs of files of which one uses the other.
    pub fn n_uses(&self) -> usize {
        self.uses.values().map(BTreeMap::len).sum()
    }

    /// Every largest set of files that all depend on each other, with two files or more.
    pub fn circles(&self) -> Vec<BTreeSet<&str>> {
        let reached: BTreeMap<&str, BTreeSet<&str>> =
            self.uses.keys().map(|file| (file.as_str(), self.reached_from(file))).collect();
        let mut circles: Vec<BTreeSet<&str>> = Vec::new();
        for (&file, ahead) in &reached {
            let is_mutual = |other: &&str| reached.get(other).is_some_and(|r| r.contains(file));
            let circle: BTreeSet<&str> = ahead.iter().copied().filter(is_mutual).collect();
            if !circle.is_empty() && !circles.contains(&circle) {
                circles.push(circle);
            }
        }
        circles
    }

    /// The uses that make a circle, as `file:line uses file`.
    pub fn uses_within(&self, circle: &BTreeSet<&str>) -> Vec<String> {
        let files = circle.iter().flat_map(|file| self.uses[*file].iter().map(move |u| (file, u)));
        let inside = files.filter(|(_, (used, _))| circle.contains(used.as_str()));
        inside.map(|(file, (used, line))| format!("{file}:{line} uses {used}")).collect()
    }

    /// Files reached by one use or more.
    fn reached_from(&self, file: &str) -> BTreeSet<&str> {
        let mut reached = BTreeSet::new();
        let mut open: Vec<&str> = vec![file];
        while let Some(file) = open.pop() {
            for used in self.uses.get(file).into_iter().flat_map(BTreeMap::keys) {
                if reached.insert(used.as_str()) {
                    open.push(used);
                }
            }
        }
        reached
    }
}

/// Of a file: `a/b.rs` and `a/b/mod.rs` are both `a::b`, the roots are empty.
fn module_path(file: &str) -> Path {
    let path = file.strip_suffix(".rs").unwrap_or(file);
    let path = path.strip_suffix("/mod").unwrap_or(path);
    if path == "lib" {
        return Vec::new();
    }
    // The binary's root is a file of its own, which nothing can name.
    path.split('/').map(str::to_owned).collect()
}

/// Paths that a file uses: its imports but those it hands on from below, and what its code names.
fn used_by(path: &Path, module: &Module, known: &BTreeSet<Path>) -> Vec<(Path, usize)> {
    let hands_on =
        |i: &Import| i.is_public && i.path.len() > path.len() && i.path.starts_with(path);
    let mut used: Vec<(Path, usize)> = Vec::new();
    for import in &module.imports {
        // A module as such is not used before something in it is named.
        if !hands_on(import) && !known.contains(&import.path) {
            used.push((import.path.clone(), import.line));
        }
    }
    let handed_on: BTreeMap<&str, &Path> =
        module.imports.iter().filter(|i| hands_on(i)).map(|i| (i.name.as_str(), &i.path)).collect();
    for named in paths(path, &module.tokens) {
        let head = named.segments[0].as_str();
        let absolute = match (&named.base, module.names.get(head), handed_on.get(head)) {
            (Some(base), ..) => [base.as_slice(), &named.segments].concat(),
            (None, _, Some(target)) => (*target).clone(),
            (None, Some(target), None) if named.segments.len() > 1 => {
                [target.as_slice(), &named.segments[1..]].concat()
            }
            (None, None, None) if named.segments.len() > 1 => {
                let below = [path.as_slice(), &named.segments].concat();
                if !known.contains(&below[..=path.len()]) {
                    continue;
                }
                below
            }
            _ => continue,
        };
        used.push((absolute, named.line));
    }
    used
}

/// Where what a path names is defined.
fn defining_file<'a>(modules: &Modules<'a>, path: &[String], steps: usize) -> Option<&'a str> {
    let length = (0..=path.len()).rev().find(|&n| modules.contains_key(&path[..n]))?;
    let module = &modules[&path[..length]];
    let imported = path.get(length).and_then(|item| module.names.get(item));
    match imported {
        Some(target) if steps > 0 => {
            let further = [target.as_slice(), &path[length + 1..]].concat();
            defining_file(modules, &further, steps - 1)
        }
        _ => Some(module.file),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn graph(files: &[(&str, &str)]) -> Graph {
        let owned = |&(file, source): &(&str, &str)| (file.to_owned(), source.to_owned());
        Graph::new(&files.iter().map(owned).collect::<Vec<_>>())
    }

    fn circles(files: &[(&str, &str)]) -> Vec<Vec<String>> {
        let graph = graph(files);
        graph.circles().iter().map(|c| c.iter().map(|f| (*f).to_owned()).collect()).collect()
    }

    #[test]
    fn circles_are_found() {
        let two: [&[(&str, &str)]; 9] = [
            &[("a.rs", "use crate::b::B;"), ("b.rs", "use crate::a::{A, C};")],
            &[("a.rs", "use super::b::B;"), ("b.rs", "fn f(a: crate::a::A) {}")],
            &[("a.rs", "use crate::b; fn f() { b::g() }"), ("b.rs", "use super::a::{self, A};")],
            &[("a/mod.rs", "mod b; use b::B; pub struct A;"), ("a/b.rs", "use super::A;")],
            &[("a/mod.rs", "pub mod b; fn f() { b::g() }"), ("a/b.rs", "use crate::a::f;")],
            &[("a/mod.rs", "mod b; pub use b::B; fn f() { B::new() }"), ("a/b.rs", "super::f()")],
            &[("a.rs", "mod m { use super::super::b::B; }"), ("b.rs", "use vbgs_studio::a::A;")],
            &[("a.rs", "use crate::b::B as C;"), ("b.rs", "macro m { $crate::a::f() }")],
            &[("a.rs", "pub use crate::b::B;"), ("b.rs", "use crate::a::A;")],
        ];
        for files in two {
            assert_eq!(circles(files).len(), 1, "{files:?}");
            assert_eq!(circles(files)[0].len(), 2, "{files:?}");
        }
        let three =
            [("a.rs", "crate::b::f()"), ("b.rs", "crate::c::f()"), ("c.rs", "crate::a::f()")];
        assert_eq!(circles(&three), [["a.rs", "b.rs", "c.rs"]]);
        let graph = graph(&three);
        let uses = graph.uses_within(&graph.circles()[0]);
        assert_eq!(uses, ["a.rs:1 uses b.rs", "b.rs:1 uses c.rs", "c.rs:1 uses a.rs"]);
    }

    #[test]
    fn what_is_no_circle_is_not_reported() {
        let fine: [&[(&str, &str)]; 8] = [
            &[("a.rs", "use crate::b::B;"), ("b.rs", "use std::fmt; use serde::Serialize;")],
            &[("a/mod.rs", "pub mod b; pub use b::B;"), ("a/b.rs", "use super::A;")],
            &[
                ("a/mod.rs", "mod b; mod c; use b::B;"),
                ("a/b.rs", "pub struct B;"),
                ("a/c.rs", "use super::B;"),
            ],
            &[("a.rs", "use crate::b::B;"), ("b.rs", "#[cfg(test)] mod t { use crate::a::A; }")],
            &[("a.rs", "use crate::b::B;"), ("b.rs", "#[cfg(test)]\nuse crate::a::A; fn f() {}")],
            &[("a.rs", "use crate::b::B;"), ("b.rs", "/// [`crate::a`]\nfn f() { \"crate::a\" }")],
            &[("a.rs", "mod m { use super::A; } struct A;"), ("b.rs", "use crate::a::A;")],
            &[("lib.rs", "pub mod a;"), ("a/mod.rs", "use crate::c;"), ("a/c.rs", "use super::D;")],
        ];
        for files in fine {
            assert_eq!(circles(files), [[""; 0]; 0], "{files:?}");
        }
    }
}
