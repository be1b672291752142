//! Visits views of a split, a few at a time: what each does alone (decoding, drawing depth into
//! another camera) is hidden behind the others.

use crate::dataset::Dataset;
use crate::dataset::error::FrameError;
use crate::dataset::frame::Frame;
use crate::render::cpu::CpuRenderer;
use rayon::prelude::*;

/// Views at once at most: each takes a renderer with all its buffers.
const VIEWS_AT_ONCE: usize = 4;

/// What `visit` makes of every view, in order; `progress` hears how many are done.
pub fn over_views<T: Send>(
    dataset: &Dataset,
    split: usize,
    views: &[usize],
    visit: impl Fn(&mut CpuRenderer, usize, Result<Frame, FrameError>) -> T + Sync,
    mut progress: impl FnMut(usize),
) -> Vec<T> {
    let at_once = VIEWS_AT_ONCE.min(rayon::current_num_threads());
    let mut renderers: Vec<CpuRenderer> = (0..at_once).map(|_| CpuRenderer::new()).collect();
    let mut found = Vec::with_capacity(views.len());
    // In batches of as many views as renderers: each keeps its buffers, and results come in order.
    for batch in views.chunks(at_once) {
        // One view a task: with two in one another renderer would wait.
        let visited = renderers.par_iter_mut().zip(batch).with_max_len(1);
        found.par_extend(
            visited.map(|(renderer, &index)| visit(renderer, index, dataset.load(split, index))),
        );
        progress(found.len());
    }
    found
}
