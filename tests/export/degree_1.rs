//! Degree-1 colour in files: written coefficients, evaluated by the formulas of other programs, give the
//! colour of our renderers.

use super::glb_file::Glb;
use super::{distance, random_splats, read_bytes, set, written, written_as};
use crate::common::oracle::Oracle;
use crate::common::scenes::random_appearance;
use glam::{DQuat, DVec2, DVec3};
use ply_rs_bw::parser::Parser;
use ply_rs_bw::ply::{DefaultElement, Property};
use serde_json::json;
use vbgs_studio::export::{Axes, ModelFormat, WriteOptions};
use vbgs_studio::math::camera::{Camera, Intrinsics};
use vbgs_studio::math::pose::Pose;
use vbgs_studio::math::rng::{Purpose, Rng};
use vbgs_studio::model::splat::appearance::{Appearance, SplatSet};
use vbgs_studio::model::splat::splats::Splat;
use vbgs_studio::render::cpu::CpuRenderer;
use vbgs_studio::render::{RenderMethod, RenderOptions};

/// Splats with view-dependent colour and no gradients; opacities are at least 0.5 so that each is visible.
fn directed(n: usize, seed: u64) -> SplatSet {
    let mut splats = random_splats(n, seed);
    splats.iter_mut().for_each(|s| s.opacity = 0.5 + 0.5 * s.opacity);
    let plain = |a: Appearance| Appearance { gradient: [[0.0; 3]; 3], ..a };
    let appearance: Vec<_> = random_appearance(&splats, seed).into_iter().map(plain).collect();
    set(&splats, &appearance)
}

/// Colour by the published 3DGS rasteriser, from coefficients of degrees 0 and 1 (by coefficient, then
/// channel) and the unit direction from the camera to the splat.
fn published_color(sh: [[f32; 3]; 4], d: DVec3) -> DVec3 {
    let [f0, f1, f2, f3] = sh.map(|f| DVec3::from_array(f.map(f64::from)));
    let (c0, c1) = (0.282_094_791_773_878_14, 0.488_602_511_902_919_9);
    let color = c0 * f0 - c1 * d.y * f1 + c1 * d.z * f2 - c1 * d.x * f3;
    (color + 0.5).max(DVec3::ZERO)
}

/// Mean and coefficients of each splat of a PLY, by an independent reader.
fn harmonics(bytes: &[u8]) -> Vec<(DVec3, [[f32; 3]; 4])> {
    let ply = Parser::<DefaultElement>::new().read_ply(&mut &bytes[..]).unwrap();
    let per_channel = (ply.header.elements["vertex"].properties.len() - 17) / 3;
    let float = |vertex: &DefaultElement, name: &str| match vertex.get(name) {
        Some(Property::Float(value)) => *value,
        other => panic!("{name}: {other:?}"),
    };
    let row = |vertex: &DefaultElement| {
        let channels = [0, 1, 2];
        let rest =
            |i: usize| channels.map(|c| float(vertex, &format!("f_rest_{}", c * per_channel + i)));
        let higher = (0..3 * per_channel).filter(|i| i % per_channel >= 3);
        assert!(higher.into_iter().all(|i| float(vertex, &format!("f_rest_{i}")) == 0.0));
        let f0 = channels.map(|c| float(vertex, &format!("f_dc_{c}")));
        let mean = ["x", "y", "z"].map(|n| f64::from(float(vertex, n)));
        (DVec3::from_array(mean), [f0, rest(0), rest(1), rest(2)])
    };
    ply.payload["vertex"].iter().map(row).collect()
}

/// Colour of a single splat at its centre in our oracle, seen from `eye`.
fn shown(splats: &SplatSet, i: usize, eye: DVec3) -> DVec3 {
    // The shape does not affect the colour; a fixed size keeps the splat visible.
    let splat = Splat { scale: [0.05; 3], ..splats[i] };
    let alone = set(&[splat], &splats.view().appearance()[i..=i]);
    let mean = DVec3::from_array(splat.mean.map(f64::from));
    let up = (mean - eye).any_orthogonal_vector();
    let camera = Camera {
        intrinsics: Intrinsics::from_horizontal_fov(64, 64, 0.5),
        pose: Pose::look_at(eye, mean, up).unwrap(),
    };
    let options = RenderOptions::evaluation(RenderMethod::PROJECTED, [0.0; 3]);
    let [r, g, b, alpha] = Oracle::of(&alone, &camera, &options).at(DVec2::splat(32.0)).rgba;
    DVec3::new(r, g, b) / alpha
}

/// Random unit directions from a camera to a splat.
fn directions(seed: u64) -> Vec<DVec3> {
    let mut rng = Rng::new(seed, Purpose::Synthetic, 2);
    (0..5).map(|_| DVec3::from_array([0; 3].map(|_| rng.normal())).normalize()).collect()
}

fn assert_same_colors(
    splats: &SplatSet,
    file: &[(DVec3, [[f32; 3]; 4])],
    to_file: impl Fn(DVec3) -> DVec3,
) {
    let (mut worst, mut largest_change) = (0f64, 0f64);
    for (i, (mean, sh)) in file.iter().enumerate() {
        let world_mean = DVec3::from_array(splats[i].mean.map(f64::from));
        assert_eq!(to_file(world_mean), *mean);
        for d in directions(i as u64) {
            // Our renderers clamp the colour to 1 before blending, others clamp only the pixel.
            let expected = published_color(*sh, to_file(d)).min(DVec3::ONE);
            worst = worst.max((shown(splats, i, world_mean - 2.0 * d) - expected).length());
            let diffuse = published_color([sh[0], [0.0; 3], [0.0; 3], [0.0; 3]], d);
            largest_change = largest_change.max((expected - diffuse).length());
        }
    }
    assert!(worst < 1e-5 && largest_change > 0.5, "{worst:e} {largest_change}");
}

#[test]
fn ply_coefficients_mean_what_the_renderer_shows() {
    let splats = directed(40, 61);
    for (axes, sh3_padding) in [(Axes::AsIs, false), (Axes::AsIs, true), (Axes::Viewer, false)] {
        let options = WriteOptions { axes, sh3_padding, ..WriteOptions::new(ModelFormat::Ply) };
        let bytes = written(&splats, &options);
        assert_same_colors(&splats, &harmonics(&bytes), |v| match axes {
            Axes::Viewer => DVec3::new(-v.x, -v.z, -v.y),
            _ => v,
        });
    }
}

#[test]
fn glb_coefficients_mean_what_the_renderer_shows() {
    let splats = directed(40, 62);
    let glb = Glb::parse(&written_as(ModelFormat::Glb, &splats));
    let rows = |name: &str| -> Vec<[f32; 3]> {
        let rows = glb.floats(name).into_iter();
        rows.map(|row| row.try_into().unwrap()).collect()
    };
    let degree = |l, n| rows(&format!("KHR_gaussian_splatting:SH_DEGREE_{l}_COEF_{n}"));
    let (f0, f1, f2, f3) = (degree(0, 0), degree(1, 0), degree(1, 1), degree(1, 2));
    let means = rows("POSITION");
    let row = |i: usize| (DVec3::from_array(means[i].map(f64::from)), [f0[i], f1[i], f2[i], f3[i]]);
    let file: Vec<_> = (0..splats.len()).map(row).collect();
    assert_same_colors(&splats, &file, |v| DVec3::new(v.x, v.z, -v.y));
}

#[test]
fn files_without_degree_1_do_not_mention_it() {
    let splats = random_splats(3, 63);
    let zeros = set(&splats, &[Appearance::default(); 3]);
    for format in [ModelFormat::Ply, ModelFormat::Glb] {
        let bytes = written_as(format, &zeros);
        assert!(bytes == written_as(format, &splats));
        let text = String::from_utf8_lossy(&bytes);
        assert!(!text.contains("f_rest") && !text.contains("SH_DEGREE_1"), "{format}");
    }
}

#[test]
fn appearance_comes_back_and_looks_the_same() {
    let splats = directed(400, 64);
    let mut camera = Camera {
        intrinsics: Intrinsics::from_horizontal_fov(96, 64, 1.2),
        pose: Pose::look_at(DVec3::new(60.0, -90.0, 40.0), DVec3::ZERO, DVec3::Z).unwrap(),
    };
    camera.intrinsics.cx += 3.5;
    let options = RenderOptions::evaluation(RenderMethod::PROJECTED, [0.2; 3]);
    let draw = |set: &SplatSet| CpuRenderer::new().render(set, &camera, &options).color;
    let original = draw(&splats);
    assert!(original.data.iter().filter(|c| distance(**c, [0.2; 3]) > 0.1).count() > 1000);
    for (format, sh3_padding) in
        [(ModelFormat::Ply, false), (ModelFormat::Ply, true), (ModelFormat::Glb, false)]
    {
        let written = written(&splats, &WriteOptions { sh3_padding, ..WriteOptions::new(format) });
        let back = read_bytes(&written).unwrap().splats;
        for (a, b) in splats.view().appearance().iter().zip(back.view().appearance()) {
            for (row, other) in a.directional.iter().zip(b.directional) {
                assert!(distance(*row, other) < 1e-6, "{format}: {row:?} {other:?}");
            }
            assert_eq!(b.gradient, [[0.0; 3]; 3]);
        }
        let image = draw(&back);
        let pairs = original.data.iter().zip(&image.data);
        let worst = pairs.map(|(a, b)| distance(*a, *b)).fold(0.0, f32::max);
        println!("{format}: image off by {worst:.1e}");
        // Alphas near the cut may fall to either side.
        assert!(worst < 4e-3, "{format}: {worst:e}");
    }
}

/// The constant term is the regression's value at direction zero, which may lie outside [0, 1].
#[test]
fn constant_terms_outside_0_to_1_survive() {
    let splat = Splat { opacity: 0.9, color: [-0.4, 1.7, 0.5], ..Splat::default() };
    let directional = [[0.8, 0.0, 0.0], [0.0, -0.9, 0.0], [0.0; 3]];
    let native = set(&[splat], &[Appearance { directional, ..Appearance::default() }]);
    for format in [ModelFormat::Ply, ModelFormat::Glb] {
        let model = read_bytes(&written_as(format, &native)).unwrap();
        assert!(distance(model.splats[0].color, splat.color) < 1e-6, "{format}");
        assert_eq!(model.notes, [], "{format}");
    }
    // The fallback colour for viewers without the extension is clamped.
    let glb = Glb::parse(&written_as(ModelFormat::Glb, &native));
    let at = glb.clone().view("COLOR_0")["byteOffset"].as_u64().unwrap() as usize;
    let channel = |i: usize| u16::from_le_bytes([glb.bin[at + 2 * i], glb.bin[at + 2 * i + 1]]);
    assert_eq!((channel(0), channel(1)), (0, u16::MAX));
}

#[test]
fn points_have_the_colour_seen_from_the_nearest_camera() {
    let splat = Splat { opacity: 0.9, color: [0.5; 3], scale: [0.1; 3], ..Splat::default() };
    let directional = [[0.2, 0.0, 0.0], [0.0, 0.4, 0.0], [0.0, 0.0, -5.0]];
    let native = set(&[splat], &[Appearance { directional, ..Appearance::default() }]);
    let centres = [DVec3::new(0.0, 9.0, 0.0), DVec3::new(-3.0, 0.0, 0.0)];
    let color = |centres: &[DVec3]| {
        let options = WriteOptions {
            camera_centres: centres,
            ..WriteOptions::new(ModelFormat::PointCloudPly)
        };
        read_bytes(&written(&native, &options)).unwrap().splats[0].color
    };
    assert!(distance(color(&[]), [0.5; 3]) < 0.003);
    assert!(distance(color(&centres), [0.7, 0.5, 0.5]) < 0.003);
    assert!(distance(color(&centres[..1]), [0.5, 0.1, 0.5]) < 0.003);
    assert!(distance(color(&[DVec3::new(0.0, 0.0, -1.0)]), [0.5, 0.5, 0.0]) < 0.003);
    // A camera at the centre of a splat has no viewing direction.
    assert!(distance(color(&[DVec3::ZERO]), [0.5; 3]) < 0.003);
}

#[test]
fn nodes_turn_the_colour_along() {
    let splats = directed(20, 65);
    let mut glb = Glb::parse(&written_as(ModelFormat::Glb, &splats));
    let turn = DQuat::from_xyzw(0.2, -0.5, 0.3, 0.7).normalize();
    glb.json["nodes"][0] =
        json!({"mesh": 0, "rotation": turn.to_array(), "scale": [2.0, 3.0, 0.5]});
    let model = read_bytes(&glb.to_bytes()).unwrap();
    // A rotation about (x, y, z) in y-up axes is one about (x, −z, y) in z-up axes.
    let turn = DQuat::from_xyzw(turn.x, -turn.z, turn.y, turn.w);
    let appearance = splats.view().appearance().iter().zip(model.splats.view().appearance());
    for ((before, after), d) in appearance.zip(directions(65).into_iter().cycle()) {
        let change = |a: &Appearance, d: DVec3| {
            DVec3::from_array(a.directional.map(|w| DVec3::from_array(w.map(f64::from)).dot(d)))
        };
        let difference = change(before, d) - change(after, turn * d);
        assert!(difference.length() < 1e-6, "{difference}");
    }
    assert_eq!(model.splats.view().appearance().len(), splats.len());
}

#[test]
fn coefficients_that_are_no_numbers_leave_their_rows_out() {
    let splats = directed(3, 66);
    let mut ply = written_as(ModelFormat::Ply, &splats);
    let row = 4 * 26;
    // Nine numbers precede the first coefficient of degree 1 in the row of the second splat.
    let at = ply.len() - 2 * row + 4 * 9;
    ply[at..at + 4].copy_from_slice(&f32::NAN.to_le_bytes());
    let mut glb = Glb::parse(&written_as(ModelFormat::Glb, &splats));
    let view = glb.view("KHR_gaussian_splatting:SH_DEGREE_1_COEF_2");
    let at = view["byteOffset"].as_u64().unwrap() as usize + 16;
    glb.bin[at..at + 4].copy_from_slice(&f32::INFINITY.to_le_bytes());
    for bytes in [ply, glb.to_bytes()] {
        let model = read_bytes(&bytes).unwrap();
        assert_eq!((model.splats.len(), model.skipped), (2, 1));
        assert_eq!(model.splats[1].mean, splats[2].mean);
    }
}
