//! Presets are told apart in the seam; everybody else asks what every preset answers.

use crate::tokens::{shipped, tokens};
use std::collections::BTreeMap;

/// Where it is decided which preset is meant.
const SEAM: [&str; 5] = [
    "pipeline/start.rs",
    "pipeline/presets/",
    "pipeline/settings/method.rs",
    "pipeline/settings/presets.rs",
    "train/setting/preset.rs",
];
/// Types that have one variant a preset.
const TYPES: [&str; 4] = ["Preset", "Method", "MethodRequest", "StoredModel"];
/// Those variants.
const VARIANTS: [&str; 3] = ["Paper", "Scene", "Mixture"];

/// Lines outside the seam with a pattern that asks for a preset: arms of `match`, and `let`.
pub fn arms(file: &str, source: &str) -> Vec<usize> {
    if SEAM.iter().any(|seam| file.starts_with(seam)) {
        return Vec::new();
    }
    let mut lines: BTreeMap<usize, Vec<&str>> = BTreeMap::new();
    for token in shipped(tokens(source)) {
        lines.entry(token.line).or_default().push(token.text);
    }
    let asks = |words: &[&str]| {
        let names = |w: &[&str]| TYPES.contains(&w[0]) && w[1] == "::" && VARIANTS.contains(&w[2]);
        let at = words.windows(3).position(names)?;
        let is_arm = words[at..].windows(2).any(|w| w == ["=", ">"]) || words[at..].contains(&"=>");
        let is_let = words[..at].contains(&"let") && words[at..].contains(&"=");
        (is_arm || is_let).then_some(())
    };
    lines.into_iter().filter_map(|(line, words)| asks(&words).map(|()| line)).collect()
}

#[test]
fn arms_are_found() {
    let source = "match m {\n Method::Paper(p) => 1,\n x if x == Preset::Scene => 2,\n}\n\
                  let StoredModel::Scene(s) = m else {};\nlet m = Method::Paper(p);\n";
    assert_eq!(arms("app/a.rs", source), [2, 3, 5]);
    assert_eq!(arms("pipeline/start.rs", source), [0; 0]);
}
