//! Parsers of command-line values.

use clap::builder::{PossibleValuesParser, TypedValueParser};
use glam::DVec3;
use std::str::FromStr;
use std::time::Duration;
use vbgs_studio::pipeline::plan::MAX_PASSES;

/// Parses an enum of the library by its names in files.
pub fn choice<T>() -> impl TypedValueParser<Value = T>
where
    T: FromStr<Err = strum::ParseError> + strum::VariantNames + Clone + Send + Sync + 'static,
{
    // The names are listed first, so that help and errors show them.
    PossibleValuesParser::new(T::VARIANTS).try_map(|name| name.parse::<T>())
}

/// Parses a whole number, 1 or more.
pub fn parse_count(text: &str) -> Result<usize, String> {
    // Options of this type allow negative numbers: otherwise clap would report `-5` as an unknown option
    // instead of the expected value.
    let count = text.parse().ok().filter(|&n| n > 0);
    count.ok_or_else(|| "expected a whole number, 1 or more".to_owned())
}

/// Parses the number of passes over the frames.
pub fn parse_passes(text: &str) -> Result<usize, String> {
    let passes = text.parse().ok().filter(|n| (1..=MAX_PASSES).contains(n));
    passes.ok_or_else(|| format!("expected a whole number from 1 to {MAX_PASSES}"))
}

/// Parses a number above 0.
pub fn parse_positive(text: &str) -> Result<f64, String> {
    let number = text.parse().ok().filter(|n: &f64| n.is_finite() && *n > 0.0);
    number.ok_or_else(|| "expected a number above 0".to_owned())
}

/// Parses a factor between units of length.
pub fn parse_unit_scale(text: &str) -> Result<f64, String> {
    // Beyond this range, coordinates of usual scenes do not fit a file's single-precision floats.
    let factor = parse_positive(text).ok().filter(|factor| (1e-9..=1e9).contains(factor));
    factor.ok_or_else(|| "expected a factor from 1e-9 to 1e9".to_owned())
}

/// Parses a positive time in seconds.
pub fn parse_seconds(text: &str) -> Result<Duration, String> {
    let time = parse_positive(text).ok().and_then(|s| Duration::try_from_secs_f64(s).ok());
    time.ok_or_else(|| "expected a number of seconds above 0".to_owned())
}

/// Parses two opposite corners of a box.
pub fn parse_box(text: &str) -> Result<[DVec3; 2], String> {
    let numbers: Vec<f64> = text.split(',').filter_map(|n| n.trim().parse().ok()).collect();
    match numbers[..] {
        [a, b, c, d, e, f] if numbers.iter().all(|n| n.is_finite()) => {
            Ok([DVec3::new(a, b, c), DVec3::new(d, e, f)])
        }
        _ => Err("expected six numbers X,Y,Z,X,Y,Z: two opposite corners".to_owned()),
    }
}

pub fn parse_color(text: &str) -> Result<[f32; 3], String> {
    match text {
        "black" => return Ok([0.0; 3]),
        "white" => return Ok([1.0; 3]),
        _ => {}
    }
    // ASCII only: otherwise a two-byte slice could split a character and panic.
    let hex = text.strip_prefix('#').filter(|h| h.len() == 6 && h.is_ascii());
    let byte = |i: usize| hex.and_then(|h| u8::from_str_radix(&h[2 * i..2 * i + 2], 16).ok());
    match (byte(0), byte(1), byte(2)) {
        (Some(r), Some(g), Some(b)) => Ok([r, g, b].map(|v| v as f32 / 255.0)),
        _ => Err("expected black, white or #rrggbb".to_owned()),
    }
}

pub fn parse_size(text: &str) -> Result<[u32; 2], String> {
    let side = |s: &str| s.parse::<u32>().ok().filter(|n| (1..=16384).contains(n));
    let parts = text.split_once('x').and_then(|(w, h)| Some([side(w)?, side(h)?]));
    parts.ok_or_else(|| "expected WIDTHxHEIGHT, each from 1 to 16384, such as 1280x720".to_owned())
}
