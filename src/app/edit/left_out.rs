//! What a file does not get.

use super::edits::Edits;
use super::marks::SplatMarks;
use crate::export::WriteSelection;
use crate::model::splat::appearance::SplatSet;
use crate::model::splat::splats::Splat;
use glam::DVec3;
use std::sync::Arc;

/// What the user has taken out of files.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LeftOut {
    deleted: Arc<SplatMarks>,
    crop: Option<[DVec3; 2]>,
}

impl LeftOut {
    /// By the edits of now.
    pub fn new(edits: &Edits) -> Self {
        Self { deleted: edits.deleted.clone(), crop: edits.crop }
    }

    /// Whether a file gets everything.
    pub fn is_nothing(&self) -> bool {
        self.deleted.is_empty() && self.crop.is_none()
    }

    /// Which of the splats are deleted, one flag for each.
    pub fn flags(&self, splats: &[Splat]) -> Vec<bool> {
        let is_deleted = |(slot, splat): (usize, &Splat)| self.deleted.has(slot as u32, splat);
        splats.iter().enumerate().map(is_deleted).collect()
    }

    /// What is asked of the file's writer, with the flags of [`Self::flags`].
    pub fn selection<'a>(&self, flags: &'a [bool]) -> WriteSelection<'a> {
        WriteSelection { crop: self.crop, left_out: Some(flags), ..WriteSelection::default() }
    }

    /// The splats that are left, alone.
    pub fn kept(&self, scene: Arc<SplatSet>) -> Arc<SplatSet> {
        if self.is_nothing() {
            return scene;
        }
        let mut kept = SplatSet::default().finished(scene.finishing().clone());
        for (i, splat) in scene.iter().enumerate() {
            if self.keeps(i as u32, splat) {
                kept.push(*splat, scene.appearance_of(i));
            }
        }
        Arc::new(kept)
    }

    /// Whether a splat is written.
    pub fn keeps(&self, slot: u32, splat: &Splat) -> bool {
        let is_left_out = [self.deleted.has(slot, splat)];
        let mean = DVec3::from_array(splat.mean.map(f64::from));
        self.selection(&is_left_out).takes(0, mean, None)
    }
}
