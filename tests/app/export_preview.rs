//! The export preview: appearance and losses of a file before it is written.

use super::harness::{
    PATIENCE, Window, clear_view, click, dataset, enter_path, press_in_dialog, train, wait, window,
};
use crate::common::adapter::turn;
use eframe::egui::{Key, Modifiers};
use egui_kittest::kittest::Queryable;
use std::sync::Arc;
use std::time::{Duration, Instant};
use vbgs_studio::app::Painting;
use vbgs_studio::app::state::Subject;
use vbgs_studio::app::viewer::export_preview::PreviewReport;
use vbgs_studio::app::viewer::toolbar::ViewMode;
use vbgs_studio::export;

/// Waits for the PSNR of the view; returns the file's size in bytes, the PSNR and the losses.
fn measured(window: &mut Window) -> (u64, f64, Vec<String>) {
    let started = Instant::now();
    loop {
        window.step();
        let report = window.state().view().comparison.export_preview_report();
        if let Some(PreviewReport::Shown { bytes, psnr: Some(psnr), losses, .. }) = report {
            return (bytes, psnr, losses);
        }
        assert!(started.elapsed() < PATIENCE, "nothing is measured: {report:?}");
        std::thread::sleep(Duration::from_millis(10));
    }
}

#[test]
fn a_file_is_seen_and_measured_before_it_is_written() {
    let _turn = turn();
    let folder = tempfile::tempdir().unwrap();
    let path = dataset(folder.path(), 3);
    let Some(mut window) = window(Some(Subject::Path(path)), Painting::Auto) else { return };
    train(&mut window);
    wait(&mut window, "splats", |s| s.n_drawn() > 100);
    clear_view(&mut window);
    assert!(window.state().view().comparison.export_preview_report().is_none());

    window.key_press_modifiers(Modifiers::COMMAND, Key::E);
    window.run_steps(2);
    let ply = folder.path().join("scene.ply");
    enter_path(&mut window, &ply);
    let (ply_bytes, ply_psnr, losses) = measured(&mut window);
    let view = window.state().view();
    assert_eq!(view.comparison.mode(), ViewMode::ModelWipe);
    let shown = view.comparison.model().unwrap().clone();
    assert_eq!(shown.name, "As .ply file");
    // The preview is not a second model and cannot be removed as one.
    assert!(view.comparison.remove_unavailable_reason().is_some_and(|why| why.contains("preview")));
    assert!((10.0..80.0).contains(&ply_psnr), "{ply_psnr} dB for a scene with colour gradients");
    assert!(losses.iter().any(|loss| loss.contains("Colour gradients")), "{losses:?}");
    window.get_by_label_contains("PSNR against the scene");

    // Another format triggers a new conversion.
    enter_path(&mut window, &folder.path().join("scene.spz"));
    wait(&mut window, "the other file", |s| {
        s.view().comparison.model().is_some_and(|model| model.name == "As .spz file")
    });
    let (spz_bytes, _, losses) = measured(&mut window);
    assert!(spz_bytes < ply_bytes, "{spz_bytes} after {ply_bytes}");
    assert!(losses.iter().any(|loss| loss.starts_with("SPZ quantises")), "{losses:?}");

    click(&mut window, "SPZ 2");
    wait(&mut window, "the other version", |s| {
        let report = s.view().comparison.export_preview_report();
        let rounds = |loss: &String| loss.starts_with("SPZ version 2 rounds rotations");
        matches!(report, Some(PreviewReport::Shown { losses, .. }) if losses.iter().any(rounds))
    });

    // Switching the preview off restores the previous view mode.
    click(&mut window, "Preview the file");
    wait(&mut window, "no preview", |s| s.view().comparison.export_preview_report().is_none());
    let view = window.state().view();
    assert_eq!(
        (view.comparison.mode(), view.comparison.model().is_none()),
        (ViewMode::Single, true)
    );
    assert_eq!(view.comparison.remove_unavailable_reason(), Some("No second model is open"));
    click(&mut window, "Preview the file");
    enter_path(&mut window, &ply);
    let again = |s: &vbgs_studio::app::Studio| {
        s.view().comparison.model().is_some_and(|model| model.name == "As .ply file")
    };
    wait(&mut window, "the preview again", again);

    // The file holds the previewed splats.
    press_in_dialog(&mut window, "Export");
    wait(&mut window, "the file", |s| s.snapshot().files.unsaved_frames == 0);
    let file = export::read(&ply).unwrap();
    assert!(file.splats == shown.splats, "the file differs from the preview");
    wait(&mut window, "no preview", |s| s.view().comparison.export_preview_report().is_none());
    assert_eq!(window.state().view().comparison.mode(), ViewMode::Single);
    assert_eq!(Arc::strong_count(&shown), 1, "the preview's splats are still referenced");
}
