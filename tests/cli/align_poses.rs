//! `eval --align-poses`: refines each view's camera pose against its photograph before scoring.

use super::runner::Scratch;
use serde_json::Value;

/// Shifts the cameras of the evaluation views along x, in world units.
fn move_views(scratch: &Scratch, by: f64) {
    let path = scratch.path("room/transforms_eval.json");
    let mut list: Value = serde_json::from_slice(&std::fs::read(&path).unwrap()).unwrap();
    for frame in list["frames"].as_array_mut().unwrap() {
        let x = &mut frame["transform_matrix"][0][3];
        *x = (x.as_f64().unwrap() + by).into();
    }
    std::fs::write(&path, list.to_string()).unwrap();
}

#[test]
fn wrong_poses_are_told_from_wrong_pictures() {
    let scratch = Scratch::empty();
    scratch.run("synth room --size 160x120 --frames 8 --eval-frames 2").succeeds();
    scratch.run("train room --out out").succeeds();
    let eval = |more: &str| {
        scratch.run(&format!("eval out/scene.ply room --json {more}")).succeeds().json()
    };
    let (plain, right) = (eval(""), eval("--align-poses"));
    let number = |found: &Value, name: &str| found["eval"][0][name].as_f64().unwrap();
    let aligned =
        |found: &Value, name: &str| found["eval"][0]["pose_aligned_mean"][name].as_f64().unwrap();
    assert_eq!(number(&plain, "psnr_mean"), number(&right, "psnr_mean"), "plain scores stay");
    assert!(plain["eval"][0].get("pose_aligned_mean").is_none(), "only with --align-poses");
    move_views(&scratch, 0.06);
    let wrong = eval("--align-poses");
    assert!(number(&wrong, "psnr_mean") < number(&right, "psnr_mean") - 0.5, "{wrong}");
    let mended = aligned(&wrong, "psnr_aligned_covered");
    assert!(mended > number(&wrong, "psnr_aligned_covered_mean") + 0.1, "{wrong}");
    assert!(aligned(&wrong, "shift") > 0.005, "{wrong}");
    assert_eq!(wrong["views"][0]["pose_aligned"]["bands"].as_array().unwrap().len(), 4);
    let said = scratch.run("eval out/scene.ply room --align-poses").succeeds().stdout;
    assert!(said.contains("poses aligned to their photographs (moved by 0.0"), "{said}");
    // A line per view, the line of aligned colours and that of aligned poses.
    assert_eq!(said.matches(", detail ").count(), 4, "{said}");
}
