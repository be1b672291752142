//! Result of importing a model file.
//!
//! Non-finite rows are skipped and counted, so one broken splat does not lose a model of a million. Anything
//! else that was ignored, guessed or converted is reported as a [`Note`].

use super::error::{Fault, shorten, shorten_to, try_with_capacity};
use super::gaussian::{Gaussian, unit_quaternion};
use super::local_origin;
use crate::model::splat::appearance::{Appearance, Finishing, SplatSet};
use crate::model::splat::splats::{Splat, bounds};
use glam::{DQuat, DVec3};

/// Model read from a file.
#[derive(Clone, Debug, PartialEq)]
pub struct Imported {
    /// Finite splats in file order, in the file's axes (PLY, `.splat`) or rotated to z-up (glTF, SPZ). Points
    /// become opaque spheres with half the point spacing as radius. View-dependent colour has degree 1 at most.
    /// Empty if only the outline was read.
    pub splats: SplatSet,
    /// Number, bounds and colour of the finite splats.
    pub outline: Outline,
    /// Kind of the rows: splats or points.
    pub kind: ModelKind,
    /// Local origin in the file's world, in the axes of `splats`; zero if the file has none.
    pub local_origin: DVec3,
    /// Up direction in the axes of `splats`, if the format defines its axes. Readers rotate such models to z-up.
    pub defined_up: Option<DVec3>,
    /// Number of rows skipped because a field was NaN or infinite.
    pub skipped: usize,
    /// Notices about content that was ignored, guessed or converted.
    pub notes: Vec<Note>,
    /// Comment lines of a PLY, or `asset.extras.comments` of a glTF.
    pub comments: Vec<String>,
    /// Size of the file in bytes.
    pub bytes: u64,
}

/// Number, bounds and colour of a model's finite splats.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Outline {
    /// Number of splats or points.
    pub n_splats: usize,
    /// Lowest and highest coordinates of the means, relative to the local origin.
    pub bounds: Option<[DVec3; 2]>,
    /// True if a colour depends on the direction of view.
    pub is_directional: bool,
}

impl Outline {
    fn add(&mut self, splat: &Splat, appearance: &Appearance) {
        let mean = DVec3::from_array(splat.mean.map(f64::from));
        let [lo, hi] = self.bounds.unwrap_or([mean; 2]);
        self.bounds = Some([lo.min(mean), hi.max(mean)]);
        self.n_splats += 1;
        self.is_directional |= *appearance != Appearance::default();
    }
}

// brush reads this comment as well.
pub(super) const VERTICAL_AXIS: &str = "Vertical axis:";

impl Imported {
    /// Up direction of the model's world as a unit vector, if the file states one.
    pub fn up(&self) -> Option<DVec3> {
        if self.defined_up.is_some() {
            return self.defined_up;
        }
        // The last line applies, as in brush.
        let text = self.comments.iter().rev().find_map(|line| value_of(line, VERTICAL_AXIS))?;
        parse_up(text, &self.comments)
    }

    /// Marks the splats as trained with antialiasing.
    pub(super) fn antialiased(mut self) -> Self {
        self.notes.push(Note::Antialiased);
        self.splats =
            self.splats.finished(Finishing { is_antialiased: true, ..Finishing::default() });
        self
    }
}

/// Comment of brush, gsplat and nerfstudio about the opacities of splats; `mip` means antialiased.
const RENDER_MODE: &str = "SplatRenderMode:";
/// Comment of Postshot with the same meaning, followed by 0 or 1.
const ANTIALIASED: &str = "antialiased";
/// Comments of an antialiased model, one for each convention.
pub(super) const ANTIALIASED_COMMENTS: [&str; 2] = ["SplatRenderMode: mip", "antialiased 1"];
/// Words that mark a comment about the meaning of a file's numbers.
const TELLING_WORDS: &str = "axis axes coordinate coordinates crs epsg feet filter frame gamma handed handedness \
    kernel linear meters metres offset origin scale shift transform unit units up";

/// Returns the text after `name`, whose case is irrelevant.
fn value_of<'a>(line: &'a str, name: &str) -> Option<&'a str> {
    let start = line.get(..name.len())?;
    start.eq_ignore_ascii_case(name).then(|| line.get(name.len()..).unwrap_or_default().trim())
}

/// Parses an axis such as `z`, `-y` or `0 0 1`.
fn parse_up(text: &str, comments: &[String]) -> Option<DVec3> {
    let first = text.split_whitespace().next()?;
    let axis = match first.trim_start_matches(['+', '-']).to_ascii_lowercase().as_str() {
        "x" => DVec3::X,
        "y" => DVec3::Y,
        "z" => DVec3::Z,
        _ => {
            let numbers = text.split([' ', '\t', ',', '[', ']']).filter_map(|n| n.parse().ok());
            let numbers: Vec<f64> = numbers.collect();
            return DVec3::from_array(numbers.try_into().ok()?).try_normalize();
        }
    };
    // Brush names the axis of its worlds, in which y and z point down.
    let is_of_brush = axis != DVec3::X && comments.iter().any(|line| line.contains("Brush"));
    // Adding zero turns −0 into 0.
    Some(if first.starts_with('-') != is_of_brush { -axis + DVec3::ZERO } else { axis })
}

/// Returns true if comments state that the splats are antialiased. Adds notes about comments that are not
/// understood.
fn read_statements(comments: &[String], notes: &mut Vec<Note>) -> bool {
    let mut is_antialiased = false;
    let mut others = Vec::new();
    for line in comments {
        let mode = value_of(line, RENDER_MODE).or(value_of(line, ANTIALIASED));
        let known = match mode.map(str::to_ascii_lowercase).as_deref() {
            Some("mip" | "1") => Some(true),
            Some("default" | "2dgs" | "0") => Some(false),
            _ => None,
        };
        // The last line applies, as in other readers.
        is_antialiased = known.unwrap_or(is_antialiased);
        let up = value_of(line, VERTICAL_AXIS).and_then(|text| parse_up(text, comments));
        if let Some(up) = up.filter(|_| !line.contains(char::is_numeric)) {
            notes.push(Note::Up { line: shorten(line), up });
        }
        let is_telling = |word| TELLING_WORDS.split(' ').any(|w| w.eq_ignore_ascii_case(word));
        let mut words = line.split(|c: char| !c.is_ascii_alphabetic());
        let is_relevant = mode.is_some() || !line.starts_with("vbgs ") && words.any(is_telling);
        if is_relevant && known.is_none() && up.is_none() {
            others.push(line.as_str());
        }
    }
    notes.extend(Note::not_used("comment", others.into_iter()));
    is_antialiased
}

/// Kind of the rows in a model file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ModelKind {
    /// Gaussian splats: rows with scales and a rotation.
    Splats,
    /// Coloured points without extent.
    PointCloud,
}

/// Notice about a successful import.
#[allow(missing_docs, reason = "every message names its fields")]
#[derive(Clone, Debug, PartialEq, strum::Display)]
pub enum Note {
    /// Spherical harmonics above degree 1 were ignored; those of degree 1 were ignored if incomplete or in
    /// linear colour.
    #[strum(to_string = "view-dependent colour ignored ({n_coefficients} coefficients per splat)")]
    ViewDependentColorIgnored { n_coefficients: usize },
    /// Zero quaternions were read as the identity.
    #[strum(to_string = "{n_splats} splats had a rotation of length zero, read as no rotation")]
    ZeroRotation { n_splats: usize },
    /// Colours outside `[0, 1]` were clamped.
    #[strum(to_string = "{n_splats} splats had a colour outside 0..1, clamped")]
    ColorClamped { n_splats: usize },
    /// The third scale is missing, so splats are flat.
    #[strum(to_string = "scale_2 is missing: splats read as flat")]
    FlatSplats,
    /// The file has no colours, so points are gray.
    #[strum(to_string = "the file holds no colour: points read as gray")]
    NoColor,
    /// Linear colours were encoded to sRGB.
    #[strum(to_string = "linear colours encoded to sRGB")]
    LinearColorEncoded,
    /// Scales were logarithms, as in drafts of the glTF extension before 2026.
    #[strum(to_string = "scales read as logarithms: the file follows a draft of the extension")]
    LogarithmicScales,
    /// A value of another extension or program was replaced.
    #[strum(to_string = "{name} {value} is not supported: {used} is used")]
    Unsupported { name: &'static str, value: String, used: &'static str },
    /// A comment names the up axis by a letter, whose sign depends on the program.
    #[strum(to_string = "\"{line}\" is read as up = {up}")]
    Up { line: String, up: DVec3 },
    /// Splats are drawn with opacity compensation.
    #[strum(
        to_string = "trained with antialiasing (Mip-Splatting): opacities are drawn lowered by the area that antialiasing adds"
    )]
    Antialiased,
    /// The 3D filter of Mip-Splatting was applied to scales and opacities.
    #[strum(to_string = "filter_3D of Mip-Splatting was applied to scales and opacities")]
    FilterApplied,
    /// Content without a meaning to this program.
    #[strum(to_string = "not used: {what}")]
    NotUsed { what: String },
    /// Splats of a glTF without harmonics got the colours of `COLOR_0`.
    #[strum(to_string = "no harmonics: splats use the colours of COLOR_0")]
    FallbackColor,
    /// Primitives of a glTF were skipped, such as meshes.
    #[strum(to_string = "{n_primitives} other primitives of the file (meshes, points) skipped")]
    PrimitivesSkipped { n_primitives: usize },
}

impl Note {
    /// Note about named content without a meaning to this program; `None` if there is none.
    pub(super) fn not_used<'a>(kind: &str, names: impl Iterator<Item = &'a str>) -> Option<Self> {
        // A file may hold any number of names.
        let names: Vec<&str> = names.take(20).collect();
        let what = || format!("{kind} {}", shorten_to(&names.join(", "), 200));
        (!names.is_empty()).then(|| Note::NotUsed { what: what() })
    }
}

/// Size in memory of the splats of a file of any size, bytes: four million of a single colour.
const ANY_BYTES: u64 = 224_000_000;
/// Largest ratio between the sizes of splats in memory and in their file. Points without colour, of three floats,
/// have 4.7; compressed splats with harmonics have 5.9.
const MAX_FACTOR: u64 = 6;

/// Limit on the rows of a model, and their use.
#[derive(Clone, Copy, Debug)]
pub(super) struct Intake {
    pub max_splats: usize,
    /// False if only the outline of the rows is needed.
    pub is_stored: bool,
}

pub(super) struct Rows {
    splats: SplatSet,
    outline: Outline,
    is_stored: bool,
    skipped: usize,
    n_zero_rotations: usize,
    n_wild_colors: usize,
}

impl Rows {
    /// Reserves memory for the rows of a file, or of what it unpacks to, of `size` bytes.
    ///
    /// # Errors
    /// Fails if the rows take more than [`MAX_FACTOR`] times that size, and [`ANY_BYTES`].
    pub fn with_capacity(
        n: usize,
        is_directional: bool,
        size: u64,
        Intake { is_stored, .. }: Intake,
    ) -> Result<Self, Fault> {
        let appearance = if is_directional { size_of::<Appearance>() } else { 0 };
        let most = ANY_BYTES.max(MAX_FACTOR.saturating_mul(size));
        let cap = most / (size_of::<Splat>() + appearance) as u64;
        if n as u64 > cap {
            return Err(Fault::TooMany { declared: n as u64, cap: cap as usize });
        }
        let splats: Vec<Splat> = try_with_capacity(if is_stored { n } else { 0 })?;
        Ok(Self {
            splats: splats.into(),
            outline: Outline::default(),
            is_stored,
            skipped: 0,
            n_zero_rotations: 0,
            n_wild_colors: 0,
        })
    }

    /// Normalises the quaternion `w x y z`. A zero quaternion becomes the identity and is counted.
    pub fn rotation(&mut self, quaternion: [f64; 4]) -> DQuat {
        unit_quaternion(quaternion).unwrap_or_else(|| {
            self.n_zero_rotations += 1;
            DQuat::IDENTITY
        })
    }

    /// Adds a row, or counts it as skipped if it is not finite.
    pub fn push(&mut self, row: Gaussian) {
        // A rotation of the axes may have made w negative.
        match row.with_positive_w().to_splat() {
            // Only rows that are retained count as clamped.
            Some((splat, appearance)) => {
                self.n_wild_colors += usize::from(row.is_color_out_of_range());
                self.outline.add(&splat, &appearance);
                if self.is_stored {
                    self.splats.push(splat, appearance);
                }
            }
            None => self.skipped += 1,
        }
    }

    pub fn finish(
        mut self,
        kind: ModelKind,
        mut notes: Vec<Note>,
        comments: Vec<String>,
    ) -> Result<Imported, Fault> {
        // An error is clearer than an empty scene.
        if self.outline.n_splats == 0 {
            return Err(Fault::NothingToImport { skipped: self.skipped });
        }
        if kind == ModelKind::PointCloud {
            set_point_scales(self.splats.splats_mut());
        }
        if self.n_zero_rotations > 0 {
            notes.push(Note::ZeroRotation { n_splats: self.n_zero_rotations });
        }
        if self.n_wild_colors > 0 {
            notes.push(Note::ColorClamped { n_splats: self.n_wild_colors });
        }
        let is_antialiased = read_statements(&comments, &mut notes);
        let Self { splats, outline, skipped, .. } = self;
        let imported = Imported {
            splats,
            outline,
            kind,
            local_origin: local_origin::from_comments(&comments),
            // Readers of y-up formats replace this value.
            defined_up: None,
            skipped,
            notes,
            comments,
            // `read_up_to` sets the size.
            bytes: 0,
        };
        Ok(if is_antialiased { imported.antialiased() } else { imported })
    }
}

/// Sets the standard deviations of points to half the estimated point spacing.
fn set_point_scales(points: &mut [Splat]) {
    // Estimated as if the points covered a surface as large as their bounding box. Neighbours then touch in
    // any unit of length.
    let diagonal = bounds(points).map_or(0.0, |(lo, hi)| (hi - lo).length());
    let spacing = diagonal / (points.len() as f64).sqrt();
    // A single point, or coincident ones, have no spacing; 1 mm (in metres) is at least visible.
    let scale = if spacing > 0.0 { (0.5 * spacing) as f32 } else { 1e-3 };
    for point in points {
        point.scale = [scale; 3];
    }
}
