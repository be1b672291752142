//! Worlds in any unit, worlds far from the origin, and outlier poses.

use super::runner::{Run, Scratch};
use glam::{DQuat, DVec3};
use serde_json::Value;
use std::f64::consts::FRAC_PI_2;
use std::fs;
use vbgs_studio::model::splat::splats::Splat;

/// Recording in the TUM layout, whose poses are text and so easy to change.
fn recorded(size: &str, frames: usize) -> Scratch {
    let scratch = Scratch::empty();
    let synth = format!("synth room --layout tum --size {size} --frames {frames} --eval-frames 0");
    scratch.run(&synth).succeeds();
    scratch
}

/// Rewrites the position of every pose from its number and old position.
fn move_cameras(scratch: &Scratch, to: impl Fn(usize, [f64; 3]) -> [f64; 3]) {
    place_cameras(scratch, |i, place, rotation| (to(i, place.to_array()).into(), rotation));
}

/// Rewrites every pose from its number, old position and old rotation.
fn place_cameras(scratch: &Scratch, to: impl Fn(usize, DVec3, DQuat) -> (DVec3, DQuat)) {
    let path = scratch.path("room/groundtruth.txt");
    let text = fs::read_to_string(&path).unwrap();
    let (head, poses): (Vec<&str>, Vec<&str>) = text.lines().partition(|l| l.starts_with('#'));
    let moved = poses.iter().enumerate().map(|(i, line)| {
        let fields: Vec<&str> = line.split_whitespace().collect();
        let [x, y, z, a, b, c, w] = [1, 2, 3, 4, 5, 6, 7].map(|k| fields[k].parse().unwrap());
        let (place, turn) = to(i, DVec3::new(x, y, z), DQuat::from_xyzw(a, b, c, w));
        let numbers = place.to_array().into_iter().chain(turn.to_array());
        format!(
            "{} {}\n",
            fields[0],
            numbers.map(|v| format!("{v:e}")).collect::<Vec<_>>().join(" ")
        )
    });
    let text: String = head.iter().map(|line| format!("{line}\n")).chain(moved).collect();
    fs::write(path, text).unwrap();
}

/// Report and stderr of training, with held-out views, in a world of `metre` units per metre.
fn measured(metre: f64) -> (Value, String) {
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
    let train = format!("train room --out run --eval held-out --json {depth}");
    let Run { stdout, stderr, .. } = scratch.run(&train).succeeds();
    let report: Value = serde_json::from_str(&stdout).unwrap();
    (report["eval"][0].clone(), stderr)
}

/// Near plane, sensor noise and all thresholds in metres scale with the unit of the world.
#[test]
fn figures_do_not_depend_on_the_unit_of_the_world() {
    let (one, _) = measured(1.0);
    for metre in [1e-4, 1e4] {
        let (other, said) = measured(metre);
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
            assert!(differ(path) <= most, "{metre}, {path}: {one} {other}");
        }
        let error = |eval: &Value| eval["depth_mae_mean"].as_f64().unwrap();
        let ratio = error(&other) / error(&one) / metre;
        assert!((ratio - 1.0).abs() < 0.02, "{metre}: depth error {ratio}");
    }
}

/// Multiplies all depth codes by a factor and rounds them.
fn recode_depth(scratch: &Scratch, by: f64) {
    for file in fs::read_dir(scratch.path("room/depth")).unwrap() {
        let path = file.unwrap().path();
        let mut codes = image::open(&path).unwrap().to_luma16();
        codes.iter_mut().for_each(|code| *code = (f64::from(*code) * by).round() as u16);
        codes.save(path).unwrap();
    }
}

/// Share of splats that the other model also has, in a world `metre` times as large.
fn share_in_both(scratch: [&Scratch; 2], metre: f32) -> f64 {
    let [one, other] = scratch.map(|scratch| scratch.model("run/native.ply").splats);
    let is_same = |a: &Splat, b: &Splat| {
        let near = |a: f32, b: f32, most: f32| (a - b / metre).abs() <= most;
        (0..3).all(|i| near(a.mean[i], b.mean[i], 1e-4))
            && (0..3).all(|i| near(a.scale[i], b.scale[i], 0.01 * a.scale[i]))
            && (a.opacity - b.opacity).abs() < 0.01
            && (0..3).all(|i| (a.color[i] - b.color[i]).abs() < 0.01)
    };
    let n = one.iter().filter(|a| other.iter().any(|b| is_same(a, b))).count();
    n as f64 / one.len().max(other.len()) as f64
}

/// `--depth-scale` is the length of one depth code in world units. Sensor constants in metres are
/// converted to the unit of the world, so the scene is the same.
#[test]
fn the_scene_does_not_depend_on_the_unit_of_depth() {
    // Codes of TUM are fifths of a millimetre: here whole millimetres, as in no layout.
    let trained = |by: f64, metre: f64, depth: &str| {
        let scratch = recorded("64x48", 9);
        recode_depth(&scratch, 0.2);
        recode_depth(&scratch, by);
        move_cameras(&scratch, |_, place| place.map(|x| x * metre));
        let said = scratch.run(&format!("train room --out run {depth}")).succeeds();
        assert_eq!(said.stderr.contains("to the metre"), metre != 1.0, "{}", said.stderr);
        let export = "export run/checkpoint.vbgs -o run/native.ply --export-detail 0";
        scratch.run(export).succeeds();
        scratch
    };
    let plain = trained(1.0, 1.0, "--depth-scale 0.001");
    for (by, metre, depth) in [
        (10.0, 1.0, "--depth-scale 0.0001"),
        (1.0, 10.0, "--depth-scale 0.01 --depth-range 3 40"),
        (5.0, 1.0, ""),
        (5.0, 10.0, "--depth-scale 0.002 --depth-range 3 40"),
        (1.0, 1000.0, "--depth-scale 1 --depth-range 300 4000"),
    ] {
        let share = share_in_both([&plain, &trained(by, metre, depth)], metre as f32);
        // Rounding decides the few births at the limit of the structural scale.
        assert!(share > 0.98, "{depth}: {share} of the scene");
    }
}

/// An outlier pose loses the points of its frame only, and a warning names the frame.
#[test]
fn a_wild_pose_is_named_and_leaves_the_rest_as_it_is() {
    let psnr = |run: Run| run.json()["eval"][0]["psnr_mean"].as_f64().unwrap();
    let train = |preset: &str| format!("train room --out run --eval held-out --json {preset}");
    for (preset, at) in [("--preset paper --set components=500", 6), ("", 1)] {
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
            assert!(
                source.contains("outlier poses left out") && source.contains(&frame),
                "{source}"
            );
        }
        let wild = psnr(run);
        assert!(wild > sound - 1.5, "{preset}: {sound} dB, with a wild pose {wild} dB");
        let info = scratch.run("info room --json").succeeds().json();
        let defects = info["defects"].to_string();
        assert!(defects.contains(&frame), "{defects}");
    }
}

/// Map coordinates, which f32 rounds to whole metres.
const FAR: [f64; 3] = [1e7, -1e7, 0.0];
/// Tolerance of scores, dB.
const SAME: f64 = 0.05;

fn moved_by([x, y, z]: [f64; 3], far: [f64; 3]) -> [f64; 3] {
    [x + far[0], y + far[1], z + far[2]]
}

/// Recording whose world has its origin far away.
fn far_recording() -> Scratch {
    let scratch = recorded("64x48", FRAMES);
    move_cameras(&scratch, |_, place| moved_by(place, FAR));
    scratch
}

/// Enough frames to cover the held-out views; gaps would hide errors.
const FRAMES: usize = 24;

/// PSNR of held-out views, over all and over covered pixels.
fn held_out_psnr(scratch: &Scratch, command: &str) -> [f64; 2] {
    let run = scratch.run(&format!("{command} --json")).succeeds();
    let eval = &run.json()["eval"][0];
    // NaN if no pixel is covered.
    ["psnr_mean", "psnr_covered_mean"].map(|name| eval[name].as_f64().unwrap_or(f64::NAN))
}

#[track_caller]
fn differ_by_less(most: f64, a: [f64; 2], b: [f64; 2], what: &str) {
    for (a, b) in a.into_iter().zip(b) {
        assert!((a - b).abs() < most, "{what}: {a} and {b} dB");
    }
}

/// Scores of the run and of its files do not depend on where the world lies.
#[test]
fn figures_do_not_depend_on_where_the_world_lies() {
    for preset in ["--preset scene", "--preset paper --set components=500"] {
        let figures = |scratch: Scratch| {
            let train = format!("train room --out run --eval held-out {preset}");
            let trained = held_out_psnr(&scratch, &train);
            scratch.run("export run/checkpoint.vbgs -o run/scene.glb --up z").succeeds();
            // PLY and GLB lose detail of the native scene, equally in both worlds.
            let eval =
                |model| held_out_psnr(&scratch, &format!("eval run/{model} room --split held-out"));
            let [checkpoint, ply, glb] = ["checkpoint.vbgs", "scene.ply", "scene.glb"].map(eval);
            differ_by_less(1e-6, trained, checkpoint, preset);
            differ_by_less(SAME, ply, glb, preset);
            [checkpoint, ply, glb]
        };
        let [near, far] = [recorded("64x48", FRAMES), far_recording()].map(figures);
        for ((near, far), model) in near.into_iter().zip(far).zip(["checkpoint", "PLY", "GLB"]) {
            differ_by_less(SAME, near, far, &format!("{preset}, {model}"));
        }
    }
}

/// Files store the local origin, or a warning states that the format cannot.
#[test]
fn files_of_a_far_world_say_where_it_lies() {
    let scratch = far_recording();
    let run = scratch.run("train room --out run").succeeds();
    assert!(run.stderr.contains("relative to the local origin (10000"), "{}", run.stderr);
    assert!(run.stderr.contains("only a comment of the file states"), "{}", run.stderr);
    let export = |options: &str| {
        scratch.run(&format!("export run/checkpoint.vbgs -o {options}")).succeeds().stderr
    };
    assert!(!export("scene.glb").contains("local origin"));
    assert!(!export("scene.usda").contains("local origin"));
    for (to, said) in [
        ("scene.spz", "the file cannot store"),
        ("scene.sog", "the file cannot store"),
        ("scene.html", "the file cannot store"),
        ("cloud.ply --format point-cloud", "only a comment"),
        ("mesh.obj --as mesh", "only a comment"),
    ] {
        let warned = export(to);
        assert!(warned.contains("warning") && warned.contains(said), "{to}: {warned}");
    }
    let near = |at: [f64; 3]| {
        (0..3).all(|axis| (at[axis] - FAR[axis]).abs() < 20.0 && at[axis].fract() == 0.0)
    };
    let origin = |model: &str| scratch.model(model).local_origin.to_array();
    for model in ["run/scene.ply", "cloud.ply", "scene.glb"] {
        assert!(near(origin(model)), "{model}: {:?}", origin(model));
        let info = scratch.run(&format!("info {model} --json")).succeeds().json();
        let low = info["bounds"][0][0].as_f64().unwrap();
        assert!((low - FAR[0]).abs() < 20.0, "{model}: {low}");
    }
    // Round trips through other formats, axes and units.
    for (from, options, factor) in [
        ("run/scene.ply", "again.glb --up z", 1.0),
        ("scene.glb", "again.ply", 1.0),
        ("run/scene.ply", "again.ply --axes viewer --up z --unit-scale 100", 100.0),
    ] {
        scratch.run(&format!("export {from} -o {options}")).succeeds();
        let again = scratch.model(options.split(' ').next().unwrap());
        let found = again.local_origin / factor;
        let expected = glam::DVec3::from_array(origin("run/scene.ply"));
        let turned = glam::DVec3::new(-expected.x, -expected.z, -expected.y);
        let expected = if options.contains("viewer") { turned } else { expected };
        assert!((found - expected).length() < 1e-6, "{options}: {found} {expected}");
        let lines = again.comments.iter().filter(|line| line.contains("local origin")).count();
        assert!(lines <= 1, "{:?}", again.comments);
    }
}

/// Outputs of a world near zero do not mention an origin.
#[test]
fn a_world_near_zero_has_no_local_origin() {
    let scratch = recorded("64x48", 6);
    let run = scratch.run("train room --out run").succeeds();
    assert!(!run.stderr.contains("origin"), "{}", run.stderr);
    for file in ["run/checkpoint.vbgs", "run/report.json", "run/scene.ply"] {
        let bytes = scratch.bytes(file);
        let text = String::from_utf8_lossy(&bytes);
        assert!(!text.contains("local_origin") && !text.contains("local origin"), "{file}");
    }
}

/// A resumed run in a far world gives the same scores, and renders show the room.
#[test]
fn a_far_run_is_resumed_and_drawn() {
    let scratch = far_recording();
    let train = "train room --eval held-out";
    let whole = held_out_psnr(&scratch, &format!("{train} --out whole"));
    scratch.run("train room --out half --max-frames 3").succeeds();
    // The first run reads part of the recording: resuming must keep its origin.
    let resume = format!("{train} --out rest --resume half/checkpoint.vbgs --max-frames 100");
    let resumed = held_out_psnr(&scratch, &resume);
    differ_by_less(1e-9, whole, resumed, "resumed");
    for view in ["--dataset room --view 0", "--size 64x48"] {
        let render = format!("render rest/checkpoint.vbgs -o view.png {view}");
        scratch.run(&render).succeeds();
        let picture = image::open(scratch.path("view.png")).unwrap().to_rgb8();
        let lit = picture.pixels().filter(|p| p.0.iter().any(|&c| c > 20)).count();
        let all = picture.pixels().len();
        // Everything outside the room is black.
        assert!(4 * lit > all, "{view}: {lit} of {all}");
    }
}

/// Models and cameras with different origins are refused or cause a warning.
#[test]
fn other_origins_are_refused_or_said() {
    let scratch = far_recording();
    scratch.run("train room --out far --shard 1/2").succeeds();
    scratch.run("export far/checkpoint.vbgs -o far.spz").succeeds();
    let eval = scratch.run("eval far.spz room --split held-out").succeeds();
    assert!(
        eval.stderr.contains("from the local origin (0, 0, 0) of the model"),
        "{}",
        eval.stderr
    );
    move_cameras(&scratch, |_, place| moved_by(place, [5e5, 0.0, 0.0]));
    scratch.run("train room --out other --shard 2/2").succeeds();
    let merge = "merge far/checkpoint.vbgs other/checkpoint.vbgs -o both.vbgs";
    scratch.run(merge).fails(1, &["the same local origin in both", "10000", "10500"]);
    let eval = scratch.run("eval far/checkpoint.vbgs room --split held-out").succeeds();
    assert!(eval.stderr.contains("of the model beside them"), "{}", eval.stderr);
}

/// Prints scores by unit and position of the world.
#[test]
#[ignore = "prints a table, a minute of training"]
fn figures_of_units_and_places() {
    println!("{:>8} {:>10} {:>8} {:>8}", "metre", "moved", "scene", "paper");
    for metre in [1e-4, 1.0, 1e4] {
        for moved in [0.0, 1e2, 1e3, 1e5, 1e7] {
            let psnr = ["", "--preset paper --set components=500"].map(|preset| {
                let scratch = recorded("64x48", FRAMES);
                let far = [moved, -moved, 0.0];
                move_cameras(&scratch, |_, place| moved_by(place.map(|x| x * metre), far));
                let depth = match metre == 1.0 {
                    true => String::new(),
                    false => format!(
                        "--depth-scale {:e} --depth-range {:e} {:e}",
                        metre / 5000.0,
                        0.3 * metre,
                        4.0 * metre
                    ),
                };
                let train = format!("train room --out run --eval held-out {depth} {preset}");
                held_out_psnr(&scratch, &train)
            });
            println!("{metre:>8.0e} {moved:>10.0e} {:>8.3?} {:>8.3?}", psnr[0], psnr[1]);
        }
    }
}

/// A GLB of a world with y down has y up, and its metadata state the axis and the unit.
#[test]
fn glb_of_a_world_with_y_down_stands_upright() {
    let scratch = recorded("64x48", 4);
    // TUM's world has z up; this rotation about x makes y point down.
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

/// A budget beyond the machine's memory is refused before training.
#[test]
fn what_memory_cannot_hold_is_refused_before_work() {
    let scratch = Scratch::with_room();
    let huge = "train room --out run --photometric light --budget 20000000";
    scratch.run(huge).fails(
        1,
        &["budget (`--budget`): found 20000000", "expected at most", "of memory for this program"],
    );
    assert!(!scratch.path("run/report.json").exists());
}

/// GLB, SPZ and SOG define their axes, so an export is turned away from a world that is not z-up.
#[test]
fn exports_of_every_format_stand_in_the_world_of_their_dataset() {
    for (up, turn) in [
        (DVec3::NEG_Y, DQuat::from_rotation_x(FRAC_PI_2)),
        (DVec3::X, DQuat::from_rotation_y(FRAC_PI_2)),
        // Not within 30° of an axis.
        (DVec3::new(0.0, -0.6, 0.8), DQuat::from_rotation_x(0.6_f64.asin())),
    ] {
        let scratch = recorded("64x48", 9);
        assert!((turn * DVec3::Z).dot(up) > 0.999, "{}", turn * DVec3::Z);
        place_cameras(&scratch, |_, place, rotation| (turn * place, turn * rotation));
        scratch.run("train room --out out").succeeds();
        let psnr = |model: &str| {
            let run = scratch.run(&format!("eval {model} room --json")).succeeds();
            run.json()["eval"][0]["psnr_mean"].as_f64().unwrap()
        };
        let own = psnr("out/scene.ply");
        for name in ["a.glb", "a.spz", "a.sog"] {
            scratch.run(&format!("export out/checkpoint.vbgs -o {name}")).succeeds();
            let found = psnr(name);
            assert!((own - found).abs() < 0.3, "{name}, up {up}: {own} and {found} dB");
        }
    }
}
