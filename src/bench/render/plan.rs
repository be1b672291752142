//! What is timed, and who draws it.

#[cfg(feature = "gui")]
use super::gpu::TimedGpu;
use super::painter::{TimedCpu, TimedPainter};
use super::scene::BenchScene;
use crate::bench::findings::{BenchError, BenchOptions};
use crate::render::Renderer;
#[cfg(feature = "gui")]
use crate::render::gpu::{DrawPath, adapters::AdapterChoice};

/// Renderers that are timed, in the order of the rows.
pub const RENDERERS: [Renderer; 2] = [Renderer::Projected, Renderer::Exact];

/// What draws the frames.
#[derive(Clone, Copy, Debug, PartialEq, Eq, strum::EnumString, strum::VariantNames)]
#[strum(serialize_all = "kebab-case")]
pub enum BenchDevice {
    /// The CPU renderer.
    Cpu,
    /// A graphics adapter, by both of its paths.
    #[cfg(feature = "gui")]
    Gpu,
    /// Compute tiles of a graphics adapter alone: what draws beside them costs them memory and clock.
    #[cfg(feature = "gui")]
    Tiles,
    /// The CPU renderer, and a graphics adapter where there is one that is not software.
    All,
}

/// What is timed.
#[derive(Clone, Debug)]
pub struct RenderPlan {
    /// Numbers of splats.
    pub splats: Vec<usize>,
    /// Columns and rows of the images.
    pub sizes: Vec<[u32; 2]>,
    /// What draws them.
    pub device: BenchDevice,
    /// Name or number of the adapter, which may then be software.
    #[cfg(feature = "gui")]
    pub adapter: Option<String>,
    /// Timed frames of every combination, each from its own side.
    pub frames: usize,
    /// What was asked for.
    pub options: BenchOptions,
}

impl RenderPlan {
    /// 10⁴ to 4·10⁶ splats, or to 10⁶ in the quick form; a model's own number is among them.
    pub fn new(options: BenchOptions, scene: &BenchScene) -> Self {
        let mut splats = vec![10_000, 100_000, 1_000_000];
        let mut sizes = vec![[400, 400], [1280, 720]];
        if !options.quick {
            splats.extend([30_000, 300_000, 4_000_000]);
            sizes.insert(1, [800, 600]);
        }
        splats.extend(scene.own_count());
        splats.sort_unstable();
        splats.dedup();
        Self {
            splats,
            sizes,
            device: BenchDevice::All,
            #[cfg(feature = "gui")]
            adapter: None,
            // Repeats are frames here: each is drawn from a side of its own.
            frames: options.repeats.unwrap_or(if options.quick { 5 } else { 15 }),
            options,
        }
    }

    /// Everybody who draws; a GPU that was not asked for by name and is not there becomes a note.
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
            let all = [DrawPath::Quads, DrawPath::Tiles];
            let paths = if self.device == BenchDevice::Tiles { &all[1..] } else { &all };
            match TimedGpu::all(&choice, paths) {
                Ok(paths) => painters.extend(paths.into_iter().map(|p| Box::new(p) as _)),
                // One that was asked for must be there; as one of all it may be missing.
                Err(error) if self.device == BenchDevice::All && self.adapter.is_none() => {
                    notes.push(format!("CPU only: {error}"));
                }
                Err(error) => return Err(error.into()),
            }
        }
        #[cfg(not(feature = "gui"))]
        if self.device == BenchDevice::All {
            notes.push("CPU only: this build draws on no GPU".to_owned());
        }
        Ok(painters)
    }
}
