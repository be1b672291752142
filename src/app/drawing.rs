//! Timings of recent viewport pictures, stage by stage.

use std::collections::VecDeque;

/// Renderer of the viewport.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ViewRenderer {
    /// CPU renderer.
    Cpu,
    /// GPU with timestamp queries.
    Gpu,
    /// GPU without timestamp queries.
    UntimedGpu,
}

/// Stages of a picture, in order of execution.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DrawStage {
    /// Whole picture on the CPU.
    Picture,
    /// Depth sort on a CPU thread.
    Order,
    /// Projection of the splats on the GPU.
    Preprocess,
    /// Depth sort on the GPU.
    Sort,
    /// Rasterisation on the GPU.
    Draw,
}

impl DrawStage {
    /// Every stage, in order.
    pub const ALL: [DrawStage; 5] = [
        DrawStage::Picture,
        DrawStage::Order,
        DrawStage::Preprocess,
        DrawStage::Sort,
        DrawStage::Draw,
    ];

    /// Label in the panel.
    pub fn label(self) -> &'static str {
        match self {
            DrawStage::Picture => "Picture (CPU)",
            DrawStage::Order => "Order (CPU)",
            DrawStage::Preprocess => "Preprocess (GPU)",
            DrawStage::Sort => "Sort (GPU)",
            DrawStage::Draw => "Draw (GPU)",
        }
    }
}

/// Timings of one picture.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct DrawSample {
    ms: [Option<f64>; DrawStage::ALL.len()],
    /// Splat data uploaded to the GPU for this picture, bytes.
    pub uploaded_bytes: u64,
}

impl DrawSample {
    /// Creates a record without timings for a picture that uploaded this many bytes.
    pub fn new(uploaded_bytes: u64) -> Self {
        Self { uploaded_bytes, ..Self::default() }
    }

    /// Time of a stage in milliseconds; `None` if it did not run or cannot be measured.
    pub fn ms(&self, stage: DrawStage) -> Option<f64> {
        self.ms[stage as usize]
    }

    /// Adds to the time of a stage; two pictures side by side are summed.
    pub fn add(&mut self, stage: DrawStage, ms: Option<f64>) {
        if let Some(ms) = ms {
            *self.ms[stage as usize].get_or_insert(0.0) += ms;
        }
    }
}

/// Length of the history, pictures.
const MAX_SAMPLES: usize = 300;

/// Timings of the latest pictures, oldest first.
#[derive(Clone, Debug)]
pub struct DrawHistory {
    /// Renderer that drew them.
    pub drawer: ViewRenderer,
    samples: VecDeque<DrawSample>,
}

impl DrawHistory {
    /// Creates an empty history.
    pub fn new(drawer: ViewRenderer) -> Self {
        Self { drawer, samples: VecDeque::new() }
    }

    /// Appends a picture and drops the oldest beyond 300.
    pub fn push(&mut self, sample: DrawSample) {
        if self.samples.len() == MAX_SAMPLES {
            self.samples.pop_front();
        }
        self.samples.push_back(sample);
    }

    /// Recorded pictures, oldest first.
    pub fn samples(&self) -> impl ExactSizeIterator<Item = &DrawSample> {
        self.samples.iter()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_pictures_add_up_and_old_ones_are_forgotten() {
        let mut sample = DrawSample::new(0);
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
}
