//! Local origin of a file's positions (`files.md`, Local origin).
//!
//! All formats store 32-bit positions, so those far from zero are written relative to a nearby origin. A glTF
//! stores it as a node transform, in decimal numbers; a PLY only as a comment, which no other program reads.

use glam::DVec3;

const COMMENT: &str = "vbgs local origin ";
pub(super) const EXTRA: &str = "local_origin";

/// Method by which a file format stores the local origin.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OriginCarrier {
    /// The local origin is stored as a transform, which every program applies.
    Transform,
    /// The local origin is stored as a comment, which only this program reads.
    Comment,
    /// The format cannot store the local origin.
    None,
}

/// True if a comment line states the local origin. Such a comment applies only to its own file, in the
/// axes and units of that file.
pub fn is_comment(line: &str) -> bool {
    line.starts_with(COMMENT)
}

/// Returns a warning if other programs cannot read the local origin.
///
/// ```
/// use glam::DVec3;
/// use vbgs_studio::export::local_origin::{OriginCarrier, warning};
///
/// assert_eq!(warning(DVec3::ZERO, OriginCarrier::None), None);
/// assert_eq!(warning(DVec3::X, OriginCarrier::Transform), None);
/// assert!(warning(DVec3::X, OriginCarrier::Comment).is_some());
/// ```
pub fn warning(origin: DVec3, carrier: OriginCarrier) -> Option<String> {
    let says = match carrier {
        _ if origin == DVec3::ZERO => return None,
        OriginCarrier::Transform => return None,
        OriginCarrier::Comment => {
            "which only a comment of the file states: other programs do not read it"
        }
        OriginCarrier::None => "which the file cannot store: note it down",
    };
    let [x, y, z] = origin.to_array();
    Some(format!(
        "32-bit positions cannot hold a world this far from zero; they are relative to ({x}, {y}, {z}), {says}; export GLB, whose node has the translation"
    ))
}

/// Formats the comment line for a local origin in the axes and units of the file; `None` for zero.
pub(super) fn comment(origin: DVec3) -> Option<String> {
    let [x, y, z] = origin.to_array();
    (origin != DVec3::ZERO).then(|| format!("{COMMENT}{x} {y} {z}"))
}

pub(super) fn from_comments(comments: &[String]) -> DVec3 {
    let named = comments.iter().find_map(|line| line.strip_prefix(COMMENT));
    named.and_then(parse_origin).unwrap_or(DVec3::ZERO)
}

fn parse_origin(text: &str) -> Option<DVec3> {
    let numbers: Option<Vec<f64>> = text.split_whitespace().map(|n| n.parse().ok()).collect();
    Some(DVec3::from_array(numbers?.try_into().ok()?)).filter(|origin| origin.is_finite())
}
