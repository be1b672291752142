//! What to write: formats, axes and the options of each.

use super::error::{ExportError, Fault};
use super::local_origin::OriginCarrier;
use super::mapping::Mapping;
use super::progress::WriteProgress;
use glam::DVec3;
use std::fmt;
use std::path::Path;
use std::str::FromStr;

/// A file format for models.
///
/// ```
/// use std::path::Path;
/// use vbgs_studio::export::ModelFormat;
///
/// assert_eq!(ModelFormat::from_path(Path::new("scene.GLB"))?, ModelFormat::Glb);
/// assert_eq!("point-cloud".parse::<ModelFormat>()?, ModelFormat::PointCloudPly);
/// assert!(ModelFormat::from_path(Path::new("scene.obj")).is_err());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ModelFormat {
    /// Splats as PLY in the 3DGS layout (`export.md`, PLY of splats): what splat viewers open.
    Ply,
    /// Centres as coloured points in PLY (`export.md`, Point cloud): for MeshLab, CloudCompare,
    /// Open3D.
    #[serde(rename = "point-cloud")]
    PointCloudPly,
    /// Splats as GLB with `KHR_gaussian_splatting` (`export.md`, GLB).
    Glb,
    /// Splats as SPZ version 4 (`export.md`, SPZ): a fifth of the bytes of PLY, rounded.
    Spz,
}

impl ModelFormat {
    /// Every format, in the order menus show them.
    pub const ALL: [ModelFormat; 4] =
        [ModelFormat::Ply, ModelFormat::PointCloudPly, ModelFormat::Glb, ModelFormat::Spz];

    /// The name used by the command line and settings.
    pub fn name(self) -> &'static str {
        match self {
            ModelFormat::Ply => "ply",
            ModelFormat::PointCloudPly => "point-cloud",
            ModelFormat::Glb => "glb",
            ModelFormat::Spz => "spz",
        }
    }

    /// The usual file name extension, without a dot.
    pub fn extension(self) -> &'static str {
        match self {
            ModelFormat::Ply | ModelFormat::PointCloudPly => "ply",
            ModelFormat::Glb => "glb",
            ModelFormat::Spz => "spz",
        }
    }

    /// How it says what its positions are relative to.
    pub fn origin_carrier(self) -> OriginCarrier {
        match self {
            ModelFormat::Glb => OriginCarrier::Transform,
            ModelFormat::Ply | ModelFormat::PointCloudPly => OriginCarrier::Comment,
            ModelFormat::Spz => OriginCarrier::None,
        }
    }

    /// The format a file name asks for: `.ply` means splats; case does not matter.
    ///
    /// # Errors
    /// [`Fault::UnknownExtension`] for any other name.
    pub fn from_path(path: &Path) -> Result<Self, ExportError> {
        let found = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase());
        match found.as_deref() {
            // Splats, not points: what a user means by PLY here; points are asked for by name.
            Some("ply") => Ok(ModelFormat::Ply),
            Some("glb") => Ok(ModelFormat::Glb),
            Some("spz") => Ok(ModelFormat::Spz),
            _ => Err(Fault::UnknownExtension { found: found.unwrap_or_default() }.at(path)),
        }
    }
}

impl fmt::Display for ModelFormat {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// A format name that does not exist.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("expected ply, point-cloud, glb or spz, found {0:?}")]
pub struct UnknownFormat(pub String);

impl FromStr for ModelFormat {
    type Err = UnknownFormat;

    fn from_str(name: &str) -> Result<Self, UnknownFormat> {
        let known = ModelFormat::ALL.into_iter().find(|format| format.name() == name);
        known.ok_or_else(|| UnknownFormat(name.to_owned()))
    }
}

/// The axes of a written PLY. GLB and SPZ prescribe their own, y up, and ignore this.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Axes {
    /// The model's world, unchanged.
    #[default]
    AsIs,
    /// Up turned to −y, as splat viewers expect it: of a z-up world `(x, y, z)` becomes
    /// `(−x, −z, −y)`.
    Viewer,
    /// Up turned to y: of a z-up world `(x, y, z)` becomes `(x, z, −y)`.
    YUp,
    /// Up turned to z.
    ZUp,
}

/// Which splats a file gets; `default()` leaves none out that can be drawn.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct WriteSelection<'a> {
    /// Two opposite corners, world units of the model: centres outside stay out.
    pub crop: Option<[DVec3; 2]>,
    /// Least number of points behind a splat; asks for [`WriteOptions::confidence`].
    pub min_evidence: Option<f64>,
    /// Largest standard deviation of a splat's position, world units; asks for `uncertainty`.
    pub max_uncertainty: Option<f64>,
    /// Standard deviation of the position of every splat given, world units; point clouds also hold it.
    pub uncertainty: Option<&'a [f64]>,
    /// Splats that stay out whatever else is asked for, one flag for each.
    pub left_out: Option<&'a [bool]>,
}

impl WriteSelection<'_> {
    /// Whether splat `i` is asked for, by its centre and the evidence of every splat. Lists are as long
    /// as the splats.
    pub fn takes(&self, i: usize, mean: DVec3, evidence: Option<&[f64]>) -> bool {
        let is_inside =
            self.crop.is_none_or(|[a, b]| mean.cmpge(a.min(b)).all() && mean.cmple(a.max(b)).all());
        let evidence = evidence.and_then(|all| all.get(i)).map_or(f64::INFINITY, |of| *of);
        let uncertainty = self.uncertainty.and_then(|all| all.get(i)).map_or(0.0, |of| *of);
        is_inside
            && self.left_out.is_none_or(|all| all.get(i) != Some(&true))
            && self.min_evidence.is_none_or(|min| evidence >= min)
            && self.max_uncertainty.is_none_or(|max| uncertainty <= max)
    }
}

/// How to write a model; [`WriteOptions::new`] gives the defaults.
#[derive(Clone, Debug)]
pub struct WriteOptions<'a> {
    /// The file's format.
    pub format: ModelFormat,
    /// Axes of both PLY formats.
    pub axes: Axes,
    /// 45 coefficients per splat above degree 0 (248 instead of 68 or 104 bytes), zeros above degree
    /// 1, for readers that insist on spherical harmonics of degree 3. 3DGS PLY only.
    pub sh3_padding: bool,
    /// How splats of native appearance become plain ones; plain splats and point clouds ignore it.
    pub mapping: Mapping,
    /// Lines kept with the file, such as `vbgs legacy-cov`: PLY comments, `asset.extras.comments`
    /// of a GLB. Printable ASCII.
    pub comments: &'a [String],
    /// World positions of the training cameras: when there are any, a point cloud gets normals,
    /// turned toward the nearest one.
    pub camera_centres: &'a [DVec3],
    /// `N_k` of every splat given, written with the points of a point cloud.
    pub confidence: Option<&'a [f64]>,
    /// Direction that points up in the model's world, not zero: GLB and SPZ have it turned to y, a
    /// PLY says it.
    pub up: DVec3,
    /// What positions are relative to in the world, in its axes and units; zero is left out. A GLB has it as
    /// the translation of its node, a PLY as a comment, both in the axes and units of the file.
    pub local_origin: DVec3,
    /// Lengths are metres: a GLB says so in `asset.extras.units`.
    pub metric: bool,
    /// Units of the file for each unit of the model's world, above 0.
    pub unit_scale: f64,
    /// Which splats are written.
    pub selection: WriteSelection<'a>,
    /// Who is told how far the writing is.
    pub progress: WriteProgress<'a>,
}

impl WriteOptions<'_> {
    /// Axes as they are, z up, no padding, one splat for each, no comments, no normals, no confidence,
    /// unknown units, nothing left out.
    pub fn new(format: ModelFormat) -> Self {
        Self {
            format,
            axes: Axes::AsIs,
            sh3_padding: false,
            mapping: Mapping::default(),
            comments: &[],
            camera_centres: &[],
            confidence: None,
            up: DVec3::Z,
            local_origin: DVec3::ZERO,
            metric: false,
            unit_scale: 1.0,
            selection: WriteSelection::default(),
            progress: WriteProgress::NONE,
        }
    }
}
