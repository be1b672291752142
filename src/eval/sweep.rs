//! Visits views of a split in small parallel batches, which hides the serial parts of each (decoding,
//! projecting depth).

use crate::dataset::Dataset;
use crate::dataset::error::FrameError;
use crate::dataset::frame::Frame;
use crate::render::cpu::CpuRenderer;
use rayon::prelude::*;

/// Maximum number of parallel views: each needs a renderer with all its buffers.
const VIEWS_AT_ONCE: usize = 4;

/// Applies `visit` to all views; results are in order. `progress` receives the number of views done.
pub fn visit_views<T: Send>(
    dataset: &Dataset,
    split: usize,
    views: &[usize],
    visit: impl Fn(&mut CpuRenderer, usize, Result<Frame, FrameError>) -> T + Sync,
    mut progress: impl FnMut(usize),
) -> Vec<T> {
    let at_once = VIEWS_AT_ONCE.min(rayon::current_num_threads());
    let mut renderers: Vec<CpuRenderer> = (0..at_once).map(|_| CpuRenderer::new()).collect();
    let mut found = Vec::with_capacity(views.len());
    // One view per renderer and batch: buffers are reused and results stay in order.
    for batch in views.chunks(at_once) {
        // One view per task: with two in one, another renderer would be idle.
        let visited = renderers.par_iter_mut().zip(batch).with_max_len(1);
        found.par_extend(
            visited.map(|(renderer, &index)| visit(renderer, index, dataset.load(split, index))),
        );
        progress(found.len());
    }
    found
}
