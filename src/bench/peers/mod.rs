//! Comparison with other programs on the same frames. Programs run in turns frame by frame, so that
//! other load on the machine slows all of them alike. Each time is also given as a ratio to ours on
//! the same frame.

use super::findings::{Bench, BenchError, BenchOptions, Findings, Progress};
use super::paper::sample::spaced;
use super::plot::draw::{Mark, Panel, Series};
use super::plot::{Axis, draw};
use crate::dataset::Dataset;
use crate::dataset::frame::Frame;
use crate::dataset::unproject::Unprojector;
use crate::eval::metrics::Spread;
use crate::eval::report;
use crate::math::measured_pixel::Normalization;
use crate::observation::points::Points;
use crate::pipeline::frame_loop::TypedPreset;
use crate::pipeline::plan::Selection;
use crate::pipeline::session::Session;
use crate::train::paper::config::{PaperConfig, PaperOverrides, ReassignPolicy};
use crate::train::paper::init::InitialDraw;
use crate::train::paper::learner;
use crate::train::paper::learner::PaperLearner;
use bytemuck::cast_slice;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use std::ffi::OsString;
use std::io::{BufRead, BufReader, Lines, Write};
use std::path::Path;
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::sync::Arc;
use tempfile::TempDir;

/// Frames per run, including one warm-up frame.
const FRAMES: usize = 11;
const QUICK_FRAMES: usize = 4;

#[derive(Clone, Debug)]
pub struct PeersPlan {
    pub peers: Vec<PeerCommand>,
    pub components: usize,
    pub options: BenchOptions,
}

/// Times of one program, with first and third quartiles.
#[derive(Clone, Debug, Serialize)]
pub struct PeerRow {
    pub name: String,
    /// Timed frames, without the warm-up frame.
    pub frames: usize,
    /// Median milliseconds to train on a frame.
    pub ms: f64,
    pub ms_q1: f64,
    pub ms_q3: f64,
    /// Median ratio of its time to ours without reassignment on the same frame.
    pub ratio: f64,
    pub ratio_q1: f64,
    pub ratio_q3: f64,
}

/// A timed program: this engine or a peer process.
enum Learning {
    Ours(Box<dyn PaperLearner>),
    Theirs(PeerProcess),
}

pub fn run(
    plan: &PeersPlan,
    dataset: &Arc<Dataset>,
    progress: Progress,
) -> Result<Bench, BenchError> {
    let n = if plan.options.quick { QUICK_FRAMES } else { FRAMES };
    let n = plan.options.max_frames.unwrap_or(n).max(2);
    let config = |reassign| {
        PaperConfig::paper().with(&PaperOverrides {
            components: Some(plan.components),
            seed: Some(plan.options.seed),
            reassign: Some(reassign),
            ..PaperOverrides::default()
        })
    };
    let told = json!({ "components": plan.components, "threads": rayon::current_num_threads() });
    let frames = SharedFrames::write(dataset, n, &config(ReassignPolicy::Off)?, told)?;
    let draw = InitialDraw::random(plan.components, plan.options.seed);
    let mut lines = Vec::new();
    for (name, policy) in
        [("vbgs-studio", ReassignPolicy::Off), ("vbgs-studio, padded", ReassignPolicy::Padded)]
    {
        let engine = learner::begin(&config(policy)?, &draw, Normalization::IDENTITY)?;
        lines.push((name.to_owned(), Learning::Ours(engine)));
    }
    for peer in &plan.peers {
        let process = PeerProcess::start(peer, frames.folder.path())?;
        lines.push((peer.name.clone(), Learning::Theirs(process)));
    }
    let mut times = vec![Vec::new(); lines.len()];
    for (number, points) in frames.points.iter().enumerate() {
        for ((_, learning), times) in lines.iter_mut().zip(&mut times) {
            times.push(match learning {
                Learning::Ours(engine) => engine.learn(points)?.ms.train,
                Learning::Theirs(process) => process.learn(number)?,
            });
        }
        progress(number + 1, frames.points.len());
    }
    let names = lines.into_iter().map(|(name, _)| name);
    let rows: Vec<PeerRow> =
        names.zip(&times).map(|(name, own)| row(name, own, &times[0])).collect();
    findings(plan, &dataset.name, rows)
}

/// Summarises the times `own` of a program relative to `ours`, frame by frame.
fn row(name: String, own: &[f64], ours: &[f64]) -> PeerRow {
    // The first frame warms up and is excluded unless it is the only usable one.
    let counted = usize::from(own.len() > 1)..;
    let (own, ours) = (&own[counted.clone()], &ours[counted]);
    let ms = Spread::of(own.to_vec());
    let ratio = Spread::of(own.iter().zip(ours).map(|(own, ours)| own / ours).collect());
    let ([ms_q1, ms_q3], [ratio_q1, ratio_q3]) = (ms.quartiles, ratio.quartiles);
    let (ms, ratio) = (ms.median, ratio.median);
    PeerRow { name, frames: own.len(), ms, ms_q1, ms_q3, ratio, ratio_q1, ratio_q3 }
}

fn findings(plan: &PeersPlan, dataset: &str, rows: Vec<PeerRow>) -> Result<Bench, BenchError> {
    let notes = vec![format!(
        "{} components in every mixture. ms: median time to train on a frame in memory, without the first frame. ratio: median of the time relative to vbgs-studio without reassignment on the same frame. Quartiles in parentheses. Each program uses its own threads.",
        plan.components
    )];
    Findings {
        name: "peers",
        dataset,
        adapter: None,
        options: plan.options,
        notes,
        table: text(&rows),
        plot: draw::draw("Time per frame of other programs", &[panel(&rows)])?,
        summary: json!({ "components": plan.components }),
        rows,
    }
    .into_bench()
}

fn text(rows: &[PeerRow]) -> String {
    let cells = |row: &PeerRow| {
        [
            row.name.clone(),
            row.frames.to_string(),
            format!("{:.2} ({:.2} to {:.2})", row.ms, row.ms_q1, row.ms_q3),
            format!("{:.2} ({:.2} to {:.2})", row.ratio, row.ratio_q1, row.ratio_q3),
        ]
    };
    let rows: Vec<_> = rows.iter().map(cells).collect();
    report::text(["program", "frames", "ms/frame", "ratio"], &rows)
}

fn panel(rows: &[PeerRow]) -> Panel {
    let mark = |(at, row): (usize, &PeerRow)| {
        let x = Spread { median: row.ratio, quartiles: [row.ratio_q1, row.ratio_q3] };
        Mark { x, y: Spread::exact(at as f64), label: None }
    };
    let marks = rows.iter().enumerate().map(mark).collect();
    Panel {
        title: "time per frame relative to ours without reassignment".to_owned(),
        x: Axis::Log("ratio of times".to_owned()),
        y: Axis::Names(rows.iter().map(|row| row.name.clone()).collect()),
        series: vec![Series { name: "ratio".to_owned(), marks, connected: false }],
    }
}

/// Command line of a program to compare with.
#[derive(Clone, Debug)]
pub struct PeerCommand {
    /// Name in tables.
    pub name: String,
    pub program: OsString,
    /// Arguments before the folder of frames.
    pub arguments: Vec<OsString>,
}

impl PeerCommand {
    /// Open3D's TSDF integration, run by a Python that has Open3D.
    pub fn open3d(python: &Path) -> Self {
        let arguments = vec!["-c".into(), include_str!("open3d.py").into()];
        Self { name: "Open3D TSDF".to_owned(), program: python.into(), arguments }
    }

    /// The published implementation in a checkout of its repository, run by a Python with its
    /// dependencies.
    pub fn published(python: &Path, checkout: &Path) -> Self {
        let script = include_str!("published.py");
        let arguments = vec!["-c".into(), script.into(), checkout.into()];
        Self { name: "published, dense".to_owned(), program: python.into(), arguments }
    }
}

#[derive(Debug, thiserror::Error)]
pub enum PeerError {
    #[error("{name}: `{program}` does not start: {source}; install it, or omit this comparison")]
    Start { name: String, program: String, source: std::io::Error },
    /// The program reported an error.
    #[error("{name}: {reason}")]
    Refused { name: String, reason: String },
    /// The program ended or sent an unexpected line.
    #[error("{name}: expected an output line such as {expected}, found {found}")]
    Answer {
        name: String,
        /// Example of a valid line.
        expected: &'static str,
        found: String,
    },
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum Answer {
    Ready,
    Ms(f64),
    Error(String),
}

/// A running peer program. Dropping it ends the process.
struct PeerProcess {
    name: String,
    child: Child,
    asks: Option<ChildStdin>,
    answers: Option<Lines<BufReader<ChildStdout>>>,
}

impl PeerProcess {
    /// Starts the program on a folder of frames and waits until it is ready.
    pub fn start(command: &PeerCommand, frames: &Path) -> Result<Self, PeerError> {
        let PeerCommand { name, program, arguments } = command;
        let started = Command::new(program)
            .args(arguments)
            .arg(frames)
            .stdin(Stdio::piped())
            // stderr is inherited, so that the program's own messages reach the user.
            .stdout(Stdio::piped())
            .spawn();
        let mut child = started.map_err(|source| PeerError::Start {
            name: name.clone(),
            program: program.to_string_lossy().into_owned(),
            source,
        })?;
        let (asks, out) = (child.stdin.take(), child.stdout.take());
        let answers = out.map(|out| BufReader::new(out).lines());
        let mut process = Self { name: name.clone(), child, asks, answers };
        match process.answer()? {
            Some(Answer::Ready) => Ok(process),
            other => Err(process.unexpected("\"ready\"", other)),
        }
    }

    /// Requests training on a frame and returns its milliseconds.
    pub fn learn(&mut self, frame: usize) -> Result<f64, PeerError> {
        // A failed write means that the program has ended. The missing answer then reports it.
        let asked = self.asks.as_mut().map(|asks| writeln!(asks, "{frame}"));
        drop(asked);
        match self.answer()? {
            Some(Answer::Ms(ms)) if ms > 0.0 && ms.is_finite() => Ok(ms),
            other => Err(self.unexpected("{\"ms\": 12.5}", other)),
        }
    }

    /// Returns the next line in the protocol's format, or `None` at the end. Other lines are
    /// ignored.
    fn answer(&mut self) -> Result<Option<Answer>, PeerError> {
        let lines = self.answers.iter_mut().flatten().map_while(Result::ok);
        // Libraries also print to stdout, so skip lines that are not in the protocol's format.
        match lines.filter_map(|line| serde_json::from_str(&line).ok()).next() {
            Some(Answer::Error(reason)) => {
                Err(PeerError::Refused { name: self.name.clone(), reason })
            }
            answer => Ok(answer),
        }
    }

    fn unexpected(&mut self, expected: &'static str, found: Option<Answer>) -> PeerError {
        let found = found.map_or_else(
            || match self.child.wait() {
                Ok(status) => format!("the end of its output ({status})"),
                Err(error) => error.to_string(),
            },
            |answer| format!("{answer:?}"),
        );
        PeerError::Answer { name: self.name.clone(), expected, found }
    }
}

impl Drop for PeerProcess {
    fn drop(&mut self) {
        // Errors are ignored: the program may have ended already.
        drop(self.child.kill());
        drop(self.child.wait());
    }
}

/// Frames in memory for this engine, and as files for other programs.
struct SharedFrames {
    /// Points by frame.
    pub points: Vec<Points<f32>>,
    /// Folder with the same frames as files. Deleted on drop.
    pub folder: TempDir,
}

impl SharedFrames {
    /// Writes up to `n` evenly spaced training frames. Unusable frames are skipped. The last
    /// argument is passed on to the programs in `frames.json`.
    pub fn write(
        dataset: &Arc<Dataset>,
        n: usize,
        config: &PaperConfig,
        told: Value,
    ) -> Result<Self, BenchError> {
        let session = Session::new(dataset.clone(), config.clone(), Selection::all_frames())?;
        let normalization = *session.normalization();
        let preparation = config.preparation(session.config(), normalization);
        let (split, chosen) = (session.plan().split, spaced(&session.plan().frames, n));
        // Only the plan and the preparation are needed: free the model before decoding.
        drop(session);
        let folder = tempfile::tempdir().map_err(at(&std::env::temp_dir()))?;
        let (mut all, mut described, mut first_problem) = (Vec::new(), Vec::new(), None);
        let mut unprojector = Unprojector::new();
        for i in chosen {
            let mut points = Points::new();
            let frame = dataset.load(split, i).and_then(|frame| {
                unprojector.unproject(&frame, &preparation, &mut points).map(|_| frame)
            });
            match frame {
                Ok(frame) => {
                    described.push(write_frame(folder.path(), all.len(), &frame, &points)?);
                    all.push(points);
                }
                Err(problem) => drop(first_problem.get_or_insert(problem.to_string())),
            }
        }
        if all.is_empty() {
            let first = first_problem.unwrap_or_else(|| "no frame is selected".to_owned());
            return Err(BenchError::NoFrame { dataset: dataset.name.clone(), first });
        }
        let frames = json!({ "frames": described, "told": told });
        let path = folder.path().join("frames.json");
        std::fs::write(&path, serde_json::to_vec(&frames)?).map_err(at(&path))?;
        Ok(Self { points: all, folder })
    }
}

fn write_frame(
    folder: &Path,
    number: usize,
    frame: &Frame,
    points: &Points<f32>,
) -> Result<Value, BenchError> {
    let array = |name: &str, kind, shape: &[usize], bytes: &[u8]| {
        let path = folder.join(format!("{name}-{number}.npy"));
        std::fs::write(&path, npy(kind, shape, bytes)).map_err(at(&path))
    };
    let row = |i| {
        let ([x, y, z], [r, g, b]) = (points.position(i), points.color(i));
        [x, y, z, r, g, b]
    };
    let rows: Vec<[f32; 6]> = (0..points.len()).map(row).collect();
    array("points", "<f4", &[rows.len(), 6], cast_slice(&rows))?;
    let registered = frame.with_registered_color();
    let color = &registered.color;
    let rgb: Vec<[u8; 3]> = color.data.iter().map(|&[r, g, b, _]| [r, g, b]).collect();
    array("color", "|u1", &[color.height, color.width, 3], cast_slice(&rgb))?;
    if let Some(depth) = frame.depth_z() {
        array("depth", "<f4", &[depth.height, depth.width], cast_slice(&depth.data))?;
    }
    let k = &frame.camera.intrinsics;
    let pose = frame.camera.pose;
    Ok(json!({
        "name": frame.name,
        "intrinsics": [k.fx, k.fy, k.cx, k.cy],
        // Rotation columns (camera to world, OpenCV axes) and camera centre.
        "axes": pose.rotation().to_cols_array_2d(),
        "centre": pose.centre().to_array(),
    }))
}

/// Encodes an array in NumPy's file format, version 1.0.
fn npy(kind: &str, shape: &[usize], bytes: &[u8]) -> Vec<u8> {
    /// Alignment of the data, bytes.
    const ALIGNMENT: usize = 64;
    /// Total length of magic, version and header length, bytes.
    const BEFORE: usize = 10;
    let shape: String = shape.iter().map(|n| format!("{n}, ")).collect();
    let mut header = format!("{{'descr': '{kind}', 'fortran_order': False, 'shape': ({shape}), }}");
    let padded = (BEFORE + header.len() + 1).next_multiple_of(ALIGNMENT) - BEFORE;
    header.extend(std::iter::repeat_n(' ', padded - header.len() - 1));
    header.push('\n');
    let length = (header.len() as u16).to_le_bytes();
    [b"\x93NUMPY\x01\x00", &length[..], header.as_bytes(), bytes].concat()
}

fn at(path: &Path) -> impl FnOnce(std::io::Error) -> BenchError {
    |source| BenchError::File { path: path.to_owned(), source }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ratios_are_of_the_same_frame_and_the_first_does_not_count() {
        let ours = [50.0, 2.0, 4.0, 8.0];
        let found = row("a".to_owned(), &[900.0, 6.0, 12.0, 24.0], &ours);
        assert_eq!((found.frames, found.ms, found.ratio), (3, 12.0, 3.0));
        assert_eq!((found.ratio_q1, found.ratio_q3), (3.0, 3.0));
        assert_eq!(row("b".to_owned(), &[4.0], &[2.0]).ratio, 2.0);
    }
}

#[cfg(test)]
mod shared_frames_tests {
    use super::*;

    #[test]
    fn arrays_begin_at_a_multiple_of_64_bytes_behind_their_shape() {
        let values = [1.5f32, -2.0, 0.25, 3.0, 4.0, 5.0];
        let array = npy("<f4", &[3, 2], cast_slice(&values));
        let header = usize::from(u16::from_le_bytes([array[8], array[9]]));
        assert_eq!((10 + header) % 64, 0);
        let text = std::str::from_utf8(&array[10..10 + header]).unwrap();
        assert!(text.starts_with("{'descr': '<f4', 'fortran_order': False, 'shape': (3, 2, ), }"));
        assert!(text.ends_with(" \n"), "{text:?}");
        assert_eq!(array[10 + header..], *cast_slice::<f32, u8>(&values));
    }
}
