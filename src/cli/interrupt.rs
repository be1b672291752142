//! Ctrl-C, SIGTERM and SIGHUP: the first one asks for an orderly end, the second ends at once.
//!
//! A terminal that is closed and a machine that is shut down are no reason to lose a scene either.

use super::failure::{Failure, INTERRUPTED};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, OnceLock};

/// What the process listens with: handlers are installed once.
static LISTENING: OnceLock<Interrupt> = OnceLock::new();

/// Whether the user asked to stop.
#[derive(Clone)]
pub struct Interrupt(Arc<AtomicBool>);

impl Interrupt {
    /// Listens from now on, or goes on listening: where no window opens, the demo trains without one.
    pub fn listen() -> Result<Self, Failure> {
        if let Some(interrupt) = LISTENING.get() {
            return Ok(interrupt.clone());
        }
        let asked = Arc::new(AtomicBool::new(false));
        listen(&asked)?;
        Ok(LISTENING.get_or_init(|| Self(asked)).clone())
    }

    /// Whether the user asked to stop.
    pub fn is_asked(&self) -> bool {
        self.0.load(Ordering::SeqCst)
    }
}

fn listen(asked: &Arc<AtomicBool>) -> Result<(), Failure> {
    let flag = asked.clone();
    ctrlc::set_handler(move || {
        if flag.swap(true, Ordering::SeqCst) {
            // The first waits for the end of a frame, which may be long. No file is left half
            // written: each gets its name when it is whole.
            std::process::exit(i32::from(INTERRUPTED));
        }
    })?;
    #[cfg(unix)]
    listen_to_the_system(asked)?;
    Ok(())
}

#[cfg(unix)]
fn listen_to_the_system(asked: &Arc<AtomicBool>) -> Result<(), Failure> {
    use signal_hook::consts::{SIGHUP, SIGTERM};
    use signal_hook::flag::{register, register_conditional_shutdown};
    let hangup = (!is_hangup_ignored()).then_some(SIGHUP);
    for signal in std::iter::once(SIGTERM).chain(hangup) {
        // In this order: the first sets the flag by which the second ends the process.
        register_conditional_shutdown(signal, i32::from(INTERRUPTED), asked.clone())?;
        register(signal, asked.clone())?;
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
