//! `register`: scale, level and place of a checkpoint, which every export applies and no training loses.

use super::runner::Scratch;
use glam::{DQuat, DVec3};
use std::fs;
use vbgs_studio::model::splat::splats::Splat;

fn place(splat: &Splat) -> DVec3 {
    DVec3::from_array(splat.mean.map(f64::from))
}

fn trained() -> Scratch {
    let scratch = Scratch::with_room();
    scratch.run("train room --out run --scale 0.3 --max-frames 3").succeeds();
    scratch.run("export run/checkpoint.vbgs -o plain.ply --export-detail 0").succeeds();
    scratch
}

#[test]
fn exports_are_in_the_coordinates_of_control_points() {
    let scratch = trained();
    let plain = scratch.model("plain.ply");
    // The truth, and six points of the room in a map.
    let (turn, far) = (DQuat::from_rotation_z(2.1), DVec3::new(691_234.5, 5_335_987.25, 512.0));
    let to_map = |p: DVec3| 0.98 * (turn * p) + far;
    let mut text = "# x y z east north height\n\n".to_owned();
    for splat in plain.splats.iter().step_by(9) {
        let (p, q) = (place(splat), to_map(place(splat)));
        text += &format!("{} {},{}; {}\t{} {}\n", p.x, p.y, p.z, q.x, q.y, q.z);
    }
    fs::write(scratch.path("points.txt"), text).unwrap();
    let before = scratch.bytes("run/checkpoint.vbgs");
    let run = scratch.run("register run/checkpoint.vbgs --to points.txt --system EPSG:25832");
    let said = run.succeeds().stdout;
    assert!(said.contains("EPSG:25832") && said.contains("deviate by 0.0000 RMS"), "{said}");
    assert!(scratch.bytes("run/checkpoint.vbgs.bak") == before, "the older file stays");
    let info = scratch.run("info run/checkpoint.vbgs --json").succeeds().json();
    assert!((info["registration"]["scale"].as_f64().unwrap() - 0.98).abs() < 1e-7, "{info}");
    let native = "--export-detail 0";
    for (file, options) in
        [("a.ply", native), ("a.glb", native), ("cloud.ply", "--format point-cloud")]
    {
        scratch.run(&format!("export run/checkpoint.vbgs -o {file} {options}")).succeeds();
        let model = scratch.model(file);
        assert_eq!(model.splats.len(), plain.splats.len());
        for (a, b) in plain.splats.iter().zip(model.splats.iter()) {
            let error = (place(b) + model.local_origin).distance(to_map(place(a)));
            assert!(error < 1e-5, "{file}: {error}");
        }
    }
    let warned = scratch.run("export run/checkpoint.vbgs -o a.spz").succeeds().stderr;
    assert!(warned.contains("691234.5") && warned.contains("cannot store"), "{warned}");
    // Training and merging keep it, and it changes nothing that they learn.
    let train = |from: &str, out: &str| {
        scratch.run(&format!("train room --resume {from} --out {out} --max-frames 5")).succeeds();
        scratch.run(&format!("info {out}/checkpoint.vbgs --json")).succeeds().json()
    };
    let more = train("run/checkpoint.vbgs", "more");
    assert_eq!(more["registration"], info["registration"]);
    fs::write(scratch.path("older.vbgs"), before).unwrap();
    assert!(train("older.vbgs", "other").get("registration").is_none());
    let [registered, world] = ["more/scene.ply", "other/scene.ply"].map(|file| scratch.model(file));
    assert_eq!(registered.splats.len(), world.splats.len());
    for (a, b) in world.splats.iter().zip(registered.splats.iter()) {
        let error = (place(b) + registered.local_origin).distance(to_map(place(a)));
        assert!(error < 1e-5, "scene.ply: {error}");
    }
    // Without its registration the file is the former one.
    scratch.run("register run/checkpoint.vbgs --clear -o clear.vbgs").succeeds();
    scratch.run("export clear.vbgs -o again.ply --export-detail 0").succeeds();
    assert!(scratch.bytes("again.ply") == scratch.bytes("plain.ply"));
}

#[test]
fn a_length_a_floor_and_a_place_are_enough() {
    let scratch = trained();
    fs::write(scratch.path("one.txt"), "0 0 0 10 20 30").unwrap();
    let run = scratch.run(
        "register run/checkpoint.vbgs -o b.vbgs --scale-by 0,0,0 -2,0,0 500cm --up-by 1,0,0 0,1,0 0,0,0 --to one.txt",
    );
    let said = run.succeeds().stdout;
    assert!(said.contains("scale 2.5,") && said.contains("(10, 20, 30), metres"), "{said}");
    scratch.run("export b.vbgs -o b.ply --export-detail 0").succeeds();
    let [plain, found] = ["plain.ply", "b.ply"].map(|file| scratch.model(file));
    for (a, b) in plain.splats.iter().zip(found.splats.iter()) {
        let expected = 2.5 * place(a) + DVec3::new(10.0, 20.0, 30.0);
        assert!(place(b).distance(expected) < 1e-5);
        let ratio = f64::from(b.scale[0] / a.scale[0]);
        assert!((ratio - 2.5).abs() < 1e-5, "{ratio}");
    }
}

#[test]
fn references_that_say_nothing_are_refused() {
    let scratch = trained();
    let checkpoint = scratch.bytes("run/checkpoint.vbgs");
    let mirrored = "0 0 0 0 0 0\n1 0 0 0 1 0\n0 1 0 1 0 0\n0 0 1 0 0 1\n";
    for (name, text) in [
        ("two.txt", "0 0 0 1 1 1\n1 0 0 2 1 1\n"),
        ("line.txt", "0 0 0 1 1 1\n1 0 0 2 1 1\n2 0 0 3 1 1\n"),
        ("words.txt", "0 0 0 1 1 1\n1 0 0 north\n"),
        ("nan.txt", "0 0 0 1 1 nan\n"),
        ("empty.txt", "# nothing\n"),
        ("mirrored.txt", mirrored),
    ] {
        fs::write(scratch.path(name), text).unwrap();
    }
    for (options, code, parts) in [
        ("", 2, &["--scale-by, --up-by, --to or --clear"][..]),
        ("--scale-by 0,0,0 0,0,0 1m", 1, &["--scale-by: expected two different points"]),
        ("--scale-by 0,0,0 1,0,0 0m", 2, &["--scale-by", "length above 0", "found 0,0,0 1,0,0 0m"]),
        ("--scale-by 0,0 1,0,0 1m", 2, &["--scale-by", "X,Y,Z X,Y,Z LENGTH"]),
        ("--up-by 0,0,0 1,0,0 2,0,0", 1, &["--up-by", "not on a line"]),
        ("--up-by 0,0,0 1,0,0 inf,0,0", 2, &["three numbers X,Y,Z"]),
        ("--to two.txt", 1, &["three and more, found 2"]),
        ("--to line.txt", 1, &["not on a line"]),
        ("--to words.txt", 1, &["words.txt", "six numbers", "found 1 0 0 north in line 2"]),
        ("--to nan.txt", 1, &["nan.txt", "line 1"]),
        ("--to empty.txt", 1, &["empty.txt", "one pair of control points or more, found none"]),
        ("--to none.txt", 1, &["none.txt", "found nothing"]),
        ("--to run", 1, &["found a folder"]),
        ("--up-by 0,0,0 1,0,0 0,1,0 --system naïve", 2, &["--system", "ASCII"]),
        ("--clear --system a", 2, &["--clear"]),
    ] {
        scratch.run(&format!("register run/checkpoint.vbgs {options}")).fails(code, parts);
    }
    scratch.run("register plain.ply --clear").fails(1, &["plain.ply", "checkpoint"]);
    assert!(scratch.bytes("run/checkpoint.vbgs") == checkpoint, "a refusal changes no file");
    // Swapped axes cannot be refused, but are named.
    let run = scratch.run("register run/checkpoint.vbgs --to mirrored.txt -o m.vbgs").succeeds();
    assert!(run.stderr.contains("east, north and height"), "{}", run.stderr);
}
