//! Random, seeded corruption of valid files.

use vbgs_studio::math::rng::Rng;

/// Tokens that mutations insert: extreme numbers, syntax and noise.
const TOKENS: [&str; 20] = [
    "NaN",
    "null",
    "-1e308",
    "1e999",
    "0",
    "1e-320",
    "\"\"",
    "[]",
    "{}",
    "]",
    "}",
    ",",
    "..",
    "/",
    "true",
    "\u{fffd}",
    "\0",
    "inf",
    "-",
    "999999999999999999999999",
];

/// Returns the bytes with one to four changes: truncation, deletion, duplication, insertion of a token, a
/// flipped bit or a digit.
pub fn mutate(bytes: &[u8], rng: &mut Rng) -> Vec<u8> {
    let mut out = bytes.to_vec();
    for _ in 0..=rng.below(4) {
        let at = rng.below(out.len().max(1)).min(out.len());
        let end = (at + rng.below(12)).min(out.len());
        match rng.below(6) {
            0 => out.truncate(at),
            1 => drop(out.drain(at..end)),
            2 => {
                let token = TOKENS[rng.below(TOKENS.len())];
                out.splice(at..end, token.bytes());
            }
            3 => {
                let copy = out[at..end].to_vec();
                out.splice(at..at, copy);
            }
            4 => out.iter_mut().skip(at).take(1).for_each(|b| *b ^= 1 << rng.below(8)),
            _ => out.iter_mut().skip(at).take(1).for_each(|b| *b = b'0' + rng.below(10) as u8),
        }
    }
    out
}
