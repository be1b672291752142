//! Searches the nearest seed of each point and sums the points of each component, on a GPU (`scene.md`, On a
//! device). A seed is the point at which a component was created.
//!
//! Points are uploaded once per frame, through mapped memory filled by all threads, for both search and sums.
//! Seeds remain on the GPU, and new ones are appended to a hash grid. The grid is rebuilt when the number of
//! buckets grows. Sums are not retained: each frame returns them for the components it touched.

pub mod layout;

use super::constants::{SUM_GROUP, module};
use super::headless::HeadlessGpu;
use super::pipeline::Grid;
use super::task::GpuTask;
use crate::model::inspection::DeviceError;
use crate::model::scene::points_device::{POINT_WORDS, PointsDevice, Seeds, SlotSums};
use crate::model::scene::sums::N_SUMS;
use layout::{
    FILED, FIT_UPLOAD, FOUND, POINT_UPLOAD, Part, SEED_BYTES, SEED_UPLOAD, SUMMED, Settings,
};

const MIN_BUCKETS: u64 = 1 << 12;

/// Finds the nearest seed of each point and sums each component's points, on a GPU device of its own. A
/// component's seed is the point at which the component was created.
pub struct GpuPoints {
    task: GpuTask<Part>,
    file: usize,
    find: usize,
    sum: usize,
    search: Settings,
    /// Index of the first seed that is not on the GPU yet.
    first_new: u64,
}

impl GpuPoints {
    /// Creates the kernels on the device `gpu`.
    pub fn new(gpu: HeadlessGpu) -> Self {
        let mut task = GpuTask::new(gpu);
        let mut kernel = |entry, shader, parts| {
            let module = module(&task.device, "fit of points", shader);
            task.add_kernel(&module, entry, &[], parts)
        };
        Self {
            file: kernel("file", layout::FILE, FILED),
            find: kernel("find", layout::FIND, FOUND),
            sum: kernel("sum", layout::SUM, SUMMED),
            task,
            search: bytemuck::Zeroable::zeroed(),
            first_new: 0,
        }
    }
}

impl PointsDevice for GpuPoints {
    fn name(&self) -> String {
        self.task.name.clone()
    }

    fn set_seeds(&mut self, seeds: &Seeds<'_>) -> Result<(), DeviceError> {
        let n_seeds = seeds.positions.len() as u64;
        // At least twice as many buckets as seeds, to keep chains short.
        let buckets = (2 * n_seeds).next_power_of_two().max(MIN_BUCKETS);
        let is_refiled =
            seeds.are_new || buckets != self.task.sizes.buckets || self.first_new > n_seeds;
        (self.task.sizes.seeds, self.task.sizes.buckets) = (n_seeds, buckets);
        let is_lost = self.task.ensure_capacity([Part::Seeds, Part::Heads])?;
        // An upload that was never submitted is replaced by this one.
        if is_refiled || is_lost || self.task.is_staged(SEED_UPLOAD) {
            self.first_new = 0;
        }
        self.search = Settings::search(seeds);
        let new = &seeds.positions[self.first_new as usize..];
        if new.is_empty() {
            return Ok(());
        }
        let packed: Vec<[f32; 4]> = new.iter().map(|&[x, y, z]| [x, y, z, 0.0]).collect();
        let piece = (Part::Seeds, bytemuck::cast_slice(&packed));
        self.task.stage_upload(SEED_UPLOAD, self.first_new * SEED_BYTES, [piece])
    }

    fn set_points(&mut self, points: &[[u32; POINT_WORDS]]) -> Result<(), DeviceError> {
        self.task.sizes.points = points.len() as u64;
        self.task.ensure_capacity([Part::Points, Part::Nearest])?;
        let piece = (Part::Points, bytemuck::cast_slice(points));
        self.task.stage_upload(POINT_UPLOAD, 0, [piece])
    }

    fn nearest(&mut self) -> Result<&[u32], DeviceError> {
        let (points, seeds) = (self.task.sizes.points, self.task.sizes.seeds);
        // Nothing to dispatch.
        if points == 0 {
            return Ok(&[]);
        }
        let settings = self.search.of_frame(points, self.first_new, self.task.sizes.buckets);
        self.task.write(Part::Settings, &settings);
        let clears: &[Part] = if self.first_new == 0 { &[Part::Heads] } else { &[] };
        let new = (self.file, Grid::lanes((seeds - self.first_new) as usize));
        let all = (self.find, Grid::lanes(points as usize));
        let dispatches = if self.first_new < seeds { &[new, all][..] } else { &[all] };
        self.task.run(clears, dispatches, &[Part::Nearest])?;
        self.first_new = seeds;
        Ok(bytemuck::cast_slice(self.task.result()))
    }

    fn sums(&mut self, asked: &SlotSums<'_>) -> Result<&[[i32; N_SUMS]], DeviceError> {
        if asked.seeds.is_empty() {
            return Ok(&[]);
        }
        let (expected, found) = (self.task.sizes.points, asked.points.len());
        // The kernel reads the points of the last upload.
        if found as u64 != expected {
            let reason = format!("expected slots for {expected} points, found {found}");
            return Err(self.task.failed(reason));
        }
        self.task.sizes.slots = asked.seeds.len() as u64;
        self.task.ensure_capacity([Part::Fits, Part::References, Part::Sums])?;
        let pieces = [
            (Part::Fits, bytemuck::cast_slice(asked.points)),
            (Part::References, bytemuck::cast_slice(asked.seeds)),
        ];
        self.task.stage_upload(FIT_UPLOAD, 0, pieces)?;
        self.task.write(Part::Settings, &Settings::sums(asked));
        let groups = Grid::groups(found.div_ceil(SUM_GROUP as usize));
        self.task.run(&[Part::Sums], &[(self.sum, groups)], &[Part::Sums])?;
        let quanta: &[i32] = bytemuck::cast_slice(self.task.result());
        Ok(quanta.as_chunks().0)
    }
}
