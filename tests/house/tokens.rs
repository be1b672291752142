//! Rust source as words and punctuation, without comments, strings and character literals.

/// A word or a piece of punctuation (`::` is one piece).
#[derive(Clone, Debug, PartialEq)]
pub struct Token<'a> {
    /// Line, from 1.
    pub line: usize,
    pub text: &'a str,
}

/// Splits a source file.
pub fn tokens(source: &str) -> Vec<Token<'_>> {
    let mut found = Vec::new();
    let (mut rest, mut line) = (source, 1);
    while let Some(first) = rest.chars().next() {
        let (length, kept) = piece(rest, first);
        let (text, after) = rest.split_at(length);
        if kept {
            found.push(Token { line, text });
        }
        line += text.matches('\n').count();
        rest = after;
    }
    found
}

/// What is compiled outside of tests: items under `#[cfg(test)]` are left out.
pub fn shipped(tokens: Vec<Token<'_>>) -> Vec<Token<'_>> {
    const TEST: [&str; 7] = ["#", "[", "cfg", "(", "test", ")", "]"];
    let mut kept = Vec::with_capacity(tokens.len());
    let mut at = 0;
    while at < tokens.len() {
        if TEST.iter().enumerate().all(|(i, part)| text(&tokens, at + i) == *part) {
            at = end_of_item(&tokens, at + TEST.len());
        } else {
            kept.push(tokens[at].clone());
            at += 1;
        }
    }
    kept
}

/// Past the item that starts at `at`: its `;` or the brace that closes it.
fn end_of_item(tokens: &[Token<'_>], mut at: usize) -> usize {
    let mut depth = 0usize;
    while at < tokens.len() {
        let word = tokens[at].text;
        at += 1;
        match word {
            "{" | "(" | "[" => depth += 1,
            "}" | ")" | "]" => depth = depth.saturating_sub(1),
            _ => {}
        }
        if depth == 0 && [";", "}"].contains(&word) {
            break;
        }
    }
    at
}

/// The text of a token, nothing past the end.
pub fn text<'a>(tokens: &[Token<'a>], at: usize) -> &'a str {
    tokens.get(at).map_or("", |t| t.text)
}

/// Length in bytes of what the source starts with, and whether it is a token.
fn piece(source: &str, first: char) -> (usize, bool) {
    if let Some(length) = comment(source).or_else(|| literal(source)) {
        return (length, false);
    }
    if is_word(first) {
        return (source.find(|c| !is_word(c)).unwrap_or(source.len()), true);
    }
    if source.starts_with("::") {
        return (2, true);
    }
    (first.len_utf8(), !first.is_whitespace())
}

fn is_word(c: char) -> bool {
    c.is_alphanumeric() || c == '_'
}

fn comment(source: &str) -> Option<usize> {
    if source.starts_with("//") {
        return Some(source.find('\n').unwrap_or(source.len()));
    }
    if !source.starts_with("/*") {
        return None;
    }
    let (mut depth, mut at) = (0, 0);
    while at < source.len() {
        let rest = &source.as_bytes()[at..];
        at += match (rest.starts_with(b"/*"), rest.starts_with(b"*/")) {
            (true, _) => {
                depth += 1;
                2
            }
            (_, true) => {
                depth -= 1;
                2
            }
            _ => 1,
        };
        if depth == 0 {
            break;
        }
    }
    Some(at.min(source.len()))
}

fn literal(source: &str) -> Option<usize> {
    let unprefixed = source.trim_start_matches(['b', 'c', 'r']);
    let prefix = source.len() - unprefixed.len();
    let hashes = unprefixed.len() - unprefixed.trim_start_matches('#').len();
    let quoted = unprefixed[hashes..].strip_prefix('"');
    match quoted {
        Some(text) if prefix > 0 && source[..prefix].contains('r') => {
            let end = format!("\"{}", "#".repeat(hashes));
            let length = text.find(&end).map_or(text.len(), |i| i + end.len());
            Some(prefix + hashes + 1 + length)
        }
        Some(text) if hashes == 0 => Some(prefix + 1 + closing(text, b'"')),
        _ => character(unprefixed).filter(|_| prefix <= 1).map(|length| prefix + length),
    }
}

/// A character literal; a lifetime is none.
fn character(source: &str) -> Option<usize> {
    let inner = source.strip_prefix('\'')?;
    let escaped = inner.starts_with('\\');
    let single = inner.chars().nth(1) == Some('\'');
    (escaped || single).then(|| 1 + closing(inner, b'\''))
}

/// Bytes up to and including the closing quote.
fn closing(text: &str, quote: u8) -> usize {
    let mut escaped = false;
    for (i, &byte) in text.as_bytes().iter().enumerate() {
        match byte {
            _ if escaped => escaped = false,
            b'\\' => escaped = true,
            _ if byte == quote => return i + 1,
            _ => {}
        }
    }
    text.len()
}

#[test]
fn only_code_is_left() {
    let texts = |source| tokens(source).into_iter().map(|t| t.text).collect::<Vec<_>>();
    let cases: [(&str, &[&str]); 9] = [
        ("a::b // c::d", &["a", "::", "b"]),
        ("a /* b /* c */ d */ e", &["a", "e"]),
        (r#"x("crate::\"y", z)"#, &["x", "(", ",", "z", ")"]),
        ("r#\"a \" b\"# c", &["c"]),
        ("b\"a\" br\"\\\" c", &["c"]),
        ("'a' 'b'x 'static '\\'' b'\\n' y", &["x", "'", "static", "y"]),
        ("/// crate::app\nfn f", &["fn", "f"]),
        ("broken crate_ r", &["broken", "crate_", "r"]),
        ("\"never closed", &[]),
    ];
    for (source, expected) in cases {
        assert_eq!(texts(source), expected, "{source}");
    }
    assert_eq!(tokens("a\n\"x\ny\"\n b")[1], Token { line: 4, text: "b" });
}

#[test]
fn tests_are_not_shipped() {
    let cases = [
        ("a #[cfg(test)] mod t { b { c } } d", "a d"),
        ("a #[cfg(test)] mod t; d", "a d"),
        ("a #[cfg(test)] #[test] fn f([x]: T) -> [u8; 3] { b } d", "a d"),
        ("#[cfg(feature)] a", "# [ cfg ( feature ) ] a"),
    ];
    for (source, expected) in cases {
        let left: Vec<&str> = shipped(tokens(source)).into_iter().map(|t| t.text).collect();
        assert_eq!(left.join(" "), expected, "{source}");
    }
}
