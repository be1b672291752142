//! Without a display the demo still trains.

use super::runner::{Run, Scratch};

fn run_without_display(scratch: &Scratch, arguments: &[&str]) -> Run {
    let mut command = scratch.command(arguments);
    for display in ["DISPLAY", "WAYLAND_DISPLAY", "WAYLAND_SOCKET"] {
        command.env_remove(display);
    }
    Run::from(command.output().unwrap())
}

/// A path on the command line opens a window; without a display the error names the commands to use.
#[test]
fn a_path_needs_a_display() {
    let scratch = Scratch::with_scene();
    let code = if cfg!(feature = "gui") { 1 } else { 2 };
    if cfg!(feature = "gui") {
        run_without_display(&scratch, &["no.ply"]).fails(1, &["no.ply", "nothing there"]);
    }
    let parts = ["scene.ply", "no ", "`train`", "`eval`", "`render`", "`export`", "`info`"];
    run_without_display(&scratch, &["out/scene.ply"]).fails(code, &parts);
    assert!(!scratch.path("vbgs-demo").exists());
}

#[test]
fn the_demo_trains_without_a_display() {
    let scratch = Scratch::empty();
    let run = run_without_display(&scratch, &[]).succeeds();
    let lines: Vec<&str> = run.stdout.lines().collect();
    assert_eq!(lines.len(), 2, "{}", run.stdout);
    assert!(lines[0].contains("headless into vbgs-demo/"), "{}", lines[0]);
    let report = scratch.json("vbgs-demo/report.json");
    assert_eq!(report["format"], "vbgs-report/1");
    assert_eq!(report["dataset"]["layout"], "synthetic");
    assert_eq!(report["machine"]["adapter"], serde_json::Value::Null);
    let used = report["summary"]["used"].as_u64().unwrap();
    for file in ["vbgs-demo/scene.ply", "vbgs-demo/scene.glb"] {
        let drawn = scratch.model(file).splats.len() as u64;
        // Splats with a texture become several.
        assert!(drawn >= used / 2, "{file}: {drawn} of {used}");
    }
    let preview = image::open(scratch.path("vbgs-demo/preview.png")).unwrap().into_rgb8();
    assert_eq!(preview.dimensions(), (320, 240));
    let dark = preview.pixels().filter(|p| p.0.iter().all(|&v| v < 8)).count();
    assert!(dark * 10 < 320 * 240, "{dark} pixels of the preview are dark");
}
