//! Export and re-import in memory, for previews of lossy formats, and models in the axes they were exported from.

use super::error::Fault;
use super::format::{Axes, ModelFormat, WriteOptions};
use super::gaussian::{AxisRotation, Gaussian};
use super::source::Placement;
use super::{read, write};
use crate::model::splat::appearance::{SplatSet, SplatView};
use glam::DVec3;

/// Model after export and import.
#[derive(Clone, Debug, PartialEq)]
pub struct ReadBack {
    /// Splats of the file, in the axes and units of the model.
    pub splats: SplatSet,
    /// Size of the file in bytes.
    pub bytes: u64,
}

/// Writes a model to memory and reads it back, in the model's own axes and units, without its registration.
/// Needs memory for the whole file and for the splats read from it.
///
/// ```
/// use vbgs_studio::export::{ModelFormat, WriteOptions, read_back};
/// use vbgs_studio::model::splat::splats::Splat;
///
/// let splat = Splat { mean: [0.1, 0.2, 0.3], scale: [0.01; 3], ..Splat::default() };
/// let splat = Splat { opacity: 0.7, ..splat };
/// let ply = read_back(&[splat], &WriteOptions::new(ModelFormat::Ply))?;
/// assert_eq!(ply.splats[0].mean, splat.mean);
/// // SPZ rounds.
/// let spz = read_back(&[splat], &WriteOptions::new(ModelFormat::Spz))?;
/// assert_ne!(spz.splats[0].mean, splat.mean);
/// assert!((spz.splats[0].mean[0] - splat.mean[0]).abs() < 0.002);
/// # Ok::<(), vbgs_studio::export::Fault>(())
/// ```
///
/// # Errors
/// Those of [`write()`](super::write()) and [`read()`](super::read()), except file errors.
pub fn read_back<'a>(
    splats: impl Into<SplatView<'a>>,
    options: &WriteOptions,
) -> Result<ReadBack, Fault> {
    let (splats, stated) = (splats.into(), options);
    // Formats that are not read hold the same splats as one that is.
    let format = match options.format {
        ModelFormat::Html => ModelFormat::Spz,
        ModelFormat::Usda => ModelFormat::Glb,
        other => other,
    };
    // Placing the model elsewhere changes nothing that a preview could show.
    let options = &WriteOptions { format, registration: None, ..options.clone() };
    let bytes = write::encode(splats, options)?;
    let model = read::decode(&bytes)?;
    let n_bytes = match format == stated.format {
        true => bytes.len(),
        false => write::encode(splats, stated)?.len(),
    };
    // Reading rotated some files to z-up, which is undone as well.
    let back = match options.format.own_axes() {
        None => AxisRotation::IDENTITY,
        Some(Axes::Viewer) => AxisRotation::Z_UP_TO_Y_DOWN.inverse(),
        Some(_) => AxisRotation::Y_UP_TO_Z_UP,
    };
    let there = Placement::of(options).turn.then(back);
    let splats = to_model_axes(model.splats, there.inverse(), 1.0 / options.unit_scale);
    Ok(ReadBack { splats, bytes: n_bytes as u64 })
}

/// Turns splats and their local origin from axes with the first up direction to axes with the second. For a model
/// exported from a world with the second, this is the inverse of the rotation that the export applied.
///
/// ```
/// use glam::DVec3;
/// use vbgs_studio::export::turned;
/// use vbgs_studio::model::splat::splats::Splat;
///
/// let splat = Splat { mean: [0.0, 0.0, 2.0], ..Splat::default() };
/// let (splats, _) = turned(vec![splat].into(), DVec3::ZERO, [DVec3::Z, DVec3::NEG_Y]);
/// assert_eq!(splats[0].mean, [0.0, -2.0, 0.0]);
/// ```
pub fn turned(splats: SplatSet, local_origin: DVec3, [from, to]: [DVec3; 2]) -> (SplatSet, DVec3) {
    let turn = AxisRotation::to_z_up(from).then(AxisRotation::to_z_up(to).inverse());
    (to_model_axes(splats, turn, 1.0), turn.rotate_vector(local_origin))
}

fn to_model_axes(read: SplatSet, turn: AxisRotation, scale: f64) -> SplatSet {
    // A rotation or factor would round.
    if turn.is_identity() && scale == 1.0 {
        return read;
    }
    let mut turned = SplatSet::default().finished(read.finishing().clone());
    for (i, splat) in read.iter().enumerate() {
        let gaussian =
            Gaussian::from_splat(splat, &read.appearance_of(i)).rotated(&turn).scaled(scale);
        if let Some((splat, appearance)) = gaussian.with_positive_w().to_splat() {
            turned.push(splat, appearance);
        }
    }
    turned
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::splat::splats::Splat;
    use glam::DMat3;

    #[test]
    fn every_format_gives_a_model_back_where_it_stood() {
        let splat = Splat {
            mean: [0.5, -1.25, 2.0],
            opacity: 0.75,
            color: [0.25, 0.5, 0.75],
            scale: [0.02, 0.01, 0.005],
            rotation: [0.5, 0.5, -0.5, 0.5],
        };
        let other = Splat { mean: [-0.3, 0.1, 0.2], ..splat };
        let splat_formats =
            ModelFormat::ALL.into_iter().filter(|f| *f != ModelFormat::PointCloudPly);
        for format in splat_formats {
            for up in [DVec3::Z, DVec3::NEG_Y, DVec3::NEG_Z, DVec3::new(2.0, -3.0, 6.0) / 7.0] {
                let options = WriteOptions {
                    up,
                    axes: Axes::Viewer,
                    unit_scale: 2.0,
                    ..WriteOptions::new(format)
                };
                let given = read_back(&[splat, other], &options).unwrap();
                assert_eq!(given.splats.len(), 2);
                assert!(given.bytes > 40);
                for original in [splat, other] {
                    let place = |s: &Splat| DVec3::from_array(s.mean.map(f64::from));
                    let is_near = |s: &&Splat| place(s).distance(place(&original)) < 2e-3;
                    let found = given.splats.iter().find(is_near).unwrap();
                    // SOG may add half a turn about an axis of the splat.
                    let axes = |s: &Splat| DMat3::from_quat(s.quaternion());
                    let same = |k| axes(found).col(k).dot(axes(&original).col(k)).abs();
                    assert!(
                        (0..3).all(|k| same(k) > 0.9986),
                        "{format} {up}: {:?}",
                        found.rotation
                    );
                    for axis in 0..3 {
                        let ratio = found.scale[axis] / original.scale[axis];
                        assert!((ratio - 1.0).abs() < 0.05, "{format} {up}: {:?}", found.scale);
                    }
                }
            }
        }
    }
}
