//! Metadata of a merged run.

use super::super::error::RunError;
use super::super::json::canonical;
use super::super::saved::{Meta, SavedRun};
use super::super::snapshot::now_unix_s;
use crate::export::checkpoint::{Checkpoint, Cursor};
use crate::pipeline::error::SessionError;

/// Combines two runs into one over the frames of both, still with the model of `a`.
pub(super) fn combine_runs(a: SavedRun, b: SavedRun) -> Result<SavedRun, RunError> {
    let config = a.config.without_shard();
    let (ours, theirs) = (a.content.cursor, b.content.cursor);
    let cursor = Cursor {
        frames: ours.frames + theirs.frames,
        points: ours.points + theirs.points,
        visited: [ours.visited, theirs.visited].concat(),
    };
    let meta = Meta {
        saved_unix_s: now_unix_s(),
        planned_frames: cursor.visited.len(),
        wall_s: a.meta.wall_s + b.meta.wall_s,
        ..a.meta
    };
    let content = Checkpoint {
        config: canonical(&config).map_err(SessionError::from)?,
        meta: canonical(&meta).map_err(SessionError::from)?,
        // Frame reports refer to positions in different plans.
        history: None,
        cursor,
        ..a.content
    };
    Ok(SavedRun { config, meta, content, ..a })
}
