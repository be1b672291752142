//! Edits of the open scene and the state of the editing tools.

use super::marks::{EditLog, Edits, LeftOut, Mark, SelectMode};
use super::past::{PastScene, PastScenes};
use super::visible::{ShownPast, VisibilityRules, VisibleSplats};
use crate::app::command::UiCommand;
use crate::app::palette::Palette;
use crate::app::panels::quality::EvidenceHistogram;
use crate::app::splat_updates::SplatChange;
use crate::model::splat::appearance::SplatSet;
use crate::model::splat::framing::{Framing, framing};
use crate::model::splat::splats::{Splat, bounds};
use glam::DVec3;
use std::sync::Arc;

/// Number of splats in each editing state.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct EditCounts {
    pub all: usize,
    pub selected: usize,
    pub hidden: usize,
    /// Number of splats excluded from exports: deleted or outside the crop box.
    pub left_out: usize,
    pub deleted: usize,
}

/// Undo log, visible splats and tool state.
#[derive(Default)]
pub struct Editor {
    pub log: EditLog,
    visible: VisibleSplats,
    /// True while dragging over the viewport selects splats.
    pub is_box_selecting: bool,
    /// Number of frames after which the displayed earlier scene was stored; `None` displays the current
    /// scene.
    pub earlier_frames: Option<usize>,
    pub stored_scenes: PastScenes,
    /// Stored scene that was read last, while one is displayed.
    read_past: Option<ShownPast>,
    /// Reason why a stored scene could not be read, until it is reported.
    unread_past: Option<String>,
    /// True if a panel needs component attributes. Set by the panels; reset at the end of every egui pass.
    pub needs_attributes: bool,
    /// True if the viewport shows the crop box and its handles. Set by the edit panel; reset at the end of
    /// every egui pass.
    pub shows_crop: bool,
    /// Cached counts of the current splats and edits; `None` until requested.
    counts: Option<EditCounts>,
    /// Cached histogram of the components' evidence; the outer option is `None` until it is requested.
    evidence: Option<Option<EvidenceHistogram>>,
}

impl Editor {
    /// Discards all edits and the tool state, for a newly opened scene.
    pub fn reset(&mut self) {
        // `visible` is retained so that the next pass sends painters the difference.
        *self = Self { visible: std::mem::take(&mut self.visible), ..Self::default() };
    }

    /// Drops the displayed splats and the values computed from them. Keeps edits, tools and stored earlier
    /// scenes.
    pub fn without_scene(self) -> Self {
        Self { visible: VisibleSplats::default(), counts: None, evidence: None, ..self }
    }

    pub fn edits(&self) -> &Edits {
        self.log.current()
    }

    /// Updates the displayed splats after a change of the scene, which `palette` must already contain.
    /// Returns the resulting change to be painted, if any.
    pub fn apply_change(&mut self, change: SplatChange, palette: &Palette) -> Option<SplatChange> {
        (self.counts, self.evidence) = (None, None);
        self.visible.apply_change(change, palette.splats())
    }

    pub fn displayed_past(&self) -> Option<&PastScene> {
        self.stored_scenes.latest_at(self.earlier_frames?)
    }

    /// Displays the current scene again, because edits apply to its splats.
    fn return_to_current(&mut self) {
        if self.displayed_past().is_some() {
            self.earlier_frames = None;
        }
    }

    /// Applies the current edits to the displayed splats. Returns the resulting change to be painted, if
    /// any.
    pub fn update_visible(&mut self, palette: &Palette) -> Option<SplatChange> {
        self.stored_scenes.release_written();
        self.read_past();
        let rules = VisibilityRules { edits: self.edits().clone(), past: self.read_past.clone() };
        let change = self.visible.set_rules(rules, palette.splats());
        if change.is_some() {
            (self.counts, self.evidence) = (None, None);
        }
        change
    }

    /// Reads the earlier scene to display, unless it is the one that was read last.
    fn read_past(&mut self) {
        let Some(moment) = self.displayed_past() else { return self.read_past = None };
        if self.read_past.as_ref().is_some_and(|read| read.moment == *moment) {
            return;
        }
        match ShownPast::read(moment) {
            Ok(read) => {
                // Read by the test that drives the program with a mouse (`tests/app/journey.rs`).
                tracing::debug!("shown: the scene after frame {}", moment.after.n_seen);
                self.read_past = Some(read);
            }
            Err(error) => {
                self.unread_past = Some(format!(
                    "The stored scene after frame {} cannot be read again: {error}; the newest scene is shown, and another frame may still be readable",
                    moment.after.n_seen
                ));
                (self.read_past, self.earlier_frames) = (None, None);
            }
        }
    }

    /// Returns a problem with stored scenes that is not reported yet.
    pub fn take_past_problem(&mut self) -> Option<String> {
        self.unread_past.take().or_else(|| self.stored_scenes.take_unreported_failure())
    }

    pub fn displayed_splats<'a>(&'a self, palette: &'a Palette) -> &'a Arc<SplatSet> {
        self.visible.splats().unwrap_or(palette.splats())
    }

    /// Returns the splats that a click can hit, shared with the picking thread.
    pub fn pickable_splats<'a>(&'a self, palette: &'a Palette) -> &'a Arc<SplatSet> {
        self.visible.splats().unwrap_or(palette.learned())
    }

    /// Returns the bounding sphere of the displayed splats, for framing the camera.
    pub fn framing(&self, palette: &Palette) -> Option<Framing> {
        match self.visible.splats() {
            None => framing(palette.splats().iter()),
            Some(shown) => framing(shown.iter().filter(|splat| splat.is_drawable())),
        }
    }

    /// Adds the displayed splats in the given slots to the selection, removes them from it, or makes them
    /// the new selection, as specified by `how`.
    pub fn select(
        &mut self,
        slots: impl IntoIterator<Item = u32>,
        palette: &Palette,
        how: SelectMode,
    ) {
        // Hidden, deleted and cropped splats are transparent and cannot be selected.
        let shown = self.displayed_splats(palette);
        let is_shown = |slot: &u32| shown.get(*slot as usize).is_some_and(Splat::is_drawable);
        let slots = slots.into_iter().filter(is_shown);
        let next = self.edits().with_selection(slots, palette.learned(), how);
        self.log.step(next);
    }

    pub fn invert(&mut self, palette: &Palette) {
        self.return_to_current();
        let (edits, all) = (self.edits().clone(), (0..).zip(palette.learned().iter()));
        let others = all.filter(|(slot, splat)| edits.mark(*slot, splat) != Some(Mark::Selected));
        self.select(others.map(|(slot, _)| slot), palette, SelectMode::Replace);
    }

    /// Returns the reason why `command` would have no effect. `None` if it would have an effect or is not
    /// an edit command.
    pub fn unavailable_reason(&self, command: UiCommand) -> Option<&'static str> {
        let has = |mark| self.edits().count(mark) > 0;
        let is_of_use = match command {
            UiCommand::Undo => self.log.can_undo(),
            UiCommand::Redo => self.log.can_redo(),
            UiCommand::HideSelected | UiCommand::DeleteSelected => has(Mark::Selected),
            UiCommand::ShowHidden => has(Mark::Hidden),
            UiCommand::RestoreDeleted => has(Mark::Deleted),
            _ => true,
        };
        (!is_of_use).then_some("Nothing to apply it to")
    }

    /// Executes an editing command. Ignores other commands.
    pub fn execute(&mut self, command: UiCommand, palette: &Palette) {
        let now = self.edits();
        let next = match command {
            UiCommand::Undo => return self.log.undo(),
            UiCommand::Redo => return self.log.redo(),
            UiCommand::BoxSelect => {
                self.is_box_selecting = !self.is_box_selecting;
                return self.return_to_current();
            }
            UiCommand::Deselect => now.with_replaced(Mark::Selected, None),
            UiCommand::HideSelected => now.with_replaced(Mark::Selected, Some(Mark::Hidden)),
            UiCommand::ShowHidden => now.with_replaced(Mark::Hidden, None),
            UiCommand::DeleteSelected => now.with_replaced(Mark::Selected, Some(Mark::Deleted)),
            UiCommand::RestoreDeleted => now.with_replaced(Mark::Deleted, None),
            UiCommand::CropBox if now.crop().is_some() => now.with_crop(None),
            UiCommand::CropBox => now.with_crop(self.selection_bounds(palette)),
            _ => return,
        };
        self.log.step(next);
    }

    /// Returns the bounding box of the centres of the selected splats, or of all displayed splats if
    /// none is selected.
    fn selection_bounds(&self, palette: &Palette) -> Option<[DVec3; 2]> {
        let (shown, edits) = (self.displayed_splats(palette), self.edits());
        let all = edits.count(Mark::Selected) == 0;
        let is_meant = |(slot, splat): &(u32, &Splat)| {
            splat.is_drawable() && (all || edits.mark(*slot, splat) == Some(Mark::Selected))
        };
        let meant: Vec<Splat> =
            (0..).zip(shown.iter()).filter(is_meant).map(|(_, splat)| *splat).collect();
        bounds(&meant).map(|(low, high)| [low, high])
    }

    pub fn left_out(&self) -> LeftOut {
        LeftOut::new(self.edits())
    }

    /// Counts the splats in each editing state. The result is cached until splats or edits change.
    pub fn counts(&mut self, palette: &Palette) -> EditCounts {
        let counts = self.counts.unwrap_or_else(|| self.count(palette));
        *self.counts.insert(counts)
    }

    /// Returns the histogram of the components' evidence. Also requests the evidence from the worker;
    /// `None` until it has been delivered.
    pub fn evidence(&mut self, palette: &Palette) -> Option<EvidenceHistogram> {
        self.needs_attributes = true;
        let count = || EvidenceHistogram::count(palette.attributes());
        self.evidence.get_or_insert_with(count).clone()
    }

    fn count(&self, palette: &Palette) -> EditCounts {
        let (edits, mut counts) = (self.edits(), EditCounts::default());
        for (slot, splat) in (0..).zip(palette.learned().iter()) {
            if !splat.is_drawable() {
                continue;
            }
            let mark = edits.mark(slot, splat);
            counts.all += 1;
            counts.selected += usize::from(mark == Some(Mark::Selected));
            counts.hidden += usize::from(mark == Some(Mark::Hidden));
            counts.deleted += usize::from(mark == Some(Mark::Deleted));
            counts.left_out += usize::from(!edits.is_exported(slot, splat));
        }
        counts
    }
}
