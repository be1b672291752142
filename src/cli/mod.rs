//! The command line: parses arguments, calls the library and prints results. Contains no algorithms.

/// Prints a formatted line on stdout. Unlike `println!`, it does not panic on an error; the command
/// fails at its end instead.
macro_rules! out {
    ($($text:tt)*) => { $crate::cli::output::print_line(format_args!($($text)*)) };
}

/// Prints a formatted line on stderr. Names and texts from files cannot control the terminal.
macro_rules! note {
    ($($text:tt)*) => { $crate::cli::output::print_note(format_args!($($text)*)) };
}

/// Creates the failure for wrong usage of the command line, with a formatted message.
macro_rules! usage {
    ($($text:tt)*) => { $crate::cli::failure::Failure::Usage(format!($($text)*)) };
}

/// Creates a failure other than wrong usage, with a formatted message.
macro_rules! failed {
    ($($text:tt)*) => { $crate::cli::failure::Failure::failed(anyhow::anyhow!($($text)*)) };
}

mod args;
#[cfg(feature = "bench")]
mod bench;
mod eval;
mod export;
mod failure;
mod info;
mod interrupt;
mod model;
mod output;
mod quality;
mod render;
mod synth;
mod tracked;
mod train;
#[cfg(feature = "gui")]
mod window;

use args::{Arguments, Command};
use failure::Failure;
use std::io::IsTerminal;
use std::process::ExitCode;
use std::time::Instant;
use vbgs_studio::pipeline::prefetch::default_threads;

/// Upper limit of `--threads`, above the number of cores of any supported machine.
const MAX_THREADS: usize = 1024;

/// Runs the command given by the process's arguments. The exit status is 0 for success, 1 for failure, 2
/// for wrong usage and 130 if interrupted.
pub fn run() -> ExitCode {
    // Taken first: the log states the time from here to the first visible splats.
    let started = Instant::now();
    let arguments = Arguments::from_command_line();
    start_logging();
    // A failed write to stdout makes the command fail, although its work was completed.
    match dispatch(arguments, started).and_then(|()| output::check_stdout()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => failure.report(),
    }
}

fn dispatch(arguments: Arguments, started: Instant) -> Result<(), Failure> {
    // First, because the global pool is created on first use and cannot be changed later.
    set_threads(arguments.threads)?;
    match arguments.command {
        None => open_window(arguments, started),
        // Shared, because the dataset is opened on another thread.
        Some(Command::Train(args)) => train::run(&args.into()),
        Some(Command::Eval(args)) => eval::run(&args),
        Some(Command::Render(args)) => render::run(&args),
        Some(Command::Export(args)) => export::run(&args),
        Some(Command::Synth(args)) => synth::run(&args),
        Some(Command::Merge(args)) => export::run_merge(&args),
        Some(Command::Register(args)) => export::run_register(&args),
        Some(Command::Info(args)) => info::run(&args),
        Some(Command::Calibrate(args)) => info::run_calibrate(&args),
        Some(Command::Manual(args)) => args::write_manual(&args)
            .map_err(|e| failed!("{}: {e}; name an existing folder", args.folder.display())),
        #[cfg(feature = "bench")]
        Some(Command::Bench(bench)) => bench::run(&bench),
        #[cfg(feature = "bench")]
        Some(Command::PrecisionSearch(args)) => bench::run_precision_search(&args),
    }
}

#[cfg(feature = "gui")]
fn open_window(arguments: Arguments, started: Instant) -> Result<(), Failure> {
    let Arguments { path, calibration, adapter, .. } = arguments;
    window::run(path, calibration, adapter.as_deref(), started)
}

#[cfg(not(feature = "gui"))]
fn open_window(arguments: Arguments, _: Instant) -> Result<(), Failure> {
    match arguments.path {
        None => train::run_demo("this build has no window"),
        Some(path) => Err(usage!(
            "{}: this build has no window; use `train`, `eval`, `render`, `export` or `info`",
            path.display()
        )),
    }
}

fn set_threads(threads: Option<usize>) -> Result<(), Failure> {
    // Without the option, a larger machine must not cause an error.
    let threads = threads.unwrap_or_else(|| default_threads().min(MAX_THREADS));
    if threads > MAX_THREADS {
        return Err(usage!("--threads: expected 1 to {MAX_THREADS}, found {threads}"));
    }
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build_global();
    pool.map_err(|e| failed!("--threads: starting {threads} threads failed: {e}"))
}

/// Starts logging of warnings to stderr; `VBGS_LOG=info` or `debug` shows more. The graphics and window
/// libraries log only errors, because the program's own messages cover their warnings.
fn start_logging() {
    use tracing_subscriber::filter::Targets;
    use tracing_subscriber::prelude::*;
    let level = std::env::var("VBGS_LOG").unwrap_or_else(|_| "warn".to_owned());
    let quiet = "eframe=off,winit=error,egui_wgpu=error,wgpu_core=error,wgpu_hal=off,naga=error";
    let filter: Targets = format!("{level},{quiet}")
        .parse()
        // An invalid level must not stop the program.
        .or_else(|_| format!("warn,{quiet}").parse())
        .unwrap_or_default();
    let lines = tracing_subscriber::fmt::layer()
        .with_writer(std::io::stderr)
        .with_ansi(std::io::stderr().is_terminal())
        .without_time();
    tracing_subscriber::registry().with(lines.with_filter(filter)).init();
}
