//! Runs other programs on the same frames in turns with this engine and prints their times and ratios.
//!
//! `cargo run --release --example peers -- DATASET --open3d --published CHECKOUT --peer NAME=COMMAND`
//!
//! A program's last argument is the folder of frames (`frames.json` and NumPy arrays). It prints "ready" in
//! quotes, then `{"ms": 12.5}` for each frame number on its input.
#![allow(clippy::print_stdout, reason = "a command-line program")]

use bytemuck::cast_slice;
use clap::Parser;
use serde::Deserialize;
use serde_json::{Value, json};
use std::error::Error;
use std::ffi::OsString;
use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::time::Duration;
use tempfile::TempDir;
use vbgs_studio::dataset::frame::Frame;
use vbgs_studio::dataset::unproject::Unprojector;
use vbgs_studio::dataset::{self, Dataset, LoadOptions};
use vbgs_studio::eval::metrics::Spread;
use vbgs_studio::math::measured_pixel::Normalization;
use vbgs_studio::observation::points::Points;
use vbgs_studio::pipeline::frame_loop::TypedPreset;
use vbgs_studio::pipeline::plan::Selection;
use vbgs_studio::pipeline::session::Session;
use vbgs_studio::train::paper::config::{PaperConfig, PaperOverrides, ReassignPolicy};
use vbgs_studio::train::paper::init::InitialDraw;
use vbgs_studio::train::paper::learner;
use vbgs_studio::train::paper::learner::PaperLearner;

type Outcome<T> = Result<T, Box<dyn Error>>;

#[derive(Parser)]
struct Args {
    /// Dataset folder
    dataset: PathBuf,
    /// Compare with Open3D's fusion on the CPU; --python must have `open3d`
    #[arg(long)]
    open3d: bool,
    /// Compare with the published implementation in this checkout; --python must have its dependencies
    #[arg(long, value_name = "DIR")]
    published: Option<PathBuf>,
    /// Compare with another program
    #[arg(long, value_name = "NAME=COMMAND")]
    peer: Vec<String>,
    /// Python interpreter for --open3d and --published
    #[arg(long, value_name = "PROGRAM", default_value = "python3")]
    python: PathBuf,
    /// Number of components of each mixture
    #[arg(long, value_name = "N", default_value_t = 10_000)]
    components: usize,
    /// Number of frames, evenly spaced; the first one warms up
    #[arg(long, value_name = "N", default_value_t = 11)]
    frames: usize,
    /// Longest time without an answer of a program, in seconds
    #[arg(long, value_name = "S", default_value_t = 600)]
    patience: u64,
}

/// A timed program: this engine or another process.
enum Learning {
    Ours(Box<dyn PaperLearner>),
    Theirs(Peer),
}

fn main() -> Outcome<()> {
    let args = Args::parse();
    let config = |reassign| {
        PaperConfig::paper().with(&PaperOverrides {
            components: Some(args.components),
            reassign: Some(reassign),
            ..PaperOverrides::default()
        })
    };
    let dataset = Arc::new(dataset::open(&args.dataset, &LoadOptions::default())?);
    let told = json!({ "components": args.components, "threads": rayon::current_num_threads() });
    let (frames, folder) = share_frames(&dataset, &args, &config(ReassignPolicy::Off)?, told)?;
    let draw = InitialDraw::random(args.components, 0);
    let mut programs = Vec::new();
    for (name, policy) in
        [("vbgs-studio", ReassignPolicy::Off), ("vbgs-studio, padded", ReassignPolicy::Padded)]
    {
        let engine = learner::begin(&config(policy)?, &draw, Normalization::IDENTITY)?;
        programs.push((name.to_owned(), Learning::Ours(engine)));
    }
    for (name, command) in args.commands()? {
        let peer = Peer::start(&name, &command, folder.path(), Duration::from_secs(args.patience))?;
        programs.push((name, Learning::Theirs(peer)));
    }
    let mut times = vec![Vec::new(); programs.len()];
    // Frame by frame in turns, so that other load on the machine slows all programs alike.
    for (number, points) in frames.iter().enumerate() {
        for ((_, program), times) in programs.iter_mut().zip(&mut times) {
            times.push(match program {
                Learning::Ours(engine) => engine.learn(points)?.ms.train,
                Learning::Theirs(peer) => peer.learn(number)?,
            });
        }
    }
    println!("{} components, {} frames of {}", args.components, frames.len(), dataset.name);
    let warm = usize::from(frames.len() > 1);
    for ((name, _), own) in programs.iter().zip(&times) {
        let ratios = own.iter().zip(&times[0]).skip(warm).map(|(own, ours)| own / ours);
        let (ms, ratio) = (Spread::of(own[warm..].to_vec()), Spread::of(ratios.collect()));
        println!("{name}: {ms} ms a frame, {ratio} times vbgs-studio without reassignment");
    }
    Ok(())
}

impl Args {
    /// Name and words of each program's command line.
    fn commands(&self) -> Outcome<Vec<(String, Vec<OsString>)>> {
        let python = |script: &str| vec![self.python.clone().into(), "-c".into(), script.into()];
        let mut commands: Vec<(String, Vec<OsString>)> = Vec::new();
        if let Some(checkout) = &self.published {
            let words = [python(include_str!("published.py")), vec![checkout.into()]].concat();
            commands.push(("published, dense".to_owned(), words));
        }
        if self.open3d {
            commands.push(("Open3D TSDF".to_owned(), python(include_str!("open3d.py"))));
        }
        for peer in &self.peer {
            let (name, command) = peer.split_once('=').ok_or_else(|| {
                format!("--peer: expected a name and a command, such as mine=./mine, found {peer}")
            })?;
            let words = command.split_whitespace().map(OsString::from).collect();
            commands.push((name.to_owned(), words));
        }
        Ok(commands)
    }
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum Answer {
    Ready,
    Ms(f64),
    Error(String),
}

/// A running program. Dropping it ends the process.
struct Peer {
    name: String,
    child: Child,
    requests: ChildStdin,
    /// Answers, read on another thread, so that a silent program can be given up.
    answers: Receiver<Answer>,
    patience: Duration,
}

impl Peer {
    fn start(name: &str, command: &[OsString], frames: &Path, patience: Duration) -> Outcome<Self> {
        let (program, arguments) = command.split_first().ok_or("--peer: found no command")?;
        let mut child = Command::new(program)
            .args(arguments)
            .arg(frames)
            .stdin(Stdio::piped())
            // stderr is inherited, so that the program's own messages reach the user.
            .stdout(Stdio::piped())
            .spawn()
            .map_err(|e| format!("{name}: {} does not start: {e}", program.display()))?;
        let requests = child.stdin.take().ok_or("no standard input")?;
        let lines = BufReader::new(child.stdout.take().ok_or("no standard output")?).lines();
        let (answered, answers) = channel();
        std::thread::spawn(move || {
            // Libraries also print to stdout, so other lines are skipped.
            let found = lines.map_while(Result::ok);
            let mut found = found.filter_map(|line| serde_json::from_str(&line).ok());
            // Fails once the program is given up.
            found.try_for_each(|answer| answered.send(answer))
        });
        let mut peer = Self { name: name.to_owned(), child, requests, answers, patience };
        match peer.answer()? {
            Some(Answer::Ready) => Ok(peer),
            other => Err(format!("{name}: expected \"ready\", found {other:?}").into()),
        }
    }

    /// Trains on a frame and returns the program's milliseconds.
    fn learn(&mut self, frame: usize) -> Outcome<f64> {
        writeln!(self.requests, "{frame}")?;
        match self.answer()? {
            Some(Answer::Ms(ms)) if ms > 0.0 && ms.is_finite() => Ok(ms),
            other => {
                Err(format!("{}: expected {{\"ms\": 12.5}}, found {other:?}", self.name).into())
            }
        }
    }

    fn answer(&mut self) -> Outcome<Option<Answer>> {
        let (name, patience) = (&self.name, self.patience.as_secs());
        match self.answers.recv_timeout(self.patience) {
            Ok(Answer::Error(reason)) => Err(format!("{name}: {reason}").into()),
            Ok(answer) => Ok(Some(answer)),
            Err(RecvTimeoutError::Disconnected) => Ok(None),
            Err(RecvTimeoutError::Timeout) => Err(format!(
                "{name}: found no answer within {patience} s; wait longer with --patience, or look for its error above"
            )
            .into()),
        }
    }
}

impl Drop for Peer {
    fn drop(&mut self) {
        // Errors are ignored: the program may have ended already.
        drop(self.child.kill());
        drop(self.child.wait());
    }
}

/// Prepares evenly spaced training frames, and writes the same frames to a folder for other programs.
fn share_frames(
    dataset: &Arc<Dataset>,
    args: &Args,
    config: &PaperConfig,
    told: Value,
) -> Outcome<(Vec<Points<f32>>, TempDir)> {
    let session = Session::new(dataset.clone(), config.clone(), Selection::all_frames())?;
    let preparation = config.preparation(session.config(), *session.normalization());
    let plan = session.plan().clone();
    // Only the plan and the preparation are needed: free the model before decoding.
    drop(session);
    let folder = tempfile::tempdir()?;
    let (mut all, mut described) = (Vec::new(), Vec::new());
    let n = args.frames.min(plan.frames.len());
    for i in (0..n).map(|i| plan.frames[i * plan.frames.len() / n]) {
        let mut points = Points::new();
        let frame = dataset.load(plan.split, i)?;
        Unprojector::new().unproject(&frame, &preparation, &mut points)?;
        described.push(write_frame(folder.path(), all.len(), &frame, &points)?);
        all.push(points);
    }
    let frames = json!({ "frames": described, "told": told });
    std::fs::write(folder.path().join("frames.json"), serde_json::to_vec(&frames)?)?;
    Ok((all, folder))
}

fn write_frame(
    folder: &Path,
    number: usize,
    frame: &Frame,
    points: &Points<f32>,
) -> Outcome<Value> {
    let array = |name: &str, kind, shape: &[usize], bytes: &[u8]| {
        std::fs::write(folder.join(format!("{name}-{number}.npy")), npy(kind, shape, bytes))
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
    let (k, pose) = (&frame.camera.intrinsics, frame.camera.pose);
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

#[cfg(all(test, unix))]
mod tests {
    use super::*;
    use std::time::Instant;

    fn peer(script: &str) -> Outcome<Peer> {
        let command = ["sh", "-c", script].map(OsString::from);
        Peer::start("other", &command, Path::new("."), Duration::from_secs(1))
    }

    #[test]
    fn a_silent_program_is_given_up() {
        let started = Instant::now();
        let error = peer("exec sleep 60").err().unwrap().to_string();
        assert!(error.contains("other: found no answer within 1 s"), "{error}");
        let mut late = peer(r#"echo '"ready"'; exec sleep 60"#).unwrap();
        assert!(late.learn(0).unwrap_err().to_string().contains("within 1 s"));
        drop(late);
        assert!(started.elapsed() < Duration::from_secs(30));
        let mut sound =
            peer(r#"echo noise; echo '"ready"'; read frame; echo '{"ms": 2.5}'"#).unwrap();
        assert_eq!(sound.learn(0).unwrap(), 2.5);
        let ended = peer("exit 0").err().unwrap().to_string();
        assert!(ended.contains("expected \"ready\", found None"), "{ended}");
    }
}
