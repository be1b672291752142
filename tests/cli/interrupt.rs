//! Ctrl-C during training finishes the frame, writes the files and ends with status 130.

use super::runner::{Run, Scratch, end, signal};

#[test]
fn ctrl_c_keeps_the_scene() {
    let scratch = Scratch::empty();
    // Dense candidates and many components: about a second a frame, enough time to interrupt.
    scratch.run("synth room --size 64x48 --frames 100 --eval-frames 1").succeeds();
    let run = interrupted_after_the_first_frame(&scratch);
    assert_eq!(run.code, 130, "{}", run.stderr);
    assert!(!run.stderr.contains("error"), "{}", run.stderr);
    let report = scratch.json("out/report.json");
    let n_frames = report["frames"].as_array().unwrap().len();
    assert!((1..100).contains(&n_frames), "{n_frames} frames were trained");
    assert_eq!(report["dataset"]["frames"], 100);
    let used = report["summary"]["used"].as_u64().unwrap();
    assert_eq!(scratch.model("out/scene.ply").splats.len() as u64, used);
    assert_eq!(report["frames"][n_frames - 1]["used"], used);
    assert_eq!(report["eval"], serde_json::json!([]), "no evaluation after Ctrl-C");
    scratch.run("eval out/scene.ply room").succeeds();
    let info = scratch.run("info out/checkpoint.vbgs --json").succeeds().json();
    assert_eq!((&info["frames"], &info["planned_frames"]), (&n_frames.into(), &100.into()));
    let options = format!("--resume out/checkpoint.vbgs --max-frames {}", n_frames + 1);
    scratch.run(&format!("train room --out on {options}")).succeeds();
    let frames = scratch.json("on/report.json")["frames"].clone();
    assert_eq!(frames.as_array().unwrap().len(), n_frames + 1);
}

/// The first autosave shows that a frame is trained and that the signal handler is installed.
fn interrupted_after_the_first_frame(scratch: &Scratch) -> Run {
    let train = "train room --out out --preset paper --set components=20000 --set candidates=dense";
    let child = scratch.start(&format!("{train} --eval eval --set autosave=1"));
    scratch.wait_for("out/checkpoint.vbgs");
    signal("INT", &child);
    end(child)
}
