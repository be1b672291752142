//! Wrong usage ends with status 2 and lists the allowed values.

use super::runner::Scratch;

#[test]
fn settings_out_of_range() {
    let scratch = Scratch::with_room();
    for (option, parts) in [
        ("--preset paper --set components=0", &["components", "1 to 20000000", "found 0"][..]),
        (
            "--preset paper --set components=20000001",
            &["components", "1 to 20000000", "found 20000001"],
        ),
        ("--set components=-5", &["--set components", "-5"]),
        ("--set components=many", &["--set components", "many"]),
        ("--preset paper --set candidates=0", &["candidates", "1 to 1024, or dense", "found 0"]),
        (
            "--preset paper --set components=50 --set candidates=51",
            &["candidates: expected at most the number of components, 50", "found 51"],
        ),
        ("--set candidates=some", &["candidates", "expected a number or `dense`", "`some`"]),
        ("--preset paper --set reassign_fraction=2", &["reassign_fraction", "0 to 1", "found 2"]),
        (
            "--preset paper --set reassign_fraction=-0.1",
            &["reassign_fraction", "0 to 1", "found -0.1"],
        ),
        (
            "--preset paper --set reassign_fraction=nan",
            &["reassign_fraction", "0 to 1", "found NaN"],
        ),
        (
            "--preset paper --set scale_factor=0",
            &["scale_factor", "more than 0, at most 100", "found 0"],
        ),
        ("--set stride=0", &["--set stride", "1 or more"]),
        ("--max-frames 0", &["'0'", "--max-frames", "1 or more"]),
        ("--threads 0", &["'0'", "--threads", "1 or more"]),
        ("--threads 100000", &["--threads", "1 to 1024", "found 100000"]),
        ("--depth-scale -1", &["depth scale", "a positive number", "found -1"]),
        ("--depth-scale 1e308", &["depth scale", "at most 1e9", "found 1e308"]),
        ("--depth-range 3 1", &["depth range", "near < far", "found 3.0 to 1.0"]),
        ("--depth-range 1e307 1e308", &["depth range", "at most 1e9", "found 1e307 to 1e308"]),
        ("--intrinsics 1e308 1e308 1 1", &["intrinsics", "at most 1e9", "found [1e308"]),
        ("--scale 1e308", &["scale (`--scale`)", "the depth of the scene", "found 1e308"]),
        ("--set reassign=never", &["--set reassign", "never"]),
        ("--no-such-option", &["--no-such-option"]),
    ] {
        scratch.run(&format!("train room --out out {option}")).fails(2, parts);
        assert!(!scratch.path("out").exists(), "{option}: no output is written");
    }
}

#[test]
fn arguments_of_the_other_commands() {
    let scratch = Scratch::with_scene();
    for (arguments, parts) in [
        ("train room", &["required arguments"][..]),
        ("eval out/scene.ply room --max-frames 0", &["--max-frames", "1 or more"]),
        ("eval out/scene.ply room --background blue", &["--background", "black, white or #rrggbb"]),
        ("eval out/scene.ply room --renderer fast", &["'fast'", "--renderer"]),
        ("eval out/scene.ply room --protocol fair", &["'fair'", "--protocol"]),
        ("eval out/scene.ply", &["required arguments"]),
        ("render out/scene.ply -o a.png --size 0x9", &["--size", "each from 1 to 16384"]),
        ("render out/scene.ply -o a.png --fov 200", &["--fov", "less than 170", "found 200"]),
        ("render out/scene.ply -o a.png --fov -1", &["--fov", "more than 1", "found -1"]),
        (
            "render out/scene.ply -o a.png --renderer exact --lens fisheye --fov 361",
            &["--fov", "at most 360", "fisheye", "found 361"],
        ),
        ("render out/scene.ply -o a.png --lens fisheye", &["--lens", "add --renderer exact"]),
        (
            "render out/scene.ply -o a.png --lens fisheye --renderer both",
            &["--lens", "the projected renderer has no fisheye"],
        ),
        (
            "render out/scene.ply -o a.png --lens fisheye --renderer exact --dataset room",
            &["cannot be used with", "--lens"],
        ),
        ("render out/scene.ply -o a.png --lens wide", &["'wide'", "--lens"]),
        ("render out/scene.ply -o a.png --response line", &["--response", "exact or both"]),
        (
            "render out/scene.ply -o a.png --antialias none",
            &["--antialias", "add --renderer exact"],
        ),
        (
            "render out/scene.ply -o a.png --renderer exact --antialias much",
            &["'much'", "--antialias"],
        ),
        ("render out/scene.ply -o a.png --orbit 1,2", &["--orbit", "such as 30,20,4"]),
        ("render out/scene.ply -o a.png --orbit 1,2,-3", &["--orbit", "a positive distance"]),
        ("render out/scene.ply -o a.png --orbit 0,0,1e308", &["--orbit", "at most 1e9"]),
        ("render out/scene.ply -o a.png --orbit 1e308,0,4", &["--orbit", "angles up to 360"]),
        ("render out/scene.ply -o a --turntable 0", &["--turntable", "1 or more"]),
        ("render out/scene.ply -o a.jpg", &["--output", "ending in .png", "a.jpg"]),
        ("render out/scene.ply -o a.png --view 1", &["required arguments"]),
        ("render out/scene.ply -o a.png --dataset room --view 3", &["--view", "0 to 2", "found 3"]),
        ("export out/scene.ply -o a.ply --format stl", &["'stl'", "--format"]),
        ("export out/scene.ply -o a.ply --export-split 3", &["'3'", "--export-split"]),
        ("export out/scene.ply -o a.ply --export-mapping wide", &["'wide'", "--export-mapping"]),
        (
            "export out/scene.ply -o a.ply --format point-cloud --export-split 2",
            &["--export-split", "a setting of splats", "export splats, such as ply"],
        ),
        ("synth new --layout lidar", &["'lidar'", "--layout"]),
        ("synth new --frames 0", &["training frames", "1 to 100000", "found 0"]),
        ("synth new --depth-noise -1", &["depth noise", "0 to 100", "found -1"]),
        ("synth new --size 4x4", &["width", "8 to 8192", "found 4"]),
        ("synth new --scene door", &["--scene", "expected --camera phone"]),
        ("synth new --camera phone --layout tum", &["layout", "record3d", "found tum"]),
        ("synth new --free-frames 200000", &["free frames", "0 to 100000"]),
        ("room train room --out out", &["`room` precedes the command"]),
        ("--no-such-option", &["--no-such-option"]),
    ] {
        scratch.run(arguments).fails(2, parts);
    }
}

#[test]
fn the_version_is_that_of_the_package() {
    let version = Scratch::empty().run("--version").succeeds().stdout;
    assert_eq!(version.trim(), concat!("vbgs-studio ", env!("CARGO_PKG_VERSION")));
}

#[test]
fn common_options_stand_before_or_after_the_command() {
    let scratch = Scratch::with_room();
    for arguments in ["--threads 1 train room --out out", "train room --out out --threads 1"] {
        scratch.run(&format!("{arguments} --preset paper --set components=100")).succeeds();
        assert_eq!(scratch.json("out/report.json")["machine"]["threads"], 1);
    }
}
