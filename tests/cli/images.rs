//! `render` writes pictures of the right size with visible content.

use super::runner::Scratch;
use image::RgbImage;
use std::collections::BTreeSet;

#[track_caller]
fn picture(scratch: &Scratch, path: &str, size: (u32, u32)) -> RgbImage {
    let image = image::open(scratch.path(path)).unwrap();
    assert_eq!(image.color(), image::ColorType::Rgb8, "{path}");
    let image = image.into_rgb8();
    assert_eq!(image.dimensions(), size, "{path}");
    let colors: BTreeSet<[u8; 3]> = image.pixels().map(|p| p.0).collect();
    assert!(colors.len() > 10, "{path} has {} colours", colors.len());
    image
}

#[test]
fn views_of_a_scene() {
    let scratch = Scratch::with_scene();
    for (options, size) in [
        ("", (1280, 720)),
        ("--size 80x60", (80, 60)),
        ("--size 64x64 --orbit 30,20,4", (64, 64)),
        ("--size 64x64 --orbit -30,-20,4 --up -y --fov 90", (64, 64)),
        ("--size 64x48 --renderer exact --antialias none --response line --fov 150", (64, 48)),
        ("--size 64x64 --renderer exact --lens fisheye --fov 360", (64, 64)),
        ("--size 64x48 --renderer exact --lens fisheye --fov 180 --orbit 0,0,2", (64, 48)),
        ("--size 64x48 --paint depth", (64, 48)),
        ("--size 64x48 --paint normal", (64, 48)),
        ("--dataset room", (64, 48)),
        ("--dataset room --renderer exact --paint depth", (64, 48)),
        ("--dataset room --view 2", (64, 48)),
        ("--dataset room --split train --view 7", (64, 48)),
    ] {
        let said = scratch.run(&format!("render out/scene.ply -o a.png {options}")).succeeds();
        assert!(said.stdout.starts_with("wrote a.png"), "{}", said.stdout);
        picture(&scratch, "a.png", size);
    }
}

#[test]
fn a_turntable_goes_around() {
    let scratch = Scratch::with_scene();
    scratch.run("render out/scene.ply -o turn --turntable 4 --size 64x48").succeeds();
    let views: Vec<RgbImage> =
        (0..4).map(|i| picture(&scratch, &format!("turn/{i:03}.png"), (64, 48))).collect();
    assert_eq!(std::fs::read_dir(scratch.path("turn")).unwrap().count(), 4);
    assert!(views[1..].iter().all(|view| *view != views[0]));
    scratch.run("render out/scene.ply -o still.png --size 64x48").succeeds();
    assert_eq!(picture(&scratch, "still.png", (64, 48)), views[0], "it starts at the still view");
}

const WAY: &str = r#"{"version": 1, "fps": 4, "keyframes": [
    {"time": 0, "eye": [3, 3, 1], "target": [0, 0, 0.5], "fov_y": 60},
    {"time": 1, "eye": [-3, 3, 1], "target": [0, 0, 0.5]},
    {"time": 1.5, "eye": [-3, -3, 2], "target": [0, 0, 0.5]}]}"#;

#[test]
fn a_path_is_followed_picture_by_picture() {
    let scratch = Scratch::with_scene();
    std::fs::write(scratch.path("way.json"), WAY).unwrap();
    let said =
        scratch.run("render out/scene.ply -o way --path way.json --size 64x48").succeeds().stdout;
    assert_eq!(said.trim(), "wrote 7 pictures to way");
    let views: Vec<RgbImage> =
        (0..7).map(|i| picture(&scratch, &format!("way/{i:05}.png"), (64, 48))).collect();
    assert_eq!(std::fs::read_dir(scratch.path("way")).unwrap().count(), 7);
    assert!(views.windows(2).all(|pair| pair[0] != pair[1]));
    std::fs::write(scratch.path("wrong.json"), WAY.replace("1.5", "0.5")).unwrap();
    let wrong = scratch.run("render out/scene.ply -o w --path wrong.json");
    wrong.fails(
        1,
        &["wrong.json", "keyframes[2].time", "more than the previous keyframe's", "found 0.5"],
    );
    let both = scratch.run("render out/scene.ply -o w --path way.json --orbit 1,2,3");
    both.fails(2, &["--orbit", "--path"]);
}

#[test]
fn a_gif_needs_no_other_program_and_holds_the_pictures() {
    let scratch = Scratch::with_scene();
    std::fs::write(scratch.path("way.json"), WAY.replace("\"fps\": 4", "\"fps\": 30")).unwrap();
    let render = |output: &str| {
        let mut command = scratch.command(&[
            "render",
            "out/scene.ply",
            "-o",
            output,
            "--path",
            "way.json",
            "--size",
            "64x48",
        ]);
        // No ffmpeg is on this path.
        command.env("PATH", scratch.path("none")).output().unwrap()
    };
    assert!(render("way").status.success());
    let gif = render("way.GIF");
    assert_eq!(String::from_utf8_lossy(&gif.stdout).trim(), "wrote 46 pictures to way.GIF");
    let mut options = gif::DecodeOptions::new();
    options.set_color_output(gif::ColorOutput::RGBA);
    let file = std::fs::File::open(scratch.path("way.GIF")).unwrap();
    let mut decoder = options.read_info(file).unwrap();
    let mut delays = Vec::new();
    while let Some(frame) = decoder.read_next_frame().unwrap() {
        let drawn = picture(&scratch, &format!("way/{:05}.png", delays.len()), (64, 48));
        let (read, drawn): (Vec<u8>, _) = (
            frame.buffer.chunks_exact(4).flat_map(|pixel| &pixel[..3]).copied().collect(),
            drawn.into_raw(),
        );
        let squares = read.iter().zip(&drawn).map(|(a, b)| f64::from(a.abs_diff(*b)).powi(2));
        let psnr = 10.0 * (255.0 * 255.0 * read.len() as f64 / squares.sum::<f64>()).log10();
        assert!(psnr > 32.0, "picture {}: {psnr:.1} dB", delays.len());
        delays.push(frame.delay);
    }
    let size = (decoder.width(), decoder.height());
    assert_eq!((size, decoder.repeat()), ((64, 48), gif::Repeat::Infinite));
    // 46 pictures at 30 a second take 1.53 s; each alone takes 3.33 hundredths.
    assert_eq!((delays.len(), delays.iter().sum::<u16>()), (46, 153));
    assert_eq!(delays[..6], [3, 4, 3, 3, 4, 3]);
    std::fs::write(scratch.path("fast.json"), WAY.replace("\"fps\": 4", "\"fps\": 60")).unwrap();
    let fast = scratch.run("render out/scene.ply -o fast.gif --path fast.json");
    fast.fails(1, &["fast.gif: found 1280×720 pixels at 60", "at most 65535", "0.002 to 50"]);
}

/// A script replaces ffmpeg, which may not be installed, and stores the frames that it receives.
#[cfg(unix)]
#[test]
fn a_video_is_what_ffmpeg_makes_of_the_pictures() {
    use std::os::unix::fs::PermissionsExt;

    let scratch = Scratch::with_scene();
    std::fs::write(scratch.path("way.json"), WAY).unwrap();
    std::fs::create_dir(scratch.path("bin")).unwrap();
    let render = |name: &str| {
        let asked =
            ["render", "out/scene.ply", "-o", name, "--path", "way.json", "--size", "64x48"];
        let mut command = scratch.command(&asked);
        command.env("PATH", scratch.path("bin"));
        command.output().unwrap()
    };
    let files = || std::fs::read_dir(scratch.path(".")).unwrap().count();
    let before = files();
    let said = String::from_utf8(render("way.mp4").stderr).unwrap();
    for part in ["way.mp4", "expected ffmpeg", "install ffmpeg"] {
        assert!(said.contains(part), "`{part}` is missing from: {said}");
    }
    assert_eq!(files(), before, "a failed video leaves no file");
    let fake = scratch.path("bin/ffmpeg");
    let ffmpeg = |text: &str| {
        std::fs::write(&fake, text).unwrap();
        std::fs::set_permissions(&fake, std::fs::Permissions::from_mode(0o755)).unwrap();
    };
    ffmpeg("#!/bin/sh\nfor last; do :; done\necho $* > ${0%/*}/asked\n/bin/cat > \"$last\"\n");
    // Arguments with which ffmpeg 5.1 produced a video with all frames, the right size and frame rate.
    let codecs = [("mp4", "-c:v libx264"), ("webm", "-c:v libvpx-vp9"), ("webp", "-c:v libwebp")];
    for (form, codec) in codecs {
        let name = format!("way.{form}");
        let made = render(&name);
        assert!(made.status.success(), "{made:?}");
        assert_eq!(scratch.bytes(&name).len(), 7 * 64 * 48 * 3);
        let asked = std::fs::read_to_string(scratch.path("bin/asked")).unwrap();
        for part in ["-f rawvideo -pix_fmt rgb24 -s 64x48 -r 4 -i -", codec] {
            assert!(asked.contains(part), "`{part}` is missing from: {asked}");
        }
    }
    ffmpeg("#!/bin/sh\necho no such encoder >&2\nexit 1\n");
    let failed = render("other.webm");
    assert_eq!(failed.status.code(), Some(1));
    let said = String::from_utf8(failed.stderr).unwrap();
    assert!(said.contains("no such encoder") && said.contains("other.webm"), "{said}");
    assert_eq!(files(), before + codecs.len(), "only the first videos are left");
}

#[test]
fn both_renderers_write_a_picture_each() {
    let scratch = Scratch::with_scene();
    let options = "--renderer both --size 64x48";
    let said = scratch.run(&format!("render out/scene.ply -o a.png {options}")).succeeds().stdout;
    assert_eq!(said.trim(), "wrote a-projected.png and a-exact.png");
    scratch.run("render out/scene.ply -o b.png --size 64x48").succeeds();
    let projected = picture(&scratch, "a-projected.png", (64, 48));
    assert_eq!(projected, picture(&scratch, "b.png", (64, 48)), "the default is projected");
    picture(&scratch, "a-exact.png", (64, 48));
    assert!(!scratch.path("a.png").exists());
    scratch.run(&format!("render out/scene.ply -o turn --turntable 2 {options}")).succeeds();
    for name in ["000-projected", "000-exact", "001-projected", "001-exact"] {
        picture(&scratch, &format!("turn/{name}.png"), (64, 48));
    }
    assert_eq!(std::fs::read_dir(scratch.path("turn")).unwrap().count(), 4);
}

/// The render of a dataset view has the same PSNR against its photograph as `eval` reports.
#[test]
fn a_dataset_view_is_the_photographs() {
    let scratch = Scratch::with_scene();
    scratch.run("render out/scene.ply -o a.png --dataset room --view 1").succeeds();
    let render = picture(&scratch, "a.png", (64, 48));
    let photograph = image::open(scratch.path("room/eval/r_1.png")).unwrap().into_rgb8();
    let squares = render.as_raw().iter().zip(photograph.as_raw());
    let mse = squares.map(|(a, b)| (f64::from(*a) - f64::from(*b)).powi(2)).sum::<f64>()
        / render.as_raw().len() as f64;
    let psnr = 10.0 * (255.0 * 255.0 / mse).log10();
    let measured = scratch.run("eval out/scene.ply room --json").succeeds().json();
    let measured = measured["views"][1]["psnr"].as_f64().unwrap();
    // Tolerance for half an 8-bit step of rounding per pixel.
    assert!((psnr - measured).abs() < 0.02, "the file {psnr} dB, `eval` {measured} dB");
}

#[test]
fn the_background_is_as_asked() {
    let scratch = Scratch::with_scene();
    let corner = |background: &str| {
        let options = format!("--orbit 0,20,500 --size 32x32 --background {background}");
        scratch.run(&format!("render out/scene.ply -o a.png {options}")).succeeds();
        image::open(scratch.path("a.png")).unwrap().into_rgb8().get_pixel(0, 0).0
    };
    assert_eq!(corner("black"), [0, 0, 0]);
    assert_eq!(corner("white"), [255, 255, 255]);
    assert_eq!(corner("#1080ff"), [16, 128, 255]);
}
