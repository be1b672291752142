//! Plan of the render bench: sizes and devices.

#[cfg(feature = "gui")]
use super::gpu::TimedGpu;
use super::painter::{TimedCpu, TimedPainter};
use super::scene::BenchScene;
use crate::bench::findings::{BenchError, BenchOptions};
use crate::render::Renderer;
#[cfg(feature = "gui")]
use crate::render::gpu::adapters::AdapterChoice;

/// Both renderers, in the order of the table's rows.
pub const RENDERERS: [Renderer; 2] = [Renderer::Projected, Renderer::Exact];

#[derive(Clone, Copy, Debug, PartialEq, Eq, strum::EnumString, strum::VariantNames)]
#[strum(serialize_all = "kebab-case")]
pub enum BenchDevice {
    Cpu,
    #[cfg(feature = "gui")]
    Gpu,
    /// The CPU renderer, and a graphics adapter unless it is a software adapter.
    All,
}

#[derive(Clone, Debug)]
pub struct RenderPlan {
    pub splats: Vec<usize>,
    /// Width and height of the images, pixels.
    pub sizes: Vec<[u32; 2]>,
    pub device: BenchDevice,
    /// Name or number of the graphics adapter, which may be a software adapter.
    #[cfg(feature = "gui")]
    pub adapter: Option<String>,
    /// Number of timed frames per combination, each from a different side.
    pub frames: usize,
    pub options: BenchOptions,
}

impl RenderPlan {
    /// Creates a plan with 10⁴ to 4·10⁶ splats (10⁶ if quick), and the model's own number of splats.
    pub fn new(options: BenchOptions, scene: &BenchScene) -> Self {
        let mut splats = vec![10_000, 100_000, 1_000_000];
        let mut sizes = vec![[400, 400], [1280, 720]];
        if !options.quick {
            splats.extend([30_000, 300_000, 4_000_000]);
            // In the middle, because plots show sizes in this order.
            sizes.insert(1, [800, 600]);
        }
        splats.extend(scene.own_count());
        // The model's own number may be among these.
        splats.sort_unstable();
        splats.dedup();
        Self {
            splats,
            sizes,
            device: BenchDevice::All,
            #[cfg(feature = "gui")]
            adapter: None,
            // `repeats` is the number of frames, each from a different side.
            frames: options.repeats.unwrap_or(if options.quick { 5 } else { 15 }),
            options,
        }
    }

    /// Creates all painters. With `All` and no named adapter, a missing GPU is reported as a note
    /// instead of an error.
    pub fn painters(
        &self,
        notes: &mut Vec<String>,
    ) -> Result<Vec<Box<dyn TimedPainter>>, BenchError> {
        let mut painters: Vec<Box<dyn TimedPainter>> = Vec::new();
        if matches!(self.device, BenchDevice::Cpu | BenchDevice::All) {
            painters.push(Box::new(TimedCpu::default()));
        }
        #[cfg(feature = "gui")]
        if self.device != BenchDevice::Cpu {
            let choice = self.adapter.as_deref().map_or(AdapterChoice::Auto, AdapterChoice::parse);
            match TimedGpu::new(&choice) {
                Ok(painter) => painters.push(Box::new(painter)),
                // A requested adapter must exist. As part of `All` it may be missing.
                Err(error) if self.device == BenchDevice::All && self.adapter.is_none() => {
                    notes.push(format!("CPU only: {error}"));
                }
                Err(error) => return Err(error.into()),
            }
        }
        #[cfg(not(feature = "gui"))]
        if self.device == BenchDevice::All {
            notes.push("CPU only: this build has no GPU support".to_owned());
        }
        Ok(painters)
    }
}
