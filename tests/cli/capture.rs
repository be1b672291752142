//! Capture warnings of `info`: blurred frames, brightness jumps and gaps in time.

use super::runner::Scratch;
use image::RgbImage;
use serde_json::Value;

fn room(scratch: &Scratch, layout: &str) {
    let synth = format!("synth room --layout {layout} --size 160x120 --frames 24 --eval-frames 0");
    scratch.run(&synth).succeeds();
}

fn edit(scratch: &Scratch, file: &str, edit: impl FnOnce(RgbImage) -> RgbImage) {
    let path = scratch.path(file);
    edit(image::open(&path).unwrap().into_rgb8()).save(&path).unwrap();
}

/// Frame names in the capture report of one kind.
fn found(info: &Value, kind: &str) -> Vec<String> {
    let list = info["splits"][0]["capture"][kind].as_array().unwrap();
    list.iter().map(|one| one["frame"].as_str().unwrap().to_owned()).collect()
}

#[test]
fn what_is_wrong_with_a_recording_is_named_and_nothing_else() {
    let scratch = Scratch::empty();
    room(&scratch, "tum");
    let clean = scratch.run("info room --json").succeeds().json();
    for kind in ["blurred", "brightness_jumps", "gaps"] {
        assert_eq!(found(&clean, kind), [""; 0], "{kind}: {clean}");
    }
    let text = std::fs::read_to_string(scratch.path("room/rgb.txt")).unwrap();
    let files: Vec<String> = text
        .lines()
        .filter(|line| !line.starts_with('#'))
        .map(|line| line.split_whitespace().nth(1).unwrap().to_owned())
        .collect();
    edit(&scratch, &format!("room/{}", files[9]), |picture| image::imageops::blur(&picture, 2.5));
    for file in &files[16..] {
        edit(&scratch, &format!("room/{file}"), |mut picture| {
            picture.iter_mut().for_each(|value| *value = (f32::from(*value) * 0.6) as u8);
            picture
        });
    }
    let info = scratch.run("info room --json").succeeds().json();
    let name = |i: usize| files[i].trim_start_matches("rgb/").trim_end_matches(".png");
    assert_eq!(found(&info, "blurred"), [name(9)], "{}", info["splits"][0]["capture"]);
    assert_eq!(found(&info, "brightness_jumps"), [name(16)], "{}", info["splits"][0]["capture"]);
    let said = scratch.run("info room").succeeds().stdout;
    assert!(said.contains("24 of 24 frames checked, 1 blurred, 1 jumps of brightness"), "{said}");
    assert!(said.contains("frames a second, 0 gaps"), "{said}");
}

#[test]
fn frames_that_are_missing_leave_a_gap() {
    let scratch = Scratch::empty();
    room(&scratch, "tum");
    for list in ["rgb.txt", "depth.txt", "groundtruth.txt"] {
        let path = scratch.path("room").join(list);
        let text = std::fs::read_to_string(&path).unwrap();
        let (comments, rows): (Vec<&str>, Vec<&str>) =
            text.lines().partition(|line| line.starts_with('#'));
        let kept = rows.iter().enumerate().filter(|(i, _)| !(10..14).contains(i)).map(|(_, r)| *r);
        let text: Vec<&str> = comments.into_iter().chain(kept).collect();
        std::fs::write(&path, text.join("\n")).unwrap();
    }
    let info = scratch.run("info room --json").succeeds().json();
    let gaps = &info["splits"][0]["capture"]["gaps"];
    assert_eq!(gaps.as_array().unwrap().len(), 1, "{gaps}");
    let usual = info["splits"][0]["capture"]["usual_step_s"].as_f64().unwrap();
    assert!((gaps[0]["seconds"].as_f64().unwrap() / usual - 5.0).abs() < 0.1, "{gaps}");
}
