//! Handling of Ctrl-C, SIGTERM and SIGHUP: the first signal requests an orderly stop, the second exits
//! immediately.
//!
//! A closed terminal or a system shutdown must not lose a scene. On Unix each signal also writes to a socket
//! pair, which wakes waiting threads without polling.

use super::failure::{Failure, INTERRUPTED};
#[cfg(unix)]
use std::io::{Read, Write};
#[cfg(unix)]
use std::os::unix::net::UnixStream;
use std::panic::resume_unwind;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, OnceLock};
use std::time::{Duration, Instant};
use vbgs_studio::pipeline::job::Job;

static LISTENING: OnceLock<Interrupt> = OnceLock::new();

/// Interval at which a waiting thread checks for a stop request if signals cannot wake it.
const LOOK: Duration = Duration::from_millis(100);

/// Time allowed for cancelled work to remove its own files.
const GRACE: Duration = Duration::from_millis(500);

#[derive(Clone)]
pub struct Interrupt {
    is_stop_requested: Arc<AtomicBool>,
    /// Socket that becomes readable when a signal arrives.
    #[cfg(unix)]
    wakes: Arc<UnixStream>,
}

impl Interrupt {
    /// Installs the signal handlers, or returns the existing ones. Handlers already exist if a failed
    /// window falls back to the headless demo.
    pub fn listen() -> Result<Self, Failure> {
        if let Some(interrupt) = LISTENING.get() {
            return Ok(interrupt.clone());
        }
        let interrupt = Self::new()?;
        Ok(LISTENING.get_or_init(|| interrupt).clone())
    }

    #[cfg(unix)]
    fn new() -> Result<Self, Failure> {
        let asked = Arc::new(AtomicBool::new(false));
        let (wakes, sender) = UnixStream::pair()?;
        let mut waker = sender.try_clone()?;
        // A failed write is harmless: waits also have a timeout.
        listen(&asked, move || drop(waker.write_all(&[0])))?;
        listen_to_the_system(&asked, &sender)?;
        Ok(Self { is_stop_requested: asked, wakes: Arc::new(wakes) })
    }

    #[cfg(not(unix))]
    fn new() -> Result<Self, Failure> {
        let asked = Arc::new(AtomicBool::new(false));
        listen(&asked, || ())?;
        Ok(Self { is_stop_requested: asked })
    }

    pub fn is_requested(&self) -> bool {
        self.is_stop_requested.load(Ordering::SeqCst)
    }

    pub fn wait_for_request(&self, longest: Duration) -> bool {
        if !self.is_requested() {
            self.sleep(longest);
        }
        self.is_requested()
    }

    /// Runs work that precedes training, when no results need saving. Returns [`Failure::Interrupted`]
    /// on a stop request, even if an unresponsive drive blocks the work.
    pub fn run_interruptibly<T: Send + 'static>(
        &self,
        work: impl FnOnce() -> T + Send + 'static,
    ) -> Result<T, Failure> {
        let work = Job::start("opening", work).map_err(|error| {
            failed!("starting a thread failed: {error}; raise the limits of memory and processes")
        })?;
        let mut asked: Option<Instant> = None;
        // Without a stop request, the work may take any time.
        while asked.is_none_or(|since| since.elapsed() < GRACE) {
            if let Some(ended) = work.wait(LOOK) {
                // A panic of the work becomes one of the command.
                return Ok(ended.unwrap_or_else(|panic| resume_unwind(Box::new(panic.message))));
            }
            asked = asked.or_else(|| self.is_requested().then(Instant::now));
        }
        Err(Failure::Interrupted)
    }

    #[cfg(unix)]
    fn sleep(&self, longest: Duration) {
        if self.wakes.set_read_timeout(Some(longest)).is_err() {
            return std::thread::sleep(longest);
        }
        // The result does not matter: the caller checks the flag next.
        let _ = (&*self.wakes).read_exact(&mut [0]);
    }

    #[cfg(not(unix))]
    fn sleep(&self, longest: Duration) {
        std::thread::sleep(longest.min(LOOK));
    }
}

fn listen(asked: &Arc<AtomicBool>, mut wake: impl FnMut() + Send + 'static) -> Result<(), Failure> {
    let flag = asked.clone();
    ctrlc::set_handler(move || {
        if flag.swap(true, Ordering::SeqCst) {
            // The first request waits for the end of a frame, which may take long. No file is left
            // incomplete: files are renamed when complete.
            std::process::exit(i32::from(INTERRUPTED));
        }
        wake();
    })?;
    Ok(())
}

#[cfg(unix)]
fn listen_to_the_system(asked: &Arc<AtomicBool>, wakes: &UnixStream) -> Result<(), Failure> {
    use signal_hook::consts::{SIGHUP, SIGTERM};
    use signal_hook::flag::{register, register_conditional_shutdown};
    use signal_hook::low_level::pipe;
    let hangup = (!is_hangup_ignored()).then_some(SIGHUP);
    for signal in std::iter::once(SIGTERM).chain(hangup) {
        // Order matters: the first action checks the flag that the second one sets.
        register_conditional_shutdown(signal, i32::from(INTERRUPTED), asked.clone())?;
        register(signal, asked.clone())?;
        // Registered after the flag's handler, because the woken thread checks the flag.
        pipe::register(signal, wakes.try_clone()?)?;
    }
    Ok(())
}

/// True if SIGHUP is ignored, as by `nohup`. A run then continues after its terminal closes.
#[cfg(unix)]
fn is_hangup_ignored() -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    let mask = mask.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok());
    mask.is_some_and(|mask| mask >> (signal_hook::consts::SIGHUP - 1) & 1 == 1)
}
