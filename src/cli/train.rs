//! `train`: trains headless and writes files at the end. Machines without a display train the demo.
//!
//! Files of an earlier run remain until this run has trained a frame. Each then remains until its
//! replacement is complete. The report is written before quality is measured, because measuring may take
//! longer than training and may be interrupted. It is written again with the results.

use super::args::settings::{calibration_file, method_request, resume_request, selection};
use super::args::{DeviceName, TrainArgs};
use super::export::warn_of_origin;
use super::failure::Failure;
use super::interrupt::Interrupt;
use super::quality::{RunQuality, is_measured, measure_run, photo_pixels};
use super::{failure, output, tracked};
use indicatif::ProgressBar;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};
use vbgs_studio::dataset;
use vbgs_studio::dataset::growing::END_MARKER;
use vbgs_studio::dataset::pose_check::{ENOUGH_FRAMES, PoseCheck};
use vbgs_studio::dataset::wild_poses::outlier_poses;
use vbgs_studio::dataset::{Dataset, LoadOptions};
use vbgs_studio::eval::choices::SEEN_AFTER;
use vbgs_studio::eval::report::{Report, with_evaluation};
use vbgs_studio::export::atomic::remove_leftovers;
use vbgs_studio::export::registration::shift_and_origin;
use vbgs_studio::export::video::write_png;
use vbgs_studio::export::{ModelFormat, WriteOptions, write};
use vbgs_studio::model::splat::appearance::SplatSet;
use vbgs_studio::pipeline::any_preset::file_comments;
use vbgs_studio::pipeline::autosave;
use vbgs_studio::pipeline::autosave::{Autosave, AutosaveInterval};
use vbgs_studio::pipeline::checkpoint::{ResumeRequest, RunError, SavedRun};
use vbgs_studio::pipeline::error::SessionError;
use vbgs_studio::pipeline::follow::Follow;
use vbgs_studio::pipeline::memory;
use vbgs_studio::pipeline::plan::Selection;
use vbgs_studio::pipeline::session::{Session, Step, demo_session};
use vbgs_studio::pipeline::settings::method::MethodRequest;
use vbgs_studio::pipeline::settings::scene::SceneOverrides;
use vbgs_studio::pipeline::tracked::Trajectory;
use vbgs_studio::render::cpu::CpuRenderer;
use vbgs_studio::render::{RenderMethod, RenderOptions};
use vbgs_studio::train::learner::DeviceUse;

/// Trains and writes the output files, also after an interrupt.
pub fn run(args: &Arc<TrainArgs>) -> Result<(), Failure> {
    let start = start(args)?;
    let interrupt = Interrupt::listen()?;
    let session = create_session(args, start, &interrupt);
    let mut session =
        session.map_err(|failure| failure.with_calibration_file(calibration_file(args)))?;
    attach(&mut session, args)?;
    prepare_folder(args)?;
    print_notes(&session, args)?;
    // Measured after the run, whose timings must not be affected.
    let mut early: Vec<(usize, SplatSet)> = Vec::new();
    let mut autosave = Autosave::new(args.out.join(CHECKPOINT), interval(args), &session);
    let train = |session: &mut Session| {
        train(session, &interrupt, |session, bar| {
            // Fewer frames do not allow a reliable check.
            if args.follow && trained_frames(session) == ENOUGH_FRAMES {
                let dataset = session.dataset().clone();
                // In parallel with training, because frames keep arriving.
                rayon::spawn(move || warn_about_poses(&dataset));
            }
            if is_measured(session, args) && SEEN_AFTER.contains(&trained_frames(session)) {
                // As they would be exported if the run ended here.
                session.settle();
                early.push((session.visited(), session.splats()));
            }
            // A failed autosave is reported but does not stop the run.
            if let Some(Err(error)) = autosave.poll(session) {
                output::warn(bar, &error.to_string());
            }
        })
    };
    let end = failure::save_on_panic(&mut session, &args.out, train)?;
    autosave.wait().and_then(Result::err).iter().for_each(|error| note!("warning: {error}"));
    match &end {
        // Files of an earlier run are worth more than a report of an empty run.
        Ok(false) if trained_frames(&session) == 0 => return Err(Failure::Interrupted),
        Err(_) if trained_frames(&session) == 0 => return end.map(drop),
        _ => {}
    }
    let warnings = session.learner().status().warnings;
    warnings.iter().for_each(|found| note!("warning: {found}"));
    let mut unsaved = Vec::new();
    // Saved first, so that the model is safe whatever happens next.
    let files = save_model(&mut session, args, &mut unsaved);
    let measured = match &end {
        Ok(true) if is_measured(&session, args) => {
            // An error is reported when the report is written again, below.
            let report = session.report(None, Vec::new());
            let _ = output::write_json(&args.out.join(REPORT), &report);
            measure_run(&session, &early, args)
        }
        _ => Ok(RunQuality::default()),
    };
    let (measured, failure) = match measured {
        Ok(measured) => (measured, None),
        Err(failure) => (RunQuality::default(), Some(failure)),
    };
    if let Err(failure) = save_report(&session, args, &files, measured) {
        unsaved.push(failure);
    }
    if let Some(failure) = Failure::joined(unsaved) {
        return Err(failure);
    }
    // An interrupt during the evaluation counts too.
    let finished = end? && !interrupt.is_requested();
    match failure {
        Some(failure) => Err(failure),
        None if finished => Ok(()),
        None => Err(Failure::Interrupted),
    }
}

/// Creates the output folder, removes temporary files of killed runs and checks that the output files
/// can be replaced.
fn prepare_folder(args: &TrainArgs) -> Result<(), Failure> {
    output::create_folder(&args.out)?;
    let files = [SCENE, CHECKPOINT, REPORT].map(|name| args.out.join(name));
    files.iter().for_each(|file| remove_leftovers(file));
    let previous = args.out.join(format!("{CHECKPOINT}.bak"));
    let files: Vec<PathBuf> = files.into_iter().chain([previous]).collect();
    output::check_files(&files)?;
    output::check_no_links(&files)
}

fn interval(args: &TrainArgs) -> AutosaveInterval {
    let time = Some(Duration::from_secs(autosave::DEFAULT_S.into()));
    args.settings.run.autosave.unwrap_or(AutosaveInterval { frames: None, time })
}

/// Opens the dataset and creates a session that has not trained a frame yet. Opening is interruptible,
/// because a drive may block it.
fn create_session(
    args: &Arc<TrainArgs>,
    start: Start,
    interrupt: &Interrupt,
) -> Result<Session, Failure> {
    if args.follow {
        let session = follow_session(args, start, interrupt)?;
        print_dataset_notes(session.dataset());
        let has_no_split = |name: &&String| session.dataset().split_named(name).is_err();
        if let Some(split) = args.eval.as_ref().filter(has_no_split) {
            note!("note: the split {split} does not exist yet; it is measured after training");
        }
        return Ok(session);
    }
    let args = args.clone();
    interrupt.run_interruptibly(move || open_session(&args, start))?
}

fn open_session(args: &TrainArgs, start: Start) -> Result<Session, Failure> {
    let dataset = Arc::new(dataset::open(&args.dataset, &start.load_options(args))?);
    // A misspelt split must not cost the training.
    if let Some(split) = &args.eval {
        dataset.split_named(split)?;
    }
    print_dataset_notes(&dataset);
    warn_about_poses(&dataset);
    Ok(start.session(dataset, selection(args), args)?)
}

/// Creates a session on the first complete frames of a recording in progress. Waits for these frames as
/// long as needed.
fn follow_session(
    args: &Arc<TrainArgs>,
    start: Start,
    interrupt: &Interrupt,
) -> Result<Session, Failure> {
    let selection = match &start {
        Start::New(_) => selection(args),
        Start::Saved(run, _) => run.config.selection.clone(),
    };
    // Owned, because opening runs on another thread.
    let (path, load) = (args.dataset.clone(), start.load_options(args));
    let follow = move || Follow::new(&path, &load, &selection);
    let mut follow = interrupt.run_interruptibly(follow)??;
    let path = args.dataset.display();
    note!("note: following {path}, until {END_MARKER} is in it or Ctrl-C");
    let mut reported = ReportedProblem::default();
    while !interrupt.is_requested() {
        if let Some(dataset) = follow.poll_dataset()? {
            let (start, args) = (start.clone(), args.clone());
            let selection = follow.selection().clone();
            let session = move || start.session(dataset, selection, &args);
            // Reading the first frames may block on the drive.
            match interrupt.run_interruptibly(session)? {
                Ok(mut session) => {
                    session.follow(Some(follow));
                    return Ok(session);
                }
                Err(RunError::Session(error)) if follow.may_succeed_later(&error) => {}
                Err(error) => return Err(error.into()),
            }
        }
        reported.wait_for_frames(&follow, interrupt);
    }
    Err(Failure::Interrupted)
}

fn start(args: &TrainArgs) -> Result<Start, Failure> {
    let Some(path) = &args.resume else { return Ok(Start::New(Box::new(method_request(args)?))) };
    let run = SavedRun::read(path)?;
    let preset = args.preset.unwrap_or(run.config.method.preset());
    let asked = resume_request(args, preset)?;
    // Checked before the dataset is opened, which may take long.
    check(&run, &asked)?;
    Ok(Start::Saved(Box::new(run), Box::new(asked)))
}

fn print_notes(session: &Session, args: &TrainArgs) -> Result<(), Failure> {
    if let Some(why) = &session.plan().held_out {
        note!("note: held out for evaluation: {why}");
    }
    if session.config().method.assumes_calibration(session.dataset()) {
        note!("note: {KNOWN_CALIBRATION}");
    }
    let split = &session.dataset().splits[session.plan().split];
    let color_camera = session.config().method.as_any().color_camera();
    if let Some(Ok(Some(scaled))) = color_camera.map(|camera| split.camera_scaling(&camera)) {
        note!("note: {scaled}");
    }
    let preset = session.config().method.as_any();
    let limit = preset.component_limit();
    // Evaluation draws whole photographs, which may need more memory than training.
    let memory = match is_measured(session, args) {
        true => with_evaluation(session.memory(), photo_pixels(session, args), limit.components()),
        false => session.memory(),
    };
    let megabytes = |bytes: u64| bytes.div_ceil(1_000_000);
    note!(
        "note: needs up to {} MB of memory for the model at its maximum number of components, and {} MB for frames and textures",
        megabytes(memory.model),
        megabytes(memory.frames.saturating_add(memory.textures))
    );
    memory::note(limit).iter().for_each(|note| note!("note: {note}"));
    memory::check(memory, limit).map_err(|error| Failure::from(SessionError::from(error)))
}

const KNOWN_CALIBRATION: &str = "no calibration is given: the published calibration of the Kinect's colour camera is used (see report.json); --calibration FILE.ron selects another, `vbgs-studio calibrate DATASET` checks it";

/// Returns the number of frames trained on, including those before a resumed checkpoint.
fn trained_frames(session: &Session) -> usize {
    session.learner().status().frames as usize
}

#[derive(Clone)]
enum Start {
    New(Box<MethodRequest>),
    Saved(Box<SavedRun>, Box<ResumeRequest>),
}

impl Start {
    fn load_options(&self, args: &TrainArgs) -> LoadOptions {
        match self {
            Self::New(request) => LoadOptions {
                calibrated_photographs: request.has_color_camera(),
                ..args.reading.load_options()
            },
            Self::Saved(run, _) => run.load_options(),
        }
    }

    fn session(
        self,
        dataset: Arc<Dataset>,
        selection: Selection,
        args: &TrainArgs,
    ) -> Result<Session, RunError> {
        match self {
            Self::New(config) => Ok(Session::new(dataset, *config, selection)?),
            Self::Saved(run, asked) => run.resume(dataset, &asked, args.force),
        }
    }
}

/// Checks that a run can be resumed as requested. Prints warnings.
fn check(run: &SavedRun, asked: &ResumeRequest) -> Result<(), Failure> {
    run.check(asked)?;
    if let Some(warning) = run.numerics_differ() {
        note!("warning: {warning}");
    }
    let trained = run.content.cursor.visited.len();
    let most = asked.max_frames.or(run.config.selection.max_frames);
    if most.is_some_and(|most| most <= trained) {
        note!("note: {trained} frames are trained already; --max-frames N trains up to N in total");
    }
    Ok(())
}

/// Trains a session and calls `after` after each trained frame. Returns false if interrupted before the
/// last frame.
pub fn train(
    session: &mut Session,
    interrupt: &Interrupt,
    mut after: impl FnMut(&mut Session, &ProgressBar),
) -> Result<bool, Failure> {
    let bar = output::bar(session.plan().frames.len(), "frame");
    bar.set_position(session.visited() as u64);
    // Frames of a resumed run took no time in this process.
    bar.reset_eta();
    let mut reported = ReportedProblem::default();
    loop {
        if interrupt.is_requested() {
            // Remains visible and shows where training stopped.
            bar.abandon();
            return Ok(false);
        }
        // Returns regularly, so that an interrupt is handled even if the drive does not respond.
        let Some(step) = session.step_within(LOOK)? else { continue };
        session.take_outlier_warnings().iter().for_each(|doubt| output::warn(&bar, doubt));
        match step {
            Step::Trained(frame) => {
                // A followed recording grows.
                bar.set_length(session.plan().frames.len() as u64);
                bar.set_position(frame.index as u64 + 1);
                bar.set_message(format!(
                    "{:.1} ms/frame, {} of {} components used,",
                    frame.ms.stages.train, frame.used, frame.components
                ));
                after(session, &bar);
            }
            Step::Skipped(skipped) | Step::Lost(skipped) => output::warn(&bar, &skipped.message),
            Step::Waiting => {
                bar.set_message("waiting for the next frame,");
                if let Some(follow) = session.followed() {
                    reported.wait_for_frames(follow, interrupt);
                }
            }
            Step::Finished => break,
        }
    }
    bar.finish_and_clear();
    Ok(true)
}

/// Interval at which interrupts are checked while waiting for a frame.
const LOOK: Duration = Duration::from_millis(100);

/// Name of the trajectory file in the output folder, written only for tracked poses.
const TRAJECTORY: &str = "trajectory.txt";
const SCENE: &str = "scene.ply";
const CHECKPOINT: &str = "checkpoint.vbgs";
const REPORT: &str = "report.json";

/// Writes `checkpoint.vbgs` and `scene.ply`, each whatever happens to the other, and adds errors to
/// `unsaved`. Returns the names of the written files for a message. Writes nothing if no component is used.
fn save_model(session: &mut Session, args: &TrainArgs, unsaved: &mut Vec<Failure>) -> String {
    if session.learner().status().used == 0 {
        return String::new();
    }
    let mut written = Vec::new();
    let checkpoint = args.out.join(CHECKPOINT);
    let given = args.settings.run.autosave.unwrap_or_default();
    let saved = match given == AutosaveInterval::default() {
        true => session.save(&checkpoint),
        // As for autosaves, the previous checkpoint is retained.
        false => session.save_keeping_old(&checkpoint),
    };
    match saved {
        Ok(_) => written.push(CHECKPOINT),
        Err(error) => unsaved.push(save_elsewhere(session, error)),
    }
    match save_scene(session, args) {
        Ok(()) => written.insert(0, SCENE),
        Err(failure) => unsaved.push(failure),
    }
    match written.is_empty() {
        true => String::new(),
        false => format!("{} and ", written.join(", ")),
    }
}

/// Saves a checkpoint that its folder cannot hold to the user's state folder, else to the system's temporary
/// folder. Returns the error of its folder, with the place of the checkpoint.
fn save_elsewhere(session: &Session, error: RunError) -> Failure {
    let mut problems = vec![error.to_string()];
    for folder in spare_folders() {
        let path = folder.join(format!("unsaved-{}.vbgs", std::process::id()));
        let saved = std::fs::create_dir_all(&folder).map_err(|e| e.to_string());
        match saved.and_then(|()| session.save(&path).map_err(|e| e.to_string())) {
            Ok(_) => {
                let path = path.display();
                let place =
                    format!("the checkpoint is in {path}: continue with --resume, or export it");
                return failed!("{}; {place}", problems.join("; "));
            }
            Err(problem) => problems.push(problem),
        }
    }
    failed!("{}", problems.join("; "))
}

#[cfg(feature = "gui")]
fn spare_folders() -> Vec<PathBuf> {
    vbgs_studio::app::rescue::default_folders()
}

#[cfg(not(feature = "gui"))]
fn spare_folders() -> Vec<PathBuf> {
    vec![std::env::temp_dir()]
}

fn save_scene(session: &mut Session, args: &TrainArgs) -> Result<(), Failure> {
    session.settle();
    session.take_outlier_warnings().iter().for_each(|doubt| note!("warning: {doubt}"));
    let comments = file_comments(&session.config().method, session.learner().status().frames);
    let options = WriteOptions {
        comments: &comments,
        up: session.up(),
        local_origin: session.dataset().local_origin(),
        registration: session.registration(),
        ..WriteOptions::new(ModelFormat::Ply)
    };
    write(&args.out.join(SCENE), &session.splats(), &options)?;
    let [_, origin] = shift_and_origin(options.registration, options.local_origin);
    warn_of_origin(&args.out.join(SCENE), origin, ModelFormat::Ply.origin_carrier());
    Ok(())
}

fn save_report(
    session: &Session,
    args: &TrainArgs,
    models: &str,
    RunQuality { eval, seen }: RunQuality,
) -> Result<(), Failure> {
    let trajectory = Trajectory::of(session.frames(), session.skipped());
    let tracking = trajectory.as_ref().and_then(|found| found.error(session.dataset()));
    let report = Report { seen, tracking, ..session.report(None, eval) };
    output::write_json(&args.out.join(REPORT), &report)?;
    if let Some(found) = &trajectory {
        let text = found.tum(session.dataset(), session.plan().split);
        output::write_text(&args.out.join(TRAJECTORY), &text)?;
    }
    if args.json {
        return output::print_json(&report);
    }
    if let Some(found) = &trajectory {
        output::print_line(tracked::summary(found, report.tracking.as_ref()));
    }
    let summary = &report.summary;
    out!(
        "{} frames, {} skipped, in {:.1} s: median {:.1} ms a frame (95 % below {:.1} ms), {} of {} components used, {} drawn",
        report.frames.len(),
        report.skipped.len(),
        summary.wall_s,
        summary.train_ms_median,
        summary.train_ms_p95,
        summary.used,
        summary.components,
        summary.drawn
    );
    // The CPU is the normal case and needs no line.
    let fits = [&report.passes, &report.points].into_iter().flatten();
    for used in fits.filter(|used| used.device.is_some()) {
        output::print_line(used.summary_line());
    }
    if let Some(used) = &report.comparer {
        output::print_line(used.summary_line());
    }
    report.seen.iter().for_each(|s| output::print_line(output::format_early(s)));
    report.eval.iter().for_each(|e| output::print_line(output::quality(e)));
    out!("wrote {models}{REPORT} to {}", args.out.display());
    Ok(())
}

/// Warns about outlier poses and about poses that do not follow the layout's convention. Such poses
/// would waste hours of training.
fn warn_about_poses(dataset: &Dataset) {
    let split = dataset.training_split().ok();
    for wild in split.map_or_else(Vec::new, |split| outlier_poses(&dataset.splits[split])) {
        note!("warning: {wild}");
    }
    let check = split.and_then(|split| dataset::pose_check::check(dataset, split));
    for warning in check.iter().flat_map(PoseCheck::warnings) {
        note!("warning: {warning}");
    }
}

pub fn print_dataset_notes(dataset: &Dataset) {
    dataset.notes.iter().for_each(|note| note!("note: {note}"));
    dataset.warnings.iter().for_each(|warning| note!("warning: {warning}"));
    dataset.unused.iter().for_each(|unused| note!("warning: {unused}"));
}

/// Gives a session the training devices chosen on the command line.
fn attach(session: &mut Session, args: &TrainArgs) -> Result<(), Failure> {
    let is_without_work = session.learner().device_use() == DeviceUse::default();
    match args.device {
        DeviceName::Cpu => Ok(()),
        DeviceName::Gpu if is_without_work => Err(usage!(
            "--device gpu: expected a run with work that a GPU supports, found none in these settings; use --device auto"
        )),
        DeviceName::Auto => attach_gpu(session, false),
        DeviceName::Gpu => attach_gpu(session, true),
    }
}

#[cfg(feature = "gui")]
fn attach_gpu(session: &mut Session, must: bool) -> Result<(), Failure> {
    use vbgs_studio::render::gpu::adapters::{AdapterChoice, may_have_gpu};
    use vbgs_studio::render::gpu::headless::{HeadlessError, HeadlessGpu};
    use vbgs_studio::render::gpu::mixture::GpuMixture;
    use vbgs_studio::render::gpu::photometric::GpuComparer;
    use vbgs_studio::render::gpu::points::GpuPoints;
    use vbgs_studio::train::device_trial::DevicePolicy;
    use vbgs_studio::train::learner::TrainingDevice;
    type MakeDevice = fn(HeadlessGpu) -> TrainingDevice;

    if !must && !may_have_gpu() {
        return Ok(());
    }
    let used = session.learner().device_use();
    let tasks: [(bool, &str, MakeDevice); 3] = [
        (used.points.is_some(), "trains", |gpu| {
            TrainingDevice::Points(Box::new(GpuPoints::new(gpu)))
        }),
        (used.passes.is_some(), "trains", |gpu| {
            TrainingDevice::Passes(Box::new(GpuMixture::new(gpu)))
        }),
        (used.photographs.is_some(), "compares photographs", |gpu| {
            TrainingDevice::Photographs(Box::new(GpuComparer::new(gpu)))
        }),
    ];
    let policy = if must { DevicePolicy::Device } else { DevicePolicy::Fastest };
    // Drivers are not loaded if there is no work for them.
    for (_, what, device) in tasks.into_iter().filter(|(is_needed, ..)| *is_needed) {
        let gpu = match HeadlessGpu::new(&AdapterChoice::Auto) {
            Err(HeadlessError::NoHardware { .. }) if must => {
                HeadlessGpu::new(&AdapterChoice::Software)
            }
            other => other,
        };
        let error = match gpu {
            Ok(gpu) => match session.add_device(device(gpu), policy) {
                Ok(()) => continue,
                Err(error) => error.to_string(),
            },
            // The usual machine without a GPU deserves no note.
            Err(HeadlessError::NoHardware { .. }) if !must => continue,
            Err(error) => error.to_string(),
        };
        if must {
            return Err(failed!("--device gpu: {error}; --device cpu needs none"));
        }
        note!("note: {error}: the CPU {what}");
    }
    Ok(())
}

#[cfg(not(feature = "gui"))]
fn attach_gpu(_: &mut Session, must: bool) -> Result<(), Failure> {
    if !must {
        return Ok(());
    }
    Err(usage!(
        "--device gpu: expected auto or cpu, since this build has no GPU support; build it with the feature gui"
    ))
}

/// Time after which a problem with a followed recording is reported. Most problems disappear with the
/// recorder's next write.
const LASTING: Duration = Duration::from_secs(2);

#[derive(Default)]
struct ReportedProblem {
    /// Latest problem: its text, the time of its first occurrence, and true if it was reported.
    latest: Option<(String, Instant, bool)>,
}

impl ReportedProblem {
    /// Waits for more frames or an interrupt. Reports a lasting problem once.
    fn wait_for_frames(&mut self, follow: &Follow, interrupt: &Interrupt) {
        match (follow.problem(), &mut self.latest) {
            (None, latest) => *latest = None,
            (Some(problem), Some((known, since, is_reported))) if *known == problem => {
                if !*is_reported && since.elapsed() > LASTING {
                    note!("note: waiting: {problem}");
                    *is_reported = true;
                }
            }
            (Some(problem), latest) => *latest = Some((problem.to_owned(), Instant::now(), false)),
        }
        // Never without a pause, however late the next poll is.
        interrupt.wait_for_request(follow.time_to_next_scan().max(Duration::from_millis(1)));
    }
}

/// Folder of the headless demo.
const DEMO: &str = "vbgs-demo";

/// Trains the built-in demo and writes its model, report and a preview image. `reason` states why there
/// is no window.
pub fn run_demo(reason: &str) -> Result<(), Failure> {
    out!("{reason}: training the demo headless into {DEMO}/");
    let interrupt = Interrupt::listen()?;
    let mut session = demo_session(SceneOverrides::default())?;
    // Ctrl-C ends training but not the command: the files are written in any case.
    let finished = train(&mut session, &interrupt, |_, _| ())?;
    let out = Path::new(DEMO);
    output::create_folder(out)?;
    let splats = session.splats();
    let comments = file_comments(&session.config().method, session.learner().status().frames);
    for format in [ModelFormat::Ply, ModelFormat::Glb] {
        let options = WriteOptions {
            comments: &comments,
            up: session.up(),
            // The room's unit is the metre; files of unknown scale are written without a unit.
            metric: true,
            ..WriteOptions::new(format)
        };
        write(&out.join("scene").with_extension(format.extension()), &splats, &options)?;
    }
    let camera = session.dataset().splits[session.plan().split].frames[0].camera;
    let preview = CpuRenderer::new().render(
        &splats,
        &camera,
        &RenderOptions::evaluation(RenderMethod::PROJECTED, [0.0; 3]),
    );
    write_png(&out.join("preview.png"), &preview.color)?;
    output::write_json(&out.join("report.json"), &session.report(None, Vec::new()))?;
    out!("wrote scene.ply, scene.glb, report.json and preview.png to {DEMO}/");
    if finished { Ok(()) } else { Err(Failure::Interrupted) }
}
