//! Stored frames, whose poses may still be corrected (`scene.md`, Second alignment).

use super::assert_refused;
use super::raw::edited;
use super::scene::{VIEWPOINT, mixed, sample};
use glam::DVec3;
use vbgs_studio::export::checkpoint::{Checkpoint, StoredModel, parse, to_bytes};
use vbgs_studio::model::scene::kept::{ComponentObservation, FrameContribution, StoredFrame};
use vbgs_studio::model::scene::state::StoredSums;
use vbgs_studio::model::splat::pose_log::FramePose;

/// Checkpoint with two stored frames, the second without a remaining contribution.
fn kept() -> Checkpoint {
    let mut checkpoint = sample(mixed());
    let StoredModel::Scene(state) = &mut checkpoint.model else { unreachable!() };
    let StoredSums::Mixed { rows, .. } = &state.sums else { unreachable!() };
    let (rotation, turn) = ([0.6, 0.0, 0.0, 0.8], [0.01, 0.0, -0.02]);
    let pose = FramePose { recorded: VIEWPOINT, rotation, turn, shift: [0.1, 0.2, 0.3] };
    state.poses = vec![pose; 3];
    let shown = |component: u32| ComponentObservation {
        component,
        position: DVec3::new(1.0, f64::from(component), -2.0),
        color: DVec3::new(0.25, 0.5, 0.75),
        noise: 0.01,
    };
    let taught = FrameContribution { ids: vec![2, 3, 8], sums: vec![rows[2], rows[3], rows[7]] };
    let deviation = 0.02;
    let shown = vec![shown(2), shown(8)];
    state.stored_frames = vec![
        StoredFrame { frame: 5, log_index: 1, deviation, shown: shown.clone(), taught },
        StoredFrame {
            frame: 6,
            log_index: 2,
            deviation,
            shown,
            taught: FrameContribution::default(),
        },
    ];
    checkpoint
}

#[test]
fn frames_that_are_kept_come_back() {
    let checkpoint = kept();
    assert_eq!(parse(&to_bytes(&checkpoint)).unwrap().checkpoint, checkpoint);
    let bytes = to_bytes(&sample(mixed()));
    assert!(!bytes.windows(4).any(|tag| tag == b"KEPT"), "a section without frames");
}

#[test]
fn frames_that_no_scene_keeps_are_refused() {
    let bytes = to_bytes(&kept());
    let with = |tag: &[u8; 4], at: usize, value: f64| {
        edited(&bytes, tag, |s| {
            s.content[8 * at..8 * at + 8].copy_from_slice(&value.to_le_bytes());
        })
    };
    for (at, name, wrong) in [
        (0, "frame", 0.5),
        (6, "pose", -1.0),
        (7, "deviation", 0.0),
        (2, "deviation", f64::NAN),
        (3, "components shown", f64::INFINITY),
        (9, "components updated", 1e300),
    ] {
        let part = format!("KEPT[component {}, {name}]", at / 5);
        assert_refused(&with(b"KEPT", at, wrong), &[&part]);
    }
    assert_refused(
        &with(b"KEPT", 6, 3.0),
        &["KEPT[component 1, pose]", "an index below the 3 corrected poses"],
    );
    assert_refused(&with(b"KEPT", 4, 4.0), &["KETI", "4 elements", "found 3"]);
    assert_refused(&with(b"KEPT", 3, 1e15), &["KESI"]);
    assert_refused(&with(b"KESH", 13, f64::NAN), &["KESH[component 0, mean]", "a finite number"]);
    let id = |tag: &[u8; 4], at: usize, id: u32| {
        edited(&bytes, tag, |s| s.content[4 * at..4 * at + 4].copy_from_slice(&id.to_le_bytes()))
    };
    assert_refused(&id(b"KETI", 0, 3), &["KETI", "ascending"]);
    assert_refused(&id(b"KETI", 2, 20), &["KETI", "below 20"]);
    assert_refused(&id(b"KESI", 3, 99), &["KESI", "below 20"]);
    // A negative second moment.
    assert_refused(&id(b"KETS", 42 + 4, u32::MAX), &["KETS[component 3, xx]", "0 or more"]);
}
