//! Background thread with its own copy of the splats. It applies changes in order and answers only the
//! latest request, so that the window never waits.
//!
//! A panic of the thread is rethrown when the window takes the answer. Otherwise the picture would silently
//! stop changing.

use super::splat_updates::{SplatChange, apply};
use super::worker::Waker;
use crate::model::splat::appearance::SplatSet;
use crate::pipeline::job::Job;
use crate::pipeline::panic_report::PanicReport;
use rayon::{ThreadPool, ThreadPoolBuilder};
use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Returns a pool of one thread for background work, so that training can use the other cores.
pub fn one_thread() -> std::io::Result<ThreadPool> {
    ThreadPoolBuilder::new().num_threads(1).build().map_err(std::io::Error::other)
}

/// Runs `work` in `pool`, or on all threads if `pool` is `None`.
pub fn run_in<T: Send>(pool: Option<&ThreadPool>, work: impl FnOnce() -> T + Send) -> T {
    match pool {
        Some(pool) => pool.install(work),
        None => work(),
    }
}

/// Takes the result of a finished job, with its key, from `slot`. `None` while the job is running or if
/// there is none.
pub fn take_finished<K, T: Send + 'static>(
    slot: &mut Option<(K, Job<T>)>,
) -> Option<(K, Result<T, PanicReport>)> {
    let done = slot.as_ref()?.1.poll()?;
    slot.take().map(|(key, _)| (key, done))
}

/// Pause after background work during training, as a multiple of the duration of the work.
// On two cores training slows down by half of 1/15, about 3 %.
pub const REST: u32 = 15;

/// Runs one background job at a time. During training, each job is followed by a pause of [`REST`] times
/// its duration.
pub struct RestingJob<K, T> {
    running: Option<(K, Job<(T, Duration)>)>,
    rests_until: Option<Instant>,
}

impl<K, T> Default for RestingJob<K, T> {
    fn default() -> Self {
        Self { running: None, rests_until: None }
    }
}

impl<K, T: Send + 'static> RestingJob<K, T> {
    /// True if no job is running and, during training, the pause after the last job is over.
    pub fn is_ready(&self, is_training: bool) -> bool {
        let rests = is_training && self.rests_until.is_some_and(|until| Instant::now() < until);
        self.running.is_none() && !rests
    }

    pub fn start(
        &mut self,
        name: &str,
        key: K,
        waker: Waker,
        work: impl FnOnce() -> T + Send + 'static,
    ) -> std::io::Result<()> {
        let timed = move || {
            let started = Instant::now();
            (work(), started.elapsed())
        };
        self.running = Some((key, Job::start_waking(name, waker, timed)?));
        Ok(())
    }

    /// Removes and returns a finished result with its key.
    pub fn take(&mut self) -> Option<(K, Result<T, PanicReport>)> {
        let (key, done) = take_finished(&mut self.running)?;
        let took = done.as_ref().map_or(Duration::ZERO, |(_, took)| *took);
        // Also without training, which may start during the rest.
        self.rests_until = Some(Instant::now() + took * REST);
        Some((key, done.map(|(result, _)| result)))
    }
}

/// Handle of a thread that answers requests about the splats. Dropping it stops the thread after the
/// current answer.
pub struct ViewThread<Q, A> {
    requests: Arc<Requests<Q, A>>,
    thread: Option<JoinHandle<()>>,
}

struct Requests<Q, A> {
    inbox: Mutex<Inbox<Q, A>>,
    wake: Condvar,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Announce {
    Wake,
    /// Does not wake the window; the answer is used in the next egui pass.
    Quietly,
}

struct Inbox<Q, A> {
    /// Changes since the thread last took them, as one: of several, each would retain its textures while the
    /// thread works.
    change: Option<SplatChange>,
    request: Option<(Q, Announce)>,
    answer: Option<Result<A, Box<dyn Any + Send>>>,
    is_working: bool,
    is_closed: bool,
}

impl<Q, A> Requests<Q, A> {
    fn lock(&self) -> MutexGuard<'_, Inbox<Q, A>> {
        // Every change of the inbox is complete before anything can panic.
        self.inbox.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn answer(&self, answer: Result<A, Box<dyn Any + Send>>) {
        let mut inbox = self.lock();
        inbox.answer = Some(answer);
        inbox.is_working = false;
    }
}

impl<Q: Send + 'static, A: Send + 'static> ViewThread<Q, A> {
    /// Starts the thread. `work` computes the answer to a request from the splats at that time.
    pub fn start(
        name: &str,
        waker: Waker,
        mut work: impl FnMut(&SplatSet, Q) -> A + Send + 'static,
    ) -> std::io::Result<Self> {
        let inbox = Inbox {
            change: None,
            request: None,
            answer: None,
            is_working: false,
            is_closed: false,
        };
        let requests = Arc::new(Requests { inbox: Mutex::new(inbox), wake: Condvar::new() });
        let (own, failed) = (requests.clone(), requests.clone());
        let wake_after_panic = waker.clone();
        let work = move || {
            // Its own copy, so that no lock is held during the work.
            let mut splats = Arc::default();
            while let Some((change, request)) = next(&own) {
                if let Some(change) = change {
                    apply(&mut splats, change);
                    // Copied here if it is shared, rather than by the window's next change.
                    Arc::make_mut(&mut splats);
                }
                let Some((request, announce)) = request else { continue };
                own.answer(Ok(work(&splats, request)));
                if announce == Announce::Wake {
                    waker();
                }
            }
        };
        let thread = std::thread::Builder::new().name(name.to_owned()).spawn(move || {
            if let Err(panic) = catch_unwind(AssertUnwindSafe(work)) {
                failed.answer(Err(panic));
                // Even for a quiet answer, because the window must take the panic.
                wake_after_panic();
            }
        })?;
        Ok(Self { requests, thread: Some(thread) })
    }

    pub fn change(&self, change: SplatChange) {
        let mut inbox = self.requests.lock();
        match &mut inbox.change {
            Some(pending) => pending.append(change),
            empty => *empty = Some(change),
        }
        // Released first, or the thread would wake only to wait for the lock.
        drop(inbox);
        self.requests.wake.notify_one();
    }

    /// Submits a request, which replaces a request that is still waiting.
    pub fn send_request(&self, request: Q, announce: Announce) {
        self.requests.lock().request = Some((request, announce));
        self.requests.wake.notify_one();
    }

    pub fn is_busy(&self) -> bool {
        let inbox = self.requests.lock();
        inbox.is_working || inbox.request.is_some()
    }

    /// Removes and returns the newest answer.
    ///
    /// # Panics
    /// If the thread has panicked, with the same panic.
    pub fn take(&self) -> Option<A> {
        let answer = self.requests.lock().answer.take();
        answer.map(|answer| answer.unwrap_or_else(|panic| resume_unwind(panic)))
    }
}

/// Pending change, and the request to answer after it, if any.
type Work<Q> = (Option<SplatChange>, Option<(Q, Announce)>);

/// Waits for a change or a request. A change is returned even without a request, so that changes do not
/// accumulate. `None` once the handle is dropped.
fn next<Q, A>(requests: &Requests<Q, A>) -> Option<Work<Q>> {
    let mut inbox = requests.lock();
    loop {
        if inbox.is_closed {
            return None;
        }
        let request = inbox.request.take();
        if request.is_some() || inbox.change.is_some() {
            // Under the lock that takes the request, or the thread would appear idle in between.
            inbox.is_working = request.is_some();
            return Some((inbox.change.take(), request));
        }
        inbox = requests.wake.wait(inbox).unwrap_or_else(PoisonError::into_inner);
    }
}

impl<Q, A> Drop for ViewThread<Q, A> {
    fn drop(&mut self) {
        self.requests.lock().is_closed = true;
        self.requests.wake.notify_one();
        if let Some(thread) = self.thread.take() {
            // A panic of the work was caught and stored as an answer.
            let _ = thread.join();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::splat::splats::Splat;
    use std::sync::mpsc::channel;

    #[test]
    fn answers_the_latest_request_with_all_changes() {
        let (woken, wakes) = channel();
        let waker: Waker = Arc::new(move || {
            let _ = woken.send(());
        });
        let thread =
            ViewThread::start("test", waker, |splats: &SplatSet, q: usize| (q, splats.len()))
                .unwrap();
        thread.change(SplatChange::all(vec![Splat::default(); 3]));
        thread.send_request(7, Announce::Wake);
        wakes.recv_timeout(Duration::from_secs(10)).unwrap();
        assert_eq!(thread.take(), Some((7, 3)));
        assert!(thread.take().is_none() && !thread.is_busy());
    }

    #[test]
    fn a_panic_reaches_whoever_takes_the_answer() {
        let (woken, wakes) = channel();
        let waker: Waker = Arc::new(move || {
            let _ = woken.send(());
        });
        let work = |_: &SplatSet, (): ()| -> usize { panic!("no picture") };
        let thread = ViewThread::start("test", waker, work).unwrap();
        thread.send_request((), Announce::Quietly);
        wakes.recv_timeout(Duration::from_secs(10)).unwrap();
        let panic = catch_unwind(AssertUnwindSafe(|| thread.take())).unwrap_err();
        assert_eq!(panic.downcast_ref(), Some(&"no picture"));
    }

    #[test]
    fn changes_do_not_pile_up_while_nobody_asks() {
        let thread =
            ViewThread::start("test", Arc::new(|| {}), |splats: &SplatSet, (): ()| splats.len())
                .unwrap();
        let started = Instant::now();
        for n in 1..=3 {
            thread.change(SplatChange::all(vec![Splat::default(); n]));
            while thread.requests.lock().change.is_some() {
                assert!(started.elapsed() < Duration::from_secs(10), "never taken");
                std::thread::yield_now();
            }
        }
        assert!(!thread.is_busy() && thread.take().is_none());
    }
}
