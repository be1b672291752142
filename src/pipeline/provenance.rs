//! What files of splats say of where they are from.

use super::settings::method::Method;
use crate::model::splat::splats::CovarianceForm;
use crate::render::Antialias;

/// Comment lines of a file of splats: by which program and settings they were made, for which rule of
/// antialiasing, and by which conversion where that is not the plain one.
pub fn file_comments(method: &Method, n_frames: u64) -> Vec<String> {
    let program = concat!("vbgs-studio ", env!("CARGO_PKG_VERSION"));
    let preset = method.preset();
    let mut comments = vec![
        format!("vbgs made by {program}, preset {preset}, from {n_frames} frames"),
        // Other programs know a second rule, which takes from the opacity what it adds to the size.
        format!("vbgs antialias {}: 0.3 px2 added, opacity kept", Antialias::Footprint),
    ];
    if method.any().covariance_form() == CovarianceForm::LegacyCholesky {
        comments.push("vbgs legacy-cov".to_owned());
    }
    comments
}
