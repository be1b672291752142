//! Passes of the published algorithm over frames, on a GPU (`training.md`, On a device).
//!
//! A frame is uploaded once, through mapped memory filled by all threads. Only moved means are uploaded, and
//! the GPU sorts all means into cells. One kernel searches, scores and sums, with one workgroup per tile.
//! One readback returns the scores, the sums of tiles, and the tiles left to the CPU. The capacity for sums
//! is estimated from the last pass; if it is too small, the pass is repeated.

pub mod layout;

use super::constants::{STRIP_CELLS, module};
use super::headless::HeadlessGpu;
use super::pipeline::Grid;
use super::task::{GpuTask, TaskPart};
use crate::model::conjugate::statistics::RECORD_WORDS;
use crate::model::inspection::DeviceError;
use crate::model::paper::mixture_device::{
    DevicePass, GridShape, MAX_TILE_POINTS, MeanCells, MixtureDevice, PassRule, PointColumns,
};
use layout::{
    ADD, COUNT, FRAME_UPLOAD, Frame, HEAD_WORDS, Index, MEAN_UPLOAD, Mean, PLACE, Part,
    RECORD_BYTES, RENEW, RUN,
};
use rayon::prelude::*;

const MIN_RECORDS: u64 = 4096;
/// Number of means packed per parallel task.
const PACKED: usize = 1 << 14;

/// Runs the published algorithm's passes over frames (candidate search, E-step and sums) on a GPU device
/// of its own.
pub struct GpuMixture {
    task: GpuTask<Part>,
    pass: usize,
    /// Indices of the kernels of a counting sort, in execution order.
    index: [usize; 5],
    /// Capacity of the record buffer for the next pass that computes sums. A record holds the sums of
    /// one component over one tile.
    record_capacity: u64,
    cells: GridShape,
    packed: Vec<Mean>,
}

impl GpuMixture {
    /// Creates the kernels on the device `gpu`.
    pub fn new(gpu: HeadlessGpu) -> Self {
        let mut task = GpuTask::new(gpu);
        let pass = module(&task.device, "pass over a frame", layout::PASS);
        let index = module(&task.device, "index over means", layout::INDEX);
        let sort =
            [("renew", RENEW), ("count", COUNT), ("add", ADD), ("scan", ADD), ("place", PLACE)];
        Self {
            pass: task.add_kernel(&pass, "run", &[], RUN),
            index: sort.map(|(entry, parts)| task.add_kernel(&index, entry, &[], parts)),
            task,
            record_capacity: MIN_RECORDS,
            cells: GridShape::default(),
            packed: Vec::new(),
        }
    }

    /// Runs a pass with capacity for `sizes.records` records. Returns the number of records and the
    /// number of open tiles, which are left to the CPU. Records beyond the capacity are counted but not
    /// stored.
    fn run(&mut self, rule: &PassRule, with_sums: bool) -> Result<[u64; 2], DeviceError> {
        let task = &mut self.task;
        task.ensure_capacity([Part::Records])?;
        let (means, moved, cells) = (task.sizes.means, task.sizes.moved, task.sizes.cells);
        let sizes = [task.sizes.points, task.sizes.tiles, task.sizes.records].map(|n| n as usize);
        task.write(Part::Frame, &Frame::new(&self.cells, rule, sizes, with_sums));
        let (mut clears, mut dispatches) = (vec![Part::Outcome], Vec::new());
        if task.is_staged(MEAN_UPLOAD) {
            task.write(Part::Index, &Index::new(&self.cells, [means, moved]));
            clears.push(Part::Starts);
            let strips = Grid::row((cells + 1).div_ceil(STRIP_CELLS.into()) as u32);
            let [moved, means] = [moved, means].map(|n| Grid::lanes(n as usize));
            dispatches.extend(self.index.into_iter().zip([moved, means, strips, strips, means]));
        }
        dispatches.push((self.pass, Grid::groups(sizes[1])));
        task.run(&clears, &dispatches, &[Part::Outcome, Part::Distances, Part::Records])?;
        let head: [u32; HEAD_WORDS as usize] =
            bytemuck::pod_read_unaligned(&task.result()[..HEAD_WORDS as usize * 4]);
        Ok(head.map(u64::from))
    }

    /// Runs a pass, and repeats it if the capacity for records was too small. Returns the number of
    /// records and the number of open tiles, which are left to the CPU.
    fn run_until_fits(
        &mut self,
        rule: &PassRule,
        with_sums: bool,
    ) -> Result<[usize; 2], DeviceError> {
        loop {
            self.task.sizes.records = if with_sums { self.record_capacity } else { 0 };
            let [records, open] = self.run(rule, with_sums)?;
            // Successive frames are similar, so the estimate decays slowly: unused capacity is read back as
            // well.
            let kept = if with_sums {
                self.record_capacity - self.record_capacity / 8
            } else {
                self.record_capacity
            };
            self.record_capacity = kept.max(records + records / 4).max(MIN_RECORDS);
            if records <= self.task.sizes.records {
                return Ok([records as usize, open as usize]);
            }
        }
    }
}

impl MixtureDevice for GpuMixture {
    fn name(&self) -> String {
        self.task.name.clone()
    }

    fn set_means(&mut self, means: &MeanCells<'_>) -> Result<(), DeviceError> {
        let &MeanCells { shape, space, color, weight, changed_components: moved } = means;
        // If the previous upload was never submitted, the GPU lacks its changes: upload all means.
        let moved = moved.filter(|_| !self.task.is_staged(MEAN_UPLOAD));
        self.cells = shape;
        let sizes = &mut self.task.sizes;
        sizes.means = space.len() as u64;
        sizes.moved = moved.map_or(space.len(), <[u32]>::len) as u64;
        sizes.cells = shape.n_cells() as u64;
        use Part::{Appearance, Components, Means, Moved, Places, Starts, Strips};
        self.task
            .ensure_capacity([Starts, Means, Appearance, Components, Places, Strips, Moved])?;
        let mut packed = std::mem::take(&mut self.packed);
        packed.resize(self.task.sizes.moved as usize, Mean::default());
        packed.par_chunks_mut(PACKED).enumerate().for_each(|(task, packed)| {
            for (i, packed) in (task * PACKED..).zip(packed) {
                let id = moved.map_or(i as u32, |moved| moved[i]);
                let at = id as usize;
                let (position, weight, color) = (space[at], weight[at], color[at]);
                *packed = Mean { position, weight, color, id };
            }
        });
        let piece = (Moved, bytemuck::cast_slice(&packed));
        let staged = self.task.stage_upload(MEAN_UPLOAD, 0, [piece]);
        self.packed = packed;
        staged
    }

    fn set_points(&mut self, points: &PointColumns<'_>) -> Result<(), DeviceError> {
        let PointColumns { columns, tiles } = *points;
        // A workgroup has one lane per point of its tile.
        if tiles.windows(2).any(|tile| tile[1] - tile[0] > MAX_TILE_POINTS as u32) {
            let reason = format!("expected at most {MAX_TILE_POINTS} points per tile, found more");
            return Err(self.task.failed(reason));
        }
        self.task.sizes.points = columns[0].len() as u64;
        self.task.sizes.tiles = tiles.len().saturating_sub(1) as u64;
        let parts = [Part::Points, Part::Tiles, Part::Distances, Part::Outcome];
        self.task.ensure_capacity(parts)?;
        let columns = columns.map(|column| (Part::Points, bytemuck::cast_slice(column)));
        let tiles = (Part::Tiles, bytemuck::cast_slice(tiles));
        self.task.stage_upload(FRAME_UPLOAD, 0, columns.into_iter().chain([tiles]))
    }

    fn pass(&mut self, rule: &PassRule, with_sums: bool) -> Result<DevicePass<'_>, DeviceError> {
        // Nothing to dispatch.
        if self.task.sizes.points == 0 {
            return Ok(DevicePass { q: &[], open: &[], records: &[] });
        }
        let [n_records, n_open] = self.run_until_fits(rule, with_sums)?;
        let bytes = |part: Part| part.bytes(&self.task.sizes) as usize;
        let (outcome, rest) = self.task.result().split_at(bytes(Part::Outcome));
        let (q, records) = rest.split_at(bytes(Part::Distances));
        let outcome: &[u32] = bytemuck::cast_slice(outcome);
        let records = &records[..n_records * RECORD_BYTES as usize];
        let records: &[u32] = bytemuck::cast_slice(records);
        Ok(DevicePass {
            q: bytemuck::cast_slice(q),
            open: &outcome[HEAD_WORDS as usize..][..n_open],
            records: records.as_chunks::<RECORD_WORDS>().0,
        })
    }
}
