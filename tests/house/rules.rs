//! What each place in `src` may use.

use crate::tokens::{Token, text, tokens};

/// Who may use whom, and words that belong to few places. A place is a path prefix under `src`, or a
/// whole file.
pub struct House {
    /// Rooms and what each may use besides itself.
    rooms: &'static [(&'static str, &'static [&'static str])],
    /// Words and their places.
    words: &'static [(&'static [&'static str], &'static [&'static str])],
    /// Where threads are spawned; rayon's are not meant.
    spawners: &'static [&'static str],
}

/// The house that `src` is.
pub const HOUSE: House = House {
    rooms: &[
        ("math", &[]),
        ("observation", &["math"]),
        ("model", &["math"]),
        ("dataset", &["observation", "math"]),
        ("train", &["render", "model", "observation", "math"]),
        ("render", &["model", "math"]),
        ("export", &["model", "math"]),
        ("eval", &["train", "render", "dataset", "model", "observation", "math"]),
        ("pipeline", BELOW_PIPELINE),
        ("calibrate", UP_TO_PIPELINE),
        ("bench", UP_TO_PIPELINE),
        ("app", UP_TO_PIPELINE),
        ("cli", ALL),
    ],
    words: &[
        (&["wgpu"], &["render/gpu/", "app/viewport.rs"]),
        (&["egui", "eframe", "egui_plot", "egui_tiles", "egui_wgpu"], &["app/"]),
        (&["anyhow", "println", "print", "dbg"], &["main.rs", "cli/"]),
        (&["eprintln", "eprint"], &["main.rs", "cli/", "export/golden_tests.rs"]),
        (
            &["Instant", "SystemTime"],
            &[
                "train/timing.rs",
                "render/gpu/",
                "pipeline/",
                "calibrate/",
                "bench/",
                "app/",
                "cli/",
            ],
        ),
    ],
    spawners: &["pipeline/", "app/"],
};

/// Every room from the ground up to `cli`'s last.
const ALL: &[&str] = &[
    "math",
    "observation",
    "model",
    "dataset",
    "train",
    "render",
    "export",
    "eval",
    "pipeline",
    "calibrate",
    "bench",
    "app",
];
const BELOW_PIPELINE: &[&str] = ALL.split_at(8).0;
/// Neither the window calibrates and benches, nor does one of the two use the other.
const UP_TO_PIPELINE: &[&str] = ALL.split_at(9).0;

/// Every breach of a rule in one file, `path` relative to `src`, as `path:line: what`.
pub fn offences(house: &House, path: &str, source: &str) -> Vec<String> {
    let tokens = tokens(source);
    let layer = path.split(['/', '.']).next().unwrap_or_default();
    let allowed = house.rooms.iter().find(|(name, _)| *name == layer);
    let mut found = Vec::new();
    for (line, used) in crate_uses(path, &tokens) {
        let legal = allowed.is_some_and(|(own, others)| used == *own || others.contains(&used));
        if !legal {
            found.push(format!("{path}:{line}: `{layer}` uses `{used}`"));
        }
    }
    for (i, token) in tokens.iter().enumerate() {
        let misplaced = house
            .words
            .iter()
            .any(|(words, homes)| words.contains(&token.text) && !is_in(path, homes));
        if misplaced {
            found.push(format!("{path}:{}: `{}` is not allowed here", token.line, token.text));
        }
        if token.text == "thread" && text(&tokens, i + 1) == "::" && !is_in(path, house.spawners) {
            for head in heads(&tokens, i + 2) {
                if ["spawn", "Builder", "scope", "*"].contains(&head) {
                    found.push(format!("{path}:{}: spawns threads by `{head}`", token.line));
                }
            }
        }
    }
    found
}

fn is_in(path: &str, homes: &[&str]) -> bool {
    homes.iter().any(|home| path == *home || home.ends_with('/') && path.starts_with(home))
}

/// Top-level modules named through `crate::`, `vbgs_studio::` or a climb to the root by `super::`.
fn crate_uses<'a>(path: &str, tokens: &[Token<'a>]) -> Vec<(usize, &'a str)> {
    let mut found = Vec::new();
    let mut braces: Vec<bool> = Vec::new(); // of each open brace: does it open a module?
    let mut i = 0;
    while i < tokens.len() {
        let Token { line, text: word } = tokens[i];
        let mut next = i + 1;
        match word {
            "{" => braces.push(i >= 2 && tokens[i - 2].text == "mod"),
            "}" => drop(braces.pop()),
            "crate" | "vbgs_studio" if text(tokens, next) == "::" => {
                found.extend(heads(tokens, next + 1).into_iter().map(|head| (line, head)));
            }
            // A root under another name would hide what is used.
            "crate" | "vbgs_studio" if text(tokens, next) == "as" => found.push((line, word)),
            "super" => {
                while text(tokens, next) == "::" && text(tokens, next + 1) == "super" {
                    next += 2;
                }
                let climbed = (next - i).div_ceil(2);
                let depth = module_depth(path) + braces.iter().filter(|&&module| module).count();
                if climbed >= depth && text(tokens, next) == "::" {
                    found.extend(heads(tokens, next + 1).into_iter().map(|head| (line, head)));
                }
            }
            _ => {}
        }
        i = next;
    }
    found
}

/// Modules between the root and the file's own, itself included.
fn module_depth(path: &str) -> usize {
    let path = path.strip_suffix(".rs").unwrap_or(path);
    let path = path.strip_suffix("/mod").unwrap_or(path);
    if ["lib", "main"].contains(&path) { 0 } else { path.split('/').count() }
}

/// First words of a path or of each path in a group `{a::b, c}` that starts at `at`.
fn heads<'a>(tokens: &[Token<'a>], at: usize) -> Vec<&'a str> {
    if text(tokens, at) != "{" {
        return tokens.get(at).map(|t| t.text).into_iter().collect();
    }
    let mut found = Vec::new();
    let mut depth = 0;
    for (i, token) in tokens.iter().enumerate().skip(at) {
        match token.text {
            "{" => depth += 1,
            "}" => depth -= 1,
            _ if depth == 1 && ["{", ","].contains(&tokens[i - 1].text) => found.push(token.text),
            _ => {}
        }
        if depth == 0 {
            break;
        }
    }
    found
}

#[test]
fn every_rule_can_be_broken() {
    let broken = [
        (
            "math/pose.rs",
            "use crate::model::conjugate::niw::Niw;",
            "math/pose.rs:1: `math` uses `model`",
        ),
        ("model/niw.rs", "\nuse crate::{math::Sym3, dataset};", ":2: `model` uses `dataset`"),
        ("dataset/mod.rs", "fn f() { crate::model::g() }", "`dataset` uses `model`"),
        ("train/pass.rs", "use crate::export::{self};", "`train` uses `export`"),
        ("export/ply/read.rs", "use super::super::super::eval::x;", "`export` uses `eval`"),
        ("export/mod.rs", "use super::train;", "`export` uses `train`"),
        ("math/real.rs", "mod tests { use super::super::super::eval::x; }", "uses `eval`"),
        ("render/mod.rs", "macro m { $crate::export::f }", "`render` uses `export`"),
        ("eval/views.rs", "use crate::{math, pipeline::{plan, demo}};", "`eval` uses `pipeline`"),
        ("pipeline/mod.rs", "use crate::app;", "`pipeline` uses `app`"),
        ("pipeline/mod.rs", "use crate::bench;", "`pipeline` uses `bench`"),
        ("calibrate/mod.rs", "use crate::bench;", "`calibrate` uses `bench`"),
        ("bench/mod.rs", "use crate::calibrate;", "`bench` uses `calibrate`"),
        ("app/mod.rs", "use crate::bench;", "`app` uses `bench`"),
        ("app/mod.rs", "use crate::calibrate::plan;", "`app` uses `calibrate`"),
        ("pipeline/mod.rs", "use crate::calibrate;", "`pipeline` uses `calibrate`"),
        ("bench/mod.rs", "std::thread::spawn(f)", "threads by `spawn`"),
        ("model/mod.rs", "use crate::observation;", "`model` uses `observation`"),
        ("app/mod.rs", "use vbgs_studio::cli;", "`app` uses `cli`"),
        ("cli/mod.rs", "use vbgs_studio as v;", "`cli` uses `vbgs_studio`"),
        ("extra.rs", "use crate::math;", "`extra` uses `math`"),
        ("render/cpu/mod.rs", "use wgpu::Device;", "`wgpu` is not allowed"),
        ("app/mod.rs", "use eframe::wgpu;", "`wgpu` is not allowed"),
        ("cli/window.rs", "eframe::run_native()", "`eframe` is not allowed"),
        ("pipeline/plan.rs", "egui::Ui", "`egui` is not allowed"),
        ("export/mod.rs", "use anyhow::Result;", "`anyhow` is not allowed"),
        ("eval/mod.rs", "println!(\"x\")", "`println` is not allowed"),
        ("dataset/mod.rs", "eprintln!(\"x\")", "`eprintln` is not allowed"),
        (
            "train/paper/trainer.rs",
            "use std::time::{Duration, Instant};",
            "`Instant` is not allowed",
        ),
        ("dataset/frame.rs", "SystemTime::now()", "`SystemTime` is not allowed"),
        ("train/paper/trainer.rs", "std::thread::spawn(f)", "threads by `spawn`"),
        ("dataset/mod.rs", "use std::thread::{sleep, Builder};", "threads by `Builder`"),
        ("cli/train.rs", "thread::scope(f)", "threads by `scope`"),
    ];
    for (path, source, expected) in broken {
        let found = offences(&HOUSE, path, source);
        assert_eq!(found.len(), 1, "{path}: {source}: {found:?}");
        assert!(found[0].contains(expected), "{}: {expected}", found[0]);
    }
}

#[test]
fn what_is_allowed_is_not_reported() {
    let fine = [
        (
            "model/niw.rs",
            "use crate::math::Sym3; use crate::model::conjugate::prior; pub(crate) fn f() {}",
        ),
        ("eval/views.rs", "use crate::{dataset::Dataset, math::image, model, render, train};"),
        ("math/real.rs", "mod tests { use super::*; use super::super::sym3; }"),
        ("export/mod.rs", "mod tests { use super::*; }"),
        ("export/mod.rs", "//! [`crate::app`]\nfn f() -> &'static str { \"crate::app println\" }"),
        ("export/atomic.rs", "std::thread::sleep(wait)"),
        ("app/viewport.rs", "use eframe::{egui, wgpu}; use crate::render::gpu;"),
        ("render/gpu/timer.rs", "use std::time::Instant; use wgpu::Queue;"),
        ("pipeline/prefetch.rs", "std::thread::Builder::new()"),
        ("cli/train.rs", "use vbgs_studio::app::run; use anyhow::Context; println!(\"\")"),
        ("main.rs", "mod cli; fn main() { cli::run() }"),
        ("dataset/unproject.rs", "use crate::observation::points::Points;"),
        ("calibrate/mod.rs", "use crate::pipeline::session; use crate::observation::surface;"),
        ("bench/runs.rs", "use crate::train::timing; use std::time::Instant;"),
        ("cli/bench/mod.rs", "use vbgs_studio::bench; use vbgs_studio::calibrate;"),
    ];
    for (path, source) in fine {
        assert_eq!(offences(&HOUSE, path, source), [""; 0], "{path}: {source}");
    }
}
