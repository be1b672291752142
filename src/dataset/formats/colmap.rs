//! COLMAP: a sparse model (`cameras` and `images`, binary or text) beside photographs and depth images.
//!
//! Poses are `qw qx qy qz tx ty tz`, world to camera, OpenCV axes. Pixel centres are at +½, as everywhere in
//! this crate. World units are arbitrary. Photographs are in [`COLORS`] or where their names lead; depth is
//! in [`DEPTHS`] under the photograph's name with another extension, in millimetres if stored as whole
//! numbers, else in metres. Of several models, the one with most images is used. Observations in images are
//! skipped, and points are not read.

use super::nerfstudio::file_of;
use super::numbered::DEPTH_FILES;
use super::recording::{
    ANY_RANGE, Cameras, Recording, SPLIT, codes_by_content, encoding, frame_entry, metadata_error,
};
use super::stated::{array, majority, parse_json};
use super::trajectory::{TimedPose, lines};
use crate::dataset::decode;
use crate::dataset::distortion::Distortion;
use crate::dataset::entry::DepthSource;
use crate::dataset::error::{DatasetError, FrameProblem};
use crate::dataset::folder::{Folder, RetryingFile, check_count, relative_path};
use crate::dataset::formats::{DatasetFormat, MAX_FRAMES, ParsedFolder};
use crate::dataset::matrix::shorten;
use crate::dataset::options::{ByteSource, LoadOptions};
use crate::dataset::pose_check::PoseConvention;
use crate::dataset::surface::sensor::Sensor;
use crate::math::camera::Intrinsics;
use crate::math::pose::Pose;
use serde_json::Value;
use std::collections::{BTreeMap, HashMap, HashSet};
use std::io::{BufRead, BufReader, ErrorKind, Read};
use std::path::{Path, PathBuf};

pub(super) const FORMAT: DatasetFormat =
    DatasetFormat { poses: PoseConvention::Opencv, recognise, parse };

/// Folders of photographs; the folder of the dataset is the last.
const COLORS: [&str; 6] = ["images", "rgb", "color", "image", "input", ""];
const DEPTHS: [&str; 3] = ["depth", "depths", "depth_images"];
/// Folders of models and of numbered models.
const PARENTS: [&str; 4] = ["", "sparse", "colmap", "colmap/sparse"];
/// Numbered models of one folder that are searched for.
const MOST_MODELS: usize = 10;
/// Longest name of an image, and longest used part of a line, bytes.
const MAX_NAME: usize = 4096;
const HINT: &str = "export the model again";

/// Names and numbers of parameters of the camera models, by their numbers in binary files.
const MODELS: [(&str, usize); 12] = [
    ("SIMPLE_PINHOLE", 3),
    ("PINHOLE", 4),
    ("SIMPLE_RADIAL", 4),
    ("RADIAL", 5),
    ("OPENCV", 8),
    ("OPENCV_FISHEYE", 8),
    ("FULL_OPENCV", 12),
    ("FOV", 5),
    ("SIMPLE_RADIAL_FISHEYE", 4),
    ("RADIAL_FISHEYE", 5),
    ("THIN_PRISM_FISHEYE", 12),
    ("RAD_TAN_THIN_PRISM_FISHEYE", 16),
];

/// Folder of a model and the extension of its files.
struct Place {
    folder: String,
    extension: &'static str,
}

impl Place {
    fn shown(&self, name: &str) -> String {
        Path::new(&self.folder).join(name).display().to_string()
    }

    fn file(&self, stem: &str) -> String {
        self.shown(&format!("{stem}.{}", self.extension))
    }
}

fn recognise(folder: &Folder) -> Option<String> {
    let place = places(folder).into_iter().next()?;
    Some(format!("{} and {}", place.file("cameras"), place.file("images")))
}

fn places(folder: &Folder) -> Vec<Place> {
    let numbered = |parent: &str| (0..MOST_MODELS).map(|n| format!("{parent}/{n}")).collect();
    // Checked first: other recordings lack them, and every poll of a growing one comes here.
    let parents = PARENTS.iter().filter(|at| at.is_empty() || folder.has_folder(at));
    let all = parents.flat_map(|at| {
        let below: Vec<String> = if at.is_empty() { Vec::new() } else { numbered(at) };
        std::iter::once((*at).to_owned()).chain(below)
    });
    let forms =
        |at: String| ["bin", "txt"].map(|extension| Place { folder: at.clone(), extension });
    let is_model = |place: &Place| {
        let Ok(listing) = folder.list(Path::new(&place.folder)) else { return false };
        let has = |stem: &str| listing.has_file(&format!("{stem}.{}", place.extension));
        let is_text = || {
            let text = folder.peek(&place.file("cameras"));
            lines(&text).next().is_some_and(|(_, line)| Camera::of_line(line).is_some())
        };
        has("cameras") && has("images") && (place.extension == "bin" || is_text())
    };
    all.flat_map(forms).filter(is_model).collect()
}

type Size = (u32, u32);

struct Camera {
    model: String,
    size: Size,
    parameters: Vec<f64>,
}

impl Camera {
    fn of_line(line: &str) -> Option<(u32, Self)> {
        let mut words = line.split_whitespace();
        let id = words.next()?.parse().ok()?;
        let model = words
            .next()
            .filter(|word| word.bytes().all(|b| b == b'_' || b.is_ascii_uppercase()))?;
        let size = (words.next()?.parse().ok()?, words.next()?.parse().ok()?);
        let parameters = words.map(|word| word.parse().ok()).collect::<Option<_>>()?;
        Some((id, Self { model: model.to_owned(), size, parameters }))
    }

    /// Returns the cameras of a photograph and a depth image of these sizes.
    ///
    /// # Errors
    /// Fails for fisheyes and other models that are not of OpenCV's perspective form.
    fn fitted(
        &self,
        recording: &Recording,
        color: Size,
        depth: Size,
        file: &Path,
    ) -> Result<Cameras, DatasetError> {
        let parameters = &self.parameters[..];
        let is_whole = MODELS.contains(&(self.model.as_str(), parameters.len()));
        let ([fx, fy, cx, cy], terms) = match (self.model.as_str(), parameters) {
            ("SIMPLE_PINHOLE" | "SIMPLE_RADIAL" | "RADIAL", [f, cx, cy, terms @ ..])
                if is_whole =>
            {
                ([f, f, cx, cy], terms)
            }
            ("PINHOLE" | "OPENCV" | "FULL_OPENCV", [fx, fy, cx, cy, terms @ ..]) if is_whole => {
                ([fx, fy, cx, cy], terms)
            }
            (model, _) => {
                let expected = "a perspective camera (SIMPLE_PINHOLE, PINHOLE, SIMPLE_RADIAL, \
                                RADIAL, OPENCV, FULL_OPENCV)";
                let found = format!("{} with {} parameters", shorten(model), parameters.len());
                let hint = "undistort the images to a pinhole first";
                return Err(metadata_error(file, expected, found, hint));
            }
        };
        let (width, height) = self.size;
        if width.min(height) == 0 {
            let found = format!("{width}x{height}");
            return Err(metadata_error(file, "a camera with width and height", found, HINT));
        }
        let [fx, fy, cx, cy] = [*fx, *fy, *cx, *cy];
        let k = Intrinsics { width, height, fx, fy, cx, cy };
        let cameras = recording.cameras_of_lens(&k, color, depth, file)?;
        cameras.with_lens(Distortion::of_opencv(terms), file)
    }
}

struct Image {
    name: String,
    camera: u32,
    /// `qw qx qy qz tx ty tz`
    pose: [f64; 7],
}

impl Image {
    fn of_line(line: &str) -> Option<Self> {
        let (mut rest, mut numbers) = (line.trim(), [0.0; 9]);
        for number in &mut numbers {
            let (word, behind) = rest.split_once(char::is_whitespace)?;
            *number = word.parse().ok()?;
            rest = behind.trim_start();
        }
        let [_, qw, qx, qy, qz, x, y, z, camera] = numbers;
        // The cast saturates: an absurd number is no camera's.
        Some(Self { name: rest.to_owned(), camera: camera as u32, pose: [qw, qx, qy, qz, x, y, z] })
    }

    /// Name without folders.
    fn file(&self) -> &str {
        self.name.rsplit('/').next().unwrap_or(&self.name)
    }

    fn pose(&self) -> Result<Pose, FrameProblem> {
        let [qw, qx, qy, qz, x, y, z] = self.pose;
        let expected = "finite numbers qw qx qy qz tx ty tz, a unit quaternion first";
        let wrong = || FrameProblem::Entry { expected, found: format!("{:?}", self.pose) };
        let inverse = TimedPose::new([0.0, x, y, z, qx, qy, qz, qw]).ok_or_else(wrong)?;
        Ok(Pose::from_opencv(inverse.matrix().inverse())?)
    }
}

struct Model {
    place: Place,
    cameras: HashMap<u32, Camera>,
    images: Vec<Image>,
    /// File and message of lines that are no image.
    defects: Vec<(usize, FrameProblem)>,
}

impl Model {
    fn read(folder: &Folder, place: Place) -> Result<Self, DatasetError> {
        let [cameras, images] = ["cameras", "images"].map(|stem| place.file(stem));
        let mut model =
            Self { place, cameras: HashMap::new(), images: Vec::new(), defects: Vec::new() };
        match model.place.extension {
            "bin" => {
                model.cameras = Records::open(folder, &cameras)?.cameras()?;
                model.images = Records::open(folder, &images)?.images()?;
            }
            _ => {
                let (_, text) = folder.text(&cameras)?;
                model.cameras = lines(&text).filter_map(|(_, l)| Camera::of_line(l)).collect();
                let (path, mut reader) = folder.reader(&images)?;
                let read = model.read_lines(&mut reader);
                read.map_err(|source| DatasetError::Read { path: path.clone(), source })?;
                check_count(&path, "images", model.n_entries(), MAX_FRAMES)?;
            }
        }
        Ok(model)
    }

    fn n_entries(&self) -> usize {
        self.images.len() + self.defects.len()
    }

    /// Reads images of two lines each, up to the first beyond the limit; the second line, of observations, may be
    /// missing.
    fn read_lines(&mut self, reader: &mut impl BufRead) -> std::io::Result<()> {
        let (mut bytes, mut is_header) = (Vec::new(), true);
        for line in 1.. {
            bytes.clear();
            // Lines of observations are long, and only their end matters.
            let n = reader.by_ref().take(MAX_NAME as u64).read_until(b'\n', &mut bytes)?;
            if n == 0 || self.n_entries() > MAX_FRAMES {
                break;
            }
            if !bytes.ends_with(b"\n") {
                reader.skip_until(b'\n')?;
            }
            let text = String::from_utf8_lossy(&bytes);
            let (text, image) = (text.trim(), Image::of_line(&text));
            let is_number = |word: &str| word.parse::<f64>().is_ok();
            let is_image =
                image.as_ref().is_some_and(|image| !image.name.split(' ').all(is_number));
            match image {
                _ if text.starts_with('#') => continue,
                Some(image) if is_header || is_image => {
                    self.images.push(image);
                    is_header = false;
                }
                None if is_header && !text.is_empty() => {
                    let expected = "IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME";
                    let found = text.chars().take(60).collect();
                    self.defects.push((line, FrameProblem::Line { expected, found, line }));
                    is_header = false;
                }
                _ => is_header = true,
            }
        }
        Ok(())
    }
}

/// Binary file that is read in pieces.
struct Records {
    path: PathBuf,
    reader: BufReader<RetryingFile>,
    /// Number of records that the file states, and of those begun.
    stated: u64,
    begun: u64,
}

impl Records {
    fn open(folder: &Folder, name: &str) -> Result<Self, DatasetError> {
        let (path, reader) = folder.reader(name)?;
        let mut records = Self { path, reader, stated: 0, begun: 0 };
        records.stated = u64::from_le_bytes(records.bytes()?);
        Ok(records)
    }

    /// True while a stated record follows.
    fn next(&mut self) -> bool {
        self.begun += 1;
        self.begun <= self.stated
    }

    fn wrong(&self, found: &str) -> DatasetError {
        let found = format!("{found} in record {} of {}", self.begun, self.stated);
        metadata_error(&self.path, "a whole model of COLMAP", found, HINT)
    }

    fn checked<T>(&self, read: std::io::Result<T>) -> Result<T, DatasetError> {
        read.map_err(|source| match source.kind() {
            ErrorKind::UnexpectedEof | ErrorKind::InvalidInput => self.wrong("the end of the file"),
            _ => DatasetError::Read { path: self.path.clone(), source },
        })
    }

    fn bytes<const N: usize>(&mut self) -> Result<[u8; N], DatasetError> {
        let mut bytes = [0; N];
        let read = self.reader.read_exact(&mut bytes);
        self.checked(read)?;
        Ok(bytes)
    }

    fn reals<const N: usize>(&mut self) -> Result<[f64; N], DatasetError> {
        let mut numbers = [0.0; N];
        for number in &mut numbers {
            *number = f64::from_le_bytes(self.bytes()?);
        }
        Ok(numbers)
    }

    fn cameras(mut self) -> Result<HashMap<u32, Camera>, DatasetError> {
        let mut cameras = HashMap::new();
        while self.next() {
            let id = u32::from_le_bytes(self.bytes()?);
            let model = u32::from_le_bytes(self.bytes()?);
            // A side beyond 32 bits is refused with the camera, as is 0.
            let side = |bytes| u32::try_from(u64::from_le_bytes(bytes)).unwrap_or(0);
            let size = (side(self.bytes()?), side(self.bytes()?));
            let known = MODELS.get(model as usize);
            let (model, n) = known.ok_or_else(|| self.wrong(&format!("camera model {model}")))?;
            let mut parameters = Vec::with_capacity(*n);
            for _ in 0..*n {
                parameters.extend(self.reals::<1>()?);
            }
            cameras.insert(id, Camera { model: (*model).to_owned(), size, parameters });
        }
        Ok(cameras)
    }

    fn images(mut self) -> Result<Vec<Image>, DatasetError> {
        /// Bytes of an observation: position and point.
        const OBSERVATION: i64 = 24;
        let mut images = Vec::new();
        while self.next() {
            check_count(&self.path, "images", images.len() + 1, MAX_FRAMES)?;
            self.bytes::<4>()?;
            let pose = self.reals()?;
            let camera = u32::from_le_bytes(self.bytes()?);
            let mut name = Vec::new();
            loop {
                match self.bytes()? {
                    [0] => break,
                    [_] if name.len() == MAX_NAME => return Err(self.wrong("a name without end")),
                    [byte] => name.push(byte),
                }
            }
            let n = i64::from_le_bytes(self.bytes()?).checked_mul(OBSERVATION);
            let n = n.filter(|n| *n >= 0).ok_or_else(|| self.wrong("too many observations"))?;
            let skipped = self.reader.seek_relative(n);
            self.checked(skipped)?;
            images.push(Image { name: String::from_utf8_lossy(&name).into_owned(), camera, pose });
        }
        Ok(images)
    }
}

/// Files of an image. Photographs have their size.
struct Listed<'a> {
    image: &'a Image,
    color: Result<(ByteSource, Size), FrameProblem>,
    depth: Result<Option<ByteSource>, FrameProblem>,
}

impl<'a> Listed<'a> {
    /// Finds the files. `is_unique` states that no other image has the name in another folder.
    fn find(folder: &Folder, image: &'a Image, stated: Option<Size>, is_unique: bool) -> Self {
        let name = relative_path(&image.name);
        let found = |names: &[PathBuf], places: &[&str]| {
            let places = places.iter().filter(|at| at.is_empty() || folder.has_folder(at));
            let paths = places.flat_map(|at| names.iter().map(|name| Path::new(at).join(name)));
            file_of(folder, paths.map(|path| path.display().to_string()))
        };
        let color = || {
            let name =
                name.as_ref().map_err(|_| FrameProblem::OutsideFolder(image.name.clone()))?;
            let color = found(std::slice::from_ref(name), &COLORS)?;
            let color = color.ok_or_else(|| FrameProblem::MissingColor(image.name.clone()))?;
            let header = decode::header(&color)?;
            // Turned by EXIF if the model states that size.
            let upright = Some(header.upright()).filter(|upright| Some(*upright) == stated);
            Ok((color, upright.unwrap_or((header.width, header.height))))
        };
        // Names may begin with a folder that depth lacks.
        let names = name.iter().flat_map(|name| {
            let file = name.file_name().map(PathBuf::from).filter(|_| is_unique);
            [Some(name.clone()), file].into_iter().flatten()
        });
        let depths: Vec<_> =
            names.flat_map(|name| DEPTH_FILES.map(|end| name.with_extension(end))).collect();
        Self { image, color: color(), depth: found(&depths, &DEPTHS) }
    }

    fn depth(&self) -> Option<&ByteSource> {
        self.depth.as_ref().ok()?.as_ref()
    }
}

fn parse(folder: &Folder, options: &LoadOptions) -> Result<ParsedFolder, DatasetError> {
    let mut parsed = ParsedFolder::default();
    let mut model = most_images(folder, &mut parsed)?;
    let [images, cameras] =
        ["images", "cameras"].map(|stem| folder.path.join(model.place.file(stem)));
    for (line, problem) in std::mem::take(&mut model.defects) {
        parsed.skip(SPLIT, &format!("line {line}"), images.clone(), problem);
    }
    // Models list images in any order.
    model.images.sort_by(|a, b| a.name.cmp(&b.name));
    model.images.retain(|image| !folder.was_taken(&image.name));
    let camera = |image: &Image| model.cameras.get(&image.camera);
    let mut counts: HashMap<&str, u32> = HashMap::new();
    model.images.iter().for_each(|image| *counts.entry(image.file()).or_default() += 1);
    let listed = model.images.iter().map(|image| {
        let is_unique = counts.get(image.file()) == Some(&1);
        Listed::find(folder, image, camera(image).map(|camera| camera.size), is_unique)
    });
    let listed: Vec<_> = listed.collect();
    check_depth(folder, &model, &listed)?;
    let depths: Vec<_> = listed.iter().filter_map(Listed::depth).collect();
    let unit = codes_by_content(&depths);
    // World units are arbitrary, so no length is beyond the sensor.
    let encoding = encoding(options, unit, Sensor::Lidar, ANY_RANGE);
    let sizes = depth_sizes(&model, &listed);
    let lists = split_lists(folder, &model);
    let mut recordings: BTreeMap<&str, Recording> = BTreeMap::new();
    let (mut seen, mut refused, mut n_left_out) = (HashSet::new(), None, 0);
    for Listed { image, color, depth } in listed {
        let name = &image.name;
        let Some(split) = split(&lists, name) else {
            n_left_out += 1;
            continue;
        };
        let new = || Recording { split: split.to_owned(), ..Recording::new(folder, options) };
        let recording = recordings.entry(split).or_insert_with(new);
        let mut file = &images;
        let frame = (|| {
            if !seen.insert(name) {
                return Err(FrameProblem::Duplicate(format!("another image `{name}`")));
            }
            let pose = options.pose(|| image.pose())?;
            let (color, size) = color?;
            let depth = depth?.map(|file| DepthSource::new(file, encoding));
            let missing = || {
                let found = format!("camera {}", image.camera);
                FrameProblem::Entry { expected: "a camera of the model", found }
            };
            let camera = camera(image).ok_or_else(missing)?;
            let depth_size = sizes.get(&camera.size).copied().unwrap_or(size);
            let fitted = camera.fitted(recording, size, depth_size, &cameras);
            let fitted = fitted.map_err(|error| {
                file = &cameras;
                let problem = error.of_frame();
                refused.get_or_insert(error);
                problem
            })?;
            Ok(frame_entry(name.clone(), pose, fitted, color, depth))
        })();
        recording.add(name, file, frame);
    }
    if n_left_out > 0 {
        parsed.notes.push(format!("{n_left_out} images are in no list of a split; left out"));
    }
    // What makes every frame unusable is of the model.
    if let Some(error) = refused.filter(|_| recordings.values().all(|all| all.frames.is_empty())) {
        return Err(error);
    }
    recordings.into_values().for_each(|recording| parsed.append(recording.finish()));
    Ok(parsed)
}

/// Reads all models and returns the one with most images. Names the others.
fn most_images(folder: &Folder, parsed: &mut ParsedFolder) -> Result<Model, DatasetError> {
    let read = places(folder).into_iter().map(|place| Model::read(folder, place));
    let (mut models, mut damaged) = (Vec::new(), Vec::new());
    read.for_each(|read| match read {
        Ok(model) => models.push(model),
        Err(error) => damaged.push(error),
    });
    // A stable sort: of models of one size, the first is used.
    models.sort_by_key(|model| std::cmp::Reverse(model.images.len()));
    let said =
        |model: &Model| format!("{} ({} images)", model.place.file("images"), model.images.len());
    let mut names: Vec<String> = models.iter().map(said).collect();
    let Some(most) = models.into_iter().next().filter(|model| !model.images.is_empty()) else {
        let none = || metadata_error(&folder.path, "a model with images", "none".to_owned(), HINT);
        return Err(damaged.into_iter().next().unwrap_or_else(none));
    };
    parsed.unused.extend(damaged.iter().map(ToString::to_string));
    parsed.notes.push(format!("poses and cameras are those of {}", names.remove(0)));
    if !names.is_empty() {
        parsed.notes.push(format!("other models are not used: {}", names.join(", ")));
    }
    Ok(most)
}

/// Checks that any image has measured depth.
fn check_depth(folder: &Folder, model: &Model, listed: &[Listed]) -> Result<(), DatasetError> {
    const ESTIMATES: &str = "depth_params.json";
    let estimates = folder.path.join(model.place.shown(ESTIMATES));
    let (file, expected, found, hint) = if estimates.exists() {
        let found = "scales of inverse depth that a network estimated".to_owned();
        let hint = "replace the depth images and remove this file";
        (&estimates, "depth of a sensor", found, hint)
    } else if listed.is_empty() || listed.iter().any(|listed| listed.depth().is_some()) {
        return Ok(());
    } else {
        let (n, place) = (listed.len(), model.place.file("images"));
        let found = format!("a COLMAP model of {n} images ({place}) without depth");
        let hint = "add depth/NAME.png, 16 bits in millimetres: photographs alone do not suffice";
        (&folder.path, "depth images with the photographs' names in depth/", found, hint)
    };
    Err(metadata_error(file, expected, found, hint))
}

/// Returns the size of depth images by the stated size of photographs.
fn depth_sizes(model: &Model, listed: &[Listed]) -> HashMap<Size, Size> {
    let mut groups: HashMap<Size, Vec<&ByteSource>> = HashMap::new();
    for listed in listed {
        let camera = model.cameras.get(&listed.image.camera);
        camera.into_iter().for_each(|c| groups.entry(c.size).or_default().extend(listed.depth()));
    }
    let size = |depths: &[&ByteSource]| majority(depths, |file| decode::depth_size(file));
    groups.into_iter().filter_map(|(at, depths)| Some((at, size(&depths).ok()??))).collect()
}

/// Returns the names of each split: of `train_test_lists.json` (ScanNet++), or of `test.txt` (3DGS).
fn split_lists(folder: &Folder, model: &Model) -> Vec<(&'static str, HashSet<String>)> {
    let json = parse_json(&folder.peek_whole("train_test_lists.json")).unwrap_or_default();
    let listed = |split| array(&json, split).iter().filter_map(Value::as_str).map(str::to_owned);
    let text = folder.peek_whole(&model.place.shown("test.txt"));
    let in_text = lines(&text).map(|(_, name)| name.to_owned()).collect();
    let test: HashSet<String> = listed("test").collect();
    let test = if test.is_empty() { in_text } else { test };
    let mut lists = vec![("train", listed("train").collect()), ("test", test)];
    // Lists of other images divide nothing.
    lists.retain(|(_, names)| model.images.iter().any(|image| is_in(names, &image.name)));
    lists
}

fn split(lists: &[(&'static str, HashSet<String>)], name: &str) -> Option<&'static str> {
    let others = match lists {
        [] => Some(SPLIT),
        [("test", _)] => Some("train"),
        _ => None,
    };
    lists.iter().find(|(_, names)| is_in(names, name)).map(|(split, _)| *split).or(others)
}

/// True if a list has the name of an image, perhaps without folder or extension.
fn is_in(names: &HashSet<String>, name: &str) -> bool {
    let file = name.rsplit('/').next().unwrap_or(name);
    let stem = file.rsplit_once('.').map_or(file, |(stem, _)| stem);
    [name, file, stem].iter().any(|name| names.contains(*name))
}
