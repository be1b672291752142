//! The edits of what is open with the tools that make them.

use super::edits::{Edits, SelectHow};
use super::history::EditHistory;
use super::left_out::LeftOut;
use super::marks::SplatMarks;
use super::past::{PastScene, PastScenes};
use super::threshold::Doubt;
use super::visible::{SceneParts, VisibilityRules, VisibleSplats};
use crate::app::command::UiCommand;
use crate::app::evidence_histogram::EvidenceHistogram;
use crate::app::palette::Palette;
use crate::app::splat_updates::SplatChange;
use crate::model::splat::appearance::SplatSet;
use crate::model::splat::framing::{Framing, framing};
use crate::model::splat::splats::{Splat, bounds};
use glam::DVec3;
use std::sync::Arc;

/// Splats by what becomes of them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct EditCounts {
    /// Splats that can be drawn.
    pub all: usize,
    /// Of those, selected ones.
    pub selected: usize,
    /// Hidden, and written to files.
    pub hidden: usize,
    /// Deleted or outside the crop box: files do not get them.
    pub left_out: usize,
    /// Of those, deleted ones.
    pub deleted: usize,
    /// Of an unknown birth.
    pub unborn: usize,
}

/// What a walk back to an earlier frame shows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum WalkBack {
    /// The scene as it was, as far as it is kept.
    #[default]
    AsItWas,
    /// The splats that were born by then, as they are now.
    Births,
}

/// Edits and tools.
#[derive(Default)]
pub struct Editor {
    history: EditHistory,
    visible: VisibleSplats,
    /// Whether a drag over the viewport selects.
    pub is_boxing: bool,
    /// What the slider looks at.
    pub doubt: Doubt,
    /// Where it stands, once it was moved.
    pub threshold: Option<f64>,
    /// What is shown has seen so many frames and not what comes after; `None` shows the scene of now.
    pub walked_to: Option<usize>,
    /// What a walk back shows.
    pub walk: WalkBack,
    /// The scene after earlier frames.
    pub past: PastScenes,
    /// Whether a panel needs what is known of splats, said anew in every pass.
    pub is_asked: bool,
    /// Increases with every change of splats or edits.
    revision: u64,
    counted: Option<(u64, EditCounts)>,
    evidence: Option<(u64, Option<EvidenceHistogram>)>,
}

impl Editor {
    /// Forgets all edits: something else is open.
    pub fn reset(&mut self) {
        let Self { visible, revision, .. } = std::mem::take(self);
        // What painters show follows in the next pass.
        *self = Self { visible, revision: revision + 1, ..Self::default() };
    }

    /// The edits and tools for a view that has no splats yet.
    pub fn without_scene(self) -> Self {
        Self { visible: VisibleSplats::default(), revision: self.revision + 1, ..self }
    }

    /// The edits of now.
    pub fn edits(&self) -> &Edits {
        self.history.now()
    }

    /// The edits with what was before them.
    pub fn history(&mut self) -> &mut EditHistory {
        &mut self.history
    }

    /// Whether there is a step to take back.
    pub fn can_undo(&self) -> bool {
        self.history.can_undo()
    }

    /// Whether a step was taken back.
    pub fn can_redo(&self) -> bool {
        self.history.can_redo()
    }

    /// Takes a change that the palette has taken; returns what painters are to change, if anything.
    pub fn change(&mut self, change: SplatChange, palette: &Palette) -> Option<SplatChange> {
        self.revision += 1;
        self.visible.change(change, parts(palette, None))
    }

    /// The moment that is shown instead of the scene of now.
    pub fn past_shown(&self) -> Option<&PastScene> {
        match self.walk {
            WalkBack::AsItWas => self.past.at(self.walked_to?),
            WalkBack::Births => None,
        }
    }

    /// Back to the scene of now, whose splats edits are about.
    fn leave_past(&mut self) {
        if self.past_shown().is_some() {
            self.walked_to = None;
        }
    }

    /// The last frame, by its position in the run, whose births are shown.
    pub fn born_until(&self) -> Option<u32> {
        let until = |n_frames: usize| n_frames.saturating_sub(1) as u32;
        self.walked_to.filter(|_| self.past_shown().is_none()).map(until)
    }

    /// Shows by the edits of now; returns what painters are to change, if anything.
    pub fn follow(&mut self, palette: &Palette) -> Option<SplatChange> {
        let past = self.past_shown().cloned();
        let (edits, born_until) = (self.edits().clone(), self.born_until());
        let rules = VisibilityRules { edits, born_until, past: past.clone() };
        let change = self.visible.follow(rules, parts(palette, past.as_ref()));
        self.revision += u64::from(change.is_some());
        change
    }

    /// The splats as they are shown.
    pub fn shown<'a>(&'a self, palette: &'a Palette) -> &'a Arc<SplatSet> {
        self.visible.splats().unwrap_or(palette.splats())
    }

    /// The splats that a click may find, to be looked at on another thread.
    pub fn clickable<'a>(&'a self, palette: &'a Palette) -> &'a Arc<SplatSet> {
        self.visible.splats().unwrap_or(palette.learned())
    }

    /// Where a camera should look to see what is shown.
    pub fn framing(&self, palette: &Palette) -> Option<Framing> {
        match self.visible.splats() {
            None => framing(palette.splats().iter()),
            Some(shown) => framing(shown.iter().filter(|splat| splat.is_drawable())),
        }
    }

    /// Selects splats of ascending slots, of those that are shown.
    pub fn select(&mut self, slots: Vec<u32>, palette: &Palette, how: SelectHow) {
        let next = self.edits().selecting(self.marks(slots, palette), how);
        self.history.step(next);
    }

    /// Selects what the slider means, as a step that goes on while it is dragged.
    pub fn select_doubtful(&mut self, threshold: f64, palette: &Palette) {
        self.leave_past();
        self.threshold = Some(threshold);
        let slots = self.doubt.slots(threshold, palette.learned(), palette.known());
        let marks = self.marks(slots, palette);
        let next = self.edits().selecting(marks, SelectHow::Replace);
        self.history.drag(next);
    }

    /// Selects what is shown and not selected.
    pub fn invert(&mut self, palette: &Palette) {
        self.leave_past();
        let all = self.marks(0..palette.learned().len() as u32, palette);
        let next = self.edits().selecting(all.without(&self.edits().selected), SelectHow::Replace);
        self.history.step(next);
    }

    fn marks(&self, slots: impl IntoIterator<Item = u32>, palette: &Palette) -> SplatMarks {
        let shown = self.shown(palette);
        let is_shown = |slot: &u32| shown.get(*slot as usize).is_some_and(Splat::is_drawable);
        SplatMarks::of(slots.into_iter().filter(is_shown), palette.learned())
    }

    /// Does what a command asks of the edits.
    pub fn apply(&mut self, command: UiCommand, palette: &Palette) {
        let now = self.edits();
        let next = match command {
            UiCommand::Undo => return self.history.undo(),
            UiCommand::Redo => return self.history.redo(),
            UiCommand::BoxSelect => {
                self.is_boxing = !self.is_boxing;
                return self.leave_past();
            }
            UiCommand::Deselect => now.selecting(SplatMarks::default(), SelectHow::Replace),
            UiCommand::HideSelected => now.hiding(),
            UiCommand::ShowHidden => Edits { hidden: Arc::default(), ..now.clone() },
            UiCommand::DeleteSelected => now.deleting(),
            UiCommand::BringBack => Edits { deleted: Arc::default(), ..now.clone() },
            UiCommand::CropBox => {
                let crop = match now.crop {
                    Some(_) => None,
                    None => self.around(palette),
                };
                Edits { crop, ..now.clone() }
            }
            _ => return,
        };
        self.history.step(next);
    }

    /// A box around the centres of what is selected, else of all that is shown.
    fn around(&self, palette: &Palette) -> Option<[DVec3; 2]> {
        let (shown, selected) = (self.shown(palette), &self.edits().selected);
        let is_meant = |(slot, splat): &(u32, &Splat)| {
            splat.is_drawable() && (selected.is_empty() || selected.has(*slot, splat))
        };
        let meant: Vec<Splat> =
            (0..).zip(shown.iter()).filter(is_meant).map(|(_, splat)| *splat).collect();
        bounds(&meant).map(|(low, high)| [low, high])
    }

    /// What files do not get.
    pub fn left_out(&self) -> LeftOut {
        LeftOut::new(self.edits())
    }

    /// How many splats the edits are about.
    pub fn counts(&mut self, palette: &Palette) -> EditCounts {
        match self.counted {
            Some((revision, counts)) if revision == self.revision => counts,
            _ => {
                let counts = self.count(palette);
                self.counted = Some((self.revision, counts));
                counts
            }
        }
    }

    /// How many components have how much evidence, once the worker has told it.
    pub fn evidence(&mut self, palette: &Palette) -> Option<EvidenceHistogram> {
        self.is_asked = true;
        if self.evidence.as_ref().is_none_or(|(revision, _)| *revision != self.revision) {
            self.evidence = Some((self.revision, EvidenceHistogram::of(palette.known())));
        }
        self.evidence.as_ref().and_then(|(_, histogram)| histogram.clone())
    }

    fn count(&self, palette: &Palette) -> EditCounts {
        let (edits, left_out) = (self.edits(), self.left_out());
        let mut counts = EditCounts::default();
        for (slot, splat) in (0..).zip(palette.learned().iter()) {
            if !splat.is_drawable() {
                continue;
            }
            counts.all += 1;
            counts.selected += usize::from(edits.selected.has(slot, splat));
            counts.hidden += usize::from(edits.hidden.has(slot, splat));
            counts.deleted += usize::from(edits.deleted.has(slot, splat));
            counts.left_out += usize::from(!left_out.keeps(slot, splat));
            let known = palette.known().get(slot as usize);
            counts.unborn += usize::from(known.is_none_or(|known| known.birth.is_none()));
        }
        counts
    }
}

fn parts<'a>(palette: &'a Palette, past: Option<&'a PastScene>) -> SceneParts<'a> {
    match past {
        // What is known is known of the splats of now.
        Some(past) => SceneParts { colored: &past.splats, known: &[] },
        None => SceneParts { colored: palette.splats(), known: palette.known() },
    }
}
