//! What the positions of a file are relative to (`export.md`, Local origin).
//!
//! Positions are 32-bit in every format: those of a world far from zero are written relative to a place
//! nearby. A glTF has a transform for it, in decimal numbers; a PLY only a comment, which no other program
//! reads.

use glam::DVec3;

/// Start of the comment that names it.
const COMMENT: &str = "vbgs local origin ";
/// Name of it in `asset.extras` of a glTF.
pub(super) const EXTRA: &str = "local_origin";

/// How a format says what its positions are relative to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OriginCarrier {
    /// By a transform, which every program follows.
    Transform,
    /// By a comment, which this program alone reads.
    Comment,
    /// Not at all.
    None,
}

/// Whether a comment of a file names it, and is of that file alone: in its axes and units.
pub fn is_comment(line: &str) -> bool {
    line.starts_with(COMMENT)
}

/// What other programs make of a file with this local origin; `None` if all is well.
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
            "which only a comment of the file says: other programs do not read it"
        }
        OriginCarrier::None => "which the file cannot say: write it down",
    };
    let [x, y, z] = origin.to_array();
    Some(format!(
        "its 32-bit positions cannot hold a world so far from zero; they are relative to ({x}, {y}, {z}), {says}; export GLB, whose node has the translation"
    ))
}

/// The comment for an origin in the axes and units of the file; none for zero.
pub(super) fn comment(origin: DVec3) -> Option<String> {
    let [x, y, z] = origin.to_array();
    (origin != DVec3::ZERO).then(|| format!("{COMMENT}{x} {y} {z}"))
}

/// What comments say; zero where they do not.
pub(super) fn of_comments(comments: &[String]) -> DVec3 {
    let named = comments.iter().find_map(|line| line.strip_prefix(COMMENT));
    named.and_then(parsed).unwrap_or(DVec3::ZERO)
}

fn parsed(text: &str) -> Option<DVec3> {
    let numbers: Option<Vec<f64>> = text.split_whitespace().map(|n| n.parse().ok()).collect();
    Some(DVec3::from_array(numbers?.try_into().ok()?)).filter(|origin| origin.is_finite())
}
