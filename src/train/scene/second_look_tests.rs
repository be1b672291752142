//! Tests of the second alignment of frames and the motion of their contributions.

use super::align_tests::room;
use super::config::{BirthRule, SceneConfig};
use super::trainer::SceneTrainer;
use crate::math::pose::Pose;
use crate::model::scene::kept::{StoredFrame, quanta_to_values};
use crate::model::scene::state::{SceneState, StoredSums};
use crate::model::scene::sums::N_SUMS;
use crate::observation::surface::Observation;
use glam::{DQuat, DVec3};

fn config() -> SceneConfig {
    SceneConfig { refine: false, ..SceneConfig::coarse(0.05) }
}

/// Trains on the given number of frames with correct poses.
fn trained(config: &SceneConfig, frames: usize) -> SceneTrainer<i32> {
    let mut trainer = SceneTrainer::<i32>::new(config, DVec3::ZERO);
    let right = room(DQuat::IDENTITY, DVec3::ZERO);
    for _ in 0..frames {
        trainer.train(&right);
    }
    trainer
}

fn rows(state: &SceneState) -> &[[i32; N_SUMS]] {
    let StoredSums::Mixed { rows, .. } = &state.sums else { panic!("integers") };
    rows
}

fn change(trainer: &mut SceneTrainer<i32>, kept: StoredFrame, motion: Pose) {
    let change = trainer.change_under_motion(kept, motion);
    trainer.apply_change(&change);
}

/// Contributions of a frame as they would be if it had been added at a different pose.
fn elsewhere(trainer: &SceneTrainer<i32>, kept: &StoredFrame, motion: &Pose) -> StoredFrame {
    let mut kept = kept.clone();
    let shift = |id: u32| {
        let seed = trainer.splat_context(id as usize).seed;
        (motion.transform_point(seed) - seed) / 0.05
    };
    let change = kept.taught.clone().change_under_motion(motion.rotation(), shift);
    for (sums, change) in kept.taught.sums.iter_mut().zip(&change.sums) {
        sums.iter_mut().zip(change).for_each(|(sum, change)| *sum += change);
    }
    kept
}

#[test]
fn a_frame_that_was_learnt_wrong_is_put_right_with_all_that_it_taught() {
    let mut trainer = trained(&config(), 6);
    let right = trainer.state();
    let kept = right.stored_frames[2].clone();
    assert_eq!((kept.frame, kept.log_index), (3, 3), "the first is aligned to nothing");
    assert!(trainer.align_again(&kept).is_none(), "it is aligned already");
    let turn = DQuat::from_scaled_axis(DVec3::new(0.003, -0.002, 0.004));
    let motion = Pose::IDENTITY.attached_camera(DVec3::new(0.004, -0.006, 0.003), turn);
    let wrong = elsewhere(&trainer, &kept, &motion);
    change(&mut trainer, kept.clone(), motion);
    let moved = trainer.state();
    assert_ne!(moved.sums, right.sums);
    let real = |state: &SceneState| state.poses[3].poses().unwrap()[1];
    let expected = real(&right).transformed_by(&motion);
    assert!((real(&moved).centre() - expected.centre()).length() < 1e-12);
    let others = |state: &SceneState| [0, 1, 2, 4, 5].map(|frame: usize| state.poses[frame]);
    assert_eq!(others(&moved), others(&right));

    let back = trainer.align_again(&wrong).unwrap();
    change(&mut trainer, wrong, back);
    let again = trainer.state();
    let apart = (real(&again).centre() - real(&right).centre()).length();
    assert!(apart < 0.1 * motion.centre().length(), "{apart} is left");
    assert!((real(&again).forward() - real(&right).forward()).length() < 4e-4);
    // No points were lost, and their sums are about the same.
    for (again, right) in rows(&again).iter().zip(rows(&right)) {
        let [again, right] = [quanta_to_values(again), quanta_to_values(right)];
        assert_eq!(again[0], right[0]);
        let apart = (1..4).map(|i| (again[i] - right[i]).abs()).fold(0.0, f64::max);
        // The error of one frame in six, in structural scales.
        assert!(apart <= 0.015 * right[0] + 0.001, "{apart} of {} points", right[0]);
    }
}

/// Exact up to rounding: contributions are removed in full before they are added again.
#[test]
fn there_and_back_is_where_it_was() {
    let mut trainer = trained(&config(), 4);
    let right = trainer.state();
    let kept = right.stored_frames[1].clone();
    let motion = Pose::IDENTITY.attached_camera(DVec3::new(0.01, -0.02, 0.005), DQuat::IDENTITY);
    let back = Pose::IDENTITY.attached_camera(-motion.centre(), DQuat::IDENTITY);
    let wrong = elsewhere(&trainer, &kept, &motion);
    change(&mut trainer, kept, motion);
    change(&mut trainer, wrong, back);
    let again = trainer.state();
    let far = rows(&again).iter().zip(rows(&right)).flat_map(|(again, right)| {
        (0..N_SUMS).map(|i| again[i].abs_diff(right[i])).collect::<Vec<_>>()
    });
    // Each of the two motions rounds a sum once.
    assert!(far.max().unwrap() <= 8);
}

fn frames() -> impl Iterator<Item = Observation> {
    (0..21).map(|i| {
        let off = 0.004 * f64::from(i % 5) - 0.008;
        room(DQuat::from_rotation_z(0.3 * off), DVec3::new(off, -off, 0.5 * off))
    })
}

#[test]
fn whoever_goes_on_looks_again_at_the_same_frames() {
    let mut trainer = trained(&config(), 1);
    let mut frames = frames();
    for frame in frames.by_ref().take(18) {
        trainer.train(&frame);
    }
    let state = trainer.state();
    // The newest aligned frames.
    assert!(state.stored_frames.iter().map(|kept| kept.frame).eq(3..19));
    let mut gone_on = SceneTrainer::<i32>::restore(&config(), state, 19).unwrap();
    for frame in frames {
        trainer.train(&frame);
        gone_on.train(&frame);
    }
    assert!(gone_on.state() == trainer.state());
}

/// Lattices are stored in an order of their own.
#[test]
fn frames_are_kept_by_the_numbers_that_components_are_stored_by() {
    let config = SceneConfig { births: BirthRule::Lattice, ..config() };
    let mut trainer = SceneTrainer::<i32>::new(&config, DVec3::ZERO);
    for frame in frames().take(4) {
        trainer.train(&frame);
    }
    let state = trainer.state();
    assert!(!state.stored_frames.is_empty());
    for kept in &state.stored_frames {
        assert!(kept.taught.ids.is_sorted_by(|a, b| a < b));
        // No component has fewer points than one of the frames added.
        for (id, taught) in kept.taught.iter() {
            assert!(rows(&state)[id as usize][0] >= taught[0], "component {id}");
        }
    }
    let mut again = SceneTrainer::<i32>::restore(&config, state.clone(), 4).unwrap();
    assert!(again.state() == state);
    // Rounding does not depend on the numbering of components either.
    for frame in frames().skip(4) {
        trainer.train(&frame);
        again.train(&frame);
    }
    assert!(again.state() == trainer.state());
}

#[test]
fn poses_that_are_exact_or_tracked_or_of_unknown_exposure_are_left_alone() {
    let exact = SceneConfig { align: false, ..config() };
    assert!(trained(&exact, 3).state().stored_frames.is_empty());
    assert!(config().aligns_twice());
    for blind in [SceneConfig { track: true, ..config() }, SceneConfig { gain: false, ..config() }]
    {
        assert!(!blind.aligns_twice());
    }
}

#[test]
fn components_that_became_parts_of_others_are_let_go_of() {
    let mut trainer = trained(&config(), 3);
    let before = trainer.state().stored_frames;
    let merged = trainer.merge_to(trainer.state().visibility.len() / 2);
    assert!(merged > 100, "{merged}");
    let after = trainer.state();
    for (before, after_frame) in before.iter().zip(&after.stored_frames) {
        assert!(after_frame.taught.ids.len() < before.taught.ids.len());
        let has_points = |&id: &u32| rows(&after)[id as usize][0] > 0;
        assert!(after_frame.taught.ids.iter().all(has_points));
    }
    // The remaining contributions can still be moved.
    let motion = Pose::IDENTITY.attached_camera(DVec3::X * 0.01, DQuat::IDENTITY);
    change(&mut trainer, after.stored_frames[0].clone(), motion);
    assert_eq!(trainer.state().visibility, after.visibility);
}
