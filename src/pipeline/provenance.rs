//! Provenance comments of exported splat files.

use super::settings::method::Method;
use crate::model::splat::splats::CovarianceForm;
use crate::render::Antialias;

/// Comment lines of a splat file: program and settings, antialiasing rule, and the covariance conversion if
/// it is not the default.
pub fn file_comments(method: &Method, n_frames: u64) -> Vec<String> {
    let program = concat!("vbgs-studio ", env!("CARGO_PKG_VERSION"));
    let preset = method.preset();
    let mut comments = vec![
        format!("vbgs made by {program}, preset {preset}, from {n_frames} frames"),
        // Other programs also have a rule that reduces the opacity by as much as the area grows.
        format!("vbgs antialias {}: 0.3 px2 added, opacity kept", Antialias::Footprint),
    ];
    if method.as_any().covariance_form() == CovarianceForm::LegacyCholesky {
        comments.push("vbgs legacy-cov".to_owned());
    }
    comments
}
