//! Runs that stop, resume and are merged equal uninterrupted runs, bit for bit.

mod autosave;
mod fusion;
mod merge;
mod refusals;
mod resume;
mod scenes;

use std::path::Path;
use std::sync::Arc;
use tempfile::TempDir;
use vbgs_studio::dataset::Dataset;
use vbgs_studio::dataset::synthetic::{SyntheticParams, dataset};
use vbgs_studio::export::checkpoint::{Checkpoint, write};
use vbgs_studio::export::{self, ModelFormat, WriteOptions};
use vbgs_studio::pipeline::checkpoint::{ResumeRequest, SavedRun};
use vbgs_studio::pipeline::plan::Selection;
use vbgs_studio::pipeline::session::{Session, Step};
use vbgs_studio::pipeline::settings::method::{Method, MethodRequest as AskedMethod};
use vbgs_studio::train::paper::config::{PaperConfig, PaperOverrides, Precision, ReassignPolicy};

const FRAMES: usize = 40;

pub fn room_of(n_train: usize, seed: u64) -> Arc<Dataset> {
    let params = SyntheticParams {
        width: 64,
        height: 48,
        n_train,
        n_eval: 1,
        seed,
        depth_noise: 0.0,
        ..SyntheticParams::demo()
    };
    Arc::new(dataset(&params).unwrap())
}

fn room() -> Arc<Dataset> {
    room_of(FRAMES, 4)
}

fn config(reassign: ReassignPolicy, precision: Precision) -> PaperConfig {
    let overrides = PaperOverrides {
        components: Some(3000),
        reassign: Some(reassign),
        precision: Some(precision),
        ..PaperOverrides::default()
    };
    PaperConfig::paper().with(&overrides).unwrap()
}

fn off() -> PaperConfig {
    config(ReassignPolicy::Off, Precision::Mixed)
}

fn first(n_frames: usize) -> Selection {
    Selection { max_frames: Some(n_frames), ..Selection::all_frames() }
}

fn shard(text: &str) -> Selection {
    Selection { shard: Some(text.parse().unwrap()), ..Selection::all_frames() }
}

fn up_to(max_frames: usize) -> ResumeRequest {
    ResumeRequest { max_frames: Some(max_frames), ..ResumeRequest::default() }
}

fn finished(mut session: Session) -> Session {
    while !matches!(session.step().unwrap(), Step::Finished) {}
    session
}

fn trained(asked: &(impl Into<AskedMethod> + Clone), selection: Selection) -> Session {
    finished(Session::new(room(), asked.clone(), selection).unwrap())
}

fn paper(run: &SavedRun) -> &PaperConfig {
    let Method::Paper(train) = &run.config.method else { unreachable!() };
    train
}

fn saved(session: &Session) -> SavedRun {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("checkpoint.vbgs");
    write(&path, &session.checkpoint().unwrap()).unwrap();
    SavedRun::read(&path).unwrap()
}

fn reread(run: &SavedRun) -> SavedRun {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("checkpoint.vbgs");
    write(&path, &run.content).unwrap();
    SavedRun::read(&path).unwrap()
}

/// Removes the sections with times; the rest must be equal.
fn timeless(checkpoint: Checkpoint) -> Checkpoint {
    Checkpoint { meta: String::new(), history: None, ..checkpoint }
}

fn ply(session: &Session) -> Vec<u8> {
    let folder: TempDir = tempfile::tempdir().unwrap();
    let path: &Path = &folder.path().join("scene.ply");
    let options = WriteOptions { up: session.up(), ..WriteOptions::new(ModelFormat::Ply) };
    export::write(path, &session.splats(), &options).unwrap();
    std::fs::read(path).unwrap()
}

fn with_threads<T: Send>(n_threads: usize, work: impl FnOnce() -> T + Send) -> T {
    rayon::ThreadPoolBuilder::new().num_threads(n_threads).build().unwrap().install(work)
}
