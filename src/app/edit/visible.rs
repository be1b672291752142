//! Derives the displayed splats: hidden ones made transparent, selected ones highlighted.

use super::history::Edits;
use super::marks::LeftOut;
use super::past::PastScene;
use crate::app::splat_updates::{SplatChange, apply};
use crate::math::camera::Camera;
use crate::model::attributes::ComponentAttributes;
use crate::model::splat::appearance::{Appearance, SplatSet};
use crate::model::splat::splats::Splat;
use crate::render::Lens;
use crate::render::finish::MARKER_COLOR;
use glam::{DVec2, DVec3};
use std::sync::Arc;

/// Display state of a splat.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum DisplayState {
    #[default]
    Plain,
    /// In the highlight colour.
    Marked,
    /// Not displayed.
    Invisible,
}

/// Conditions that determine the display state of every splat.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct VisibilityRules {
    /// Current edits.
    pub edits: Edits,
    /// Latest birth frame displayed; splats with unknown birth are always displayed.
    pub born_until: Option<u32>,
    /// Earlier scene displayed instead of the current one.
    pub past: Option<PastScene>,
}

impl VisibilityRules {
    fn are_inactive(&self) -> bool {
        !self.edits.affects_display() && self.born_until.is_none() && self.past.is_none()
    }

    fn display_state(
        &self,
        slot: u32,
        splat: &Splat,
        known: Option<&ComponentAttributes>,
    ) -> DisplayState {
        let birth = known.and_then(|known| known.birth);
        let is_later = birth.zip(self.born_until).is_some_and(|(birth, until)| birth > until);
        if is_later
            || self.edits.hidden.contains(slot, splat)
            || !LeftOut::new(&self.edits).is_exported(slot, splat)
        {
            DisplayState::Invisible
        } else if self.edits.selected.contains(slot, splat) {
            DisplayState::Marked
        } else {
            DisplayState::Plain
        }
    }
}

/// Splats and attributes from which the display is derived.
#[derive(Clone, Copy)]
pub struct SceneParts<'a> {
    /// Splats in the colours of the colour mode.
    pub colored: &'a Arc<SplatSet>,
    /// Attributes of the components, as far as the worker has delivered them.
    pub known: &'a [ComponentAttributes],
}

/// Displayed splats; a separate copy only while any rule applies.
#[derive(Default)]
pub struct VisibleSplats {
    rules: VisibilityRules,
    states: Vec<DisplayState>,
    shown: Arc<SplatSet>,
}

impl VisibleSplats {
    /// Applies a change that `parts` already contain; returns the change for painters, if any.
    pub fn apply_change(
        &mut self,
        change: SplatChange,
        parts: SceneParts<'_>,
    ) -> Option<SplatChange> {
        if self.rules.are_inactive() {
            return Some(change);
        }
        if self.rules.past.is_some() {
            return None;
        }
        Some(match change {
            SplatChange::All(_) => self.rebuild(parts),
            SplatChange::Some { ids, .. } => self.update(&ids, parts),
        })
    }

    /// Applies other rules to `parts`, which hold the earlier scene if the rules name one. Returns the change
    /// for painters, if any.
    pub fn set_rules(
        &mut self,
        rules: VisibilityRules,
        parts: SceneParts<'_>,
    ) -> Option<SplatChange> {
        if rules == self.rules {
            return None;
        }
        let is_another = self.rules.are_inactive() || self.rules.past != rules.past;
        self.rules = rules;
        if self.rules.are_inactive() {
            (self.states, self.shown) = (Vec::new(), Arc::default());
            return Some(SplatChange::All(parts.colored.clone()));
        }
        if is_another {
            return Some(self.rebuild(parts));
        }
        let looks = (0..).zip(&self.states);
        let changed = looks.filter(|(slot, look)| self.display_state(*slot, parts) != **look);
        let ids: Vec<u32> = changed.map(|(slot, _)| slot).collect();
        (!ids.is_empty()).then(|| self.update(&ids, parts))
    }

    /// Displayed splats; `None` if they equal the coloured splats.
    pub fn splats(&self) -> Option<&Arc<SplatSet>> {
        (!self.rules.are_inactive()).then_some(&self.shown)
    }

    fn display_state(
        &self,
        slot: u32,
        SceneParts { colored, known }: SceneParts<'_>,
    ) -> DisplayState {
        self.rules.display_state(slot, &colored[slot as usize], known.get(slot as usize))
    }

    fn rebuild(&mut self, parts: SceneParts<'_>) -> SplatChange {
        self.states =
            (0..parts.colored.len() as u32).map(|slot| self.display_state(slot, parts)).collect();
        let mut all = SplatSet::default().finished(parts.colored.finishing().clone());
        for slot in 0..parts.colored.len() {
            let (splat, appearance) = self.displayed_splat(slot, parts);
            all.push(splat, appearance);
        }
        self.shown = Arc::new(all);
        SplatChange::All(self.shown.clone())
    }

    fn update(&mut self, ids: &[u32], parts: SceneParts<'_>) -> SplatChange {
        self.states.resize(parts.colored.len(), DisplayState::default());
        let mut splats = SplatSet::default().finished(parts.colored.finishing().clone());
        for &id in ids {
            self.states[id as usize] = self.display_state(id, parts);
            let (splat, appearance) = self.displayed_splat(id as usize, parts);
            splats.push(splat, appearance);
        }
        let change = SplatChange::Some { ids: ids.into(), splats: Arc::new(splats) };
        apply(&mut self.shown, change.clone());
        change
    }

    fn displayed_splat(
        &self,
        slot: usize,
        SceneParts { colored, .. }: SceneParts<'_>,
    ) -> (Splat, Appearance) {
        let (splat, appearance) = (colored[slot], colored.appearance_of(slot));
        match self.states[slot] {
            DisplayState::Plain => (splat, appearance),
            // Without gradient and view dependence, which would alter the highlight colour.
            DisplayState::Marked => (Splat { color: MARKER_COLOR, ..splat }, Appearance::default()),
            DisplayState::Invisible => (Splat { opacity: 0.0, ..splat }, appearance),
        }
    }
}

/// Slots of drawable splats whose centres project between corners `a` and `b` (pixels), including occluded
/// splats. `near` is the near plane, world units.
pub fn slots_within<'a>(
    splats: &'a [Splat],
    camera: &'a Camera,
    lens: Lens,
    near: f64,
    [a, b]: [DVec2; 2],
) -> impl Iterator<Item = u32> + 'a {
    let (low, high) = (a.min(b), a.max(b));
    let (rotation, translation) = camera.pose.inverse();
    let is_within = move |splat: &Splat| {
        let point = rotation * DVec3::from_array(splat.mean.map(f64::from)) + translation;
        let ahead = match lens {
            Lens::Pinhole => point.z,
            Lens::Fisheye => point.length(),
        };
        splat.is_drawable()
            && ahead > near
            && lens
                .project(&camera.intrinsics, point)
                .is_some_and(|at| at.cmpge(low).all() && at.cmple(high).all())
    };
    splats.iter().zip(0..).filter(move |(splat, _)| is_within(splat)).map(|(_, slot)| slot)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::app::edit::history::SelectMode;
    use crate::app::edit::marks::SplatMarks;
    use glam::DVec3;

    fn scene(n: usize) -> Arc<SplatSet> {
        let splat = |i: usize| Splat {
            mean: [i as f32, 0.0, 0.0],
            opacity: 1.0,
            color: [0.5; 3],
            scale: [0.1; 3],
            rotation: [1.0, 0.0, 0.0, 0.0],
        };
        Arc::new((0..n).map(splat).collect::<Vec<_>>().into())
    }

    /// One letter per splat: `s` shown, `m` marked, `.` not displayed.
    fn seen(splats: &SplatSet) -> String {
        let letter = |s: &Splat| match (s.opacity > 0.0, s.color == MARKER_COLOR) {
            (false, _) => '.',
            (true, true) => 'm',
            (true, false) => 's',
        };
        splats.iter().map(letter).collect()
    }

    #[test]
    fn painters_get_what_differs_and_the_scene_back_in_the_end() {
        let colored = scene(6);
        let born: Vec<ComponentAttributes> = (0..6)
            .map(|i| ComponentAttributes { birth: Some(i), ..ComponentAttributes::default() })
            .collect();
        let parts = SceneParts { colored: &colored, known: &born };
        let mut visible = VisibleSplats::default();
        assert!(
            visible.splats().is_none() && visible.set_rules(Default::default(), parts).is_none()
        );
        let marks = |slots: &[u32]| SplatMarks::from_slots(slots.iter().copied(), &colored);
        let mut edits = Edits::default()
            .with_selection(marks(&[0]), SelectMode::Replace)
            .with_selection_hidden();
        edits = edits.with_selection(marks(&[1]), SelectMode::Replace).with_selection_deleted();
        edits = edits.with_selection(marks(&[2]), SelectMode::Replace);
        edits.crop = Some([DVec3::splat(-1.0), DVec3::new(4.5, 1.0, 1.0)]);
        let rules = VisibilityRules { edits: edits.clone(), ..VisibilityRules::default() };
        visible.set_rules(rules, parts);
        assert_eq!(seen(visible.splats().unwrap()), "..mss.");
        let rules = VisibilityRules { edits: edits.clone(), born_until: Some(3), past: None };
        let change = visible.set_rules(rules, parts).unwrap();
        assert!(matches!(change, SplatChange::Some { ids, .. } if ids[..] == [4]));
        assert_eq!(seen(visible.splats().unwrap()), "..ms..");
        let change = visible.set_rules(VisibilityRules::default(), parts).unwrap();
        assert!(matches!(change, SplatChange::All(all) if all == colored));
        assert!(visible.splats().is_none());
    }

    #[test]
    fn what_training_changes_stays_edited_and_what_it_bears_is_shown() {
        let mut colored = scene(3);
        let marks = SplatMarks::from_slots([1], &colored);
        let edits =
            Edits::default().with_selection(marks, SelectMode::Replace).with_selection_deleted();
        let mut visible = VisibleSplats::default();
        let rules = VisibilityRules { edits, ..VisibilityRules::default() };
        visible.set_rules(rules, SceneParts { colored: &colored, known: &[] });
        let moved = Splat { mean: [1.1, 0.0, 0.0], ..colored[1] };
        let others = vec![moved, Splat { mean: [1.0, 0.0, 0.0], ..moved }];
        let change = SplatChange::some(vec![1, 3], others);
        apply(&mut colored, change.clone());
        let parts = SceneParts { colored: &colored, known: &[] };
        visible.apply_change(change, parts);
        assert_eq!(seen(visible.splats().unwrap()), "s.ss");
        // The slot was reused for a splat elsewhere.
        let elsewhere = Splat { mean: [5.0, 0.0, 0.0], ..moved };
        let change = SplatChange::some(vec![1], vec![elsewhere]);
        apply(&mut colored, change.clone());
        visible.apply_change(change, SceneParts { colored: &colored, known: &[] });
        assert_eq!(seen(visible.splats().unwrap()), "ssss");
    }
}

#[cfg(test)]
mod screen_box_tests {
    use super::*;
    use crate::math::camera::Intrinsics;
    use crate::math::pose::Pose;

    #[test]
    fn centres_ahead_of_the_camera_are_found_however_deep() {
        let camera = Camera {
            intrinsics: Intrinsics::from_horizontal_fov(100, 100, 1.0),
            pose: Pose::IDENTITY,
        };
        let at = |x: f32, z: f32| Splat {
            mean: [x, 0.0, z],
            opacity: 1.0,
            scale: [0.1; 3],
            rotation: [1.0, 0.0, 0.0, 0.0],
            ..Splat::default()
        };
        let mut splats =
            vec![at(0.0, 1.0), at(0.0, 9.0), at(0.0, -1.0), at(0.5, 1.0), at(0.0, 2.0)];
        splats[4].opacity = 0.0;
        // Corners in any order are accepted.
        let corners = [DVec2::new(60.0, 40.0), DVec2::new(40.0, 60.0)];
        let found: Vec<u32> = slots_within(&splats, &camera, Lens::Pinhole, 0.1, corners).collect();
        assert_eq!(found, [0, 1]);
    }
}
