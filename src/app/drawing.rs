//! Timings of recent viewport pictures, stage by stage, and of the passes of the window.

use super::state::RunState;
use super::worker::Waker;
use eframe::egui::Context;
use std::collections::VecDeque;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ViewRenderer {
    Cpu,
    /// Draws on a GPU that supports timestamp queries.
    Gpu,
    UntimedGpu,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DrawStage {
    Picture,
    /// Projection of the splats on the GPU.
    Preprocess,
    Sort,
    Draw,
}

impl DrawStage {
    pub const ALL: [DrawStage; 4] =
        [DrawStage::Picture, DrawStage::Preprocess, DrawStage::Sort, DrawStage::Draw];

    pub fn label(self) -> &'static str {
        match self {
            DrawStage::Picture => "Picture (CPU)",
            DrawStage::Preprocess => "Preprocess (GPU)",
            DrawStage::Sort => "Sort (GPU)",
            DrawStage::Draw => "Draw (GPU)",
        }
    }
}

#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct DrawSample {
    ms: [Option<f64>; DrawStage::ALL.len()],
    /// Amount of splat data uploaded to the GPU for the picture, bytes.
    pub uploaded_bytes: u64,
}

impl DrawSample {
    pub fn new(uploaded_bytes: u64) -> Self {
        Self { uploaded_bytes, ..Self::default() }
    }

    /// Returns the time of a stage in milliseconds; `None` if the stage did not run or cannot be
    /// measured.
    pub fn ms(&self, stage: DrawStage) -> Option<f64> {
        self.ms[stage as usize]
    }

    /// Adds `ms` to the time of a stage, because the times of two compared pictures are summed.
    pub fn add(&mut self, stage: DrawStage, ms: Option<f64>) {
        if let Some(ms) = ms {
            *self.ms[stage as usize].get_or_insert(0.0) += ms;
        }
    }
}

const MAX_SAMPLES: usize = 300;

/// Timings of the latest pictures, oldest first.
#[derive(Clone, Debug)]
pub struct DrawHistory {
    pub drawer: ViewRenderer,
    samples: VecDeque<DrawSample>,
}

impl DrawHistory {
    pub fn new(drawer: ViewRenderer) -> Self {
        Self { drawer, samples: VecDeque::new() }
    }

    pub fn push(&mut self, sample: DrawSample) {
        if self.samples.len() == MAX_SAMPLES {
            self.samples.pop_front();
        }
        self.samples.push_back(sample);
    }

    pub fn samples(&self) -> impl ExactSizeIterator<Item = &DrawSample> {
        self.samples.iter()
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Painting {
    /// Uses a hardware GPU if there is one, else the CPU renderer, which is faster than a software
    /// adapter.
    Auto,
    /// Uses the GPU renderer, even on a software adapter.
    Gpu,
}

/// Lets other threads repaint the open window. Has no effect while no window is open.
pub struct WindowWaker {
    place: Arc<Mutex<Option<Context>>>,
    waker: Waker,
}

impl Default for WindowWaker {
    fn default() -> Self {
        let place: Arc<Mutex<Option<Context>>> = Arc::default();
        let looked_up = place.clone();
        let waker = Arc::new(move || {
            if let Some(context) = &*looked_up.lock().unwrap_or_else(PoisonError::into_inner) {
                context.request_repaint();
            }
        });
        Self { place, waker }
    }
}

impl WindowWaker {
    pub fn of(context: &Context) -> Self {
        let waker = Self::default();
        waker.open(context.clone());
        waker
    }

    pub fn open(&self, context: Context) {
        self.put(Some(context));
    }

    pub fn close(&self) {
        self.put(None);
    }

    fn put(&self, context: Option<Context>) {
        let mut place = self.place.lock().unwrap_or_else(PoisonError::into_inner);
        let before = std::mem::replace(&mut *place, context);
        // Dropped after the lock is released, because the context may own much that is dropped with it.
        drop(place);
        drop(before);
    }

    /// Returns the callback that repaints the window that is open at the time of the call.
    pub fn waker(&self) -> &Waker {
        &self.waker
    }
}

impl Drop for WindowWaker {
    fn drop(&mut self) {
        self.close();
    }
}

/// Returns the CPU time of the calling thread since its start; `None` except on Linux.
fn thread_time() -> Option<Duration> {
    // The first number of `schedstat` is in nanoseconds.
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").ok()?;
    text.split_whitespace().next()?.parse().ok().map(Duration::from_nanos)
}

/// CPU time of the window's thread per egui pass, as measured by the operating system; logged for tests.
#[derive(Default)]
pub struct PassTimes {
    is_drawn: bool,
    state: RunState,
    /// CPU time of this thread at the start of the latest egui pass, and at the end of the pass's layout.
    worked: Option<Duration>,
    laid_out: Option<Duration>,
    /// CPU time of each egui pass during training, milliseconds. The first number covers the whole pass,
    /// the second only the layout, without tessellation and the graphics driver.
    passes: Vec<[f64; 2]>,
}

impl PassTimes {
    pub fn begin(&mut self, state: RunState) {
        // Reading `schedstat` costs a system call in every pass.
        if !tracing::enabled!(tracing::Level::DEBUG) {
            return;
        }
        let now = thread_time();
        if let (RunState::Training, Some(before), Some(now)) = (self.state, self.worked, now) {
            let ms = |end: Duration| 1e3 * end.saturating_sub(before).as_secs_f64();
            let layout = self.laid_out.take().map_or(0.0, ms);
            self.passes.push([ms(now), layout]);
        }
        (self.worked, self.laid_out) = (now, None);
        if state == self.state {
            return;
        }
        tracing::debug!("shown: {}", state.label());
        if self.state == RunState::Training {
            self.log_times();
        }
        self.state = state;
    }

    /// Records the end of the layout of an egui pass. `started` is the start time of the program.
    pub fn end(&mut self, started: Instant) {
        if !self.is_drawn {
            self.is_drawn = true;
            tracing::info!("window after {} ms", started.elapsed().as_millis());
        }
        if tracing::enabled!(tracing::Level::DEBUG) {
            self.laid_out = thread_time();
        }
    }

    fn log_times(&mut self) {
        let passes = std::mem::take(&mut self.passes);
        let [all, layout] = [0, 1].map(|part| passes.iter().map(|pass| pass[part]).collect());
        if let (Some((median, most)), Some((_, layout))) = (figures(all), figures(layout)) {
            tracing::debug!(
                "passes {}: median_ms {median:.2} p99_ms {most:.2} layout_p99_ms {layout:.2}",
                passes.len()
            );
        }
    }
}

/// Returns the median and the 99th percentile of `ms`; `None` if it is empty.
fn figures(mut ms: Vec<f64>) -> Option<(f64, f64)> {
    ms.sort_by(f64::total_cmp);
    let at = |share: f64| ms.get((share * ms.len() as f64) as usize).or(ms.last()).copied();
    at(0.5).zip(at(0.99))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_pictures_add_up_and_old_ones_are_forgotten() {
        let mut sample = DrawSample::default();
        sample.add(DrawStage::Draw, Some(2.0));
        sample.add(DrawStage::Draw, Some(3.0));
        sample.add(DrawStage::Sort, None);
        assert_eq!((sample.ms(DrawStage::Draw), sample.ms(DrawStage::Sort)), (Some(5.0), None));
        let mut history = DrawHistory::new(ViewRenderer::Gpu);
        for uploaded_bytes in 0..MAX_SAMPLES as u64 + 7 {
            history.push(DrawSample { uploaded_bytes, ..sample });
        }
        assert_eq!(history.samples().len(), MAX_SAMPLES);
        assert_eq!(history.samples().next().map(|s| s.uploaded_bytes), Some(7));
    }

    #[test]
    fn a_waker_outlives_its_window_and_holds_nothing_of_it() {
        let context = Context::default();
        let (held, asked) = (Arc::new(()), Arc::new(Mutex::new(0)));
        let (of_window, counter) = (held.clone(), asked.clone());
        context.set_request_repaint_callback(move |_| {
            let _ = &of_window;
            *counter.lock().unwrap() += 1;
        });
        let window = WindowWaker::of(&context);
        let waker = window.waker().clone();
        waker();
        assert_eq!(*asked.lock().unwrap(), 1);
        drop(window);
        waker();
        assert_eq!(*asked.lock().unwrap(), 1, "nobody is woken");
        drop(context);
        assert_eq!(Arc::strong_count(&held), 1, "and nothing of the window is held");
    }
}
