//! Training, saving and loading leave nothing behind, however many frames there were: of every allocation
//! of the process it is known whether it was given back.

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

/// How long threads that were told to end may take.
const PATIENCE: Duration = Duration::from_secs(20);

/// Trains so many frames, saves, reads what was saved and goes on with it.
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

/// How often a run that left something is run again.
const ROUNDS: usize = 4;

/// Blocks that a run leaves, once its threads are gone.
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

/// The fewest blocks that a run leaves: a leak is left by each of them, what a thread of the pool makes once
/// in its life only by the run in which that thread is first given such work.
fn left_by(run: impl Fn()) -> isize {
    let mut least = left_by_one(&run);
    for _ in 1..ROUNDS {
        if least > 0 {
            least = least.min(left_by_one(&run));
        }
    }
    least
}

/// Both presets, with frames that are prepared by a thread of their own and by the trainer's threads.
///
/// # Panics
/// Where anything is left.
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
            // What is made once in the life of a process, or of a thread of the pool.
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
