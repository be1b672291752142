//! The window warns if poses do not follow the layout's convention.

use super::harness::{click, copied, dataset, drop_on, is, press_in_dialog, wait, window};
use crate::common::adapter::turn;
use crate::common::scratch::edit_json;
use egui_kittest::kittest::Queryable;
use vbgs_studio::app::state::{NoticeKind, RunState, Subject};
use vbgs_studio::app::{Painting, Studio};
use vbgs_studio::dataset::PoseConvention;

#[test]
fn poses_are_checked_beside_training_and_doubts_are_told() {
    let _turn = turn();
    for is_wrong in [false, true] {
        let folder = tempfile::tempdir().unwrap();
        let room = dataset(folder.path(), 8);
        if is_wrong {
            // Camera axes with y down and z forward; the layout has y up and z back.
            edit_json(&room.join("transforms_train.json"), |json| {
                for frame in json["frames"].as_array_mut().unwrap() {
                    for row in frame["transform_matrix"].as_array_mut().unwrap() {
                        for column in [1, 2] {
                            row[column] = (-row[column].as_f64().unwrap()).into();
                        }
                    }
                }
            });
        }
        let subject = Subject::Path(room.clone());
        let Some(mut window) = window(Some(subject), Painting::Auto) else { return };
        wait(&mut window, "ready", is(RunState::Ready));
        wait(&mut window, "the check", |s| s.snapshot().sampling.poses.is_some());
        click(&mut window, "Summary");
        let agreement = "of depth agrees with neighbouring frames";
        assert!(window.query_all_by_label_contains(agreement).count() > 0);
        let snapshot = window.state().snapshot();
        let told = snapshot.notices.iter().filter(|n| n.kind == NoticeKind::Warning);
        let told: Vec<&str> = told.map(|n| n.text.as_str()).collect();
        let doubted =
            told.iter().any(|text| text.contains("poses match opencv, but the layout has opengl"));
        assert_eq!(doubted, is_wrong, "{told:?}");
        // Shown in the panel, and over the viewport until dismissed.
        let shown = window
            .query_all_by_label_contains("poses match opencv, but the layout has opengl")
            .count();
        assert!(if is_wrong { shown >= 2 } else { shown == 0 }, "{shown}");
        assert_eq!(window.query_by_label("Open as…").is_some(), is_wrong);
        if !is_wrong {
            continue;
        }
        // The offer opens the dataset with the axes that fit, and the next opening too.
        click(&mut window, "Open as…");
        let opened = |s: &Studio| s.snapshot().opened.as_ref().map_or(0, |opened| opened.serial);
        let before = opened(window.state());
        press_in_dialog(&mut window, "Open");
        for path in [None, Some(&room)] {
            if let Some(path) = path {
                drop_on(&mut window, path);
            }
            wait(&mut window, "the dataset again", |s| {
                let snapshot = s.snapshot();
                let check = snapshot.sampling.poses.as_ref();
                let fits = check.is_some_and(|check| {
                    check.opened.poses == PoseConvention::Opencv && check.warnings().is_empty()
                });
                opened(s) > before && is(RunState::Ready)(s) && fits
            });
        }
        click(&mut window, "Settings");
        let line = copied(&mut window, "Copy as command line");
        assert!(line.contains("--pose-axes opencv"), "{line}");
    }
}
