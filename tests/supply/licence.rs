//! Evaluates SPDX licence expressions, where older crates write a slash for `OR`.

/// True if the allowed licences satisfy the expression; an error if it is malformed.
pub fn is_allowed(expression: &str, allowed: &[String]) -> Result<bool, String> {
    let spaced = expression.replace('(', " ( ").replace(')', " ) ").replace('/', " OR ");
    let mut tokens = spaced.split_whitespace().peekable();
    let value = any(&mut tokens, allowed).ok_or_else(|| expression.to_owned())?;
    match tokens.next() {
        None => Ok(value),
        Some(_) => Err(expression.to_owned()),
    }
}

type Tokens<'a> = std::iter::Peekable<std::str::SplitWhitespace<'a>>;

fn any(tokens: &mut Tokens, allowed: &[String]) -> Option<bool> {
    let mut value = all(tokens, allowed)?;
    while tokens.next_if_eq(&"OR").is_some() {
        value |= all(tokens, allowed)?;
    }
    Some(value)
}

fn all(tokens: &mut Tokens, allowed: &[String]) -> Option<bool> {
    let mut value = one(tokens, allowed)?;
    while tokens.next_if_eq(&"AND").is_some() {
        value &= one(tokens, allowed)?;
    }
    Some(value)
}

fn one(tokens: &mut Tokens, allowed: &[String]) -> Option<bool> {
    let first = tokens.next()?;
    if first == "(" {
        let value = any(tokens, allowed)?;
        return (tokens.next()? == ")").then_some(value);
    }
    let name = match tokens.next_if_eq(&"WITH") {
        None => first.to_owned(),
        Some(_) => format!("{first} WITH {}", tokens.next()?),
    };
    let is_name = !["AND", "OR", "WITH", ")"].contains(&first);
    is_name.then(|| allowed.contains(&name))
}

#[test]
fn expressions_are_read_as_spdx_says() {
    let allowed = ["MIT", "Zlib", "Apache-2.0 WITH LLVM-exception"].map(str::to_owned);
    for yes in ["MIT", "MIT/GPL-3.0", "GPL-3.0 OR Zlib", "(GPL-3.0 OR MIT) AND Zlib"] {
        assert_eq!(is_allowed(yes, &allowed), Ok(true), "{yes}");
    }
    assert_eq!(is_allowed("Apache-2.0 WITH LLVM-exception", &allowed), Ok(true));
    for no in ["GPL-3.0", "MIT AND GPL-3.0", "Apache-2.0", "(MIT OR Zlib) AND GPL-3.0"] {
        assert_eq!(is_allowed(no, &allowed), Ok(false), "{no}");
    }
    for broken in ["", "MIT OR", "(MIT", "MIT Zlib", "AND MIT"] {
        assert!(is_allowed(broken, &allowed).is_err(), "{broken}");
    }
}
