//! Derives the displayed splats: hidden ones made transparent, selected ones highlighted.

use super::marks::{Edits, Mark};
use super::past::PastScene;
use crate::app::splat_updates::{SplatChange, apply};
use crate::math::camera::Camera;
use crate::model::splat::appearance::{Appearance, SplatSet};
use crate::model::splat::splats::Splat;
use crate::render::Lens;
use crate::render::finish::MARKER_COLOR;
use glam::{DVec2, DVec3};
use std::io::Result as IoResult;
use std::sync::Arc;

/// Earlier scene that is displayed.
#[derive(Clone, Debug)]
pub struct ShownPast {
    pub moment: PastScene,
    splats: Arc<SplatSet>,
}

impl PartialEq for ShownPast {
    fn eq(&self, other: &Self) -> bool {
        self.moment == other.moment
    }
}

impl ShownPast {
    /// Reads a stored scene.
    pub fn read(moment: &PastScene) -> IoResult<Self> {
        Ok(Self { moment: moment.clone(), splats: moment.splats()? })
    }
}

/// Conditions that determine how every splat is displayed.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct VisibilityRules {
    pub edits: Edits,
    /// Earlier scene that is displayed instead of the current one, if any.
    pub past: Option<ShownPast>,
}

impl VisibilityRules {
    fn are_inactive(&self) -> bool {
        !self.edits.affects_display() && self.past.is_none()
    }

    /// Returns the stored earlier scene that is displayed, if any, otherwise `current`. The splats of
    /// `current` are coloured according to the colour mode.
    fn scene<'a>(&'a self, current: &'a Arc<SplatSet>) -> &'a Arc<SplatSet> {
        self.past.as_ref().map_or(current, |past| &past.splats)
    }

    fn displayed(&self, slot: u32, scene: &SplatSet) -> (Splat, Appearance) {
        let at = slot as usize;
        let (splat, appearance) = (scene[at], scene.appearance_of(at));
        let mark = self.edits.mark(slot, &splat);
        if mark == Some(Mark::Hidden) || !self.edits.is_exported(slot, &splat) {
            // Made transparent, not removed: painters and clicks refer to splats by slot.
            return (Splat { opacity: 0.0, ..splat }, appearance);
        }
        match mark {
            // Without gradient and view dependence, which would alter the highlight colour.
            Some(_) => (Splat { color: MARKER_COLOR, ..splat }, Appearance::default()),
            None => (splat, appearance),
        }
    }
}

/// Displayed splats; stored as a separate copy only while a rule hides or changes splats.
#[derive(Default)]
pub struct VisibleSplats {
    rules: VisibilityRules,
    shown: Arc<SplatSet>,
}

impl VisibleSplats {
    /// Updates the displayed splats after a change that `current` already contains. Returns the resulting
    /// change to be painted, if any.
    pub fn apply_change(
        &mut self,
        change: SplatChange,
        current: &Arc<SplatSet>,
    ) -> Option<SplatChange> {
        if self.rules.are_inactive() {
            return Some(change);
        }
        // Training does not change the earlier scene.
        if self.rules.past.is_some() {
            return None;
        }
        Some(match change {
            SplatChange::All(_) => self.rebuild(current),
            SplatChange::Some { ids, .. } => self.update(ids, current),
        })
    }

    /// Replaces the visibility rules. Returns the resulting change to be painted, if any.
    pub fn set_rules(
        &mut self,
        rules: VisibilityRules,
        current: &Arc<SplatSet>,
    ) -> Option<SplatChange> {
        if rules == self.rules {
            return None;
        }
        // There is no list of displayed splats yet, or it is of another scene.
        let is_another = self.rules.are_inactive() || self.rules.past != rules.past;
        self.rules = rules;
        if self.rules.are_inactive() {
            // Frees the copy of the scene.
            self.shown = Arc::default();
            return Some(SplatChange::All(current.clone()));
        }
        if is_another {
            return Some(self.rebuild(current));
        }
        // Only the difference is sent, since this runs in every pass of a drag.
        let shown = |slot: u32| {
            let at = slot as usize;
            (self.shown[at], self.shown.appearance_of(at))
        };
        let all = 0..self.shown.len() as u32;
        let scene = self.rules.scene(current);
        let differs = |&slot: &u32| self.rules.displayed(slot, scene) != shown(slot);
        let ids: Arc<[u32]> = all.filter(differs).collect();
        (!ids.is_empty()).then(|| self.update(ids, current))
    }

    /// Returns the displayed splats; `None` if they are the unchanged splats of the current scene.
    pub fn splats(&self) -> Option<&Arc<SplatSet>> {
        (!self.rules.are_inactive()).then_some(&self.shown)
    }

    fn displayed(&self, slots: impl Iterator<Item = u32>, scene: &SplatSet) -> Arc<SplatSet> {
        let mut splats = SplatSet::default().finished(scene.finishing().clone());
        for slot in slots {
            let (splat, appearance) = self.rules.displayed(slot, scene);
            splats.push(splat, appearance);
        }
        Arc::new(splats)
    }

    fn rebuild(&mut self, current: &Arc<SplatSet>) -> SplatChange {
        let scene = self.rules.scene(current);
        self.shown = self.displayed(0..scene.len() as u32, scene);
        SplatChange::All(self.shown.clone())
    }

    fn update(&mut self, ids: Arc<[u32]>, current: &Arc<SplatSet>) -> SplatChange {
        let splats = self.displayed(ids.iter().copied(), self.rules.scene(current));
        let change = SplatChange::Some { ids, splats };
        apply(&mut self.shown, change.clone());
        change
    }
}

/// Returns the slots of drawable splats whose centres project between corners `a` and `b` (pixels),
/// including occluded splats. `near` is the near plane, world units.
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
        // A fisheye lens also sees points with z below 0.
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
    use crate::app::edit::marks::SelectMode;
    use crate::math::camera::Intrinsics;
    use crate::math::pose::Pose;

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

    /// Returns one letter per splat: `s` shown, `m` marked, `.` not displayed.
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
        let mut visible = VisibleSplats::default();
        assert!(visible.splats().is_none());
        assert!(visible.set_rules(VisibilityRules::default(), &colored).is_none());
        let select =
            |edits: Edits, slot| edits.with_selection([slot], &colored, SelectMode::Replace);
        let mut edits = Edits::default();
        for (slot, mark) in [(0, Mark::Hidden), (1, Mark::Deleted), (2, Mark::Selected)] {
            edits = select(edits, slot).with_replaced(Mark::Selected, Some(mark));
        }
        for (x, ids, expected) in [(4.5, 0..6, "..mss."), (3.5, 4..5, "..ms..")] {
            let crop = Some([DVec3::splat(-1.0), DVec3::new(x, 1.0, 1.0)]);
            let rules = VisibilityRules { edits: edits.with_crop(crop), past: None };
            let changed = match visible.set_rules(rules, &colored).unwrap() {
                SplatChange::All(all) => (0..all.len() as u32).collect(),
                SplatChange::Some { ids, .. } => ids.to_vec(),
            };
            assert_eq!(changed, ids.collect::<Vec<_>>());
            assert_eq!(seen(visible.splats().unwrap()), expected);
        }
        let change = visible.set_rules(VisibilityRules::default(), &colored).unwrap();
        assert!(matches!(change, SplatChange::All(all) if all == colored));
        assert!(visible.splats().is_none());
    }

    #[test]
    fn what_training_changes_stays_edited_and_what_it_bears_is_shown() {
        let mut colored = scene(3);
        let edits = Edits::default()
            .with_selection([1], &colored, SelectMode::Replace)
            .with_replaced(Mark::Selected, Some(Mark::Deleted));
        let mut visible = VisibleSplats::default();
        let rules = VisibilityRules { edits, ..VisibilityRules::default() };
        visible.set_rules(rules, &colored);
        let moved = Splat { mean: [1.1, 0.0, 0.0], ..colored[1] };
        let others = vec![moved, Splat { mean: [1.0, 0.0, 0.0], ..moved }];
        let change = SplatChange::some(vec![1, 3], others);
        apply(&mut colored, change.clone());
        visible.apply_change(change, &colored);
        assert_eq!(seen(visible.splats().unwrap()), "s.ss");
        // The slot was reused for a splat elsewhere.
        let elsewhere = Splat { mean: [5.0, 0.0, 0.0], ..moved };
        let change = SplatChange::some(vec![1], vec![elsewhere]);
        apply(&mut colored, change.clone());
        visible.apply_change(change, &colored);
        assert_eq!(seen(visible.splats().unwrap()), "ssss");
    }

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
