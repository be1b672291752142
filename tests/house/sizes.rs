//! How long functions are.

use crate::tokens::{Token, text, tokens};

/// Every function of a file with a body: its name, its first line and how many lines it has, from
/// its signature to the brace that closes it.
pub fn functions(source: &str) -> Vec<(String, usize, usize)> {
    let tokens = tokens(source);
    let mut found = Vec::new();
    for i in 0..tokens.len() {
        // A type `fn(…)` has no name.
        let is_function = tokens[i].text == "fn" && text(&tokens, i + 1) != "(";
        if let Some(end) = is_function.then(|| end_of_body(&tokens, i)).flatten() {
            let first = tokens[i].line;
            found.push((text(&tokens, i + 1).to_owned(), first, tokens[end].line - first + 1));
        }
    }
    found
}

/// The brace that closes the function at `at`; `None` for one without a body.
fn end_of_body(tokens: &[Token], at: usize) -> Option<usize> {
    let mut depth = 0usize;
    for (i, token) in tokens.iter().enumerate().skip(at) {
        match token.text {
            ";" if depth == 0 => return None,
            "{" | "(" | "[" => depth += 1,
            "}" | ")" | "]" => depth = depth.checked_sub(1)?,
            _ => {}
        }
        if token.text == "}" && depth == 0 {
            return Some(i);
        }
    }
    None
}

#[test]
fn functions_are_measured() {
    let source = "fn a() {}\n\nimpl T {\n    pub fn b(\n        x: [u8; 3],\n    ) -> u8 {\n        \
                  fn c() {\n        }\n        f(\"}\")\n    }\n    fn d();\n    x: fn(u8),\n}\n";
    let found = functions(source);
    let found: Vec<_> = found.iter().map(|(name, first, n)| (name.as_str(), *first, *n)).collect();
    assert_eq!(found, [("a", 1, 1), ("b", 4, 7), ("c", 7, 2)]);
}
