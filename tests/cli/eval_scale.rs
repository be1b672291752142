//! Comparing at a fraction of the photographs' size.

use super::runner::Scratch;

#[test]
fn views_are_compared_at_a_fraction_of_their_size_and_say_so() {
    let scratch = Scratch::with_scene();
    let eval = |scale: &str| {
        let run = scratch.run(&format!("eval out/scene.ply room --eval-scale {scale} --json"));
        run.succeeds().json()["eval"][0].clone()
    };
    let (full, half) = (eval("1"), eval("0.5"));
    assert_eq!((&full["scale"], &half["scale"]), (&1.0.into(), &0.5.into()));
    let number = |report: &serde_json::Value, name: &str| report[name].as_f64().unwrap();
    // Averaging takes away noise and texture that splats lack, and leaves the shapes.
    assert!(number(&half, "psnr_mean") > number(&full, "psnr_mean") + 0.1, "{full} {half}");
    for name in ["coverage_mean", "depth_mae_mean"] {
        let (full, half) = (number(&full, name), number(&half, name));
        assert!((full - half).abs() < 0.1 * full.max(0.01), "{name}: {full} and {half}");
    }
    let said = scratch.run("eval out/scene.ply room --eval-scale 0.5").succeeds().stdout;
    assert!(said.contains("at 0.5 of the photographs' size"), "{said}");
    let said = scratch.run("eval out/scene.ply room").succeeds().stdout;
    assert!(!said.contains("photographs' size"), "{said}");

    let train = "train room --out on --max-frames 2 --eval eval --eval-scale 0.75";
    let said = scratch.run(train).succeeds().stdout;
    assert!(said.contains("at 0.75 of the photographs' size"), "{said}");
    assert_eq!(scratch.json("on/report.json")["eval"][0]["scale"], 0.75);
}

#[test]
fn nonsense_is_refused() {
    let scratch = Scratch::with_scene();
    for scale in ["0", "-1", "1.5", "nan", "half"] {
        let run = scratch.run(&format!("eval out/scene.ply room --eval-scale {scale}"));
        assert_eq!(run.code, 2, "{scale}");
        assert!(run.stderr.contains("above 0 and at most 1"), "{}", run.stderr);
    }
    let tiny = scratch.run("eval out/scene.ply room --eval-scale 0.1");
    tiny.fails(1, &["at least 11x11 pixels, found 6x5"]);
}
