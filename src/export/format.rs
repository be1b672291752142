//! Export options: format, axes, selection and metadata.

use super::error::{ExportError, Fault};
use super::local_origin::OriginCarrier;
use super::mapping::Mapping;
use super::registration::Registration;
use super::stream::WriteProgress;
use glam::DVec3;
use std::path::Path;
use strum::{EnumMessage, EnumString, VariantNames};

/// File format of an exported model.
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
#[derive(
    Clone,
    Copy,
    Debug,
    PartialEq,
    Eq,
    serde::Serialize,
    serde::Deserialize,
    strum::Display,
    strum::EnumString,
    strum::IntoStaticStr,
)]
#[serde(rename_all = "kebab-case")]
#[strum(serialize_all = "kebab-case", parse_err_ty = UnknownFormat, parse_err_fn = unknown_format)]
pub enum ModelFormat {
    /// Splats as PLY in the 3DGS layout (`files.md`, PLY of splats), which splat viewers open.
    Ply,
    /// Splat centres as coloured points in PLY (`files.md`, Point cloud), for MeshLab, CloudCompare and
    /// Open3D.
    #[serde(rename = "point-cloud")]
    #[strum(serialize = "point-cloud")]
    PointCloudPly,
    /// Splats as GLB with `KHR_gaussian_splatting` (`files.md`, GLB).
    Glb,
    /// Splats as SPZ (`files.md`, SPZ), quantised to a fifth of the size of PLY.
    Spz,
    /// Splats as SOG (`files.md`, SOG), quantised to a tenth of the size of PLY.
    Sog,
    /// A page with a viewer (`files.md`, HTML), for any browser; not read.
    Html,
    /// Splats as particle field of OpenUSD 26.03 (`files.md`, USD), in text form; not read.
    Usda,
}

impl ModelFormat {
    /// All formats, in the order of the menu.
    pub const ALL: [ModelFormat; 7] = [
        ModelFormat::Ply,
        ModelFormat::PointCloudPly,
        ModelFormat::Glb,
        ModelFormat::Spz,
        ModelFormat::Sog,
        ModelFormat::Html,
        ModelFormat::Usda,
    ];

    /// Name of the format on the command line and in settings.
    pub fn name(self) -> &'static str {
        self.into()
    }

    /// Default file extension, without the dot.
    pub fn extension(self) -> &'static str {
        match self {
            ModelFormat::Ply | ModelFormat::PointCloudPly => "ply",
            ModelFormat::Glb => "glb",
            ModelFormat::Spz => "spz",
            ModelFormat::Sog => "sog",
            ModelFormat::Html => "html",
            ModelFormat::Usda => "usda",
        }
    }

    /// True if files of this format can be read again.
    pub fn is_read(self) -> bool {
        !matches!(self, ModelFormat::Html | ModelFormat::Usda)
    }

    /// Returns the axes that the format prescribes; `None` if it has none.
    pub fn own_axes(self) -> Option<Axes> {
        match self {
            ModelFormat::Ply | ModelFormat::PointCloudPly => None,
            ModelFormat::Sog => Some(Axes::Viewer),
            _ => Some(Axes::YUp),
        }
    }

    /// Returns how files of this format store the local origin.
    pub fn origin_carrier(self) -> OriginCarrier {
        match self {
            ModelFormat::Glb | ModelFormat::Usda => OriginCarrier::Transform,
            ModelFormat::Ply | ModelFormat::PointCloudPly => OriginCarrier::Comment,
            ModelFormat::Spz | ModelFormat::Sog | ModelFormat::Html => OriginCarrier::None,
        }
    }

    /// Derives the format from a file extension, case-insensitive; `.ply` means splats.
    ///
    /// # Errors
    /// [`Fault::UnknownExtension`] for any other extension.
    pub fn from_path(path: &Path) -> Result<Self, ExportError> {
        let found = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase());
        match found.as_deref() {
            // `.ply` usually means splats; a point cloud must be requested by name.
            Some("ply") => Ok(ModelFormat::Ply),
            Some("glb") => Ok(ModelFormat::Glb),
            Some("spz") => Ok(ModelFormat::Spz),
            Some("sog") => Ok(ModelFormat::Sog),
            Some("html" | "htm") => Ok(ModelFormat::Html),
            Some("usda") => Ok(ModelFormat::Usda),
            _ => Err(Fault::UnknownExtension { found: found.unwrap_or_default() }.with_path(path)),
        }
    }
}

/// Unknown format name.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("expected ply, point-cloud, glb, spz, sog, html or usda, found {0:?}")]
pub struct UnknownFormat(pub String);

fn unknown_format(name: &str) -> UnknownFormat {
    UnknownFormat(name.to_owned())
}

/// Version of a written SPZ file.
#[derive(
    Clone,
    Copy,
    Debug,
    Default,
    PartialEq,
    Eq,
    EnumMessage,
    EnumString,
    VariantNames,
    strum::Display,
)]
pub enum SpzVersion {
    /// Gzip, for the oldest readers (spz-js, GaussianSplats3D). Rotations err by up to 7 degrees.
    #[strum(serialize = "2")]
    V2 = 2,
    /// Gzip. Most readers accept it.
    #[default]
    #[strum(serialize = "3")]
    V3 = 3,
    /// Zstandard, the smallest. Many readers, such as Spark 2.2, refuse it.
    #[strum(serialize = "4")]
    V4 = 4,
}

impl SpzVersion {
    /// Returns a sentence about what is lost besides the rounding of all versions.
    pub fn loss(self) -> Option<&'static str> {
        let loss = "SPZ version 2 rounds rotations to 24 bits: they err by up to 7 degrees";
        (self == Self::V2).then_some(loss)
    }
}

/// Axes of a written PLY. Other formats prescribe theirs and ignore this option.
#[derive(
    Clone,
    Copy,
    Debug,
    Default,
    PartialEq,
    Eq,
    serde::Serialize,
    serde::Deserialize,
    EnumMessage,
    EnumString,
    VariantNames,
    strum::Display,
)]
#[serde(rename_all = "kebab-case")]
#[strum(serialize_all = "kebab-case")]
pub enum Axes {
    /// World axes of the model, unchanged.
    #[default]
    AsIs,
    /// Up becomes −y, as splat viewers expect. In a z-up world `(x, y, z)` becomes `(−x, −z, −y)`.
    Viewer,
    /// Up becomes y. In a z-up world `(x, y, z)` becomes `(x, z, −y)`.
    YUp,
    /// Up becomes z.
    ZUp,
}

/// Selection of the splats to write; `default()` selects all drawable ones.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct WriteSelection<'a> {
    /// Crop box as two opposite corners, in world units; splats with centres outside are left out.
    pub crop: Option<[DVec3; 2]>,
    /// Minimum number of training points assigned to a splat; requires [`WriteOptions::confidence`].
    pub min_evidence: Option<f64>,
    /// Maximum standard deviation of a splat's position, in world units; requires `uncertainty`.
    pub max_uncertainty: Option<f64>,
    /// Standard deviation of each splat's position, in world units. Required for `max_uncertainty`, and
    /// stored in point clouds.
    pub uncertainty: Option<&'a [f64]>,
    /// One flag per splat. Splats with `true` are always left out.
    pub left_out: Option<&'a [bool]>,
}

impl WriteSelection<'_> {
    /// True if splat `i`, with centre `mean`, is selected. `evidence` and the lists of the selection
    /// have one entry per splat.
    pub fn selects(&self, i: usize, mean: DVec3, evidence: Option<&[f64]>) -> bool {
        // The corners may come in any order.
        let is_inside =
            self.crop.is_none_or(|[a, b]| mean.cmpge(a.min(b)).all() && mean.cmple(a.max(b)).all());
        // A splat without an entry passes every limit.
        let evidence = evidence.and_then(|all| all.get(i)).map_or(f64::INFINITY, |of| *of);
        let uncertainty = self.uncertainty.and_then(|all| all.get(i)).map_or(0.0, |of| *of);
        is_inside
            && self.left_out.is_none_or(|all| all.get(i) != Some(&true))
            && self.min_evidence.is_none_or(|min| evidence >= min)
            && self.max_uncertainty.is_none_or(|max| uncertainty <= max)
    }
}

/// Options of writing a model; [`WriteOptions::new`] sets the defaults.
#[derive(Clone, Debug)]
pub struct WriteOptions<'a> {
    /// File format.
    pub format: ModelFormat,
    /// Axes of both PLY formats.
    pub axes: Axes,
    /// True to write 45 harmonic coefficients per splat, for readers that require spherical harmonics of
    /// degree 3. Coefficients above degree 1 are zero. Each splat takes 248 bytes instead of 68 or 104.
    /// 3DGS PLY only.
    pub sh3_padding: bool,
    /// Version of an SPZ file; other formats ignore it.
    pub spz_version: SpzVersion,
    /// Conversion of native splats (with flat tops or colour gradients) to plain ones, which other
    /// programs can draw. Plain splats and point clouds ignore it.
    pub mapping: Mapping,
    /// Comment lines in printable ASCII, such as `vbgs legacy-cov`: PLY comments, or `asset.extras.comments`
    /// of a GLB.
    pub comments: &'a [String],
    /// World positions of the training cameras. A point cloud then has normals that face the nearest camera.
    pub camera_centres: &'a [DVec3],
    /// Number of training points `N_k` of each given splat. A point cloud stores it with each point.
    pub confidence: Option<&'a [f64]>,
    /// Up direction in the world of the model, not zero. SOG rotates it to −y, other formats to y; a PLY
    /// stores it in a comment.
    pub up: DVec3,
    /// Local origin, to which positions are relative, in world axes and units; omitted if zero. A GLB
    /// stores it as the translation of its node, a PLY as a comment. Both use the file's axes and units.
    pub local_origin: DVec3,
    /// True if world units are metres. A GLB with unit scale 1 then states metres in
    /// `asset.extras.units`.
    pub metric: bool,
    /// Registration of the world. Files are then in its coordinates, which replace the world in the
    /// description of axes, local origin, metres and unit scale.
    pub registration: Option<&'a Registration>,
    /// File units per world unit, above 0.
    pub unit_scale: f64,
    /// Selection of the splats to write.
    pub selection: WriteSelection<'a>,
    /// Progress callback.
    pub progress: WriteProgress<'a>,
}

impl WriteOptions<'_> {
    /// Returns the comments of a file: those given, and the registration.
    pub(super) fn all_comments(&self) -> Vec<String> {
        let registered = self.registration.map(Registration::comments).unwrap_or_default();
        self.comments.iter().cloned().chain(registered).collect()
    }

    /// True if the coordinates of the file, before its unit scale, are in metres.
    pub(super) fn is_metric(&self) -> bool {
        self.registration.map_or(self.metric, |registration| registration.is_metric)
    }

    /// Creates options with unchanged axes, z-up, no padding, default mapping, no metadata, unknown
    /// units and all splats selected.
    pub fn new(format: ModelFormat) -> Self {
        Self {
            format,
            axes: Axes::AsIs,
            sh3_padding: false,
            spz_version: SpzVersion::default(),
            mapping: Mapping::default(),
            comments: &[],
            camera_centres: &[],
            confidence: None,
            up: DVec3::Z,
            local_origin: DVec3::ZERO,
            metric: false,
            registration: None,
            unit_scale: 1.0,
            selection: WriteSelection::default(),
            progress: WriteProgress::NONE,
        }
    }
}

/// File extensions that [`super::read()`] accepts, for the filters of file dialogs. The format itself is
/// detected from the content.
pub const READ_ENDINGS: [&str; 6] = ["ply", "glb", "gltf", "spz", "sog", "splat"];
/// File extensions that [`super::write()`] writes, the default first.
pub const WRITTEN_ENDINGS: [&str; 6] = ["ply", "glb", "spz", "sog", "html", "usda"];

/// Formats a list of extensions for a sentence, such as `.ply, .glb or .spz`.
pub fn listed(endings: &[&str]) -> String {
    match endings {
        [] => String::new(),
        [only] => format!(".{only}"),
        [others @ .., last] => {
            let others: Vec<String> = others.iter().map(|ending| format!(".{ending}")).collect();
            format!("{} or .{last}", others.join(", "))
        }
    }
}
