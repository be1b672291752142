//! ROS 2 bags in MCAP: images, `camera_info` and transforms, one frame for each depth image.
//!
//! Messages are in CDR. The pose of the depth camera's optical frame (x right, y down, z forward) is found
//! by climbing the tree of `/tf` and `/tf_static` to its root, interpolated in time; without moving
//! transforms, `Odometry` or `PoseStamped` moves the top of the static ones. The photograph is the nearest
//! in time. Both cameras have intrinsics and a lens of their own, and the photograph's its place.

use super::recording::{
    Cameras, Recording, STRUCTURED_LIGHT_RANGE, encoding, frame_entry, metadata_error, no_poses,
};
use super::stated::is_stating;
use super::trajectory::{TOLERANCE, TimedPose, Trajectory, not_in_time, usual_step};
use crate::dataset::bag::{
    AsFile, Cdr, Channel, Found, Message, Place, is_bag, n_channels, packed_image, raw_color,
    raw_depth, scan,
};
use crate::dataset::calibration::ColorCamera;
use crate::dataset::decode::{CodeKind, DepthEncoding};
use crate::dataset::distortion::Distortion;
use crate::dataset::entry::{DepthSource, FrameEntry};
use crate::dataset::error::{DatasetError, FrameProblem};
use crate::dataset::folder::{Folder, check_count};
use crate::dataset::formats::{DatasetFormat, ParsedFolder};
use crate::dataset::options::{ByteSource, LoadOptions, MILLIMETRE};
use crate::dataset::pose_check::PoseConvention;
use crate::dataset::surface::sensor::Sensor;
use crate::math::camera::Intrinsics;
use crate::math::pose::Pose;
use glam::{DMat3, DMat4, DVec3};
use std::collections::{BTreeMap, BTreeSet, HashSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;

pub(super) const FORMAT: DatasetFormat =
    DatasetFormat { poses: PoseConvention::Opencv, recognise, parse };

const IMAGE: &str = "sensor_msgs/msg/Image";
const COMPRESSED: &str = "sensor_msgs/msg/CompressedImage";
const CAMERA: &str = "sensor_msgs/msg/CameraInfo";
const TRANSFORMS: &str = "tf2_msgs/msg/TFMessage";
const ODOMETRY: &str = "nav_msgs/msg/Odometry";
const POSES: [&str; 2] =
    ["geometry_msgs/msg/PoseStamped", "geometry_msgs/msg/PoseWithCovarianceStamped"];
/// Bytes of an image's message that hold everything but its pixels.
const IMAGE_HEAD: u64 = 1024;
/// Most transforms between a camera and the world.
const MAX_CLIMB: usize = 64;
/// Difference of times of images that count as simultaneous, seconds.
const SIMULTANEOUS: f64 = 1e-3;
/// Largest number of images and poses of a bag, which take 64 bytes each.
const MOST_ENTRIES: usize = 1 << 21;
/// Most topics that a message lists.
const MOST_TOPICS: usize = 5;
/// Rotation of a camera that is not rectified.
const UNTURNED: [f64; 9] = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
/// Parts of names of a robot's body, whose axes are x forward, y left, z up.
const BODIES: [&str; 5] = ["base", "body", "footprint", "imu", "link"];

fn recognise(folder: &Folder) -> Option<String> {
    let names = bags(folder).join(", ");
    (!names.is_empty()).then_some(names)
}

fn bags(folder: &Folder) -> Vec<&str> {
    let is_ours = |name: &&str| {
        let path = folder.file(Path::new(""), &folder.listing, name);
        path.and_then(|path| Ok(is_bag(&path)?)).unwrap_or_else(|problem| {
            folder.record_unread(name, problem);
            false
        })
    };
    let is_named = |name: &&str| name.ends_with(".mcap") || folder.opened_archive() == Some(name);
    folder.listing.files().filter(is_named).filter(is_ours).collect()
}

/// Images of a topic.
struct Images {
    frame: String,
    as_file: AsFile,
    /// Unit of depth, metres; `None` for photographs.
    unit: Option<f64>,
    is_grey: bool,
    shots: Vec<Shot>,
}

#[derive(Clone)]
struct Shot {
    time: f64,
    bag: Arc<PathBuf>,
    place: Place,
}

fn pose(cdr: &mut Cdr, time: f64) -> Option<TimedPose> {
    let [x, y, z, qx, qy, qz, qw] = cdr.reals()?;
    TimedPose::new([time, x, y, z, qx, qy, qz, qw])
}

#[derive(PartialEq)]
struct CameraInfo {
    frame: String,
    size: (u32, u32),
    model: String,
    terms: Vec<f64>,
    k: [f64; 9],
    rectified: [f64; 12],
    /// Fields that state something and have no effect.
    unused: Vec<&'static str>,
}

impl CameraInfo {
    fn read(cdr: &mut Cdr) -> Option<Self> {
        let (_, frame) = cdr.header()?;
        let (height, width) = (cdr.u32()?, cdr.u32()?);
        let model = cdr.text()?.to_owned();
        let n = cdr.u32()?;
        let terms = (0..n).map(|_| Some(cdr.reals::<1>()?[0])).collect::<Option<_>>()?;
        let (k, turn, rectified) = (cdr.reals::<9>()?, cdr.reals::<9>()?, cdr.reals::<12>()?);
        let binning = [cdr.u32()?, cdr.u32()?];
        let roi = [cdr.u32()?, cdr.u32()?, cdr.u32()?, cdr.u32()?];
        let unused = [
            (k[1] != 0.0, "k (skew)"),
            (turn != [0.0; 9] && turn != UNTURNED, "r"),
            (rectified[3] != 0.0 || rectified[7] != 0.0, "p (baseline)"),
            (binning[0] > 1, "binning_x"),
            (binning[1] > 1, "binning_y"),
            (roi.iter().any(|n| *n > 0) && roi != [0, 0, height, width], "roi"),
        ];
        let unused = unused.into_iter().filter_map(|(is_so, name)| is_so.then_some(name)).collect();
        Some(Self { frame, size: (width, height), model, terms, k, rectified, unused })
    }

    /// Intrinsics and lens of the images of a topic.
    fn of_topic(&self, topic: &str, bag: &Path) -> Result<(Intrinsics, Distortion), DatasetError> {
        let (width, height) = self.size;
        let of = |fx, fy, cx, cy| Intrinsics { width, height, fx, fy, cx, cy };
        // Images of these topics are undistorted already.
        if topic.contains("image_rect") {
            let p = &self.rectified;
            return Ok((of(p[0], p[5], p[2], p[6]), Distortion::default()));
        }
        let is_bent = self.terms.iter().any(|term| *term != 0.0);
        let is_other = self.terms.iter().skip(8).any(|term| *term != 0.0);
        let is_known = ["plumb_bob", "rational_polynomial"].contains(&self.model.as_str());
        if is_bent && (is_other || !is_known) {
            let found = format!("{} with {} terms for {topic}", self.model, self.terms.len());
            let expected = "a distortion model plumb_bob or rational_polynomial";
            return Err(metadata_error(bag, expected, found, "record rectified images"));
        }
        let lens = Distortion::of_opencv(&self.terms);
        Ok((of(self.k[0], self.k[4], self.k[2], self.k[5]), lens))
    }
}

/// Pose of a frame of reference in its parent.
struct Edge {
    parent: String,
    poses: Vec<TimedPose>,
    is_static: bool,
}

/// Poses of a topic: frame of the world, body if stated.
struct Track {
    parent: String,
    child: Option<String>,
    poses: Vec<TimedPose>,
}

/// Content of a bag without pixels.
#[derive(Default)]
struct Content {
    images: BTreeMap<String, Images>,
    cameras: BTreeMap<String, CameraInfo>,
    edges: BTreeMap<String, Edge>,
    tracks: BTreeMap<String, Track>,
    /// Topics whose camera differs from the first.
    other_cameras: BTreeSet<String>,
    /// Transforms of frames that have another parent.
    second_parents: BTreeSet<String>,
    /// Schema of every topic, and number of messages that could not be read or are of no use.
    topics: BTreeMap<String, (String, usize)>,
    /// Number of images and poses, also of those beyond [`MOST_ENTRIES`], which are left out.
    n_entries: usize,
}

impl Content {
    /// Number of first bytes that are read of the messages of a schema.
    fn wanted(schema: &str) -> u64 {
        match schema {
            IMAGE | COMPRESSED => IMAGE_HEAD,
            CAMERA | TRANSFORMS | ODOMETRY => u64::MAX,
            schema if POSES.contains(&schema) => u64::MAX,
            _ => 0,
        }
    }

    fn visit(&mut self, found: &Found, bag: &Arc<PathBuf>) {
        let Channel { topic, schema, encoding } = &**found.channel;
        if self.n_entries >= MOST_ENTRIES {
            self.n_entries += 1;
            return;
        }
        let is_read = encoding == "cdr" && self.add(found, bag).is_some();
        let unread = self.topics.entry(topic.clone()).or_insert_with(|| (schema.clone(), 0));
        unread.1 += usize::from(!is_read);
    }

    fn add(&mut self, found: &Found, bag: &Arc<PathBuf>) -> Option<()> {
        let (cdr, topic) = (&mut Cdr::new(found.head)?, found.channel.topic.as_str());
        match found.channel.schema.as_str() {
            schema @ (IMAGE | COMPRESSED) => {
                let (stamp, frame) = cdr.header()?;
                if schema == IMAGE {
                    // Height and width come first.
                    cdr.u32()?;
                    cdr.u32()?;
                }
                let encoding = cdr.text()?;
                let images = Images::new(topic, frame, schema == IMAGE, encoding)?;
                let images = self.images.entry(topic.to_owned()).or_insert(images);
                let time = if stamp == 0.0 { 1e-9 * found.logged as f64 } else { stamp };
                images.shots.push(Shot { time, bag: Arc::clone(bag), place: found.place });
                self.n_entries += 1;
            }
            CAMERA => {
                let camera = CameraInfo::read(cdr)?;
                match self.cameras.get(topic) {
                    None => drop(self.cameras.insert(topic.to_owned(), camera)),
                    Some(first) if *first == camera => {}
                    Some(_) => drop(self.other_cameras.insert(topic.to_owned())),
                }
            }
            TRANSFORMS => {
                for _ in 0..cdr.u32()? {
                    let (time, parent) = cdr.header()?;
                    let child = cdr.text()?.trim_start_matches('/').to_owned();
                    let (pose, is_static) = (pose(cdr, time)?, topic.ends_with("tf_static"));
                    self.n_entries += 1;
                    let new = Edge { parent: parent.clone(), poses: Vec::new(), is_static };
                    let edge = self.edges.entry(child.clone()).or_insert(new);
                    if edge.parent == parent {
                        edge.is_static &= is_static;
                        edge.poses.push(pose);
                    } else {
                        // A tree has one parent for each frame.
                        self.second_parents.insert(format!("`{child}` in `{parent}`"));
                    }
                }
            }
            schema => {
                let (time, parent) = cdr.header()?;
                let child = if schema == ODOMETRY { Some(cdr.text()?) } else { None };
                let child = child.map(|name| name.trim_start_matches('/').to_owned());
                let pose = pose(cdr, time)?;
                self.n_entries += 1;
                let new = || Track { parent, child, poses: Vec::new() };
                self.tracks.entry(topic.to_owned()).or_insert_with(new).poses.push(pose);
            }
        }
        Some(())
    }

    fn shown(&self) -> String {
        const MOST_CHARACTERS: usize = 40;
        let name = |(topic, (schema, _)): (&String, &(String, usize))| {
            let schema = schema.rsplit('/').next().unwrap_or(schema);
            format!("{topic} ({schema})").chars().take(MOST_CHARACTERS).collect()
        };
        let mut named: Vec<String> = self.topics.iter().map(name).take(MOST_TOPICS).collect();
        if named.len() < self.topics.len() {
            named.push(format!("{} more", self.topics.len() - named.len()));
        }
        if named.is_empty() { "no message".to_owned() } else { named.join(", ") }
    }

    /// Chooses the topics of depth and of photographs.
    fn choose(&self) -> Option<[Topic<'_>; 2]> {
        let of = |is_depth: bool| {
            self.images.iter().filter(move |(_, images)| images.unit.is_some() == is_depth)
        };
        // Depth in the frame of photographs is registered to them.
        let is_aligned = |depth: &Images| of(false).any(|(_, color)| color.frame == depth.frame);
        let depth = of(true).max_by_key(|(topic, images)| {
            (self.camera(topic, images).is_some(), is_aligned(images), images.shots.len())
        })?;
        let color = of(false).max_by_key(|(topic, images)| {
            let (is_named, is_same) =
                (self.camera(topic, images).is_some(), images.frame == depth.1.frame);
            (!images.is_grey, is_named, is_same, n_shared(topic, depth.0), images.shots.len())
        })?;
        Some([depth, color])
    }

    /// Finds the camera of a topic: of the same frame of reference, and nearest by its name.
    fn camera(&self, topic: &str, images: &Images) -> Option<&CameraInfo> {
        let near = self.cameras.iter().filter(|(name, camera)| {
            camera.frame == images.frame || n_shared(name, topic) > 0 || self.cameras.len() == 1
        });
        near.max_by_key(|(name, camera)| (camera.frame == images.frame, n_shared(name, topic)))
            .map(|(_, camera)| camera)
    }
}

/// Returns the number of first parts that two topics share.
fn n_shared(one: &str, other: &str) -> usize {
    let parts = one.trim_matches('/').split('/').zip(other.trim_matches('/').split('/'));
    parts.take_while(|(a, b)| a == b).count()
}

impl Images {
    /// `None` for images of another encoding.
    fn new(topic: &str, frame: String, is_raw: bool, encoding: &str) -> Option<Self> {
        let is = |part: &str| encoding.contains(part);
        let (as_file, unit): (AsFile, _) = match is_raw {
            true => match encoding {
                "16UC1" | "mono16" => (raw_depth, Some(MILLIMETRE)),
                "32FC1" => (raw_depth, Some(1.0)),
                _ => n_channels(encoding).map(|_| (raw_color as AsFile, None))?,
            },
            // Unpacked to metres.
            false if is("compressedDepth") && is("32FC1") => (packed_image, Some(1.0)),
            false
                if is("16UC1") || is("compressedDepth") || is("png") && topic.contains("depth") =>
            {
                (packed_image, Some(MILLIMETRE))
            }
            false => (packed_image, None),
        };
        // Pictures of depth and infrared images are no photographs, if there are others.
        let is_grey = encoding.starts_with("mono")
            || encoding == "8UC1"
            || topic.split('/').any(|part| part == "depth");
        Some(Self { frame, as_file, unit, is_grey, shots: Vec::new() })
    }

    fn source(&self, topic: &str, Shot { time, bag, place }: &Shot) -> ByteSource {
        let shown = bag.join(topic.trim_start_matches('/')).join(name(*time));
        let (bag, place, as_file) = (Arc::clone(bag), *place, self.as_file);
        ByteSource::Message(Arc::new(Message { bag, place, as_file, shown }))
    }

    fn sources(&self, topic: &str) -> impl Iterator<Item = ByteSource> {
        self.shots.iter().map(move |shot| self.source(topic, shot))
    }

    fn sort(&mut self) {
        self.shots.sort_by(|a, b| a.time.total_cmp(&b.time));
    }
}

/// Name of a frame: its time in seconds.
fn name(time: f64) -> String {
    format!("{time:.6}")
}

/// Poses of frames of reference.
struct Tree(BTreeMap<String, (String, Trajectory, Option<f64>)>);

impl Tree {
    fn new(edges: BTreeMap<String, Edge>) -> Self {
        let of = |(child, edge): (String, Edge)| (child, Self::edge(edge));
        Self(edges.into_iter().map(of).collect())
    }

    /// Parent, poses, and tolerance of times; `None` for static poses.
    fn edge(Edge { parent, mut poses, is_static }: Edge) -> (String, Trajectory, Option<f64>) {
        let times: Vec<f64> = poses.iter().map(|pose| pose.time).collect();
        // A single transform does not move.
        let step = usual_step(&times).filter(|_| !is_static);
        if step.is_none() {
            poses.drain(..poses.len().saturating_sub(1));
        }
        (parent, Trajectory::new(poses).0, step.map(|step| step.max(TOLERANCE)))
    }

    fn add(&mut self, child: &str, edge: Edge) {
        self.0.insert(child.to_owned(), Self::edge(edge));
    }

    /// Returns the names of a frame and of those above it.
    fn way<'a>(&'a self, frame: &'a str) -> Vec<&'a str> {
        let parent = |at: &&'a str| self.0.get(*at).map(|(parent, ..)| parent.as_str());
        std::iter::successors(Some(frame), parent).take(MAX_CLIMB).collect()
    }

    /// Chooses the topic of poses that moves the root above a frame or, if no transform moves the frame,
    /// one whose body carries it, or that has most poses.
    fn mover(&self, mut tracks: BTreeMap<String, Track>, frame: &str) -> Option<(String, Track)> {
        let way = self.way(frame);
        let place = |track: &Track| {
            let body = track.child.as_deref()?;
            way.iter().position(|at| *at == body)
        };
        if way.iter().any(|at| self.0.get(*at).is_some_and(|(_, _, moves)| moves.is_some())) {
            tracks.retain(|_, track| place(track) == way.len().checked_sub(1));
        }
        tracks.into_iter().max_by_key(|(_, track)| (place(track).is_some(), track.poses.len()))
    }

    /// Climbs to the root at a time or, without one, to the first frame that moves. Returns the pose of
    /// `frame` there and the names of all frames on the way.
    fn climb<'a>(
        &'a self,
        frame: &'a str,
        time: Option<f64>,
    ) -> Result<(DMat4, Vec<&'a str>), FrameProblem> {
        let (mut pose, mut way) = (DMat4::IDENTITY, vec![frame]);
        while way.len() < MAX_CLIMB {
            let at = way.last().copied().unwrap_or(frame);
            let step = match (self.0.get(at), time) {
                (None, _) | (Some((_, _, Some(_))), None) => return Ok((pose, way)),
                (Some((_, path, Some(tolerance))), Some(time)) => path.within(*tolerance, time)?,
                (Some((_, path, None)), _) => path.within(f64::INFINITY, 0.0)?,
            };
            pose = step * pose;
            way.extend(self.0.get(at).map(|(parent, ..)| parent.as_str()));
        }
        let expected = "transforms that lead to a root";
        Err(FrameProblem::Entry { expected, found: format!("a cycle above `{frame}`") })
    }

    /// Lets a topic of poses move the camera; returns what is assumed about its place on the body.
    fn move_by(&mut self, track: Track, camera: &str) -> Option<String> {
        let Track { parent, child, poses } = track;
        let way = self.way(camera);
        let top = way.last().copied().unwrap_or(camera).to_owned();
        let is_on_body = child.as_ref().is_some_and(|child| way.contains(&child.as_str()));
        let assumed = match &child {
            Some(_) if is_on_body => None,
            None => Some(format!("poses are assumed to be those of `{top}`")),
            Some(child) => {
                let is_body =
                    !child.contains("optical") && BODIES.iter().any(|b| child.contains(b));
                // The camera looks ahead: its x is right, its y is down.
                let ahead = DMat3::from_cols(-DVec3::Y, -DVec3::Z, DVec3::X);
                let turn = if is_body && top == camera { ahead } else { DMat3::IDENTITY };
                let pose = TimedPose::from_matrix(0.0, DMat4::from_mat3(turn));
                let (parent, poses) = (child.clone(), vec![pose]);
                self.add(&top, Edge { parent, poses, is_static: true });
                let axes = if turn == ahead { "looking ahead" } else { "with its axes" };
                Some(format!("no transform from `{child}` to `{top}`, assumed there, {axes}"))
            }
        };
        let child = child.unwrap_or(top);
        self.add(&child, Edge { parent, poses, is_static: false });
        assumed
    }
}

fn parse(folder: &Folder, options: &LoadOptions) -> Result<ParsedFolder, DatasetError> {
    let names = bags(folder);
    let bag = folder.path.join(names.first().copied().unwrap_or_default());
    if names.len() > 1 && !folder.listing.has_file("metadata.yaml") {
        let found = format!("{} without a metadata.yaml", names.len());
        return Err(metadata_error(&folder.path, "one bag", found, "open one of the files"));
    }
    let (mut recording, mut content) = (Recording::new(folder, options), Content::default());
    for name in names {
        let path = Arc::new(folder.path.join(name));
        let wanted = |channel: &Channel| Content::wanted(&channel.schema);
        match scan(&path, wanted, &mut |found| content.visit(&found, &path)) {
            Err(source) if source.raw_os_error().is_some() => {
                return Err(DatasetError::Read { path: path.to_path_buf(), source });
            }
            Err(problem) => recording.unused(&path, format!("{problem}: what follows is not read")),
            Ok(()) => {}
        }
    }
    check_count(&bag, "images and poses", content.n_entries, MOST_ENTRIES)?;
    for (topic, (schema, n)) in &content.topics {
        let kind = schema.rsplit('/').next().unwrap_or(schema);
        if *n > 0 && (Content::wanted(schema) > 0 || is_stating(kind)) {
            recording.unused(&bag, format!("{n} messages of {topic} ({schema}) cannot be read"));
        }
    }
    for topic in &content.other_cameras {
        recording.unused(&bag, format!("later cameras of {topic} that differ from the first"));
    }
    for transform in &content.second_parents {
        recording.unused(&bag, format!("transforms of {transform} beside those in another parent"));
    }
    content.images.values_mut().for_each(Images::sort);
    let mut tree = Tree::new(std::mem::take(&mut content.edges));
    let tracks = std::mem::take(&mut content.tracks);
    let Some([depth, color]) = content.choose() else {
        let expected = "topics of photographs and of depth (16UC1 or 32FC1; raw, PNG or RVL)";
        return Err(metadata_error(&bag, expected, content.shown(), "record both as sensor_msgs"));
    };
    recording.note(format!("depth is of {}, photographs of {}", depth.0, color.0));
    let is_other = |topic: &&String| ![depth.0, color.0].contains(topic);
    let others: Vec<_> = content.images.keys().filter(is_other).map(String::as_str).collect();
    if !others.is_empty() {
        recording.note(format!("other images are not used: {}", others.join(", ")));
    }
    let sizes = recording.sizes(color.1.sources(color.0), depth.1.sources(depth.0));
    let Some(sizes) = sizes else { return Ok(recording.finish()) };
    let cameras = cameras(&mut recording, &content, [depth, color], sizes, &bag)?;
    if !options.track {
        let moves = tree.climb(&depth.1.frame, None);
        // Climbing without a time ends at a root, or at a frame that moves.
        let is_moved =
            moves.is_ok_and(|(_, way)| way.last().is_some_and(|at| tree.0.contains_key(*at)));
        match tree.mover(tracks, &depth.1.frame) {
            Some((topic, track)) => {
                recording.note(format!("poses are those of {topic}"));
                let assumed = tree.move_by(track, &depth.1.frame);
                assumed.into_iter().for_each(|assumed| recording.note(assumed));
            }
            None if is_moved => {}
            None => {
                let expected = "transforms that move the camera, odometry or poses";
                return Err(no_poses(&bag, expected, &content.shown()));
            }
        }
    }
    let [depth_frame, color_frame] = [depth, color].map(|(_, images)| images.frame.as_str());
    if tree.way(depth_frame).last() != tree.way(color_frame).last() {
        let missing = format!("no transform between `{depth_frame}` and `{color_frame}`");
        recording.note(format!("{missing}, assumed to be in one place"));
    }
    let times: Vec<f64> = color.1.shots.iter().map(|shot| shot.time).collect();
    let unit = CodeKind::ByContent(depth.1.unit.unwrap_or(MILLIMETRE));
    let frames = Frames {
        tree: &tree,
        depth,
        color,
        cameras,
        size: [sizes.0.0, sizes.0.1],
        tolerance: usual_step(&times).map_or(TOLERANCE, |step| 0.5 * step),
        encoding: encoding(options, unit, Sensor::Kinect, STRUCTURED_LIGHT_RANGE),
    };
    let mut seen = HashSet::new();
    for shot in depth.1.shots.iter().filter(|shot| !folder.was_taken(&name(shot.time))) {
        let name = name(shot.time);
        let frame = match seen.insert(name.clone()) {
            true => frames.frame(shot, options),
            false => Err(FrameProblem::Duplicate("another depth image of that time".to_owned())),
        };
        recording.add(&name, &bag, frame);
    }
    Ok(recording.finish())
}

type Topic<'a> = (&'a String, &'a Images);

/// Returns the cameras of depth and photographs, from the messages that fit their topics.
fn cameras(
    recording: &mut Recording,
    content: &Content,
    [depth, color]: [Topic; 2],
    (size, depth_size): ((u32, u32), (u32, u32)),
    bag: &Path,
) -> Result<Cameras, DatasetError> {
    let of_depth = content.camera(depth.0, depth.1);
    let of_color = content.camera(color.0, color.1).or(of_depth);
    let Some((of_depth, of_color)) = of_depth.or(of_color).zip(of_color) else {
        if recording.options.intrinsics.is_some() {
            // Replaced by the user's numbers.
            let any = Intrinsics::from_horizontal_fov(size.0, size.1, 1.0);
            return recording.cameras_of_lens(&any, size, depth_size, bag);
        }
        let expected = format!("CameraInfo for {} and {}", depth.0, color.0);
        let hint = "record camera_info beside the images, or set --intrinsics";
        return Err(metadata_error(bag, &expected, content.shown(), hint));
    };
    let unused: BTreeSet<_> = of_depth.unused.iter().chain(&of_color.unused).copied().collect();
    if !unused.is_empty() {
        let names = unused.into_iter().collect::<Vec<_>>().join(", ");
        recording.unused(bag, format!("{names} of camera_info are not used"));
    }
    let (k, lens) = of_depth.of_topic(depth.0, bag)?;
    let (color_k, color_lens) = of_color.of_topic(color.0, bag)?;
    recording
        .cameras_of_lenses((bag, &color_k), (bag, &k), size, depth_size)?
        .with_lenses([lens, color_lens], bag)
}

/// What all frames have in common.
struct Frames<'a> {
    tree: &'a Tree,
    depth: Topic<'a>,
    color: Topic<'a>,
    cameras: Cameras,
    size: [u32; 2],
    /// Largest time between a depth image and its photograph, seconds.
    tolerance: f64,
    encoding: DepthEncoding,
}

impl Frames<'_> {
    fn frame(&self, shot: &Shot, options: &LoadOptions) -> Result<FrameEntry, FrameProblem> {
        let (depth, color) = (self.depth.1, self.color.1);
        let photo = nearest(&color.shots, shot.time, self.tolerance)?;
        let climb = |frame, time| self.tree.climb(frame, Some(time).filter(|_| !options.track));
        let (matrix, way) = climb(&depth.frame, shot.time)?;
        let pose = Pose::from_opencv(matrix)?;
        // At the ends of the recording, the photograph may be beyond the last pose.
        let placed = climb(&color.frame, photo.time).ok().filter(|(_, of)| of.last() == way.last());
        let is_still = options.track || (photo.time - shot.time).abs() < SIMULTANEOUS;
        let placed = placed.filter(|_| color.frame != depth.frame || !is_still);
        let mut cameras = self.cameras;
        if let Some((matrix, _)) = placed {
            let of_depth = || ColorCamera::from_depth_intrinsics(&cameras.depth, self.size);
            let camera = cameras.color.unwrap_or_else(of_depth);
            cameras.color =
                Some(camera.with_extrinsics_between(&pose, &Pose::from_opencv(matrix)?));
        }
        let source = DepthSource::new(depth.source(self.depth.0, shot), self.encoding);
        let color = color.source(self.color.0, photo);
        let pose = options.pose(|| Ok(pose))?;
        let frame = frame_entry(name(shot.time), pose, cameras, color, Some(source));
        Ok(FrameEntry { time: Some(shot.time), ..frame })
    }
}

fn nearest(shots: &[Shot], time: f64, tolerance: f64) -> Result<&Shot, FrameProblem> {
    let after = shots.partition_point(|shot| shot.time < time);
    let around = [after.checked_sub(1).and_then(|i| shots.get(i)), shots.get(after)];
    let distance = |shot: &&Shot| (shot.time - time).abs();
    let best = around.into_iter().flatten().min_by(|a, b| distance(a).total_cmp(&distance(b)));
    let missing = || not_in_time("a colour image", time, tolerance, best.as_ref().map(distance));
    best.filter(|shot| distance(shot) <= tolerance).ok_or_else(missing)
}
