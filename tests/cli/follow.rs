//! `train --follow` beside a recorder (`synth --live`).

use super::runner::{Scratch, end, signal};
use crate::common::layouts::TestLayout;
use crate::common::silent::{SilentFile, image_of_holes};
use serde_json::Value;
use std::fs;
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::time::{Duration, Instant};

/// Longest time a program may take to end after a signal; far shorter than a drive's timeout.
const AT_ONCE: Duration = Duration::from_secs(10);

const TRAIN: &str = "train room --out out --preset paper --set components=500";

fn names(report: &Value) -> Vec<&str> {
    let frames = report["frames"].as_array().unwrap();
    frames.iter().map(|frame| frame["frame"].as_str().unwrap()).collect()
}

/// Moves the frames from number `first` on out of a 7-Scenes folder, or back.
fn move_frames(from: &Path, to: &Path, first: usize) {
    fs::create_dir_all(to).unwrap();
    for entry in fs::read_dir(from).unwrap() {
        let name = entry.unwrap().file_name().into_string().unwrap();
        let number: usize = name["frame-".len()..][..6].parse().unwrap();
        if number >= first {
            fs::rename(from.join(&name), to.join(&name)).unwrap();
        }
    }
}

#[test]
fn a_recording_is_learnt_while_it_is_written() {
    let scratch = Scratch::empty();
    // Starts before the folder exists.
    let train = scratch.start(&format!("{TRAIN} --follow --eval held-out"));
    let size = "--size 48x36 --frames 20 --eval-frames 0";
    let synth = scratch.run(&format!("synth room --layout tum --live 30 {size}")).succeeds();
    assert!(synth.stdout.contains("recorded 20 frames"), "{}", synth.stdout);
    let run = end(train).succeeds();
    assert!(run.stderr.contains("note: following room, until recording.done"), "{}", run.stderr);
    assert!(!run.stderr.contains("warning"), "{}", run.stderr);
    let report = scratch.json("out/report.json");
    assert_eq!(report["config"]["follow"], true);
    assert_eq!(report["skipped"], serde_json::json!([]));
    assert_eq!(
        (&report["dataset"]["frames"], &report["eval"][0]["views"]),
        (&17.into(), &3.into())
    );
    assert!(
        report["frames"].as_array().unwrap().iter().all(|f| f["behind_ms"].as_f64() > Some(0.0))
    );
    // Training after the recording ended uses the same frames. Only the centre of the model
    // differs, because more frames are known.
    scratch.run(&TRAIN.replace("out out", "out after")).succeeds();
    let after = scratch.json("after/report.json");
    assert_eq!(names(&report), names(&after));
    assert_eq!(after["config"]["follow"], Value::Null);
    assert_eq!(after["frames"][0]["behind_ms"], Value::Null);
}

#[test]
#[cfg(unix)]
fn ctrl_c_ends_it_and_a_later_run_goes_on() {
    let scratch = Scratch::empty();
    let size = "--size 48x36 --frames 12 --eval-frames 0";
    scratch.run(&format!("synth room --layout seven-scenes {size}")).succeeds();
    let (frames, later) = (scratch.path("room/train"), scratch.path("later"));
    move_frames(&frames, &later, 7);
    let train = scratch.start(&format!("{TRAIN} --follow --set autosave=6"));
    scratch.wait_for("out/checkpoint.vbgs");
    signal("INT", &train);
    let run = end(train);
    assert_eq!(run.code, 130, "{}", run.stderr);
    let report = scratch.json("out/report.json");
    assert_eq!(names(&report).len(), 6, "all but the first of seven frames");
    assert!(scratch.path("out/scene.ply").exists());

    // The recording has grown: a followed run resumes on it, with or without `--follow`.
    move_frames(&later, &frames, 0);
    let go_on = "train room --resume out/checkpoint.vbgs";
    scratch.run(&format!("{go_on} --out opened")).succeeds();
    let opened = scratch.json("opened/report.json");
    assert_eq!(names(&opened).len(), 10, "the ninth is held out");
    fs::write(scratch.path("room/recording.done"), "").unwrap();
    scratch.run(&format!("{go_on} --out followed --follow")).succeeds();
    assert_eq!(names(&scratch.json("followed/report.json")), names(&opened));
    assert_eq!(scratch.bytes("followed/scene.ply"), scratch.bytes("opened/scene.ply"));

    // A different recording is not a grown one.
    scratch.run(&format!("synth other --layout seven-scenes --seed 5 {size}")).succeeds();
    fs::write(scratch.path("other/recording.done"), "").unwrap();
    let other = "train other --resume out/checkpoint.vbgs --out no --follow";
    scratch.run(other).fails(1, &["expected the dataset it was trained on"]);
}

/// Without a trained frame there is nothing to save, so Ctrl-C ends the run at once.
#[test]
#[cfg(target_os = "linux")]
fn ctrl_c_ends_what_waits_for_a_drive_that_does_not_answer() {
    let scratch = Scratch::empty();
    let size = "--size 48x36 --frames 6 --eval-frames 0";
    scratch.run(&format!("synth room --layout seven-scenes {size}")).succeeds();
    let (frames, later) = (scratch.path("room/train"), scratch.path("later"));
    // The first frame is held out and the second has no depth, so training cannot begin.
    move_frames(&frames, &later, 2);
    let hole = frames.join("frame-000001.depth.png");
    fs::write(&hole, image_of_holes(48, 36)).unwrap();
    let mut followed = scratch.start("train room --out out --follow");
    let mut said = BufReader::new(followed.stderr.take().unwrap()).lines();
    let is_waiting = said.any(|line| line.unwrap().starts_with("note: waiting: "));
    assert!(is_waiting, "no note about a frame without depth");
    let Some(_silent) = SilentFile::hold(&scratch.path("."), &hole) else {
        signal("INT", &followed);
        end(followed);
        return;
    };
    move_frames(&later, &frames, 0);
    let opened = scratch.start("train room --out out");
    std::thread::sleep(Duration::from_secs(2));
    for mut child in [followed, opened] {
        assert!(child.try_wait().unwrap().is_none(), "it ended too early");
        signal("INT", &child);
        let asked = Instant::now();
        let run = end(child);
        assert!(asked.elapsed() < AT_ONCE, "{:?}: {}", asked.elapsed(), run.stderr);
        assert_eq!(run.code, 130, "{}", run.stderr);
    }
}

/// The split of the first frames stays the one to train on, also where the dataset's default is another
/// one that appears later.
#[test]
#[cfg(unix)]
fn splits_that_appear_later_do_not_replace_the_followed_one() {
    let scratch = Scratch::empty();
    let size = "--size 48x36 --frames 12 --eval-frames 2";
    scratch.run(&format!("synth room --layout seven-scenes {size}")).succeeds();
    let (train, walk) = (scratch.path("room/train"), scratch.path("room/walk"));
    let (eval, later) = (scratch.path("room/eval"), scratch.path("later"));
    fs::rename(&train, &walk).unwrap();
    fs::rename(&eval, &later).unwrap();
    move_frames(&walk, &scratch.path("rest"), 8);
    let followed = scratch.start(&format!("{TRAIN} --follow --set autosave=4"));
    scratch.wait_for("out/checkpoint.vbgs");
    fs::rename(scratch.path("rest"), &train).unwrap();
    fs::rename(&later, &eval).unwrap();
    fs::write(scratch.path("room/recording.done"), "").unwrap();
    end(followed).succeeds();
    let report = scratch.json("out/report.json");
    let learned = names(&report);
    assert!(learned.iter().all(|name| name.starts_with("walk/")), "{learned:?}");
    // Every eighth frame was held out before a split for evaluation appeared.
    assert_eq!(learned.len(), 7, "{learned:?}");
    scratch.run("train room --resume out/checkpoint.vbgs --out again").succeeds();
    let again = scratch.json("again/report.json");
    let again = names(&again);
    assert!(again.starts_with(&learned), "{again:?}");
    assert!(again.iter().all(|name| name.starts_with("walk/")), "{again:?}");
}

#[test]
fn a_limit_of_frames_ends_it() {
    let scratch = Scratch::empty();
    let size = "--size 48x36 --frames 12 --eval-frames 0";
    scratch.run(&format!("synth room --layout seven-scenes {size}")).succeeds();
    scratch.run(&format!("{TRAIN} --follow --max-frames 4 --set stride=2")).succeeds();
    let report = scratch.json("out/report.json");
    let expected = ["1", "3", "5", "7"].map(|i| format!("train/frame-00000{i}"));
    assert_eq!(names(&report).len(), 4);
    assert_eq!(names(&report)[0], expected[0]);
}

#[test]
fn frames_without_a_surface_are_waited_over() {
    let scratch = Scratch::empty();
    let size = "--size 48x36 --frames 12 --eval-frames 0";
    scratch.run(&format!("synth room --layout seven-scenes {size}")).succeeds();
    // A covered lens at first: every pixel is a hole.
    let (frames, later) = (scratch.path("room/train"), scratch.path("later"));
    move_frames(&frames, &later, 4);
    let hole = image_of_holes(48, 36);
    for i in 0..4 {
        fs::write(frames.join(format!("frame-{i:06}.depth.png")), &hole).unwrap();
    }
    let train = scratch.start("train room --out out --follow");
    std::thread::sleep(Duration::from_millis(300));
    move_frames(&later, &frames, 0);
    fs::write(scratch.path("room/recording.done"), "").unwrap();
    end(train).succeeds();
    let report = scratch.json("out/report.json");
    assert_eq!(names(&report).len(), 7, "all but the frames of holes and the ninth");
    assert_eq!(report["skipped"].as_array().unwrap().len(), 3);
}

#[test]
fn what_cannot_be_followed_is_refused() {
    let scratch = Scratch::with_room();
    scratch
        .run(&format!("{TRAIN} --follow --set order=shuffled"))
        .fails(2, &["order", "sequential"]);
    scratch.run(&format!("{TRAIN} --follow --split held-out")).fails(2, &["split", "held-out"]);
    fs::write(scratch.path("file"), "").unwrap();
    let file = "train file --out out --follow";
    scratch.run(file).fails(1, &["expected a dataset folder, found a file"]);
    // An end marker without a recording.
    fs::create_dir(scratch.path("empty")).unwrap();
    fs::write(scratch.path("empty/recording.done"), "").unwrap();
    scratch.run("train empty --out out --follow").fails(1, &["expected a known layout"]);
    let live = "synth live --layout blender --live 30";
    scratch.run(live).fails(1, &["expected one that can be recorded frame by frame", "tum"]);
    assert!(!scratch.path("live").exists());
    scratch.run("synth live --live 0").fails(2, &["--live", "expected a number above 0"]);
}

/// Training follows a recorder of 30 frames/s and uses every frame, however late. The delay depends
/// on the machine and is only printed; run it on an idle one:
/// `cargo test --release --test cli thirty_frames -- --ignored --nocapture`
#[test]
#[ignore = "records and trains 450 frames: half a minute"]
fn figures_of_thirty_frames_a_second() {
    let n = 150_usize;
    for layout in ["tum", "seven-scenes"] {
        let scratch = Scratch::empty();
        let train = scratch.start("train room --out out --follow --threads 2");
        let size = format!("--size 640x480 --frames {n} --eval-frames 0");
        scratch.run(&format!("synth room --layout {layout} --live 30 {size}")).succeeds();
        end(train).succeeds();
        let report = scratch.json("out/report.json");
        let frames = report["frames"].as_array().unwrap();
        let mut behind: Vec<f64> =
            frames.iter().map(|frame| frame["behind_ms"].as_f64().unwrap()).collect();
        behind.sort_by(f64::total_cmp);
        let at = |share: f64| behind[((behind.len() - 1) as f64 * share) as usize];
        println!(
            "{layout}: {} frames of {n} trained, {} held out, train median {} ms; from recorded to trained: median {:.0} ms, 95 % {:.0} ms, most {:.0} ms",
            frames.len(),
            n.div_ceil(8),
            report["summary"]["train_ms_median"],
            at(0.5),
            at(0.95),
            at(1.0)
        );
        assert_eq!(frames.len(), n - n.div_ceil(8), "no frame is lost");
        assert!(report["skipped"].as_array().unwrap().is_empty(), "no frame is misread");
    }
}

/// `cargo test --release --test cli ten_thousand -- --ignored --nocapture`
#[test]
#[ignore = "makes 10,000 frames of each layout, in links"]
fn figures_of_ten_thousand_frames() {
    let n = 10_000;
    for layout in ["tum", "scannet", "seven-scenes", "replica", "arkit", "nerfstudio", "blender"] {
        let scratch = Scratch::empty();
        scratch.record("few", TestLayout::named(layout), 40, 0);
        multiply(&scratch.path("few"), &scratch.path("room"), layout, 40, n);
        let started = Instant::now();
        scratch.run("train room --out one --max-frames 1").succeeds();
        let first = started.elapsed();
        println!("{layout}: {n} frames, one trained and written after {first:?}");
        assert!(first < Duration::from_secs(2), "{layout}");
    }
}

/// Makes a recording of `n` frames from a few: files are hard links, and lines of lists are
/// repeated with the number of the frame.
#[expect(clippy::too_many_lines, reason = "one arm a layout")]
fn multiply(few: &Path, out: &Path, layout: &str, n_few: usize, n: usize) {
    let link = |from: String, to: String| {
        let to = out.join(to);
        fs::create_dir_all(to.parent().unwrap()).unwrap();
        fs::hard_link(few.join(&from), &to).unwrap_or_else(|e| panic!("{from}: {e}"));
    };
    let text = |name: &str| fs::read_to_string(few.join(name)).unwrap();
    fs::create_dir_all(out).unwrap();
    let sources = || (0..n).map(|i| (i, i % n_few));
    match layout {
        "tum" => {
            link("camera-intrinsics.txt".into(), "camera-intrinsics.txt".into());
            let time = |i: usize| format!("{:.6}", 1000.0 + i as f64 / 30.0);
            let poses: Vec<String> = text("groundtruth.txt").lines().map(str::to_owned).collect();
            let mut lists = ["rgb", "depth", "groundtruth"].map(|_| String::new());
            for (i, few) in sources() {
                for (list, folder) in lists.iter_mut().zip(["rgb", "depth"]) {
                    link(
                        format!("{folder}/{}.png", time(few)),
                        format!("{folder}/{}.png", time(i)),
                    );
                    *list += &format!("{0} {folder}/{0}.png\n", time(i));
                }
                let pose = poses[1 + few].split_once(' ').unwrap().1;
                lists[2] += &format!("{} {pose}\n", time(i));
            }
            for (name, list) in ["rgb", "depth", "groundtruth"].iter().zip(lists) {
                fs::write(out.join(format!("{name}.txt")), list).unwrap();
            }
        }
        "scannet" => {
            for name in ["intrinsic_color.txt", "intrinsic_depth.txt"] {
                link(format!("intrinsic/{name}"), format!("intrinsic/{name}"));
            }
            for (i, few) in sources() {
                for (folder, end) in [("color", "jpg"), ("depth", "png"), ("pose", "txt")] {
                    link(format!("{folder}/{few}.{end}"), format!("{folder}/{i}.{end}"));
                }
            }
        }
        "seven-scenes" => {
            link("camera-intrinsics.txt".into(), "camera-intrinsics.txt".into());
            for (i, few) in sources() {
                for end in ["color.png", "depth.png", "pose.txt"] {
                    let file = |i: usize| format!("train/frame-{i:06}.{end}");
                    link(file(few), file(i));
                }
            }
        }
        "replica" => {
            link("cam_params.json".into(), "cam_params.json".into());
            let poses: Vec<String> = text("traj.txt").lines().map(str::to_owned).collect();
            let mut list = String::new();
            for (i, few) in sources() {
                for (name, end) in [("frame", "jpg"), ("depth", "png")] {
                    let file = |i: usize| format!("results/{name}{i:06}.{end}");
                    link(file(few), file(i));
                }
                list += &format!("{}\n", poses[few]);
            }
            fs::write(out.join("traj.txt"), list).unwrap();
        }
        "arkit" => {
            let lines: Vec<String> = text("frames.jsonl").lines().map(str::to_owned).collect();
            let mut list = String::new();
            for (i, few) in sources() {
                for (folder, end) in [("images", "png"), ("depth", "bin"), ("confidence", "bin")] {
                    let file = |i: usize| format!("{folder}/{i:06}.{end}");
                    link(file(few), file(i));
                }
                let (old, new) = (format!("/{few:06}."), format!("/{i:06}."));
                list += &format!("{}\n", lines[few].replace(&old, &new));
            }
            fs::write(out.join("frames.jsonl"), list).unwrap();
        }
        "nerfstudio" => {
            let mut list: Value = serde_json::from_str(&text("transforms.json")).unwrap();
            let few_frames = list["frames"].as_array().unwrap().clone();
            let mut frames = Vec::new();
            for (i, few) in sources() {
                let file = |i: usize, folder: &str| format!("{folder}/frame_{:05}.png", i + 1);
                for (key, folder) in [("file_path", "images"), ("depth_file_path", "depths")] {
                    link(file(few, folder), file(i, folder));
                    frames.resize(i + 1, few_frames[few].clone());
                    frames[i][key] = file(i, folder).into();
                }
            }
            list["frames"] = frames.into();
            fs::write(out.join("transforms.json"), list.to_string()).unwrap();
        }
        "blender" => {
            let mut list: Value = serde_json::from_str(&text("transforms_train.json")).unwrap();
            let few_frames = list["frames"].as_array().unwrap().clone();
            let mut frames = Vec::new();
            for (i, few) in sources() {
                for end in ["", "_depth_0001"] {
                    let file = |i: usize| format!("train/r_{i}{end}.png");
                    link(file(few), file(i));
                }
                frames.push(few_frames[few].clone());
                frames[i]["file_path"] = format!("./train/r_{i}").into();
            }
            list["frames"] = frames.into();
            fs::write(out.join("transforms_train.json"), list.to_string()).unwrap();
        }
        other => panic!("{other}"),
    }
}
