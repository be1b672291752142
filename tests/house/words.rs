//! Comments that point to an explanation point to a file and a heading that exist, and rustdoc shows
//! every such file.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Folders whose comments may point to explanations.
const FOLDERS: [&str; 5] = ["src", "shaders", "benches", "tests", "examples"];

/// It is for readers of the whole, not an explanation of a room.
const README: &str = "README.md";

/// Files below a folder, this one left out: it speaks of references without being one.
fn files(folder: &Path, found: &mut Vec<PathBuf>) {
    let Ok(entries) = std::fs::read_dir(folder) else { return };
    for entry in entries {
        let path = entry.unwrap().path();
        if path.is_dir() {
            files(&path, found);
        } else if path.file_name() != Path::new(file!()).file_name() {
            found.push(path);
        }
    }
}

fn with_extension(extensions: &[&str]) -> Vec<PathBuf> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut found = Vec::new();
    FOLDERS.iter().for_each(|folder| files(&root.join(folder), &mut found));
    found.retain(|path| path.extension().is_some_and(|e| extensions.iter().any(|x| e == *x)));
    found.sort();
    found
}

fn name_of(path: &Path) -> String {
    path.file_name().unwrap().to_string_lossy().into_owned()
}

/// Headings below the title.
fn headings(text: &str) -> Vec<String> {
    let mut is_code = false;
    let mut found = Vec::new();
    for line in text.lines() {
        is_code ^= line.starts_with("```");
        if let Some(heading) = line.strip_prefix("##").filter(|_| !is_code) {
            found.push(heading.trim_start_matches('#').trim().to_owned());
        }
    }
    found
}

/// The explanations by name, with their headings. Names are unique, and so are headings in a file.
fn explanations() -> BTreeMap<String, Vec<String>> {
    let mut found = BTreeMap::new();
    for path in explaining() {
        let headings = headings(&std::fs::read_to_string(&path).unwrap());
        for (i, heading) in headings.iter().enumerate() {
            assert!(!headings[..i].contains(heading), "{}: two of {heading:?}", path.display());
        }
        let twin = found.insert(name_of(&path), headings);
        assert!(twin.is_none(), "two files {}: a comment cannot tell them apart", path.display());
    }
    found
}

/// Explanations of rooms; what readers of a whole folder find first is none.
fn explaining() -> Vec<PathBuf> {
    let mut found = with_extension(&["md"]);
    found.retain(|path| name_of(path) != README);
    found
}

/// One line of text: comment marks and line breaks become blanks.
fn flat(source: &str) -> String {
    let unmarked = |line: &str| {
        let line = line.trim_start();
        let marks = ["//!", "///", "//"];
        marks.iter().find_map(|mark| line.strip_prefix(mark)).unwrap_or(line).trim().to_owned()
    };
    source.lines().map(unmarked).collect::<Vec<_>>().join(" ")
}

/// What is wrong with the references of a text; `n` counts them.
fn faults(text: &str, known: &BTreeMap<String, Vec<String>>, n: &mut usize) -> Vec<String> {
    let mut faults = Vec::new();
    for (at, _) in text.match_indices(".md") {
        let is_name = |c: char| c.is_ascii_alphanumeric() || "_-.".contains(c);
        let (before, after) = (&text[..at], &text[at + ".md".len()..]);
        let start = before.rfind(|c| !is_name(c)).map_or(0, |i| i + 1);
        if after.starts_with(|c| c == '\\' || is_name(c) && c != '.') || before.len() == start {
            continue; // part of a longer word
        }
        let name = &text[start..at + ".md".len()];
        if before[..start].ends_with('"') {
            continue; // a path that code reads
        }
        if name == README {
            continue;
        }
        *n += 1;
        let place: String = text[start..].chars().take(60).collect();
        let Some(headings) = known.get(name) else {
            faults.push(format!("no file {name}: {place}"));
            continue;
        };
        let heading = after.strip_prefix("`, ");
        let ends = |rest: &str| !rest.starts_with(|c: char| c.is_alphanumeric());
        let is_known = heading.is_some_and(|text| {
            headings.iter().any(|h| text.strip_prefix(h.as_str()).is_some_and(ends))
        });
        if !is_known {
            faults.push(format!("{name}: no such heading: {place}"));
        }
    }
    faults
}

#[test]
fn references_point_to_headings() {
    let known = explanations();
    let (mut n, mut wrong) = (0, Vec::new());
    for path in with_extension(&["rs", "wgsl"]) {
        let text = flat(&std::fs::read_to_string(&path).unwrap());
        let found = faults(&text, &known, &mut n);
        wrong.extend(found.into_iter().map(|fault| format!("{}: {fault}", path.display())));
    }
    assert!(wrong.is_empty(), "expected `file.md`, Heading:\n{}", wrong.join("\n"));
    assert!(n > 150, "only {n} references were found");
}

/// Explanations refer to each other in the same form, or by the file alone.
#[test]
fn explanations_point_to_each_other() {
    let known = explanations();
    for path in explaining() {
        let text = flat(&std::fs::read_to_string(&path).unwrap());
        let mut n = 0;
        let wrong: Vec<String> = faults(&text, &known, &mut n)
            .into_iter()
            .filter(|fault| fault.starts_with("no file") || fault.contains(".md`, "))
            .collect();
        assert!(wrong.is_empty(), "{}:\n{}", path.display(), wrong.join("\n"));
    }
}

#[test]
fn rustdoc_shows_every_explanation() {
    let sources: Vec<PathBuf> = with_extension(&["rs"]);
    for path in explaining() {
        let folder = path.parent().unwrap();
        let shown = format!("#![doc = include_str!(\"{}\")]", name_of(&path));
        let module = folder.with_extension("rs");
        let is_shown = sources.iter().any(|source| {
            (source.parent() == Some(folder) || *source == module)
                && std::fs::read_to_string(source).unwrap().contains(&shown)
        });
        assert!(is_shown, "{}: expected a module beside it with {shown}", path.display());
    }
}

#[test]
fn wrong_references_are_found() {
    let known = BTreeMap::from([("a.md".to_owned(), vec!["One thing".to_owned()])]);
    let n_faults = |text: &str| faults(&flat(text), &known, &mut 0).len();
    assert_eq!(n_faults("/// See (`a.md`, One\n/// thing)."), 0);
    assert_eq!(n_faults("#![doc = include_str!(\"b.md\")]"), 0);
    assert_eq!(n_faults("read(\"b.md\")"), 0);
    for wrong in [
        "`a.md` 3",
        "`a.md`",
        "`a.md`, Another",
        "`a.md`, One things",
        "`b.md`, One thing",
        "a.md, One thing",
    ] {
        assert_eq!(n_faults(wrong), 1, "{wrong}");
    }
}
