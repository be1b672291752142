//! History of measures: one line a commit, and a gate against the line before it.
//!
//! Times of shared machines differ by tens of per cent, instruction counts by thousandths. So kernels are
//! counted, by valgrind, which needs no permission that a container lacks. A child process runs a kernel once,
//! another one twice; the difference is the count of a run whose buffers are warm.

use super::findings::{BenchError, Progress, steps};
use super::held_out_views;
use super::protocol::file_error;
use super::render::BenchScene;
use super::scene::training;
use crate::dataset;
use crate::dataset::surface::Preparer;
use crate::dataset::synthetic::{self, SyntheticParams};
use crate::dataset::{Dataset, LoadOptions};
use crate::eval::metrics::Spread;
use crate::eval::report::describe;
use crate::eval::views::evaluate;
use crate::export::atomic::write_atomic;
use crate::math::camera::{Camera, Intrinsics};
use crate::math::measured_pixel::Normalization;
use crate::math::pose::Pose;
use crate::math::rng::{Purpose, Rng};
use crate::math::simd::Isa;
use crate::model::conjugate::statistics::{N_SUMS, TileRecord};
use crate::model::paper::totals::{Statistics, UpdateWidth};
use crate::model::splat::appearance::SplatView;
use crate::observation::points::Points;
use crate::observation::surface::Observation;
use crate::render::cpu::CpuRenderer;
use crate::render::{RenderMethod, RenderOptions};
use crate::train::candidates::{CandidateSearch, MeanGrid, nearest_in_tile};
use crate::train::learner::Learner;
use crate::train::paper::config::{PaperConfig, PaperOverrides, ReassignPolicy};
use crate::train::paper::init::InitialDraw;
use crate::train::paper::learner;
use crate::train::paper::reassign::{DestinationChooser, Quota};
use crate::train::scene::photometric::rule::PhotometricMode;
use crate::train::scene::trainer::SceneTrainer;
use glam::DVec3;
use std::hint::black_box;
use std::num::NonZero;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Arc;
use strum::{EnumIter, EnumString, IntoEnumIterator, IntoStaticStr, VariantNames};

/// Largest growth of an instruction count, and largest loss of PSNR in dB, that the gate accepts.
const MOST_GROWTH: f64 = 0.03;
const MOST_LOSS: f64 = 0.05;
/// Recordings that are trained, and number of held-out views that are measured.
const RECORDINGS: [&str; 2] = ["kinect_office", "lego400"];
const VIEWS: usize = 10;

/// Number of choices in a run of [`Kernel::Destinations`].
const CHOICES: usize = 32;

/// Size of a kernel's input.
#[derive(Clone, Copy, Debug)]
pub struct KernelSize {
    /// Pixels per side of the square of points, a multiple of 8.
    pub side: usize,
    pub components: usize,
    /// Frames of the room.
    pub frames: usize,
}

impl KernelSize {
    /// Small, since a counted program runs fifty times slower.
    pub const COUNTED: Self = Self { side: 96, components: 4000, frames: 2 };
    /// Beyond the caches, for times.
    pub const TIMED: Self = Self { side: 440, components: 100_000, frames: 4 };
}

/// Hot kernel of the engine whose instructions are counted.
#[derive(Clone, Copy, Debug, PartialEq, Eq, EnumIter, EnumString, IntoStaticStr, VariantNames)]
#[strum(serialize_all = "snake_case")]
pub enum Kernel {
    CandidateSearch,
    IndexRebuild,
    PaperFrame,
    PaperReassigned,
    PaperTotals,
    Destinations,
    PreparedFrame,
    ScenePoints,
    ScenePhotographs,
    DrawnView,
}

impl Kernel {
    /// Prepares the kernel's input and runs it `times` times.
    ///
    /// # Errors
    /// A model that cannot be built; never for the shapes used here.
    pub fn run(self, times: usize) -> Result<(), BenchError> {
        let mut work = self.prepared(KernelSize::COUNTED)?;
        (0..times).try_for_each(|_| work())
    }

    /// Prepares the kernel's input. Returns a function that runs the kernel once.
    ///
    /// # Errors
    /// A model that cannot be built; never for the shapes used here.
    pub fn prepared(self, size: KernelSize) -> Result<Work, BenchError> {
        let KernelSize { side, components, .. } = size;
        Ok(match self {
            Self::CandidateSearch => {
                let (points, grid) = (wave(side), MeanGrid::new(&means(components))?);
                let mut memory = CandidateSearch::default();
                let mut ids = Vec::new();
                Box::new(move || {
                    for tile in 0..points.n_tiles() {
                        let range = points.tile(tile);
                        let [x, y, z] = [&points.x, &points.y, &points.z];
                        let tile = [&x[range.clone()], &y[range.clone()], &z[range]];
                        ids.clear();
                        let n = NonZero::<usize>::MIN.saturating_add(3);
                        nearest_in_tile(Isa::best(), &grid, &mut memory, tile, n, &mut ids);
                        black_box(&ids);
                    }
                    Ok(())
                })
            }
            Self::IndexRebuild => {
                let (means, mut grid) = (means(components), MeanGrid::default());
                Box::new(move || Ok(grid.rebuild(&means)?))
            }
            Self::PaperFrame => paper_frames(size, ReassignPolicy::Off)?,
            Self::PaperReassigned => paper_frames(size, ReassignPolicy::Padded)?,
            Self::PaperTotals => {
                let mut rng = Rng::new(1, Purpose::Synthetic, 0);
                let mut statistics = Statistics::new(components, UpdateWidth::Fixed64);
                let mut shards = vec![Vec::new(); statistics.shards()];
                for tile in 0..components as u32 {
                    let mut sums = [0.0f32; N_SUMS];
                    sums.fill_with(|| rng.normal() as f32);
                    let id = rng.below(components) as u32;
                    shards[id as usize >> statistics.shard_bits()].push(TileRecord {
                        id,
                        tile,
                        sums,
                    });
                }
                Box::new(move || {
                    statistics.add_frame(|shard, add| add(&shards[shard]));
                    Ok(())
                })
            }
            Self::Destinations => {
                let mut rng = Rng::new(2, Purpose::Synthetic, 0);
                let q: Vec<f64> = (0..side * side).map(|_| 1e-4 * rng.normal().powi(2)).collect();
                let quota = Quota { moves: side, low_elbo: 8 * side };
                let (stream, mut chooser) =
                    (Rng::new(0, Purpose::Reassign, 1), DestinationChooser::default());
                // One choice takes a tenth of the instructions of a start, which the counter subtracts.
                Box::new(move || {
                    for _ in 0..CHOICES {
                        black_box(chooser.choose_destinations(&q, quota, &stream).len());
                    }
                    Ok(())
                })
            }
            Self::PreparedFrame => {
                let room = room(size)?;
                let (_, run, _) = training::prepare(&room, usize::MAX, 0)?;
                let frame = room.load(0, 0)?;
                let (mut preparer, mut out) = (Preparer::new(), Observation::empty());
                Box::new(move || {
                    preparer.prepare(&frame, &run.prepared_surface(), &mut out)?;
                    Ok(())
                })
            }
            Self::ScenePoints => scene_frames(size, false)?,
            Self::ScenePhotographs => scene_frames(size, true)?,
            Self::DrawnView => {
                let splats = BenchScene::synthetic().splats(components, 0).into_owned();
                let intrinsics = Intrinsics::from_horizontal_fov(2 * side as u32, side as u32, 1.0);
                let eye = DVec3::new(1.5, -1.5, 1.0);
                let pose = Pose::look_at(eye, DVec3::ZERO, DVec3::Z).unwrap_or(Pose::IDENTITY);
                let options = RenderOptions::evaluation(RenderMethod::PROJECTED, [0.0; 3]);
                let mut renderer = CpuRenderer::new();
                Box::new(move || {
                    if let Some(splats) = SplatView::new(&splats, &[]) {
                        black_box(renderer.render(splats, &Camera { intrinsics, pose }, &options));
                    }
                    Ok(())
                })
            }
        })
    }
}

/// Points of a wavy surface in `[-1, 1]`, tile by tile.
fn wave(side: usize) -> Points<f32> {
    let mut points = Points::new();
    for tile in 0..(side / 8).pow(2) {
        for k in 0..64 {
            let place = |n: usize| (n as f32 + 0.5) * 2.0 / side as f32 - 1.0;
            let (x, y) =
                (place(tile % (side / 8) * 8 + k % 8), place(tile / (side / 8) * 8 + k / 8));
            points.push([x, y, 0.5 * (2.0 * x).sin() * (1.5 * y).cos(), x, y, x - y]);
        }
        points.close_tile();
    }
    points
}

fn means(components: usize) -> Vec<[f32; 3]> {
    let draw = InitialDraw::random(components, 0);
    draw.means.iter().map(|mean| [mean[0], mean[1], mean[2]].map(|x| x as f32)).collect()
}

/// Function that runs a kernel once.
pub type Work = Box<dyn FnMut() -> Result<(), BenchError>>;

fn paper_frames(
    KernelSize { side, components, .. }: KernelSize,
    reassign: ReassignPolicy,
) -> Result<Work, BenchError> {
    let overrides = PaperOverrides {
        reassign: Some(reassign),
        components: Some(components),
        ..PaperOverrides::default()
    };
    let config = PaperConfig::paper().with(&overrides)?;
    let draw = InitialDraw::random(components, 0);
    let (points, mut engine) =
        (wave(side), learner::begin(&config, &draw, Normalization::IDENTITY)?);
    Ok(Box::new(move || {
        black_box(engine.learn(&points)?);
        Ok(())
    }))
}

fn room(KernelSize { side, frames, .. }: KernelSize) -> Result<Arc<Dataset>, BenchError> {
    let (width, height) = (side as u32, side as u32 * 3 / 4);
    let small =
        SyntheticParams { width, height, n_train: frames, n_eval: 1, ..SyntheticParams::demo() };
    Ok(Arc::new(synthetic::dataset(&small)?))
}

/// Trains a new scene on some frames of the room, with pixels that disagree with the scene before.
fn scene_frames(size: KernelSize, photographs: bool) -> Result<Work, BenchError> {
    let room = room(size)?;
    let (plan, mut run, _) = training::prepare(&room, usize::MAX, 0)?;
    run.engine.photometric = PhotometricMode::Light.rule().filter(|_| photographs);
    if let Some(rule) = &mut run.engine.photometric {
        // Each photograph is learned at once.
        rule.shuffle_buffer = 0;
    }
    let surface = run.prepared_surface();
    let mut observations = Vec::new();
    for &index in &plan.frames {
        let mut out = Observation::empty();
        Preparer::new().prepare(&room.load(plan.split, index)?, &surface, &mut out)?;
        observations.push(out);
    }
    Ok(Box::new(move || {
        let mut engine = SceneTrainer::new(&run.engine, surface.origin);
        for frame in &observations {
            black_box(engine.train(frame));
        }
        black_box(engine.splats().len());
        Ok(())
    }))
}

/// Counter of instructions: the command that runs a kernel in this program.
struct Counter {
    program: PathBuf,
}

impl Counter {
    /// Returns the instructions of one run of a kernel.
    fn count(&self, kernel: Kernel) -> Result<u64, BenchError> {
        // Two programs at once: each has one thread.
        let (once, twice) =
            rayon::join(|| self.instructions(kernel, 1), || self.instructions(kernel, 2));
        Ok(twice?.saturating_sub(once?))
    }

    fn instructions(&self, kernel: Kernel, times: usize) -> Result<u64, BenchError> {
        let name: &str = kernel.into();
        let mut command = Command::new(VALGRIND);
        command.args(["--tool=cachegrind", "--cache-sim=no", "--cachegrind-out-file=/dev/null"]);
        // One thread: with more, the waiting of idle ones is counted too.
        command.arg(&self.program).args(["bench", "history", "--threads", "1", "--kernel", name]);
        let output = command.arg("--times").arg(times.to_string()).output();
        let output = output.map_err(|error| BenchError::Counter(error.to_string()))?;
        let text = String::from_utf8_lossy(&output.stderr);
        // A program that was ended early has a count, too.
        counted(&text).filter(|_| output.status.success()).ok_or_else(|| {
            let last = text.lines().last().unwrap_or_default();
            BenchError::Counter(format!("{name}: {}: {last}", output.status))
        })
    }
}

const VALGRIND: &str = "valgrind";

/// Returns name and version of valgrind, as it prints them; nothing if it cannot be run.
fn valgrind_version() -> String {
    let output = Command::new(VALGRIND).arg("--version").output();
    output.map_or_else(
        |_| String::new(),
        |output| String::from_utf8_lossy(&output.stdout).trim().to_owned(),
    )
}

/// Returns the number in cachegrind's line `I refs: 1,234`, which versions space differently.
fn counted(text: &str) -> Option<u64> {
    let line = text.lines().rfind(|line| line.contains("refs:"))?;
    let (_, number) = line.rsplit_once(':')?;
    number.trim().replace(',', "").parse().ok()
}

#[derive(Clone, Debug)]
pub struct HistoryPlan {
    /// Folder with the recordings.
    pub data: PathBuf,
    /// File of the lines, which is created if there is none.
    pub file: PathBuf,
    pub commit: String,
    /// Compiler of the program.
    pub compiler: String,
}

/// New line of the history, and what the gate holds against it.
pub struct History {
    pub line: String,
    /// Reason why instructions are not counted, if they are not.
    pub uncounted: Option<String>,
    /// Measures that are worse than in the line before by more than the gate accepts.
    pub worse: Vec<String>,
}

/// Measures the program, compares with the last lines of the file, and appends the new line unless a measure is worse.
/// Instruction counts are compared with the last line of the same instruction set, compiler and version of valgrind.
pub fn run(plan: &HistoryPlan, progress: Progress) -> Result<History, BenchError> {
    let lines = read(&plan.file)?;
    let mut step = steps(progress, Kernel::iter().count() + RECORDINGS.len());
    let program = std::env::current_exe().map_err(file_error(Path::new("running executable")))?;
    let size = std::fs::metadata(&program).map_err(file_error(&program))?.len();
    let counter = Counter { program };
    let (mut counts, mut uncounted) = (Vec::new(), None);
    for kernel in Kernel::iter() {
        let count = match &uncounted {
            None => counter.count(kernel).map_err(|error| uncounted = Some(error.to_string())).ok(),
            Some(_) => None,
        };
        counts.push(count.map_or_else(String::new, |count| count.to_string()));
        step();
    }
    let machine = describe(None);
    let cpu = format!("{}, {} threads", machine.cpu, machine.threads);
    let toolchain = format!("{}, {}", plan.compiler, valgrind_version());
    let mut cells = vec![plan.commit.clone(), cpu, machine.simd, toolchain, size.to_string()];
    cells.extend(counts);
    for name in RECORDINGS {
        let Measured { ms, psnr } = Measured::of(&plan.data.join(name))?;
        cells.extend([format!("{ms:.2}"), format!("{psnr:.4}")]);
        step();
    }
    let worse = worse(&lines, &cells);
    let line = csv_line(&cells)?;
    if worse.is_empty() {
        let mut text = csv_line(&columns())?;
        for line in &lines {
            text += &csv_line(line)?;
        }
        text += &line;
        write_atomic(&plan.file, |out| out.write_all(text.as_bytes()))?;
    }
    Ok(History { line, uncounted, worse })
}

/// Columns of instruction set and toolchain, on which instruction counts depend.
const TARGET: Range<usize> = 2..4;
/// Column of the first kernel.
const KERNELS: usize = TARGET.end + 1;

fn columns() -> Vec<String> {
    let mut names =
        ["commit", "machine", "simd", "toolchain", "binary_bytes"].map(str::to_owned).to_vec();
    names.extend(Kernel::iter().map(|kernel| <&str>::from(kernel).to_owned()));
    names.extend(RECORDINGS.iter().flat_map(|name| [format!("{name}_ms"), format!("{name}_db")]));
    names
}

/// Returns the lines of a file below its header; none if there is no file.
fn read(file: &Path) -> Result<Vec<Vec<String>>, BenchError> {
    let text = match std::fs::read(file) {
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(Vec::new()),
        text => text.map_err(file_error(file))?,
    };
    let mut reader = csv::Reader::from_reader(&text[..]);
    let found: Vec<String> = reader.headers()?.iter().map(str::to_owned).collect();
    if found != columns() {
        let (file, found) = (file.to_owned(), found.join(","));
        return Err(BenchError::Columns { file, expected: columns().join(","), found });
    }
    let cells = |row: csv::StringRecord| row.iter().map(str::to_owned).collect();
    Ok(reader.records().map(|row| row.map(cells)).collect::<Result<_, _>>()?)
}

fn csv_line(cells: &[String]) -> Result<String, BenchError> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    writer.write_record(cells)?;
    let bytes = writer.into_inner().map_err(|error| csv::Error::from(error.into_error()))?;
    Ok(String::from_utf8_lossy(&bytes).into_owned())
}

/// Returns what is worse in `now` than in earlier lines by more than the gate accepts. Cells without a number are left
/// out.
fn worse(earlier: &[Vec<String>], now: &[String]) -> Vec<String> {
    let quality = KERNELS + Kernel::iter().count();
    let alike = earlier.iter().rfind(|line| line.get(TARGET) == now.get(TARGET));
    let of = |name: String, at: usize| {
        let is_kernel = (KERNELS..quality).contains(&at);
        // Pictures depend on neither machine nor compiler, counts on both.
        let before = if is_kernel { alike? } else { earlier.last()? };
        let (before, now) = (before.get(at)?, now.get(at)?);
        let [was, is]: [f64; 2] = [before.parse().ok()?, now.parse().ok()?];
        let is_worse = match is_kernel {
            true => is > was * (1.0 + MOST_GROWTH),
            false => name.ends_with("_db") && is < was - MOST_LOSS,
        };
        is_worse.then(|| format!("{name}: {before} before, {now} now"))
    };
    let names = columns().into_iter().zip(0..).skip(KERNELS);
    names.filter_map(|(name, at)| of(name, at)).collect()
}

/// Median time of a frame, prepared and trained, and mean PSNR of held-out views.
struct Measured {
    ms: f64,
    psnr: f64,
}

impl Measured {
    fn of(path: &Path) -> Result<Self, BenchError> {
        let dataset = Arc::new(dataset::open(path, &LoadOptions::default())?);
        let (plan, run, options) = training::prepare(&dataset, usize::MAX, 0)?;
        let trained = training::train(&dataset, &plan, &[run], &mut || ())?;
        let Some(trained) = trained.into_iter().next() else {
            let first = "no frame is trained".to_owned();
            return Err(BenchError::NoFrame { dataset: dataset.name.clone(), first });
        };
        let (split, views) = held_out_views(&dataset, plan.split, VIEWS);
        let (report, _) = evaluate(&trained.splats, &dataset, split, &views, &options, |_| ())?;
        let frames = trained.prepare_ms.iter().zip(&trained.train_ms).map(|(a, b)| a + b);
        Ok(Self { ms: Spread::of(frames.collect()).median, psnr: report.means.psnr_mean })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn line(change: impl Fn(&str) -> Option<&'static str>) -> Vec<String> {
        let cell = |name: String| match name.ends_with("_db") {
            true => change(&name).unwrap_or("24.0000").to_owned(),
            false => change(&name).unwrap_or("1000").to_owned(),
        };
        columns().into_iter().map(cell).collect()
    }

    #[test]
    fn the_gate_holds_counts_and_quality_and_no_times() {
        let before = [line(|_| None)];
        let worst = |name: &'static str, value: &'static str| {
            worse(&before, &line(|column| (column == name).then_some(value)))
        };
        assert!(worst("scene_points", "1030").is_empty());
        assert_eq!(worst("scene_points", "1031"), ["scene_points: 1000 before, 1031 now"]);
        assert!(worst("scene_points", "").is_empty(), "not counted");
        assert!(worst("lego400_db", "23.9501").is_empty());
        assert_eq!(worst("lego400_db", "23.9").len(), 1);
        assert!(worst("lego400_ms", "9000").is_empty() && worst("binary_bytes", "9000").is_empty());
    }

    #[test]
    fn counts_are_held_against_the_last_line_of_the_same_toolchain() {
        let other = |column: &str| match column {
            "toolchain" => Some("another"),
            "scene_points" => Some("500"),
            "lego400_db" => Some("23"),
            _ => None,
        };
        let (before, now) = ([line(|_| None), line(other)], line(|_| None));
        assert!(worse(&before, &now).is_empty(), "other counts are not compared");
        let slow = line(|column| (column == "scene_points").then_some("1100"));
        assert_eq!(worse(&before, &slow), ["scene_points: 1000 before, 1100 now"]);
        let dull = line(|column| (column == "lego400_db").then_some("22.5"));
        assert_eq!(worse(&before, &dull), ["lego400_db: 23 before, 22.5 now"]);
        assert!(worse(&before[1..], &slow).is_empty() && worse(&[], &slow).is_empty());
    }

    #[test]
    fn lines_are_read_as_written_and_other_columns_are_refused() {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("history.csv");
        assert!(read(&file).expect("no file").is_empty());
        let written = line(|name| (name == "machine").then_some("a, \"b\""));
        let text = csv_line(&columns()).expect("a header") + &csv_line(&written).expect("a line");
        std::fs::write(&file, text).expect("written");
        assert_eq!(read(&file).expect("lines"), [written]);
        std::fs::write(&file, "commit,kernel\na,1\n").expect("written");
        let error = read(&file).expect_err("other columns").to_string();
        assert!(error.contains("history.csv: expected the columns commit,"), "{error}");
    }

    #[test]
    fn counts_are_read_from_every_version_of_cachegrind() {
        assert_eq!(counted("==7== \n==7== I   refs:      1,234,567\n"), Some(1_234_567));
        assert_eq!(counted("==7== I refs:        42\n"), Some(42));
        assert_eq!(counted("valgrind: failed to start tool\n"), None);
    }

    #[test]
    fn every_kernel_runs() {
        for kernel in Kernel::iter() {
            kernel.run(2).unwrap_or_else(|error| panic!("{kernel:?}: {error}"));
        }
    }
}
