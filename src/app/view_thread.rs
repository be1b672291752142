//! A thread beside the window that works on its own copy of the splats: it takes changes in order
//! and always the latest request, so that the window waits for nothing.

use super::feed::{SplatChange, apply};
use super::worker::Waker;
use crate::model::splat::appearance::SplatSet;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;

/// Handle of the thread; dropping it stops the thread after the current answer.
pub struct ViewThread<Q, A> {
    desk: Arc<Desk<Q, A>>,
    thread: Option<JoinHandle<()>>,
}

struct Desk<Q, A> {
    inbox: Mutex<Inbox<Q, A>>,
    bell: Condvar,
}

/// Whether a finished answer wakes the window.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Announce {
    /// At once.
    Wake,
    /// Not: the window will look for itself.
    Quietly,
}

struct Inbox<Q, A> {
    changes: Vec<SplatChange>,
    request: Option<(Q, Announce)>,
    answer: Option<A>,
    is_working: bool,
    is_closed: bool,
}

impl<Q, A> Desk<Q, A> {
    fn lock(&self) -> MutexGuard<'_, Inbox<Q, A>> {
        // Every change of the inbox is complete before anything can panic.
        self.inbox.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl<Q: Send + 'static, A: Send + 'static> ViewThread<Q, A> {
    /// Starts the thread; `work` answers a request with the splats of that moment.
    pub fn start(
        name: &str,
        waker: Waker,
        mut work: impl FnMut(&SplatSet, Q) -> A + Send + 'static,
    ) -> std::io::Result<Self> {
        let inbox = Inbox {
            changes: Vec::new(),
            request: None,
            answer: None,
            is_working: false,
            is_closed: false,
        };
        let desk = Arc::new(Desk { inbox: Mutex::new(inbox), bell: Condvar::new() });
        let own = desk.clone();
        let thread = std::thread::Builder::new().name(name.to_owned()).spawn(move || {
            let mut splats = SplatSet::default();
            while let Some((changes, request)) = next(&own) {
                for change in changes {
                    apply(&mut splats, change);
                }
                let Some((request, announce)) = request else { continue };
                let answer = work(&splats, request);
                let mut inbox = own.lock();
                inbox.answer = Some(answer);
                inbox.is_working = false;
                drop(inbox);
                if announce == Announce::Wake {
                    waker();
                }
            }
        })?;
        Ok(Self { desk, thread: Some(thread) })
    }

    /// Hands changed splats over.
    pub fn change(&self, change: SplatChange) {
        let mut inbox = self.desk.lock();
        if matches!(change, SplatChange::All(_)) {
            inbox.changes.clear();
        }
        inbox.changes.push(change);
        drop(inbox);
        self.desk.bell.notify_one();
    }

    /// Asks for an answer; a request that still waits is replaced.
    pub fn ask(&self, request: Q, announce: Announce) {
        self.desk.lock().request = Some((request, announce));
        self.desk.bell.notify_one();
    }

    /// Whether a request waits or is worked on.
    pub fn is_busy(&self) -> bool {
        let inbox = self.desk.lock();
        inbox.is_working || inbox.request.is_some()
    }

    /// The newest answer, once.
    pub fn take(&self) -> Option<A> {
        self.desk.lock().answer.take()
    }
}

/// Changes in their order, then the request to answer, if there is one.
type Work<Q> = (Vec<SplatChange>, Option<(Q, Announce)>);

/// Waits for changes or a request: changes are taken even while nobody asks, so that they do not
/// pile up. `None` when the handle was dropped.
fn next<Q, A>(desk: &Desk<Q, A>) -> Option<Work<Q>> {
    let mut inbox = desk.lock();
    loop {
        if inbox.is_closed {
            return None;
        }
        let request = inbox.request.take();
        if request.is_some() || !inbox.changes.is_empty() {
            inbox.is_working = request.is_some();
            return Some((std::mem::take(&mut inbox.changes), request));
        }
        inbox = desk.bell.wait(inbox).unwrap_or_else(PoisonError::into_inner);
    }
}

impl<Q, A> Drop for ViewThread<Q, A> {
    fn drop(&mut self) {
        self.desk.lock().is_closed = true;
        self.desk.bell.notify_one();
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::splat::splats::Splat;
    use std::sync::mpsc::channel;
    use std::time::Duration;

    #[test]
    fn answers_the_latest_request_with_all_changes() {
        let (woken, wakes) = channel();
        let waker: Waker = Arc::new(move || {
            let _ = woken.send(());
        });
        let thread =
            ViewThread::start("test", waker, |splats: &SplatSet, q: usize| (q, splats.len()))
                .unwrap();
        thread.change(SplatChange::All(vec![Splat::default(); 3].into()));
        thread.ask(7, Announce::Wake);
        wakes.recv_timeout(Duration::from_secs(10)).unwrap();
        assert_eq!(thread.take(), Some((7, 3)));
        assert!(thread.take().is_none() && !thread.is_busy());
    }

    #[test]
    fn changes_do_not_pile_up_while_nobody_asks() {
        let thread =
            ViewThread::start("test", Arc::new(|| {}), |splats: &SplatSet, (): ()| splats.len())
                .unwrap();
        let started = std::time::Instant::now();
        for n in 1..=3 {
            thread.change(SplatChange::All(vec![Splat::default(); n].into()));
            while !thread.desk.lock().changes.is_empty() {
                assert!(started.elapsed() < Duration::from_secs(10), "never taken");
                std::thread::yield_now();
            }
        }
        assert!(!thread.is_busy() && thread.take().is_none());
    }
}
