//! The viewport's renderers, comparisons, colours and dataset cameras, drawn by CPU and GPU.

use super::harness::{
    Window, click, dataset, drag, drag_between, train, wait, wait_for_label, wait_for_picture,
    window,
};
use crate::common::adapter::turn;
use eframe::egui::accesskit::Role;
use eframe::egui::{Key, PointerButton, Pos2, Vec2};
use egui_kittest::kittest::Queryable;
use std::path::Path;
use std::sync::Arc;
use vbgs_studio::app::Painting;
use vbgs_studio::app::state::Subject;
use vbgs_studio::app::viewer::toolbar::ViewMode;
use vbgs_studio::dataset::{self, LoadOptions};
use vbgs_studio::eval::choices::{GroundTruth, ViewPoses};
use vbgs_studio::eval::report::ViewReport;
use vbgs_studio::eval::views::{EvalOptions, evaluate};
use vbgs_studio::pipeline::plan::Selection;
use vbgs_studio::pipeline::session::{Session, Step};
use vbgs_studio::pipeline::settings::scene::SceneOverrides;
use vbgs_studio::render::{Lens, RenderMethod, RenderOptions, Renderer};

/// Opens the window on a small dataset in `folder` and trains it.
fn trained(folder: &Path, painting: Painting) -> Option<Window> {
    let path = folder.join("room");
    let path = if path.exists() { path } else { dataset(folder, 3) };
    let mut window = window(Some(Subject::Path(path)), painting)?;
    train(&mut window);
    wait(&mut window, "splats", |s| s.n_drawn() > 100);
    wait_for_picture(&mut window);
    Some(window)
}

/// Presses a key and runs two passes.
pub fn press(window: &mut Window, key: Key) {
    window.key_press(key);
    window.run_steps(2);
}

/// Opens a menu of the toolbar. Its button appends what is chosen to the name.
pub fn open_menu(window: &mut Window, name: &str) {
    window.run_steps(2);
    let with_choice = format!("{name}: ");
    let is_it = |label: &str| label == name || label.starts_with(&with_choice);
    window.get_by(|node| node.label().is_some_and(|label| is_it(&label))).click();
    window.run_steps(2);
}

/// Chooses an entry of one of the menus above the viewport: compare, show, render.
pub fn choose(window: &mut Window, menu: usize, entry: &str) {
    open_menu(window, ["Compare", "Show", "Render"][menu]);
    window.get_by_role_and_label(Role::Button, entry).click();
    window.run_steps(2);
}

fn renderer(window: &Window) -> Renderer {
    window.state().view().settings.renderer
}

#[test]
fn tab_toggles_the_renderer_unless_the_lens_is_a_fisheye() {
    let _turn = turn();
    let folder = tempfile::tempdir().unwrap();
    let Some(mut window) = trained(folder.path(), Painting::Auto) else { return };
    assert_eq!(renderer(&window), Renderer::Projected);
    press(&mut window, Key::Tab);
    assert_eq!(renderer(&window), Renderer::Exact);
    // This key would have no effect if Tab had moved the focus to a button.
    press(&mut window, Key::Tab);
    assert_eq!(renderer(&window), Renderer::Projected);

    choose(&mut window, 0, "Wipe renderers");
    open_menu(&mut window, "Render");
    click(&mut window, "Fisheye");
    press(&mut window, Key::Escape);
    let view = window.state().view();
    assert_eq!((view.settings.lens, view.settings.renderer), (Lens::Fisheye, Renderer::Exact));
    assert_eq!(
        view.comparison.mode(),
        ViewMode::Single,
        "the projected renderer cannot be compared"
    );
    press(&mut window, Key::Tab);
    assert_eq!(renderer(&window), Renderer::Exact);
    wait_for_label(
        &mut window,
        "Only the exact renderer supports a fisheye: choose the pinhole first",
    );
}

#[test]
fn renderers_are_timed_and_compared_and_the_divider_is_dragged() {
    let _turn = turn();
    let folder = tempfile::tempdir().unwrap();
    for (painting, stage) in [(Painting::Auto, "Picture (CPU)"), (Painting::Gpu, "Uploaded, KiB")] {
        let Some(mut window) = trained(folder.path(), painting) else { return };
        click(&mut window, "Latency");
        wait_for_label(&mut window, stage);
        assert_eq!(window.query_by_label("Uploaded, KiB").is_some(), painting == Painting::Gpu);
        press(&mut window, Key::CloseBracket);
        choose(&mut window, 0, "Wipe renderers");
        assert_eq!(window.state().view().comparison.mode(), ViewMode::Wipe);
        window.run_steps(2);
        let left = window.get_all_by_label("Projected").last().unwrap().rect();
        let right = window.get_all_by_label("Exact").last().unwrap().rect();
        let middle = Pos2::new(0.5 * (left.left() + right.right()), 300.0);
        drag_between(&mut window, PointerButton::Primary, middle, middle - Vec2::new(120.0, 0.0));
        let view = window.state().view();
        let moved = 0.5 - view.comparison.divider;
        let expected = 120.0 / (right.right() - left.left());
        assert!((moved - expected).abs() < 0.1 * expected, "{moved} for {expected}");
        assert!(view.camera.frame_ref().is_some(), "dragging the divider does not turn the camera");
        wait_for_picture(&mut window);

        choose(&mut window, 0, "Renderer difference");
        wait_for_label(&mut window, "|Projected − exact| × 8");
        window.set_size(Vec2::new(700.0, 420.0));
        window.run_steps(3);
        window.render().unwrap();
        // Without room for the viewport nothing is drawn, and no error occurs.
        window.set_size(Vec2::new(240.0, 60.0));
        window.run_steps(3);
        assert!(window.state().snapshot().notices.is_empty());
    }
}

/// Trains the same scene as the window, without a window.
pub fn session(path: &Path, overrides: SceneOverrides) -> Session {
    let dataset = Arc::new(dataset::open(path, &LoadOptions::default()).unwrap());
    let mut session = Session::new(dataset, overrides, Selection::all_frames()).unwrap();
    while !matches!(session.step().unwrap(), Step::Finished) {}
    session
}

/// Split and index of the dataset camera of the view, if any.
pub fn position(window: &Window) -> Option<(usize, usize)> {
    window.state().view().camera.frame_ref().map(|frame| frame.position())
}

/// PSNR label that `eval` would print for a view (split and index) with these render options.
pub fn evaluated(session: &Session, view: (usize, usize), render: RenderOptions) -> String {
    format!("PSNR {:.2} dB", measured(session, view, render).psnr)
}

/// Measures a view with the default settings of `eval`.
pub fn evaluated_on_black(session: &Session, view: (usize, usize)) -> ViewReport {
    measured(session, view, RenderOptions::evaluation(RenderMethod::PROJECTED, [0.0; 3]))
}

fn measured(session: &Session, view: (usize, usize), render: RenderOptions) -> ViewReport {
    let (split, index) = view;
    let color_camera = session.config().method.as_any().color_camera();
    let poses = ViewPoses::Corrected;
    let options =
        EvalOptions { color_camera, poses, ..EvalOptions::plain(GroundTruth::Composited, render) };
    let views = [index];
    let (_, mut scores) =
        evaluate(&session.splats(), session.dataset(), split, &views, &options, |_| {}).unwrap();
    scores.remove(0)
}

#[test]
fn photographs_are_stepped_through_and_measured_as_eval_does() {
    let _turn = turn();
    let folder = tempfile::tempdir().unwrap();
    let Some(mut window) = trained(folder.path(), Painting::Auto) else { return };
    let session = session(&folder.path().join("room"), SceneOverrides::default());
    press(&mut window, Key::CloseBracket);
    assert_eq!(position(&window), Some((0, 0)));
    window.get_by_label("Camera 1 of 4");
    press(&mut window, Key::ArrowRight);
    window.get_by_label("Camera 2 of 4");

    press(&mut window, Key::G);
    assert_eq!(window.state().view().comparison.mode(), ViewMode::PhotoWipe);
    let options = window.state().view().settings.measured();
    for key in [Key::ArrowLeft, Key::OpenBracket] {
        let expected = evaluated(&session, position(&window).unwrap(), options);
        wait_for_label(&mut window, &expected);
        assert_eq!(window.get_all_by_label("Photograph").count(), 2, "summary and caption");
        press(&mut window, key);
    }
    window.get_by_label("Camera 4 of 4");
    choose(&mut window, 0, "Photograph difference");
    wait_for_label(&mut window, "|Scene − photograph| × 8");

    drag(&mut window, PointerButton::Primary);
    assert_eq!(position(&window), None, "turning leaves the dataset's camera");
    window.get_by_label("Free camera");
    window.get_by_label("No photograph from this viewpoint: press [ or ] to go to one");
    press(&mut window, Key::CloseBracket);
    window.get_by_label("Camera 4 of 4");
    press(&mut window, Key::G);
    assert_eq!(window.state().view().comparison.mode(), ViewMode::Single);
    assert!(window.query_by_label_contains("PSNR").is_none());
}
