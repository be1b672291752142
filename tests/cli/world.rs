//! Worlds of any unit, far from their origin, and with a pose that cannot be.

use super::runner::{Run, Scratch};
use serde_json::Value;
use std::fs;

/// A recording in the layout of TUM: poses in text, so that its world can be changed.
fn recorded(size: &str, frames: usize) -> Scratch {
    let scratch = Scratch::empty();
    let synth = format!("synth room --layout tum --size {size} --frames {frames} --eval-frames 0");
    scratch.run(&synth).succeeds();
    scratch
}

/// Rewrites the position of every pose, told its number.
fn move_cameras(scratch: &Scratch, to: impl Fn(usize, [f64; 3]) -> [f64; 3]) {
    let path = scratch.path("room/groundtruth.txt");
    let text = fs::read_to_string(&path).unwrap();
    let (head, poses): (Vec<&str>, Vec<&str>) = text.lines().partition(|l| l.starts_with('#'));
    let moved = poses.iter().enumerate().map(|(i, line)| {
        let fields: Vec<&str> = line.split_whitespace().collect();
        let place = [1, 2, 3].map(|k| fields[k].parse().unwrap());
        let [x, y, z] = to(i, place).map(|v| format!("{v:e}"));
        format!("{} {x} {y} {z} {}\n", fields[0], fields[4..].join(" "))
    });
    let text: String = head.iter().map(|line| format!("{line}\n")).chain(moved).collect();
    fs::write(path, text).unwrap();
}

/// What training says of held-out views, with a metre of so many world units.
fn measured(metre: f64, options: &str) -> (Value, String) {
    let scratch = recorded("64x48", 9);
    move_cameras(&scratch, |_, place| place.map(|x| x * metre));
    let depth = match metre == 1.0 {
        true => String::new(),
        false => format!(
            "--depth-scale {:e} --depth-range {:e} {:e}",
            metre / 5000.0,
            0.3 * metre,
            4.0 * metre
        ),
    };
    let train = format!("train room --out run --eval held-out --json {depth} {options}");
    let Run { stdout, stderr, .. } = scratch.run(&train).succeeds();
    let report: Value = serde_json::from_str(&stdout).unwrap();
    (report["eval"][0].clone(), stderr)
}

/// The unit of the world is nobody's business: near plane, noise of the sensor and every threshold in
/// metres follow it.
#[test]
fn figures_do_not_depend_on_the_unit_of_the_world() {
    for options in ["", "--renderer exact --births lattice"] {
        let (one, _) = measured(1.0, options);
        for metre in [1e-4, 1e4] {
            let (other, said) = measured(metre, options);
            assert!(said.contains("world units to the metre"), "{said}");
            let differ = |path: &str| {
                let [a, b] = [&one, &other].map(|eval| eval.pointer(path).and_then(Value::as_f64));
                let (a, b) = (a.unwrap_or_else(|| panic!("{path}: {one}")), b.unwrap());
                (b - a).abs()
            };
            for (path, most) in [
                ("/psnr_mean", 0.05),
                ("/psnr_covered_mean", 0.05),
                ("/psnr_aligned_covered_mean", 0.05),
                ("/ssim_mean", 0.002),
                ("/coverage_mean", 0.002),
                ("/cracks/training_distance/over_01", 0.002),
            ] {
                assert!(differ(path) <= most, "{options}, {metre}, {path}: {one} {other}");
            }
            let error = |eval: &Value| eval["depth_mae_mean"].as_f64().unwrap();
            let ratio = error(&other) / error(&one) / metre;
            assert!((ratio - 1.0).abs() < 0.02, "{options}, {metre}: depth error {ratio}");
        }
    }
}

/// One lost frame costs that frame's points and no more, and is named.
#[test]
fn a_wild_pose_is_named_and_leaves_the_rest_as_it_is() {
    let psnr = |run: Run| run.json()["eval"][0]["psnr_mean"].as_f64().unwrap();
    let train = |preset: &str| format!("train room --out run --eval held-out --json {preset}");
    for (preset, at) in [("--preset paper --components 500", 6), ("", 1)] {
        let scratch = recorded("64x48", 24);
        let sound = psnr(scratch.run(&train(preset)).succeeds());
        move_cameras(&scratch, |i, [x, y, z]| if i == at { [x + 1e7, y, z] } else { [x, y, z] });
        let run = scratch.run(&train(preset)).succeeds();
        let warned: Vec<&str> =
            run.stderr.lines().filter(|l| l.contains("its pose lies")).collect();
        assert_eq!(warned.len(), 1, "{}", run.stderr);
        let frame = warned[0].split([' ', ':']).nth(2).unwrap().to_owned();
        let report = run.json();
        if preset.contains("paper") {
            let source = report["config"]["position_range_source"].as_str().unwrap();
            assert!(source.contains("wild poses left out") && source.contains(&frame), "{source}");
        }
        let wild = psnr(run);
        assert!(wild > sound - 1.5, "{preset}: {sound} dB, with a wild pose {wild} dB");
        let info = scratch.run("info room --json").succeeds().json();
        let defects = info["defects"].to_string();
        assert!(defects.contains(&frame), "{defects}");
    }
}

/// What 32 bits cannot hold is said, with what to do.
#[test]
fn a_scene_far_from_the_origin_is_warned_of() {
    let scratch = recorded("64x48", 6);
    let near = scratch.run("train room --out run").succeeds();
    assert!(!near.stderr.contains("from the origin"), "{}", near.stderr);
    move_cameras(&scratch, |_, [x, y, z]| [x + 5e5, y + 5e6, z]);
    let far = scratch.run("train room --out run").succeeds();
    for part in ["warning: the scene lies 500000", "subtract a constant from all poses"] {
        assert!(far.stderr.contains(part), "`{part}` is missing from: {}", far.stderr);
    }
}

/// Cameras whose world has y down make a file in which up is y, and which says so and its unit.
#[test]
fn glb_of_a_world_with_y_down_stands_upright() {
    let scratch = recorded("64x48", 4);
    // TUM's world has z up: turned about x, its y points down.
    let path = scratch.path("room/groundtruth.txt");
    let text = fs::read_to_string(&path).unwrap();
    let turned = text.lines().map(|line| {
        let fields: Vec<&str> = line.split_whitespace().collect();
        if line.starts_with('#') {
            return format!("{line}\n");
        }
        let [x, y, z, qx, qy, qz, qw]: [f64; 7] =
            std::array::from_fn(|k| fields[k + 1].parse().unwrap());
        let q = glam::DQuat::from_rotation_x(std::f64::consts::FRAC_PI_2)
            * glam::DQuat::from_xyzw(qx, qy, qz, qw);
        let p = glam::DVec3::new(x, -z, y);
        format!("{} {} {} {} {} {} {} {}\n", fields[0], p.x, p.y, p.z, q.x, q.y, q.z, q.w)
    });
    let turned: String = turned.collect();
    scratch.run("train room --out upright").succeeds();
    fs::write(path, turned).unwrap();
    scratch.run("train room --out turned").succeeds();
    for (axes, format) in [("", "glb"), ("--axes viewer", "ply"), ("", "spz")] {
        let read = |run: &str| {
            let export = format!("export {run}/checkpoint.vbgs -o {run}.{format} {axes}");
            scratch.run(&export).succeeds();
            scratch.model(&format!("{run}.{format}")).splats
        };
        let [upright, turned] = ["upright", "turned"].map(read);
        let middle = |splats: &vbgs_studio::model::splat::appearance::SplatSet| {
            let n = splats.len() as f32;
            let sum = |axis: usize| splats.iter().map(|s| s.mean[axis]).sum::<f32>() / n;
            [sum(0), sum(1), sum(2)]
        };
        let [a, b] = [middle(&upright), middle(&turned)];
        let apart = (0..3).map(|i| (a[i] - b[i]).abs()).fold(0.0, f32::max);
        assert!(apart < 0.1, "{format}: {a:?} {b:?}");
    }
    let bytes = scratch.bytes("turned.glb");
    let json = String::from_utf8_lossy(&bytes[..bytes.len().min(100_000)]).into_owned();
    for part in [r#""up":"y""#, r#""units":"metres""#] {
        assert!(json.contains(part), "`{part}` is missing");
    }
}

/// A budget that no machine has memory for costs no work.
#[test]
fn what_memory_cannot_hold_is_refused_before_work() {
    let scratch = Scratch::with_room();
    let huge = "train room --out run --births lattice --photometric light --budget 20000000";
    scratch.run(huge).fails(1, &["--budget: expected at most", "found 20000000", "free memory"]);
    assert!(!scratch.path("run/report.json").exists());
}
