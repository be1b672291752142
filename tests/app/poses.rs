//! The window warns if poses do not follow the layout's convention.

use super::harness::{click, dataset, is, wait, window};
use crate::common::adapter::turn;
use crate::common::scratch::edit_json;
use egui_kittest::kittest::Queryable;
use vbgs_studio::app::Painting;
use vbgs_studio::app::state::{NoticeKind, Subject};

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
        let Some(mut window) = window(Some(Subject::Path(room)), Painting::Auto) else { return };
        wait(&mut window, "ready", is(vbgs_studio::app::state::RunState::Ready));
        wait(&mut window, "the check", |s| s.snapshot().sampling.poses.is_some());
        click(&mut window, "Scene");
        let agreement = "of depth agrees with neighbouring frames (opengl)";
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
    }
}
