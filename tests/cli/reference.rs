//! The reference of the command line is generated from the help texts of the program.

use super::runner::Scratch;
use std::fs;
use std::path::Path;

/// Writes the page instead of comparing it.
const WRITE: &str = "VBGS_WRITE_SETTINGS";
const COMMANDS: [&str; 11] = [
    "train",
    "eval",
    "render",
    "export",
    "synth",
    "merge",
    "register",
    "info",
    "calibrate",
    "bench",
    "precision-search",
];

#[test]
fn the_reference_is_the_help_of_the_program() {
    let scratch = Scratch::empty();
    let help = |command: &str| scratch.run(&format!("{command} --help")).succeeds().stdout.clone();
    let mut text = format!(
        "# Command line\n\nGenerated from the help texts by `{WRITE}=1 cargo test --release --test cli reference`; do not edit.\n\n\
         ```text\n{}```\n",
        help("")
    );
    for command in COMMANDS {
        text += &format!("\n## {command}\n\n```text\n{}```\n", help(command));
    }
    // Clap pads empty lines of a description.
    let text: String = text.lines().flat_map(|line| [line.trim_end(), "\n"]).collect();
    let page = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/reference/command-line.md");
    if std::env::var_os(WRITE).is_some() {
        fs::write(&page, &text).unwrap();
    }
    let found = fs::read_to_string(&page).unwrap();
    assert!(found == text, "{}: write it with {WRITE}=1", page.display());
}

/// Packages take manual pages and completions from the program.
#[test]
fn manual_pages_and_completions_name_every_command() {
    let scratch = Scratch::empty();
    scratch.run("manual .").succeeds();
    let read = |name: &str| fs::read_to_string(scratch.path(name)).unwrap();
    let (page, bash) = (read("vbgs-studio.1"), read("vbgs-studio.bash"));
    for command in COMMANDS {
        assert!(page.replace("\\-", "-").contains(command), "{command}");
        assert!(bash.contains(command), "{command}");
        assert!(read(&format!("vbgs-studio-{command}.1")).contains(".TH"), "{command}");
    }
    assert!(read("_vbgs-studio").starts_with("#compdef") && !read("vbgs-studio.fish").is_empty());
    scratch.run("manual missing").fails(1, &["missing", "name an existing folder"]);
}
