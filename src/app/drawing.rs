//! What drawing the viewport takes: the latest pictures, stage by stage.

use std::collections::VecDeque;

/// Who draws the scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Drawer {
    /// The CPU renderer.
    Cpu,
    /// The GPU, which can time its passes.
    Gpu,
    /// A GPU that cannot.
    UntimedGpu,
}

/// Stages of a picture, in the order they happen.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DrawStage {
    /// The whole picture on the CPU.
    Picture,
    /// The order of the splats, found on a thread of the CPU.
    Order,
    /// Records of the splats on the GPU.
    Preprocess,
    /// Their order on the GPU.
    Sort,
    /// Their pixels on the GPU.
    Draw,
}

impl DrawStage {
    /// Every stage.
    pub const ALL: [DrawStage; 5] = [
        DrawStage::Picture,
        DrawStage::Order,
        DrawStage::Preprocess,
        DrawStage::Sort,
        DrawStage::Draw,
    ];

    /// As the panel shows it.
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

/// One picture.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct DrawSample {
    ms: [Option<f64>; DrawStage::ALL.len()],
    /// Bytes of splats sent to the GPU for it.
    pub uploaded_bytes: u64,
}

impl DrawSample {
    /// A picture for which so many bytes of splats were sent to the GPU; nothing measured yet.
    pub fn new(uploaded_bytes: u64) -> Self {
        Self { uploaded_bytes, ..Self::default() }
    }

    /// Milliseconds of a stage, where it happened and could be measured.
    pub fn ms(&self, stage: DrawStage) -> Option<f64> {
        self.ms[stage as usize]
    }

    /// Notes what a stage took; two pictures side by side take what both take together.
    pub fn add(&mut self, stage: DrawStage, ms: Option<f64>) {
        if let Some(ms) = ms {
            *self.ms[stage as usize].get_or_insert(0.0) += ms;
        }
    }
}

/// Pictures whose figures are kept.
const MAX_SAMPLES: usize = 300;

/// The latest pictures, oldest first.
#[derive(Clone, Debug)]
pub struct DrawHistory {
    /// Who drew them.
    pub drawer: Drawer,
    samples: VecDeque<DrawSample>,
}

impl DrawHistory {
    /// Nothing drawn yet.
    pub fn new(drawer: Drawer) -> Self {
        Self { drawer, samples: VecDeque::new() }
    }

    /// Adds a picture and forgets the oldest beyond 300.
    pub fn push(&mut self, sample: DrawSample) {
        if self.samples.len() == MAX_SAMPLES {
            self.samples.pop_front();
        }
        self.samples.push_back(sample);
    }

    /// The pictures, oldest first.
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
        let mut history = DrawHistory::new(Drawer::Gpu);
        for uploaded_bytes in 0..MAX_SAMPLES as u64 + 7 {
            history.push(DrawSample { uploaded_bytes, ..sample });
        }
        assert_eq!(history.samples().len(), MAX_SAMPLES);
        assert_eq!(history.samples().next().map(|s| s.uploaded_bytes), Some(7));
    }
}
