//! Variants of the layouts found in real folders.

use crate::common::layouts::TestLayout;
use crate::common::scratch::{edit_json, open_plain, tiny, tiny_blender, tiny_seven_scenes};
use std::fs;
use std::path::Path;
use vbgs_studio::dataset::frame::DepthCodes;
use vbgs_studio::dataset::synthetic::write::DepthBits;
use vbgs_studio::dataset::{Dataset, Layout, LoadOptions, open, range};
use vbgs_studio::math::pose::Pose;

fn shape(dataset: &Dataset) -> Vec<(&str, usize)> {
    dataset.splits.iter().map(|s| (s.name.as_str(), s.frames.len())).collect()
}

fn sequences(root: &Path) {
    fs::rename(root.join("train"), root.join("seq-01")).unwrap();
    fs::rename(root.join("eval"), root.join("seq-02")).unwrap();
}

#[test]
fn seven_scenes_in_sequence_folders() {
    let folder = tiny_seven_scenes();
    sequences(folder.path());
    let dataset = open_plain(folder.path()).unwrap();
    assert_eq!(shape(&dataset), [("all", 4)], "without split files sequences are one split");
    let evaluation = dataset.evaluation(0);
    assert!(evaluation.training.is_some() && evaluation.why.contains("held out"), "{evaluation:?}");
    assert_eq!(evaluation.new_views.frames, [0]);

    fs::write(folder.path().join("TrainSplit.txt"), "sequence1\r\n\n").unwrap();
    fs::write(folder.path().join("TestSplit.txt"), "sequence2\nsequence7\n").unwrap();
    let dataset = open_plain(folder.path()).unwrap();
    assert_eq!(shape(&dataset), [("test", 1), ("train", 3)]);
    assert_eq!(dataset.training_split().unwrap(), 1);
    assert_eq!(dataset.evaluation(1).new_views.split, 0, "`test` is the split for `eval`");
    let warning = dataset.warnings[0].to_string();
    for part in ["TestSplit.txt", "sequence7", "expected a folder seq-07", "found none", "unpack"] {
        assert!(warning.contains(part), "{warning}");
    }
    assert_eq!(dataset.load(1, 2).unwrap().color.width, 32);
}

#[test]
fn one_sequence_folder_opens_alone_with_the_published_intrinsics() {
    let folder = tiny_seven_scenes();
    let alone = folder.path().join("train");
    let error = open_plain(&alone).unwrap_err().to_string();
    for part in ["camera-intrinsics.txt", "32x24", "published default is for 640x480", "create it"]
    {
        assert!(error.contains(part), "{error}");
    }
    for i in 0..3 {
        let blank = image::RgbImage::new(640, 480);
        blank.save(alone.join(format!("frame-{i:06}.color.png"))).unwrap();
        let depth = image::ImageBuffer::from_pixel(640, 480, image::Luma([1500u16]));
        depth.save(alone.join(format!("frame-{i:06}.depth.png"))).unwrap();
    }
    let dataset = open_plain(&alone).unwrap();
    assert_eq!(shape(&dataset), [("all", 3)]);
    let k = dataset.splits[0].frames[0].camera.intrinsics;
    assert_eq!((k.fx, k.fy, k.cx, k.cy), (585.0, 585.0, 320.0, 240.0));
    assert!(dataset.notes.iter().any(|n| n.contains("published")), "{:?}", dataset.notes);
    let depth = dataset.load(0, 0).unwrap().depth.unwrap();
    assert_eq!(depth.value_at(5, 5), Some(1.5));
    assert_eq!(depth.trusted, [0.3, 4.0]);
}

#[test]
fn frame_lists_are_known_by_content() {
    let folder = tiny_blender();
    let root = folder.path();
    fs::rename(root.join("transforms_train.json"), root.join("poses.json")).unwrap();
    fs::remove_file(root.join("transforms_eval.json")).unwrap();
    fs::write(root.join("notes.json"), "{\"author\": ").unwrap();
    let dataset = open_plain(root).unwrap();
    assert_eq!((dataset.layout, shape(&dataset)), (Layout::Blender, vec![("poses", 3)]));
    assert!(dataset.recognised_by.contains("poses.json"));
}

#[test]
fn colour_only_splits_and_jpeg_are_fine() {
    let folder = tiny_blender();
    let root = folder.path();
    fs::remove_file(root.join("eval/r_0_depth_0001.png")).unwrap();
    let image = image::open(root.join("eval/r_0.png")).unwrap().into_rgb8();
    image.save(root.join("eval/r_0.jpg")).unwrap();
    fs::remove_file(root.join("eval/r_0.png")).unwrap();
    // The depth file's name may contain any number.
    fs::rename(root.join("train/r_1_depth_0001.png"), root.join("train/r_1_depth_12.png")).unwrap();
    let dataset = open_plain(root).unwrap();
    assert!(dataset.warnings.is_empty(), "{:?}", dataset.warnings);
    let eval = dataset.split_named("eval").unwrap();
    assert!(!dataset.splits[eval].has_depth);
    let frame = dataset.load(eval, 0).unwrap();
    assert!(frame.depth.is_none() && frame.color.data.iter().all(|p| p[3] == 255));
    assert_eq!(dataset.training_split().unwrap(), dataset.split_named("train").unwrap());
}

#[test]
fn gray_and_rgb_depth_mean_the_same() {
    let folder = tiny_blender();
    let root = folder.path();
    let codes = |dataset: &Dataset, i| match dataset.load(1, i).unwrap().depth.unwrap().codes {
        DepthCodes::Inverse8(codes) => codes,
        _ => panic!("8-bit depth"),
    };
    let before: Vec<_> = (0..2).map(|i| codes(&open_plain(root).unwrap(), i)).collect();
    let depth = |i: usize| root.join(format!("train/r_{i}_depth_0001.png"));
    image::open(depth(0)).unwrap().into_rgb8().save(depth(0)).unwrap();
    let gray = image::open(depth(1)).unwrap().into_rgb8();
    let gray = image::GrayImage::from_fn(32, 24, |x, y| image::Luma([gray.get_pixel(x, y)[0]]));
    gray.save(depth(1)).unwrap();
    let after: Vec<_> = (0..2).map(|i| codes(&open_plain(root).unwrap(), i)).collect();
    assert_eq!(before, after);
}

#[test]
fn a_user_may_override_scale_and_range() {
    let folder = tiny(TestLayout::Blender(DepthBits::Sixteen));
    for name in ["train", "eval"] {
        edit_json(&folder.path().join(format!("transforms_{name}.json")), |json| {
            json.as_object_mut().unwrap().remove("integer_depth_scale");
        });
    }
    let error = open_plain(folder.path()).unwrap_err().to_string();
    for part in ["transforms_eval.json", "integer_depth_scale", "no such key", "add the key"] {
        assert!(error.contains(part), "{error}");
    }
    let options = LoadOptions {
        depth_scale: Some(0.001),
        depth_range: Some([1.0, 9.0]),
        ..LoadOptions::default()
    };
    let dataset = open(folder.path(), &options).unwrap();
    let depth = dataset.load(1, 0).unwrap().depth.unwrap();
    assert_eq!(depth.trusted, [1.0, 9.0]);
    let DepthCodes::Linear16 { unit, .. } = depth.codes else { panic!("16-bit depth") };
    assert_eq!(unit, 0.001);

    for options in [
        LoadOptions { depth_scale: Some(0.0), ..LoadOptions::default() },
        LoadOptions { depth_scale: Some(f64::NAN), ..LoadOptions::default() },
        LoadOptions { depth_range: Some([2.0, 1.0]), ..LoadOptions::default() },
        LoadOptions { depth_range: Some([f64::NAN, 1.0]), ..LoadOptions::default() },
    ] {
        let error = open(folder.path(), &options).unwrap_err().to_string();
        assert!(error.contains("setting depth") && error.contains("correct it"), "{error}");
    }
}

#[test]
fn seven_scenes_estimates_its_range_from_depth() {
    let folder = tiny_seven_scenes();
    let dataset = open_plain(folder.path()).unwrap();
    let range = range::estimate(&dataset, dataset.training_split().unwrap()).unwrap();
    let size = range.hi() - range.lo();
    assert!(size.max_element() < 6.5 && size.min_element() > 2.0, "{size}");
    let options = LoadOptions { depth_range: Some([20.0, 30.0]), ..LoadOptions::default() };
    let far = open(folder.path(), &options).unwrap();
    let error = range::estimate(&far, 0).unwrap_err().to_string();
    assert!(error.contains("widen the depth range"), "{error}");
}

#[test]
fn a_photograph_was_taken_where_the_camera_was_at_its_own_time() {
    let folder = tiny(TestLayout::Tum);
    let at_once = open_plain(folder.path()).unwrap();
    let frames = |dataset: &Dataset| dataset.splits[0].frames.clone();
    assert!(frames(&at_once).iter().all(|frame| frame.color_camera.is_none()));
    // Frames are 33 ms apart, so a photograph 10 ms late lies 0.3 of the way to the next pose.
    let list = folder.path().join("rgb.txt");
    let late = |line: &str| match line.split_once(' ') {
        Some((time, file)) if !line.starts_with('#') => {
            format!("{:.6} {file}", time.parse::<f64>().unwrap() + 0.01)
        }
        _ => line.to_owned(),
    };
    let lines: Vec<String> = fs::read_to_string(&list).unwrap().lines().map(late).collect();
    fs::write(&list, lines.join("\n")).unwrap();
    let dataset = open_plain(folder.path()).unwrap();
    let (frame, next) = (&frames(&dataset)[0], &frames(&at_once)[1]);
    let [depth, there] = [frame.camera.pose, next.camera.pose];
    let photograph = frame.color_camera.unwrap().camera_at(&frame.camera);
    assert_eq!(photograph.intrinsics, frame.camera.intrinsics);
    let expected = depth.centre().lerp(there.centre(), 0.3);
    assert!((photograph.pose.centre() - expected).length() < 1e-5);
    let angle = |a: &Pose, b: &Pose| a.forward().angle_between(b.forward());
    let (turned, all) = (angle(&depth, &photograph.pose), angle(&depth, &there));
    assert!(all > 1e-3 && (turned / all - 0.3).abs() < 0.01, "{turned} of {all}");
    assert_eq!(depth, frames(&at_once)[0].camera.pose, "depth keeps its own pose");
}
