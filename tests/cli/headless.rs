//! Without a display the demo is trained all the same.

use super::runner::{Run, Scratch};

#[test]
fn the_demo_trains_without_a_display() {
    let scratch = Scratch::empty();
    let mut command = scratch.command(&[]);
    for display in ["DISPLAY", "WAYLAND_DISPLAY", "WAYLAND_SOCKET"] {
        command.env_remove(display);
    }
    let run = Run::from(command.output().unwrap()).succeeds();
    let lines: Vec<&str> = run.stdout.lines().collect();
    assert_eq!(lines.len(), 2, "{}", run.stdout);
    assert!(lines[0].contains("headless into vbgs-demo/"), "{}", lines[0]);
    let report = scratch.json("vbgs-demo/report.json");
    assert_eq!(report["format"], "vbgs-report/1");
    assert_eq!(report["dataset"]["layout"], "synthetic");
    assert_eq!(report["machine"]["adapter"], serde_json::Value::Null);
    let used = report["summary"]["used"].as_u64().unwrap();
    for file in ["vbgs-demo/scene.ply", "vbgs-demo/scene.glb"] {
        assert_eq!(scratch.model(file).splats.len() as u64, used, "{file}");
    }
    let preview = image::open(scratch.path("vbgs-demo/preview.png")).unwrap().into_rgb8();
    assert_eq!(preview.dimensions(), (320, 240));
    let dark = preview.pixels().filter(|p| p.0.iter().all(|&v| v < 8)).count();
    assert!(dark * 10 < 320 * 240, "{dark} pixels of the preview show nothing");
}
