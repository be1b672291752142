//! Timings of recent viewport pictures, stage by stage.

use super::worker::Waker;
use eframe::egui::Context;
use std::collections::VecDeque;
use std::sync::{Arc, Mutex, PoisonError};

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
