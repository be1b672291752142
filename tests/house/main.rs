//! The architecture, held by reading `src`: who may use whom, where clocks, threads, output and
//! graphics live, that no files depend on each other in a circle, that a public name means one
//! thing, and how long files and functions are.
//!
//! What breaks a rule today stands in `known.rs`; a list there may only become shorter.
#![allow(clippy::unwrap_used)]

mod graph;
mod known;
mod names;
mod presets;
mod rules;
mod sizes;
mod tokens;
mod uses;
mod words;

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

/// Longest file, lines.
const MAX_LINES: usize = 450;
/// Longest median, lines.
const MAX_MEDIAN_LINES: usize = 250;
/// The entry fits a screen, lines.
const MAX_MAIN_LINES: usize = 40;
/// Longest function, lines.
const MAX_FUNCTION_LINES: usize = 60;
/// Patterns outside the seam that ask which preset is meant, at most.
const MAX_PRESET_ARMS: usize = 10;

/// Every file of `src` with its path there.
fn sources() -> Vec<(String, String)> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut found = Vec::new();
    let mut folders = vec![root.clone()];
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|e| e == "rs") {
                let relative = path.strip_prefix(&root).unwrap();
                let relative = relative.to_str().unwrap().replace('\\', "/");
                found.push((relative, fs::read_to_string(&path).unwrap()));
            }
        }
    }
    found.sort();
    assert!(found.len() > 50, "only {} files found under src", found.len());
    found
}

#[test]
fn layers_hold() {
    let offences: Vec<String> = sources()
        .iter()
        .flat_map(|(path, source)| rules::offences(&rules::HOUSE, path, source))
        .collect();
    assert!(offences.is_empty(), "the layer rule is broken:\n  {}", offences.join("\n  "));
}

#[test]
fn no_files_depend_on_each_other() {
    let sources = sources();
    let graph = graph::Graph::new(&sources);
    // A reading that sees no uses finds no circles either.
    assert!(graph.n_uses() > 2 * sources.len(), "only {} uses found", graph.n_uses());
    let name = |circle: &BTreeSet<&str>| circle.iter().copied().collect::<Vec<_>>().join(" ");
    let circles = graph.circles();
    let found: BTreeSet<String> = circles.iter().map(name).collect();
    let uses = |circle: &str| {
        let circle = circles.iter().find(|c| name(c) == circle);
        circle.map_or(vec![], |circle| graph.uses_within(circle))
    };
    let listed: Vec<String> = known::CIRCLES.iter().map(|files| files.join(" ")).collect();
    let listed: Vec<&str> = listed.iter().map(String::as_str).collect();
    let complaint = known::compare(&found, &listed, uses);
    assert!(complaint.is_empty(), "circles between files:\n{complaint}");
}

#[test]
fn public_type_names_are_unique() {
    let duplicates = names::duplicates(&sources());
    let found = duplicates.keys().cloned().collect();
    let complaint = known::compare(&found, known::DUPLICATE_TYPES, |n| duplicates[n].clone());
    assert!(complaint.is_empty(), "public types of one name:\n{complaint}");
}

#[test]
fn functions_are_short() {
    let sources = sources();
    let long = |(file, source): &(String, String)| {
        let functions = sizes::functions(source).into_iter();
        let long = functions.filter(|(_, _, lines)| *lines > MAX_FUNCTION_LINES);
        long.map(|(name, ..)| format!("{file} {name}")).collect::<Vec<_>>()
    };
    let found = sources.iter().flat_map(long).collect();
    let complaint = known::compare(&found, known::LONG_FUNCTIONS, |_| vec![]);
    assert!(complaint.is_empty(), "functions over {MAX_FUNCTION_LINES} lines:\n{complaint}");
}

#[test]
fn files_are_small() {
    let mut sizes: Vec<(usize, String)> =
        sources().into_iter().map(|(path, source)| (source.lines().count(), path)).collect();
    sizes.sort();
    let long = sizes.iter().filter(|(n, _)| *n > MAX_LINES).map(|(_, path)| path.clone());
    let complaint = known::compare(&long.collect(), known::LONG_FILES, |_| vec![]);
    assert!(complaint.is_empty(), "files over {MAX_LINES} lines:\n{complaint}");
    let (median, _) = sizes[sizes.len() / 2];
    assert!(median <= MAX_MEDIAN_LINES, "the median file has {median} lines");
    let (main, _) = sizes.iter().find(|(_, path)| path == "main.rs").unwrap();
    assert!(*main <= MAX_MAIN_LINES, "main.rs has {main} lines");
}

#[test]
fn presets_are_told_apart_in_the_seam() {
    let mut found = Vec::new();
    for (file, source) in sources() {
        found.extend(presets::arms(&file, &source).iter().map(|line| format!("{file}:{line}")));
    }
    assert!(found.len() <= MAX_PRESET_ARMS, "{}:\n  {}", found.len(), found.join("\n  "));
}
