//! The architecture, held by reading `src`: who may use whom, where clocks, threads, output and
//! graphics live, and how long files are.
#![allow(clippy::unwrap_used)]

#[path = "layers/rules.rs"]
mod rules;
#[path = "layers/tokens.rs"]
mod tokens;

use std::fs;
use std::path::Path;

/// Longest file, lines.
const MAX_LINES: usize = 600;
/// Longest median, lines.
const MAX_MEDIAN_LINES: usize = 250;
/// The entry fits a screen, lines.
const MAX_MAIN_LINES: usize = 40;

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
    let offences: Vec<String> =
        sources().iter().flat_map(|(path, source)| rules::offences(path, source)).collect();
    assert!(offences.is_empty(), "the layer rule is broken:\n  {}", offences.join("\n  "));
}

#[test]
fn files_are_small() {
    let mut sizes: Vec<(usize, String)> =
        sources().into_iter().map(|(path, source)| (source.lines().count(), path)).collect();
    sizes.sort();
    let long: Vec<_> = sizes.iter().filter(|(n, _)| *n > MAX_LINES).collect();
    assert!(long.is_empty(), "files over {MAX_LINES} lines: {long:?}");
    let (median, _) = sizes[sizes.len() / 2];
    assert!(median <= MAX_MEDIAN_LINES, "the median file has {median} lines");
    let (main, _) = sizes.iter().find(|(_, path)| path == "main.rs").unwrap();
    assert!(*main <= MAX_MAIN_LINES, "main.rs has {main} lines");
}
