//! Ctrl-C, SIGTERM and SIGHUP: the first one asks for an orderly end, the second ends at once.
//!
//! A terminal that is closed and a machine that is shut down are no reason to lose a scene either. On Unix every
//! signal also writes to a pair of sockets, so that whoever only waits for the end is woken and need not look
//! again and again.

use super::failure::{Failure, INTERRUPTED};
#[cfg(unix)]
use std::io::{Read, Write};
#[cfg(unix)]
use std::os::unix::net::UnixStream;
use std::panic::resume_unwind;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, OnceLock};
use std::time::{Duration, Instant};
use vbgs_studio::pipeline::drive_work::DriveWork;

/// What the process listens with: handlers are installed once.
static LISTENING: OnceLock<Interrupt> = OnceLock::new();

/// How often it is looked where signals wake nobody.
const LOOK: Duration = Duration::from_millis(100);

/// For how long work that is asked to stop is waited for: what only takes a while removes its own files.
const GRACE: Duration = Duration::from_millis(500);

/// Whether the user asked to stop.
#[derive(Clone)]
pub struct Interrupt {
    asked: Arc<AtomicBool>,
    /// Has something to read once a signal came.
    #[cfg(unix)]
    wakes: Arc<UnixStream>,
}

impl Interrupt {
    /// Listens from now on, or goes on listening: where no window opens, the demo trains without one.
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
        // Nobody who waits is missed by a word that is not written: the waits end by themselves too.
        listen(&asked, move || drop(waker.write_all(&[0])))?;
        listen_to_the_system(&asked, &sender)?;
        Ok(Self { asked, wakes: Arc::new(wakes) })
    }

    #[cfg(not(unix))]
    fn new() -> Result<Self, Failure> {
        let asked = Arc::new(AtomicBool::new(false));
        listen(&asked, || ())?;
        Ok(Self { asked })
    }

    /// Whether the user asked to stop.
    pub fn is_asked(&self) -> bool {
        self.asked.load(Ordering::SeqCst)
    }

    /// The same, waited for, at most so long.
    pub fn is_asked_within(&self, longest: Duration) -> bool {
        if !self.is_asked() {
            self.sleep(longest);
        }
        self.is_asked()
    }

    /// What comes of work before which there is nothing to save, unless the user asks to stop meanwhile: the
    /// drive that it asks may never answer.
    pub fn unless_asked<T: Send + 'static>(
        &self,
        work: impl FnOnce() -> T + Send + 'static,
    ) -> Result<T, Failure> {
        let work = DriveWork::start("opening", work)?;
        let mut asked: Option<Instant> = None;
        while asked.is_none_or(|since| since.elapsed() < GRACE) {
            if let Some(ended) = work.wait(LOOK) {
                return Ok(ended.unwrap_or_else(|panic| resume_unwind(panic)));
            }
            asked = asked.or_else(|| self.is_asked().then(Instant::now));
        }
        Err(Failure::Interrupted)
    }

    #[cfg(unix)]
    fn sleep(&self, longest: Duration) {
        if self.wakes.set_read_timeout(Some(longest)).is_err() {
            return std::thread::sleep(longest);
        }
        // How the waiting ended does not matter: it is looked at the flag next.
        let _ = (&*self.wakes).read_exact(&mut [0]);
    }

    #[cfg(not(unix))]
    fn sleep(&self, longest: Duration) {
        std::thread::sleep(longest.min(LOOK));
    }
}

/// Listens to Ctrl-C; `wake` is called once it came.
fn listen(asked: &Arc<AtomicBool>, mut wake: impl FnMut() + Send + 'static) -> Result<(), Failure> {
    let flag = asked.clone();
    ctrlc::set_handler(move || {
        if flag.swap(true, Ordering::SeqCst) {
            // The first waits for the end of a frame, which may be long. No file is left half
            // written: each gets its name when it is whole.
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
        // In this order: the first sets the flag by which the second ends the process.
        register_conditional_shutdown(signal, i32::from(INTERRUPTED), asked.clone())?;
        register(signal, asked.clone())?;
        // After the flag, which is looked at when this has woken somebody.
        pipe::register(signal, wakes.try_clone()?)?;
    }
    Ok(())
}

/// Whether `nohup` or the like asked for a run that outlives its terminal, where the system tells.
#[cfg(unix)]
fn is_hangup_ignored() -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    let mask = mask.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok());
    mask.is_some_and(|mask| mask >> (signal_hook::consts::SIGHUP - 1) & 1 == 1)
}
