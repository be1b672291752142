//! Conversion between model formats; files that are not models and output places that take no files
//! are refused.

use super::runner::Scratch;
use crate::common::layouts::TestLayout;
use std::fs;
use vbgs_studio::export::{ModelFormat, ModelKind, WriteOptions, write};
use vbgs_studio::model::splat::appearance::{Appearance, SplatSet};
use vbgs_studio::model::splat::splats::Splat;

/// Largest difference between two models, splat by splat.
fn difference(a: &[Splat], b: &[Splat]) -> f32 {
    assert_eq!(a.len(), b.len());
    let largest =
        |x: &[f32], y: &[f32]| x.iter().zip(y).map(|(x, y)| (x - y).abs()).fold(0.0f32, f32::max);
    let splat = |(a, b): (&Splat, &Splat)| {
        largest(&a.mean, &b.mean)
            .max(largest(&a.color, &b.color))
            .max(largest(&a.scale, &b.scale))
            .max(largest(&a.rotation, &b.rotation))
            .max((a.opacity - b.opacity).abs())
    };
    a.iter().zip(b).map(splat).fold(0.0, f32::max)
}

#[test]
fn exports_read_back_equal() {
    let scratch = Scratch::with_scene();
    let original = scratch.model("out/scene.ply").splats;
    for (from, to) in [
        ("out/scene.ply", "a.ply"),
        ("out/scene.ply", "a.glb"),
        ("a.glb", "b.ply"),
        ("b.ply", "c.glb"),
    ] {
        let said = scratch.run(&format!("export {from} -o {to}")).succeeds().stdout;
        assert!(said.contains(&format!("wrote {} splats", original.len())), "{said}");
        let model = scratch.model(to);
        assert_eq!(model.kind, ModelKind::Splats);
        // Round trip of logarithms, logits and sRGB curves in f32.
        let worst = difference(&original, &model.splats);
        assert!(worst < 2e-5, "{from} to {to}: {worst:e}");
    }
}

#[test]
fn a_point_cloud_keeps_centres_and_colours() {
    let scratch = Scratch::with_scene();
    let original = scratch.model("out/scene.ply").splats;
    scratch.run("export out/scene.ply -o cloud.ply --format point-cloud").succeeds();
    let cloud = scratch.model("cloud.ply");
    assert_eq!((cloud.kind, cloud.splats.len()), (ModelKind::PointCloud, original.len()));
    for (a, b) in original.iter().zip(cloud.splats.iter()) {
        assert_eq!(a.mean, b.mean);
        let off = a.color.iter().zip(b.color).any(|(a, b)| (a - b).abs() > 0.5 / 255.0 + 1e-6);
        assert!(!off, "{:?} {:?}", a.color, b.color);
    }
    let info = scratch.run("info cloud.ply --json").succeeds().json();
    assert_eq!(info["kind"], "point-cloud");
}

#[test]
fn mappings_do_not_touch_plain_scenes() {
    let scratch = Scratch::with_scene();
    let options = "--export-mapping clip --export-split 4";
    for name in ["a.ply", "a.glb"] {
        scratch.run(&format!("export out/scene.ply -o {name}")).succeeds();
        let said = scratch.run(&format!("export out/scene.ply -o mapped-{name} {options}"));
        let said = said.succeeds().stderr;
        assert!(said.contains("note: out/scene.ply: no splat has an opacity above 1"), "{said}");
        assert!(said.contains("--export-mapping has no effect"), "{said}");
        assert!(scratch.bytes(name) == scratch.bytes(&format!("mapped-{name}")));
    }
}

#[test]
fn textures_become_small_splats_or_are_named() {
    let scratch = Scratch::with_scene();
    let none = scratch.run("export out/scene.ply -o a.ply --export-detail 100").succeeds().stderr;
    assert!(none.contains("no splat has a texture: --export-detail has no effect"), "{none}");
    let mesh = "export out/checkpoint.vbgs -o a.obj --as mesh --export-detail 100";
    scratch.run(mesh).fails(2, &["--export-detail", "a setting of splats"]);
    for wrong in ["some", "-5", "0.5"] {
        scratch
            .run(&format!("export out/scene.ply -o a.ply --export-detail {wrong}"))
            .fails(2, &["--export-detail", "a whole number; 0 leaves textures out"]);
    }
    // By default they are written.
    scratch.run("train room --out run --max-frames 3").succeeds();
    let said = scratch.run("export run/checkpoint.vbgs -o native.ply --export-detail 0").succeeds();
    assert!(said.stderr.contains("are not stored"), "{}", said.stderr);
    let said = scratch.run("export run/checkpoint.vbgs -o all.ply").succeeds();
    assert!(!said.stderr.contains("are not stored"), "{}", said.stderr);
    let [native, all, trained] =
        ["native.ply", "all.ply", "run/scene.ply"].map(|name| scratch.model(name).splats.len());
    assert!(native < all && all == trained, "{native}, {all} and {trained} splats");
}

#[test]
fn exports_are_chosen_turned_scaled_and_meshed() {
    let scratch = Scratch::with_room();
    scratch.run("train room --out run").succeeds();
    let count = |name: &str| scratch.model(name).splats.len();
    let export = |options: &str, to: &str| {
        scratch.run(&format!("export run/checkpoint.vbgs -o {to} {options}")).succeeds()
    };
    export("", "all.ply");
    export("--min-evidence 20 --max-uncertainty 0.05", "sure.ply");
    export("--crop -9,-9,0,9,9,1", "low.spz");
    for name in ["sure.ply", "low.spz"] {
        assert!((1..count("all.ply")).contains(&count(name)), "{name}");
    }
    export("--format point-cloud", "points.ply");
    let header = String::from_utf8_lossy(&scratch.bytes("points.ply")).into_owned();
    for known in ["confidence", "uncertainty"] {
        assert!(header.contains(&format!("property float {known}\n")), "{known} is missing");
    }
    let comments = scratch.run("info all.ply").succeeds().stdout;
    for said in
        ["vbgs made by vbgs-studio", "preset scene, from 8 frames", "vbgs antialias footprint"]
    {
        assert!(comments.contains(said), "{said} is missing in: {comments}");
    }
    // Export with `--up -y` makes y the up axis; reading takes y as up again.
    scratch.run("export all.ply -o turned.glb --up -y --unit-scale 10").succeeds();
    let (before, after) = (scratch.model("all.ply").splats, scratch.model("turned.glb").splats);
    for (a, b) in before.iter().zip(after.iter()) {
        let [x, y, z] = a.mean.map(|v| 10.0 * v);
        let apart = [b.mean[0] - x, b.mean[1] - z, b.mean[2] + y];
        assert!(apart.iter().all(|v| v.abs() < 1e-4), "{a:?} {b:?}");
    }
    for name in ["mesh.ply", "mesh.glb", "mesh.obj"] {
        let said = export("--as mesh", name).stdout;
        assert!(said.contains(" triangles, ") && !said.contains(" 0 vertices"), "{said}");
    }
    scratch
        .run("export all.ply -o a.obj --as mesh")
        .fails(1, &["all.ply: expected a checkpoint of the `scene` preset", "train with"]);
    scratch
        .run("export all.ply -o a.ply --min-evidence 2")
        .fails(1, &["a.ply: least evidence: expected a model with training statistics"]);
    for (options, parts) in [
        ("-o a.ply --as mesh --sh3-padding", &["--sh3-padding: a setting of splats"][..]),
        ("-o a.ply --cell 0.1", &["--cell: a setting of meshes"]),
        ("-o a.ply --crop 1,2,3", &["--crop", "expected six numbers X,Y,Z,X,Y,Z"]),
        ("-o a.ply --crop 1,2,3,4,5,6,x", &["--crop", "expected six numbers X,Y,Z,X,Y,Z"]),
        ("-o a.ply --unit-scale 0", &["--unit-scale", "expected a factor from 1e-9 to 1e9"]),
    ] {
        scratch.run(&format!("export all.ply {options}")).fails(2, parts);
    }
}

#[test]
fn view_dependent_colour_passes_through() {
    let scratch = Scratch::empty();
    let splat = Splat { opacity: 0.9, color: [0.3, -0.2, 1.1], ..Splat::default() };
    let directional = [[0.5, -0.25, 0.0], [0.0, 0.125, 0.75], [-0.5, 0.0, 0.25]];
    let mut splats = SplatSet::default();
    splats.push(splat, Appearance { directional, ..Appearance::default() });
    write(&scratch.path("a.ply"), &splats, &WriteOptions::new(ModelFormat::Ply)).unwrap();
    for (from, to) in [("a.ply", "b.glb"), ("b.glb", "c.ply")] {
        scratch.run(&format!("export {from} -o {to}")).succeeds();
        let model = scratch.model(to);
        assert!(difference(&model.splats, &splats) < 1e-6);
        let back = model.splats.view().appearance()[0].directional;
        for (a, b) in back.iter().flatten().zip(directional.iter().flatten()) {
            assert!((a - b).abs() < 1e-6, "{to}: {back:?}");
        }
    }
    assert_eq!(scratch.run("info c.ply --json").succeeds().json()["sh_degree"], 1);
    let said = scratch.run("info c.ply").succeeds().stdout;
    assert!(said.contains("harmonics of degree 1"), "{said}");
    // Between the views along x and −x the splat's red and blue differ by 1.
    let side = |name: &str, azimuth: u32| {
        let view = format!("render c.ply -o {name} --orbit {azimuth},0,8 --size 9x9");
        scratch.run(&view).succeeds();
        image::open(scratch.path(name)).unwrap().to_rgb8().get_pixel(4, 4).0
    };
    let (ahead, behind) = (side("a.png", 0), side("b.png", 180));
    assert!(ahead[0] == 0 && behind[0] > 150, "{ahead:?} {behind:?}");
}

#[test]
fn a_legacy_scene_says_so() {
    let scratch = Scratch::with_room();
    scratch
        .run(
            "train room --out out --preset paper --set components=2000 --set covariance_form=legacy-cov",
        )
        .succeeds();
    scratch.run("export out/scene.ply -o a.glb").succeeds();
    scratch.run("export a.glb -o b.ply").succeeds();
    for file in ["out/scene.ply", "a.glb", "b.ply"] {
        let said = scratch.run(&format!("info {file}")).succeeds().stdout;
        assert_eq!(said.matches("vbgs legacy-cov").count(), 1, "{said}");
        assert!(said.matches("Vertical axis").count() <= 1, "{said}");
    }
    assert_eq!(scratch.model("b.ply").splats.len(), 2000, "unused components are exported");
}

#[test]
fn files_that_hold_no_model() {
    let scratch = Scratch::with_scene();
    let scene = scratch.bytes("out/scene.ply");
    scratch.run("export out/scene.ply -o out/scene.glb").succeeds();
    let glb = scratch.bytes("out/scene.glb");
    fs::write(scratch.path("empty.ply"), "").unwrap();
    fs::write(scratch.path("empty.glb"), "").unwrap();
    fs::write(scratch.path("short.ply"), &scene[..scene.len() / 2]).unwrap();
    fs::write(scratch.path("header.ply"), &scene[..100]).unwrap();
    fs::write(scratch.path("short.glb"), &glb[..glb.len() / 2]).unwrap();
    fs::write(scratch.path("text.ply"), "a shopping list").unwrap();
    fs::write(scratch.path("image.glb"), scratch.bytes("room/train/r_0.png")).unwrap();
    fs::write(scratch.path("cloud.obj"), "v 1 2 3").unwrap();
    for (file, parts) in [
        ("none.ply", &["expected", "found nothing", "check the spelling"][..]),
        (
            "empty.ply",
            &["expected a model (.ply, .glb, .gltf, .spz, .sog or .splat)", "found an empty file"],
        ),
        (
            "empty.glb",
            &["expected a model (.ply, .glb, .gltf, .spz, .sog or .splat)", "found an empty file"],
        ),
        ("short.ply", &["expected", "rows", "found", "export the file again"]),
        ("header.ply", &["expected", "found", "export the file again"]),
        ("short.glb", &["expected", "found", "export the file again"]),
        (
            "text.ply",
            &[
                "expected a model (.ply, .glb, .gltf, .spz, .sog or .splat)",
                "found a file starting \"a shopping",
            ],
        ),
        ("image.glb", &["expected a model (.ply, .glb, .gltf, .spz, .sog or .splat)", "found"]),
        (
            "cloud.obj",
            &["expected a model (.ply, .glb, .gltf, .spz, .sog or .splat)", "found", "convert it"],
        ),
        ("out/report.json", &["expected glTF 2.0", "found"]),
        ("room", &["expected a file", "found a folder"]),
    ] {
        let named = |parts: &[&'static str]| [&[file][..], parts].concat();
        scratch.run(&format!("eval {file} room")).fails(1, &named(parts));
        scratch.run(&format!("render {file} -o a.png")).fails(1, &named(parts));
        scratch.run(&format!("export {file} -o a.ply")).fails(1, &named(parts));
        if !["none.ply", "room"].contains(&file) {
            scratch.run(&format!("info {file}")).fails(1, &named(parts));
        }
    }
    assert!(!scratch.path("a.png").exists() && !scratch.path("a.ply").exists());
}

/// The content of an archive decides whether it is a model or a recording, not its name.
#[test]
fn splats_in_an_archive_are_a_model_whatever_its_name() {
    let scratch = Scratch::with_scene();
    scratch.run("export out/scene.ply -o a.sog").succeeds();
    let sog = scratch.bytes("a.sog");
    let n = scratch.model("out/scene.ply").splats.len();
    for name in ["a.sog", "a.zip", "a.r3d", "a"] {
        fs::write(scratch.path(name), &sog).unwrap();
        let info = scratch.run(&format!("info {name} --json")).succeeds().json();
        assert_eq!((&info["kind"], &info["splats"]), (&"splats".into(), &n.into()), "{name}");
    }
    // A damaged archive has only its name.
    let damaged = &sog[..sog.len() / 2];
    fs::write(scratch.path("b.sog"), damaged).unwrap();
    scratch.run("info b.sog").fails(1, &["b.sog", "SOG", "export the file again"]);
    fs::write(scratch.path("b.zip"), damaged).unwrap();
    scratch.run("info b.zip").fails(1, &["b.zip", "whole zip archive", "recording"]);
    scratch.record("room.r3d", TestLayout::Record3dArchive, 2, 0);
    let archive = fs::read_dir(scratch.path("room.r3d")).unwrap().next().unwrap().unwrap().path();
    fs::copy(archive, scratch.path("recording.sog")).unwrap();
    let info = scratch.run("info recording.sog --json").succeeds().json();
    assert!(info["layout"].is_string() && info["splats"].is_null(), "{info}");
}

#[test]
fn places_that_take_no_files() {
    let scratch = Scratch::with_scene();
    fs::write(scratch.path("file"), "x").unwrap();
    let folder = ["expected a folder to write to", "choose another"];
    for out in ["file", "file/inside"] {
        let parts = [&[out][..], &folder].concat();
        scratch.run(&format!("train room --out {out}")).fails(1, &parts);
        scratch.run(&format!("render out/scene.ply -o {out} --turntable 2")).fails(1, &parts);
        scratch.run(&format!("synth {out}")).fails(1, &[out, "expected to write", "check"]);
    }
    if cfg!(target_os = "linux") {
        // Nobody, not even root, can create files here.
        for out in ["/proc", "/proc/new"] {
            let parts = [&[out][..], &folder].concat();
            scratch.run(&format!("train room --out {out}")).fails(1, &parts);
        }
    }
    for (output, parts) in [
        ("out", &["out: expected a file", "found a folder", "name a file in it"][..]),
        ("nowhere/a.ply", &["nowhere/a.ply", "folder nowhere does not exist", "create it"]),
        (
            "a.xyz",
            &[
                "a.xyz",
                "ending in .ply, .glb, .spz, .sog, .html or .usda",
                "found \"xyz\"",
                "rename it",
            ],
        ),
        ("a", &["ending in .ply, .glb, .spz, .sog, .html or .usda", "found \"\"", "name a format"]),
    ] {
        let format = if output == "out" { "--format ply" } else { "" };
        scratch.run(&format!("export out/scene.ply -o {output} {format}")).fails(1, parts);
    }
    assert_eq!(scratch.bytes("file"), b"x");
}
