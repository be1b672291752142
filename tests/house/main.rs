//! The architecture, checked by reading `src`: which room may use which, where graphics, clocks, threads and output live, how long
//! files are, and that comments refer to documentation that exists.
#![allow(clippy::unwrap_used)]

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

/// Longest file, lines. Clippy holds the length of functions (`clippy.toml`).
const MAX_LINES: usize = 800;

/// Rooms from the ground up, and the rooms that each may use besides itself.
const ROOMS: &[(&str, &[&str])] = &[
    ("math", &[]),
    ("observation", &["math"]),
    ("model", &["math"]),
    ("dataset", &["observation", "math"]),
    ("render", &["model", "math"]),
    ("train", &["render", "model", "observation", "math"]),
    ("export", &["model", "math"]),
    ("eval", &["train", "render", "dataset", "model", "observation", "math"]),
    ("pipeline", ENGINE),
    ("calibrate", UP_TO_PIPELINE),
    ("bench", UP_TO_PIPELINE),
    ("app", UP_TO_PIPELINE),
    ("cli", ALL),
];
const ALL: &[&str] = &[
    "math",
    "observation",
    "model",
    "dataset",
    "render",
    "train",
    "export",
    "eval",
    "pipeline",
    "calibrate",
    "bench",
    "app",
];
const ENGINE: &[&str] = ALL.split_at(8).0;
const UP_TO_PIPELINE: &[&str] = ALL.split_at(9).0;

/// Words of code, and path prefixes under `src` that may hold them.
const HOMES: &[(&[&str], &[&str])] = &[
    (&["wgpu"], &["render/gpu/", "app/viewport.rs"]),
    (&["egui", "eframe", "egui_plot", "egui_tiles", "egui_wgpu"], &["app/"]),
    (&["anyhow", "println", "print", "dbg"], &["main.rs", "cli/"]),
    (&["eprintln", "eprint"], &["main.rs", "cli/"]),
    (
        &["Instant", "SystemTime"],
        &["train/timing.rs", "render/gpu/", "pipeline/", "calibrate/", "bench/", "app/", "cli/"],
    ),
    (&["thread::spawn", "thread::Builder", "thread::scope"], &["pipeline/", "app/"]),
];

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// Files below a folder with one of the extensions, by their path from the repository's root.
fn files(folder: &str, extensions: &[&str]) -> Vec<(String, String)> {
    let (mut found, mut folders) = (Vec::new(), vec![root().join(folder)]);
    while let Some(folder) = folders.pop() {
        let entries: Vec<PathBuf> =
            fs::read_dir(folder).into_iter().flatten().map(|entry| entry.unwrap().path()).collect();
        for path in entries {
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|e| extensions.iter().any(|x| e == *x)) {
                let name = path.strip_prefix(root()).unwrap().to_str().unwrap().replace('\\', "/");
                found.push((name, fs::read_to_string(&path).unwrap()));
            }
        }
    }
    found.sort();
    found
}

/// Sources of the crate without tests beside the code, by their path under `src`.
fn sources() -> Vec<(String, String)> {
    let found: Vec<(String, String)> = files("src", &["rs"])
        .into_iter()
        .filter(|(name, _)| !name.ends_with("tests.rs"))
        .map(|(name, source)| (name["src/".len()..].to_owned(), source))
        .collect();
    assert!(found.len() > 50, "only {} files found under src", found.len());
    found
}

/// Lines of code up to the tests of a file, numbered from 1, without comments.
fn code(source: &str) -> impl Iterator<Item = (usize, &str)> {
    let shipped = source.split("#[cfg(test)]\nmod ").next().unwrap_or_default();
    shipped.lines().enumerate().map(|(i, line)| (i + 1, line.split("//").next().unwrap_or("")))
}

fn is_word(c: char) -> bool {
    c.is_alphanumeric() || c == '_'
}

/// True if the line holds the word by itself, not within a string.
fn holds(line: &str, word: &str) -> bool {
    line.match_indices(word).any(|(at, _)| {
        let (before, after) = (&line[..at], &line[at + word.len()..]);
        let is_alone = !before.ends_with(is_word) && !after.starts_with(is_word);
        is_alone && before.matches('"').count() % 2 == 0
    })
}

/// Rooms that a line of code names: by `crate::`, or from a room's own `mod.rs` by `super::`.
fn rooms_named<'a>(path: &str, line: &'a str) -> Vec<&'a str> {
    let is_top = path.matches('/').count() == usize::from(path.ends_with("/mod.rs"));
    let mut found = Vec::new();
    for prefix in ["crate::", "super::"].into_iter().filter(|p| *p == "crate::" || is_top) {
        for (at, _) in line.match_indices(prefix) {
            found.extend(line[at + prefix.len()..].split(|c| !is_word(c)).next());
        }
    }
    found.retain(|name| ROOMS.iter().any(|(room, _)| room == name));
    found
}

#[test]
fn uses_are_read() {
    assert_eq!(rooms_named("math/a.rs", "use crate::model::a; crate::app::b()"), ["model", "app"]);
    assert_eq!(rooms_named("math/mod.rs", "super::render::x"), ["render"]);
    assert!(rooms_named("math/deep/a.rs", "use super::app::x").is_empty());
    assert!(holds("let t = Instant::now();", "Instant") && !holds("\"an Instant\"", "Instant"));
    assert!(!holds("InstantNoodles", "Instant"));
}

#[test]
fn rooms_use_only_rooms_below_them() {
    let (mut wrong, mut n_uses) = (Vec::new(), 0);
    for (path, source) in sources() {
        let room = path.split(['/', '.']).next().unwrap_or_default();
        let Some((_, allowed)) = ROOMS.iter().find(|(name, _)| *name == room) else { continue };
        for (line, text) in code(&source) {
            for used in rooms_named(&path, text) {
                n_uses += 1;
                if used != room && !allowed.contains(&used) {
                    wrong.push(format!("{path}:{line}: `{room}` uses `{used}`"));
                }
            }
        }
    }
    assert!(n_uses > 1000, "only {n_uses} uses found");
    assert!(wrong.is_empty(), "the layers are broken:\n{}", wrong.join("\n"));
}

#[test]
fn graphics_clocks_threads_and_output_stay_in_their_rooms() {
    let mut wrong = Vec::new();
    for (path, source) in sources() {
        let is_home = |homes: &[&str]| homes.iter().any(|home| path.starts_with(home));
        for (words, _) in HOMES.iter().filter(|(_, homes)| !is_home(homes)) {
            for (line, text) in code(&source) {
                let found = words.iter().filter(|word| holds(text, word));
                wrong.extend(found.map(|word| format!("{path}:{line}: `{word}`")));
            }
        }
    }
    assert!(wrong.is_empty(), "words outside their rooms:\n{}", wrong.join("\n"));
}

#[test]
fn files_are_small() {
    let long = |(path, source): &(String, String)| {
        let lines = source.lines().count();
        (lines > MAX_LINES).then(|| format!("{path}: {lines} lines"))
    };
    let found: Vec<String> = files("src", &["rs"]).iter().filter_map(long).collect();
    assert!(found.is_empty(), "over {MAX_LINES} lines:\n{}", found.join("\n"));
}

/// A comment refers to documentation as `file.md`, Heading.
#[test]
fn references_point_to_headings() {
    let mut known: BTreeMap<String, Vec<String>> = BTreeMap::new();
    for (name, text) in
        files("docs", &["md"]).into_iter().filter(|(name, _)| !name.starts_with("docs/lab/"))
    {
        let headings = text.lines().filter(|line| line.starts_with("##"));
        let headings = headings.map(|line| line.trim_start_matches('#').trim().to_owned());
        known.entry(name.rsplit('/').next().unwrap().to_owned()).or_default().extend(headings);
    }
    let (mut wrong, mut n) = (Vec::new(), 0);
    for folder in ["src", "shaders", "tests", "benches"] {
        for (path, text) in files(folder, &["rs", "wgsl"]) {
            if path == file!() {
                continue;
            }
            let marks = |line: &str| line.trim().trim_start_matches(['/', '!']).trim().to_owned();
            let flat = text.lines().map(marks).collect::<Vec<_>>().join(" ");
            for (at, _) in flat.match_indices(".md`, ") {
                let name = flat[..at].rsplit(['`', '/']).next().unwrap().to_owned() + ".md";
                let rest = &flat[at + ".md`, ".len()..];
                n += 1;
                if !known.get(&name).is_some_and(|all| all.iter().any(|h| rest.starts_with(h))) {
                    let start: String = rest.chars().take(40).collect();
                    wrong.push(format!("{path}: `{name}`, {start}"));
                }
            }
        }
    }
    assert!(n > 100, "only {n} references were found");
    assert!(wrong.is_empty(), "expected `file.md`, Heading:\n{}", wrong.join("\n"));
}
