//! Training, saving and loading leak no memory, for any number of frames: the test counts every allocation of
//! the process.

use crate::common::live::blocks;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};
use vbgs_studio::dataset::Dataset;
use vbgs_studio::export::checkpoint::write;
use vbgs_studio::pipeline::checkpoint::{ResumeRequest, SavedRun};
use vbgs_studio::pipeline::plan::Selection;
use vbgs_studio::pipeline::session::{Session, Step};
use vbgs_studio::pipeline::settings::method::MethodRequest;
use vbgs_studio::pipeline::settings::scene::SceneOverrides;
use vbgs_studio::train::paper::config::{PaperConfig, PaperOverrides};

/// Longest wait for threads to exit.
const PATIENCE: Duration = Duration::from_secs(20);

/// Trains `n_frames`, saves, reads the checkpoint, and resumes for one frame.
fn once(dataset: &Arc<Dataset>, asked: &MethodRequest, n_frames: usize, file: &Path) {
    let selection = Selection { max_frames: Some(n_frames), ..Selection::all_frames() };
    let mut session = Session::new(Arc::clone(dataset), asked.clone(), selection).unwrap();
    while !matches!(session.step().unwrap(), Step::Finished) {}
    write(file, &session.checkpoint().unwrap()).unwrap();
    let saved = SavedRun::read(file).unwrap();
    let more = ResumeRequest { max_frames: Some(n_frames + 1), ..ResumeRequest::default() };
    let mut resumed = saved.resume(Arc::clone(dataset), &more, false).unwrap();
    resumed.step().unwrap();
}

/// Maximum number of runs to find one without leftover blocks.
const ROUNDS: usize = 4;

/// Number of blocks left after a run, once its threads have exited.
fn left_by_one(run: impl Fn()) -> isize {
    let before = blocks();
    run();
    let started = Instant::now();
    loop {
        let left = blocks() - before;
        if left <= 0 || started.elapsed() > PATIENCE {
            return left;
        }
        std::thread::sleep(Duration::from_millis(20));
    }
}

/// Smallest number of blocks left by several runs. A leak occurs in every run; a pool thread's one-time
/// allocation remains only after the run in which the thread first gets such work.
fn left_by(run: impl Fn()) -> isize {
    let mut least = left_by_one(&run);
    for _ in 1..ROUNDS {
        if least > 0 {
            least = least.min(left_by_one(&run));
        }
    }
    least
}

/// Checks both presets on one and on four threads, with frames prepared by a separate thread or by the
/// trainer's threads.
///
/// # Panics
/// Panics if any block is left.
pub fn nothing_is_left(dataset: Dataset) {
    let (dataset, folder) = (Arc::new(dataset), tempfile::tempdir().unwrap());
    let file = folder.path().join("checkpoint.vbgs");
    let paper = PaperOverrides { components: Some(500), ..PaperOverrides::default() };
    let paper = PaperConfig::paper().with(&paper).unwrap();
    let all = dataset.splits[0].frames.len() - 1;
    for asked in [MethodRequest::from(SceneOverrides::default()), MethodRequest::from(paper)] {
        for n_threads in [1, 4] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(n_threads).build().unwrap();
            let run = |n_frames| pool.install(|| once(&dataset, &asked, n_frames, &file));
            // Warm-up: makes the one-time allocations of the process and of the pool's threads.
            run(all);
            let [few, many] = [all / 8, all].map(|n_frames| left_by(|| run(n_frames)));
            eprintln!(
                "{n_threads} threads: {few} blocks left by {} frames, {many} by {all}",
                all / 8
            );
            assert!(
                few <= 0 && many <= 0,
                "{asked:?}, {n_threads} threads: {few} and {many} blocks"
            );
        }
    }
}
