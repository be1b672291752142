//! Recordings polled while they are written: each frame is found once, when it is complete, and is
//! the same as in the finished recording.

use crate::common::layouts::{TestLayout, write, write_live};
use crate::common::scratch::open_plain;
use serde_json::Value;
use std::fs;
use std::path::Path;
use vbgs_studio::dataset::growing::{END_MARKER, GrowingRecording};
use vbgs_studio::dataset::synthetic::SyntheticParams;
use vbgs_studio::dataset::synthetic::write::DepthBits;
use vbgs_studio::dataset::{Dataset, FrameEntry, LoadOptions};

const ROOM: SyntheticParams = SyntheticParams {
    width: 16,
    height: 12,
    n_train: 11,
    n_eval: 0,
    seed: 3,
    depth_noise: 0.0,
    ..SyntheticParams::demo()
};

/// Later than the longest wait for a missing frame, seconds.
const LATER: f64 = 100.0;

fn follow(folder: &Path) -> GrowingRecording {
    GrowingRecording::new(folder, &LoadOptions::default(), None).unwrap()
}

/// Polls, marks the frames as taken and returns them; none on an error, which a later poll may resolve.
fn taken(recording: &mut GrowingRecording, is_growing: bool, now_s: f64) -> Vec<FrameEntry> {
    let Ok(found) = recording.poll(is_growing, now_s) else { return Vec::new() };
    recording.mark_taken(&found);
    let split = recording.split_of(&found);
    split.map_or_else(|_| Vec::new(), |split| found.splits[split].frames.clone())
}

fn trained(dataset: &Dataset) -> &[FrameEntry] {
    &dataset.splits[dataset.training_split().unwrap()].frames
}

#[track_caller]
fn same(found: &[FrameEntry], expected: &[FrameEntry]) {
    let names = |frames: &[FrameEntry]| -> Vec<String> {
        frames.iter().map(|frame| frame.name.clone()).collect()
    };
    assert_eq!(names(found), names(expected));
    for (found, expected) in found.iter().zip(expected) {
        assert_eq!(found.camera, expected.camera, "{}", found.name);
        assert_eq!(found.time, expected.time, "{}", found.name);
        found.load().unwrap();
    }
}

const LIVE: [TestLayout; 8] = [
    TestLayout::SevenScenes,
    TestLayout::Tum,
    TestLayout::Open3d,
    TestLayout::Replica,
    TestLayout::Scannet,
    TestLayout::StrayScanner,
    TestLayout::Arkit,
    TestLayout::RtabMap,
];

#[test]
fn every_frame_is_found_as_soon_as_it_is_there() {
    for layout in LIVE {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("room");
        let mut recording = follow(&path);
        assert!(recording.poll(true, 0.0).is_err(), "there is no folder yet");
        let mut found = Vec::new();
        write_live(&ROOM, &path, layout, &mut |due, n| {
            assert_eq!(n, ROOM.n_train);
            assert!(due == 0 || recording.has_changed(), "{layout:?}: frame {due}");
            found.extend(taken(&mut recording, true, due as f64));
            assert_eq!(found.len(), due, "{layout:?}");
            assert!(!recording.has_ended());
        })
        .unwrap();
        assert!(recording.has_ended() && path.join(END_MARKER).exists());
        found.extend(taken(&mut recording, false, LATER));
        let finished = open_plain(&path).unwrap();
        assert!(finished.warnings.is_empty(), "{layout:?}: {:?}", finished.warnings);
        same(&found, trained(&finished));
        let entries = fs::read_dir(folder.path()).unwrap().count();
        assert_eq!(entries, 1, "no temporary file is left in the folder");
    }
}

/// Lists that are rewritten for every frame; a half-written list gives no frames.
#[test]
fn lists_that_are_written_anew_are_followed() {
    for (layout, name, key) in [
        (TestLayout::Nerfstudio, "transforms.json", "frames"),
        (TestLayout::Record3d, "metadata.json", "poses"),
        (TestLayout::Blender(DepthBits::Sixteen), "transforms_train.json", "frames"),
    ] {
        let folder = tempfile::tempdir().unwrap();
        write(&ROOM, folder.path(), layout, &mut |_, _| ()).unwrap();
        let finished = open_plain(folder.path()).unwrap();
        let file = folder.path().join(name);
        let all: Value = serde_json::from_slice(&fs::read(&file).unwrap()).unwrap();
        let mut recording = follow(folder.path());
        let mut found = Vec::new();
        for n in 1..=ROOM.n_train {
            let mut list = all.clone();
            list[key].as_array_mut().unwrap().truncate(n);
            let text = serde_json::to_string(&list).unwrap();
            fs::write(&file, &text[..text.len() / 2]).unwrap();
            assert_eq!(taken(&mut recording, true, LATER).len(), 0, "half a list");
            fs::write(&file, &text).unwrap();
            found.extend(taken(&mut recording, true, LATER));
            assert_eq!(found.len(), n, "{layout:?}");
        }
        same(&found, trained(&finished));
    }
}

/// A file of any kind counts only once its last byte is written.
#[test]
fn a_half_written_file_is_never_taken() {
    let two = SyntheticParams { n_train: 2, ..ROOM };
    for (layout, files) in [
        (
            TestLayout::SevenScenes,
            &["train/frame-000001.color.png", "train/frame-000001.depth.png"][..],
        ),
        (TestLayout::Scannet, &["color/1.jpg", "depth/1.png"]),
        (TestLayout::Arkit, &["depth/000001.bin", "confidence/000001.bin"]),
        (TestLayout::Record3d, &["rgb/1.jpg", "depth/1.exr"]),
        (TestLayout::StrayScanner, &["rgb/000001.png", "confidence/000001.png"]),
    ] {
        let folder = tempfile::tempdir().unwrap();
        write(&two, folder.path(), layout, &mut |_, _| ()).unwrap();
        let finished = open_plain(folder.path()).unwrap();
        for file in files {
            let mut recording = follow(folder.path());
            let path = folder.path().join(file);
            let whole = fs::read(&path).unwrap();
            fs::remove_file(&path).unwrap();
            let mut found = taken(&mut recording, true, 0.0);
            for length in 0..whole.len() {
                fs::write(&path, &whole[..length]).unwrap();
                found.extend(taken(&mut recording, true, LATER));
                assert_eq!(found.len(), 1, "{file}: {length} of {} bytes", whole.len());
            }
            assert!(recording.is_unresolved(), "{file}");
            fs::write(&path, &whole).unwrap();
            found.extend(taken(&mut recording, true, LATER));
            same(&found, trained(&finished));
        }
    }
}

/// A line that is still being written may end in a number that lacks digits but parses.
#[test]
fn a_half_written_line_is_never_read() {
    let three = SyntheticParams { n_train: 3, ..ROOM };
    for (layout, lists) in [
        (TestLayout::Tum, &["groundtruth.txt", "depth.txt", "rgb.txt"][..]),
        (TestLayout::Replica, &["traj.txt"]),
        (TestLayout::Open3d, &["trajectory.log"]),
        (TestLayout::StrayScanner, &["odometry.csv"]),
        (TestLayout::RtabMap, &["poses.txt"]),
        (TestLayout::Arkit, &["frames.jsonl"]),
        (TestLayout::Scannet, &["pose/0.txt", "pose/2.txt"]),
        (TestLayout::SevenScenes, &["train/frame-000001.pose.txt", "camera-intrinsics.txt"]),
        (TestLayout::Tum, &["camera-intrinsics.txt"]),
    ] {
        let folder = tempfile::tempdir().unwrap();
        write(&three, folder.path(), layout, &mut |_, _| ()).unwrap();
        let finished = open_plain(folder.path()).unwrap();
        let expected = trained(&finished);
        for list in lists {
            let path = folder.path().join(list);
            let whole = fs::read(&path).unwrap();
            for length in 0..=whole.len() {
                fs::write(&path, &whole[..length]).unwrap();
                let found = taken(&mut follow(folder.path()), true, LATER);
                for frame in &found {
                    let same = expected.iter().find(|other| other.name == frame.name).unwrap();
                    assert_eq!(frame.camera, same.camera, "{list}: {length} bytes");
                }
                assert!(length < whole.len() || found.len() == expected.len(), "{list}");
            }
        }
    }
}

#[test]
fn frames_keep_their_order_as_long_as_patience_lasts() {
    let folder = tempfile::tempdir().unwrap();
    let room = SyntheticParams { n_train: 5, ..ROOM };
    write(&room, folder.path(), TestLayout::SevenScenes, &mut |_, _| ()).unwrap();
    let file = |i: usize| folder.path().join(format!("train/frame-{i:06}.color.png"));
    let late = [1, 3].map(|i| (file(i), fs::read(file(i)).unwrap()));
    let names = |found: Vec<FrameEntry>| -> String {
        found.iter().map(|frame| frame.name.chars().last().unwrap()).collect()
    };
    for i in 1..5 {
        fs::rename(file(i), file(i).with_extension("later")).unwrap();
    }
    let mut recording = follow(folder.path());
    assert_eq!(names(taken(&mut recording, true, 0.0)), "0");
    for i in 1..5 {
        fs::rename(file(i).with_extension("later"), file(i)).unwrap();
    }
    late.iter().for_each(|(path, bytes)| fs::write(path, &bytes[..99]).unwrap());
    assert_eq!(names(taken(&mut recording, true, 10.0)), "", "frame 2 waits for frame 1");
    assert_eq!(names(taken(&mut recording, true, 10.5)), "");
    assert_eq!(names(taken(&mut recording, true, 11.5)), "2", "1 is skipped, 4 waits for 3");
    fs::write(&late[1].0, &late[1].1).unwrap();
    assert_eq!(names(taken(&mut recording, true, 11.6)), "34");
    fs::write(&late[0].0, &late[0].1).unwrap();
    assert_eq!(names(taken(&mut recording, true, 99.0)), "1", "a late frame is still taken");
    assert_eq!(names(taken(&mut recording, false, 99.0)), "");
}

#[test]
fn a_pose_may_come_after_its_images() {
    let folder = tempfile::tempdir().unwrap();
    write(&ROOM, folder.path(), TestLayout::Scannet, &mut |_, _| ()).unwrap();
    let pose = folder.path().join("pose/10.txt");
    let text = fs::read(&pose).unwrap();
    fs::remove_file(&pose).unwrap();
    let mut recording = follow(folder.path());
    assert_eq!(taken(&mut recording, true, 0.0).len(), 10);
    assert_eq!(taken(&mut recording, true, LATER).len(), 0);
    assert!(recording.is_unresolved());
    fs::write(&pose, text).unwrap();
    let found = taken(&mut recording, true, 2.0 * LATER);
    assert_eq!(found.iter().map(|frame| frame.name.as_str()).collect::<Vec<_>>(), ["10"]);
}

/// A frame between two poses needs the later one too; after the end of the recording no later pose comes.
#[test]
fn a_pose_is_interpolated_only_between_two_that_are_there() {
    let folder = tempfile::tempdir().unwrap();
    let three = SyntheticParams { n_train: 3, ..ROOM };
    write(&three, folder.path(), TestLayout::Tum, &mut |_, _| ()).unwrap();
    let file = folder.path().join("groundtruth.txt");
    let text = fs::read_to_string(&file).unwrap();
    // Poses 5 ms before and 5 ms after the last depth image.
    let last = text.lines().last().unwrap();
    let (time, numbers) = last.split_once(' ').unwrap();
    let shifted = |ms: f64, x: &str| {
        let numbers = numbers.split_once(' ').unwrap().1;
        format!("{:.6} {x} {numbers}\n", time.parse::<f64>().unwrap() + 1e-3 * ms)
    };
    let before = text.replace(&format!("{last}\n"), &shifted(-5.0, "0"));
    let mut recording = follow(folder.path());
    fs::write(&file, &before).unwrap();
    assert_eq!(taken(&mut recording, true, 0.0).len(), 2, "the third may have a nearer pose");
    fs::write(&file, before + &shifted(5.0, "1")).unwrap();
    let third = taken(&mut recording, true, LATER);
    assert!((third[0].camera.pose.centre().x - 0.5).abs() < 1e-9, "{:?}", third[0].camera.pose);
}

#[test]
fn after_the_end_nothing_is_waited_for() {
    let folder = tempfile::tempdir().unwrap();
    write(&ROOM, folder.path(), TestLayout::SevenScenes, &mut |_, _| ()).unwrap();
    let file = |i: usize, part: &str| folder.path().join(format!("train/frame-{i:06}.{part}"));
    let color = fs::read(file(4, "color.png")).unwrap();
    fs::write(file(4, "color.png"), &color[..color.len() / 2]).unwrap();
    fs::remove_file(file(7, "depth.png")).unwrap();
    fs::remove_file(file(9, "pose.txt")).unwrap();
    let mut recording = follow(folder.path());
    let whole = ROOM.n_train - 3;
    assert_eq!(taken(&mut recording, true, 0.0).len(), whole);
    let found = recording.poll(false, LATER).unwrap();
    let frames = trained(&found);
    assert_eq!(frames.len(), 1, "the damaged frame; loading it reports the error");
    assert!(frames[0].load().is_err());
    let warnings: Vec<String> = found.warnings.iter().map(ToString::to_string).collect();
    assert_eq!(warnings.len(), 2, "{warnings:?}");
    assert!(warnings.iter().any(|text| text.contains("000007.depth")), "{warnings:?}");
    assert!(warnings.iter().any(|text| text.contains("000009.pose")), "{warnings:?}");
}

#[test]
fn a_frame_that_cannot_be_read_comes_again_when_its_files_change() {
    let folder = tempfile::tempdir().unwrap();
    write(&ROOM, folder.path(), TestLayout::SevenScenes, &mut |_, _| ()).unwrap();
    let file = folder.path().join("train/frame-000010.depth.png");
    let whole = fs::read(&file).unwrap();
    // The end of the file is intact, the part before it is not. The length differs because
    // file-system clocks may be too coarse to show the change.
    let (half, end) = (whole.len() / 2, whole.len() - 12);
    fs::write(&file, [&whole[..half], &vec![0; end][..], &whole[end..]].concat()).unwrap();
    let mut recording = follow(folder.path());
    let found = taken(&mut recording, true, 0.0);
    assert_eq!(found.len(), ROOM.n_train);
    let last = &found[10];
    assert!(last.load().is_err());
    recording.return_frame(last.name.clone(), last.marks());
    assert_eq!(taken(&mut recording, true, LATER).len(), 0, "it is as it was");
    fs::write(&file, &whole[..9]).unwrap();
    assert_eq!(taken(&mut recording, true, LATER).len(), 0);
    fs::write(&file, &whole).unwrap();
    same(&taken(&mut recording, true, LATER), std::slice::from_ref(last));
}

#[test]
fn a_followed_dataset_holds_out_what_an_opened_one_does() {
    let folder = tempfile::tempdir().unwrap();
    let mut recording = follow(&folder.path().join("room"));
    let mut grown: Option<Dataset> = None;
    let mut look = |is_growing: bool| {
        let Ok(found) = recording.poll(is_growing, LATER) else { return };
        recording.mark_taken(&found);
        match &mut grown {
            None if found.splits.is_empty() => {}
            None => grown = Some(found),
            Some(known) => known.append_polled(recording.split_of(known).unwrap(), found),
        }
    };
    let path = folder.path().join("room");
    write_live(&ROOM, &path, TestLayout::Scannet, &mut |_, _| look(true)).unwrap();
    look(false);
    let (grown, opened) = (grown.unwrap(), open_plain(&path).unwrap());
    assert_eq!(grown.splits.len(), 2);
    for (grown, opened) in grown.splits.iter().zip(&opened.splits) {
        assert_eq!(grown.name, opened.name);
        same(&grown.frames, &opened.frames);
    }
    assert_eq!(grown.warnings.len(), 0);
}

#[test]
fn frames_for_evaluation_are_never_followed() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("room");
    write(&SyntheticParams { n_eval: 2, ..ROOM }, &path, TestLayout::SevenScenes, &mut |_, _| ())
        .unwrap();
    let (train, later) = (path.join("train"), folder.path().join("later"));
    fs::rename(&train, &later).unwrap();
    let mut recording = follow(&path);
    let waiting = recording.poll(true, 0.0).map(|_| ()).unwrap_err().to_string();
    assert!(waiting.contains("found frames of `eval` alone"), "{waiting}");
    fs::rename(&later, &train).unwrap();
    let found = taken(&mut recording, true, LATER);
    assert_eq!((found.len(), recording.split()), (11, Some("train")));
    // The user may name any split.
    let options = LoadOptions::default();
    let mut named = GrowingRecording::new(&path, &options, Some("eval")).unwrap();
    assert_eq!(taken(&mut named, true, 0.0).len(), 2);
}

/// The first frames determine the local origin of a far world, also for later frames.
#[test]
fn a_far_recording_keeps_the_origin_of_its_first_frames() {
    let folder = tempfile::tempdir().unwrap();
    let near = folder.path().join("near");
    write(&ROOM, &near, TestLayout::Tum, &mut |_, _| ()).unwrap();
    let poses = near.join("groundtruth.txt");
    let text = fs::read_to_string(&poses).unwrap();
    let moved = text.lines().map(|line| {
        let mut fields: Vec<String> = line.split(' ').map(str::to_owned).collect();
        if !line.starts_with('#') {
            fields[1] = (fields[1].parse::<f64>().unwrap() + 1e7).to_string();
        }
        fields.join(" ") + "\n"
    });
    let lines: Vec<String> = moved.collect();
    let is_note = |line: &&String| line.starts_with('#');
    let n_begun = lines.iter().filter(is_note).count() + 2;
    fs::write(&poses, lines[..n_begun].concat()).unwrap();
    let mut recording = follow(&near);
    let first = recording.poll(true, 0.0).unwrap();
    recording.mark_taken(&first);
    let origin = first.local_origin();
    assert!((origin.x - 1e7).abs() < 20.0, "{origin}");
    fs::write(&poses, lines.concat()).unwrap();
    let rest = recording.poll(false, LATER).unwrap();
    assert_eq!(rest.local_origin(), origin);
    for frame in trained(&first).iter().chain(trained(&rest)) {
        assert!(frame.camera.pose.centre().length() < 20.0, "{}", frame.name);
    }
}

#[test]
fn what_is_no_folder_is_refused_and_what_is_empty_is_waited_for() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("recording.r3d");
    fs::write(&file, b"PK").unwrap();
    let options = LoadOptions::default();
    let error = GrowingRecording::new(&file, &options, None).err().unwrap().to_string();
    assert!(error.contains("expected a dataset folder, found a file"), "{error}");
    let wrong = LoadOptions { depth_scale: Some(-1.0), ..options };
    assert!(GrowingRecording::new(folder.path(), &wrong, None).is_err());
    let mut recording = follow(&folder.path().join("later"));
    let error = recording.poll(true, 0.0).err().unwrap().to_string();
    assert!(error.contains("found nothing at this path"), "{error}");
    fs::create_dir(folder.path().join("later")).unwrap();
    let error = recording.poll(true, 0.0).err().unwrap().to_string();
    assert!(error.contains("an empty folder"), "{error}");
}

#[test]
fn what_a_dataset_was_read_from_is_known_and_the_drive_is_not_asked() {
    let recording = |layout, file: &str| {
        let folder = tempfile::tempdir().unwrap();
        write(&ROOM, folder.path(), layout, &mut |_, _| ()).unwrap();
        let dataset = open_plain(&folder.path().join(file)).unwrap();
        // The deleted folder acts like a disconnected drive.
        drop(folder);
        GrowingRecording::of(&dataset, dataset.training_split().unwrap())
    };
    let mut gone = recording(TestLayout::Tum, "").unwrap();
    assert!(gone.has_begun());
    let error = gone.poll(true, 0.0).err().unwrap().to_string();
    assert!(error.contains("found nothing at this path"), "{error}");
    assert!(recording(TestLayout::Record3dArchive, "recording.r3d").is_none());
    let built_in = vbgs_studio::dataset::synthetic::dataset(&ROOM).unwrap();
    assert!(GrowingRecording::of(&built_in, 0).is_none());
}

/// `cargo test --release --test dataset long_recording -- --ignored --nocapture`
#[test]
#[ignore = "times polls of 3,000 frames of each layout"]
fn figures_of_a_look_at_a_long_recording() {
    let n = 3000;
    for layout in LIVE {
        let folder = tempfile::tempdir().unwrap();
        let room = SyntheticParams { width: 8, height: 8, n_train: n, ..ROOM };
        let path = folder.path().join("room");
        let mut recording = follow(&path);
        let (mut last, mut found) = (Vec::new(), 0);
        write_live(&room, &path, layout, &mut |due, _| {
            if due % 500 == 0 || due > n - 10 {
                let begun = std::time::Instant::now();
                found += taken(&mut recording, true, due as f64).len();
                last.push(begun.elapsed().as_secs_f64() * 1e3);
            }
        })
        .unwrap();
        let begun = std::time::Instant::now();
        assert!(!recording.has_changed() || recording.has_ended());
        let idle = begun.elapsed().as_secs_f64() * 1e3;
        found += taken(&mut recording, false, LATER).len();
        assert_eq!(found, n);
        let quickest = last[last.len() - 9..].iter().copied().fold(f64::INFINITY, f64::min);
        println!(
            "{layout:?}: a poll that finds one of {n} frames {quickest:.1} ms, a check for changes {idle:.3} ms"
        );
    }
}
