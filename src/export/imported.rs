//! What a model file held.
//!
//! A row that is not finite is skipped and counted, not an error: one broken splat must not lose a
//! model of a million. What else was ignored, guessed or converted is a [`Note`], which window and
//! command line word for the user.

use super::error::{Fault, reserved};
use super::gaussian::{Gaussian, unit_quaternion};
use super::local_origin;
use crate::model::splat::appearance::SplatSet;
use crate::model::splat::splats::{Splat, bounds};
use glam::{DQuat, DVec3};
use std::fmt;

/// A model read from a file.
#[derive(Clone, Debug, PartialEq)]
pub struct Imported {
    /// Finite splats in file order, in the file's axes (PLY, `.splat`) or turned to z-up (glTF, SPZ). Those of a
    /// point cloud are opaque balls about as wide as half the spacing of the points. With degree-1
    /// colour where the file has it.
    pub splats: SplatSet,
    /// What the rows were.
    pub kind: ModelKind,
    /// What positions are relative to in the file's world, in the axes of `splats`; zero where the file does
    /// not say.
    pub local_origin: DVec3,
    /// Whether the format says what is up, so that reading turned it to z.
    pub is_z_up: bool,
    /// Rows left out because a field was NaN or infinite.
    pub skipped: usize,
    /// What was ignored, guessed or converted.
    pub notes: Vec<Note>,
    /// Comment lines of a PLY, `asset.extras.comments` of a glTF.
    pub comments: Vec<String>,
    /// Size of the file.
    pub bytes: u64,
}

/// Start of the PLY comment that names the direction pointing up; brush reads it too.
pub(super) const VERTICAL_AXIS: &str = "Vertical axis:";

impl Imported {
    /// Unit vector that points up in the model's world, where the file says so.
    pub fn up(&self) -> Option<DVec3> {
        if self.is_z_up {
            return Some(DVec3::Z);
        }
        let text = self.comments.iter().find_map(|line| line.strip_prefix(VERTICAL_AXIS))?;
        let numbers: Vec<f64> = text.split_whitespace().filter_map(|n| n.parse().ok()).collect();
        DVec3::from_array(numbers.try_into().ok()?).try_normalize()
    }
}

/// What a file's rows describe.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ModelKind {
    /// Gaussian splats: rows with scales and a rotation.
    Splats,
    /// Coloured points without extent.
    PointCloud,
}

/// Something a user should know about an import that succeeded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Note {
    /// Spherical harmonics above degree 1 were dropped, or all above degree 0 where they are
    /// incomplete or linear.
    ViewDependentColorIgnored {
        /// Coefficients per splat that were ignored, over all channels.
        n_coefficients: usize,
    },
    /// Quaternions of length zero were read as the identity.
    ZeroRotation {
        /// Number of splats that this happened to.
        n_splats: usize,
    },
    /// Colours outside `[0, 1]` were clamped.
    ColorClamped {
        /// Number of splats that this happened to.
        n_splats: usize,
    },
    /// The third scale is missing: splats are flat.
    FlatSplats,
    /// There is no colour: everything is gray.
    NoColor,
    /// Linear colours were encoded to sRGB.
    LinearColorEncoded,
    /// Scales were logarithms, as drafts of glTF's extension before 2026 had them.
    LogarithmicScales,
    /// A glTF names a kernel or colour space of another extension.
    UnknownKernel,
    /// Splats of a glTF without harmonics have the colours of its points.
    FallbackColor,
    /// Records that extensions of an SPZ define.
    ExtensionsIgnored,
    /// Parts of a glTF that are not what was imported.
    PrimitivesSkipped {
        /// Number of primitives left out.
        n_primitives: usize,
    },
}

impl fmt::Display for Note {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Note::ViewDependentColorIgnored { n_coefficients } => {
                write!(f, "view-dependent colour ignored ({n_coefficients} coefficients per splat)")
            }
            Note::ZeroRotation { n_splats } => {
                write!(f, "{n_splats} splats had a rotation of length zero, read as no rotation")
            }
            Note::ColorClamped { n_splats } => {
                write!(f, "{n_splats} splats had a colour outside 0..1, clamped")
            }
            Note::FlatSplats => f.write_str("scale_2 is missing: splats read as flat"),
            Note::NoColor => f.write_str("the file holds no colour: points read as gray"),
            Note::LinearColorEncoded => f.write_str("linear colours encoded to sRGB"),
            Note::LogarithmicScales => {
                f.write_str("scales read as logarithms: the file follows a draft of the extension")
            }
            Note::UnknownKernel => f.write_str(
                "a kernel or colour space of another extension: read as ellipses in sRGB",
            ),
            Note::FallbackColor => f.write_str("no harmonics: splats have the colours of COLOR_0"),
            Note::ExtensionsIgnored => f.write_str("what extensions add to the file is ignored"),
            Note::PrimitivesSkipped { n_primitives } => {
                write!(f, "{n_primitives} other primitives of the file (meshes, points) skipped")
            }
        }
    }
}

/// Rows as they come in, counted and checked.
pub(super) struct Rows {
    splats: SplatSet,
    skipped: usize,
    n_zero_rotations: usize,
    n_wild_colors: usize,
}

impl Rows {
    /// Room for `n` rows, of which the file is known to hold the bytes.
    pub fn with_room(n: usize) -> Result<Self, Fault> {
        let splats: Vec<Splat> = reserved(n)?;
        Ok(Self { splats: splats.into(), skipped: 0, n_zero_rotations: 0, n_wild_colors: 0 })
    }

    /// The rotation of `w x y z`; one without direction is the identity, and counted.
    pub fn rotation(&mut self, quaternion: [f64; 4]) -> DQuat {
        unit_quaternion(quaternion).unwrap_or_else(|| {
            self.n_zero_rotations += 1;
            DQuat::IDENTITY
        })
    }

    /// Adds a row, or counts it as skipped.
    pub fn push(&mut self, row: Gaussian) {
        // Turned axes may have left the other quaternion of the rotation.
        match row.with_positive_w().to_splat() {
            // Colours are noted only for rows that stay.
            Some((splat, appearance)) => {
                self.n_wild_colors += usize::from(row.has_wild_color());
                self.splats.push(splat, appearance);
            }
            None => self.skipped += 1,
        }
    }

    /// The finished import, with the notes that follow from the rows added to `notes`.
    pub fn finish(
        mut self,
        kind: ModelKind,
        mut notes: Vec<Note>,
        comments: Vec<String>,
    ) -> Result<Imported, Fault> {
        // An empty scene would open and show nothing; better to say why.
        if self.splats.is_empty() {
            return Err(Fault::NothingToImport { skipped: self.skipped });
        }
        if kind == ModelKind::PointCloud {
            give_points_a_size(self.splats.splats_mut());
        }
        if self.n_zero_rotations > 0 {
            notes.push(Note::ZeroRotation { n_splats: self.n_zero_rotations });
        }
        if self.n_wild_colors > 0 {
            notes.push(Note::ColorClamped { n_splats: self.n_wild_colors });
        }
        let Self { splats, skipped, .. } = self;
        Ok(Imported {
            splats,
            kind,
            local_origin: local_origin::of_comments(&comments),
            is_z_up: false,
            skipped,
            notes,
            comments,
            bytes: 0,
        })
    }
}

/// Half the spacing of points spread over a surface about as large as their bounding box, as the
/// standard deviation: neighbours then touch whatever the file's unit of length.
fn give_points_a_size(points: &mut [Splat]) {
    let diagonal = bounds(points).map_or(0.0, |(lo, hi)| (hi - lo).length());
    let spacing = diagonal / (points.len() as f64).sqrt();
    // One point, or all in one place, has no spacing; a millimetre in metres can at least be seen.
    let scale = if spacing > 0.0 { (0.5 * spacing) as f32 } else { 1e-3 };
    for point in points {
        point.scale = [scale; 3];
    }
}
