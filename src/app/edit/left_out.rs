//! Splats excluded from exports.

use super::edits::Edits;
use super::marks::SplatMarks;
use crate::export::WriteSelection;
use crate::model::splat::appearance::SplatSet;
use crate::model::splat::splats::Splat;
use glam::DVec3;
use std::sync::Arc;

/// Deleted splats and crop box, as applied to exported files.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LeftOut {
    deleted: Arc<SplatMarks>,
    crop: Option<[DVec3; 2]>,
}

impl LeftOut {
    /// Takes deletions and crop box from the edits.
    pub fn new(edits: &Edits) -> Self {
        Self { deleted: edits.deleted.clone(), crop: edits.crop }
    }

    /// True if exports contain all splats.
    pub fn is_empty(&self) -> bool {
        self.deleted.is_empty() && self.crop.is_none()
    }

    /// Flag for each splat: true if it is deleted.
    pub fn deleted_flags(&self, splats: &[Splat]) -> Vec<bool> {
        let is_deleted = |(slot, splat): (usize, &Splat)| self.deleted.contains(slot as u32, splat);
        splats.iter().enumerate().map(is_deleted).collect()
    }

    /// Selection for the file writer, with the flags returned by [`Self::flags`].
    pub fn selection<'a>(&self, flags: &'a [bool]) -> WriteSelection<'a> {
        WriteSelection { crop: self.crop, left_out: Some(flags), ..WriteSelection::default() }
    }

    /// Returns the splats that remain.
    pub fn remaining(&self, scene: Arc<SplatSet>) -> Arc<SplatSet> {
        if self.is_empty() {
            return scene;
        }
        let mut kept = SplatSet::default().finished(scene.finishing().clone());
        for (i, splat) in scene.iter().enumerate() {
            if self.is_exported(i as u32, splat) {
                kept.push(*splat, scene.appearance_of(i));
            }
        }
        Arc::new(kept)
    }

    /// True if the splat is exported.
    pub fn is_exported(&self, slot: u32, splat: &Splat) -> bool {
        let is_left_out = [self.deleted.contains(slot, splat)];
        let mean = DVec3::from_array(splat.mean.map(f64::from));
        self.selection(&is_left_out).selects(0, mean, None)
    }
}
