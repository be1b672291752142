//! Registration: fits against their truth, and files whose positions, shapes and colours by direction are those of the
//! similarity in f64.

use super::{read_bytes, set, written};
use crate::common::scenes::{cone, random_appearance, random_rotation};
use glam::{DMat3, DQuat, DVec3};
use vbgs_studio::export::registration::{References, Registration, shift_and_origin};
use vbgs_studio::export::{Imported, ModelFormat, WriteOptions};
use vbgs_studio::math::rng::{Purpose, Rng};
use vbgs_studio::model::splat::appearance::{Appearance, SplatSet};
use vbgs_studio::model::splat::splats::Splat;

/// Zero of the world among the coordinates of a map, metres.
const FAR: [f64; 3] = [691_234.567_891, 5_335_987.654_321, 512.25];

/// A world whose y points down; z of the coordinates points up.
fn registration(translation: [f64; 3]) -> Registration {
    let level = DQuat::from_rotation_arc(DVec3::NEG_Y, DVec3::Z);
    let tilted = DQuat::from_rotation_z(0.7) * DQuat::from_rotation_x(0.1) * level;
    Registration {
        scale: 1.7,
        rotation: tilted.normalize().to_array(),
        translation,
        system: Some("EPSG:25832".to_owned()),
        is_metric: true,
    }
}

fn options(format: ModelFormat) -> WriteOptions<'static> {
    WriteOptions { up: DVec3::NEG_Y, ..WriteOptions::new(format) }
}

fn scene() -> SplatSet {
    let mut rng = Rng::new(191, Purpose::Synthetic, 0);
    let splat = |_| Splat {
        mean: std::array::from_fn(|_| rng.range(-3.0, 3.0) as f32),
        opacity: rng.range(0.2, 0.9) as f32,
        color: std::array::from_fn(|_| rng.range(0.3, 0.7) as f32),
        scale: std::array::from_fn(|_| rng.range(0.05, 0.5) as f32),
        rotation: random_rotation(&mut rng),
    };
    let splats: Vec<Splat> = (0..60).map(splat).collect();
    let of = random_appearance(&splats, 191).into_iter().map(|appearance| Appearance {
        gradient: [[0.0; 3]; 3],
        observed: cone([[0.6, 0.0, 0.2], [0.1, 0.3, 0.0], [0.0; 3]]),
        // SPZ clips steeper slopes.
        directional: appearance.directional.map(|row| row.map(|v| 0.3 * v)),
    });
    set(&splats, &of.collect::<Vec<_>>())
}

fn wide(v: [f32; 3]) -> DVec3 {
    DVec3::from_array(v.map(f64::from))
}

fn covariance(splat: &Splat) -> DMat3 {
    let axes = DMat3::from_quat(splat.quaternion());
    let scale = wide(splat.scale);
    axes * DMat3::from_diagonal(scale * scale) * axes.transpose()
}

fn directional(model: &Imported, i: usize) -> DMat3 {
    let rows = model.splats.appearance_of(i).directional.map(wide);
    DMat3::from_cols(rows[0], rows[1], rows[2]).transpose()
}

fn entries(m: DMat3) -> f64 {
    m.to_cols_array().iter().fold(0.0, |most: f64, v| most.max(v.abs()))
}

/// Compares two exports, one of a registered scene and one of the same scene in its world (z up by reading). Splats are
/// paired by their place, because some formats order them.
fn compare(format: ModelFormat, translation: [f64; 3], [most_apart, tolerance]: [f64; 2]) {
    let scene = scene();
    let registration = registration(translation);
    let registered = WriteOptions { registration: Some(&registration), ..options(format) };
    let found = read_bytes(&written(&scene, &registered)).unwrap();
    // A PLY has the axes of the world.
    let plain = read_bytes(&written(&scene, &options(ModelFormat::Ply))).unwrap();
    let turn = DMat3::from_quat(DQuat::from_array(registration.rotation));
    assert_eq!(found.splats.len(), plain.splats.len());
    for (i, splat) in plain.splats.iter().enumerate() {
        let place = registration.apply(wide(splat.mean)) - found.local_origin;
        let apart = |k: &usize| wide(found.splats[*k].mean).distance(place);
        let k = (0..found.splats.len()).min_by(|a, b| apart(a).total_cmp(&apart(b))).unwrap();
        assert!(apart(&k) < most_apart, "{format}: {} of splat {i}", apart(&k));
        let shape = turn * covariance(splat) * turn.transpose() * 1.7 * 1.7;
        let error = entries(covariance(&found.splats[k]) - shape) / entries(shape);
        assert!(error < 60.0 * tolerance, "{format}: shape {error} of splat {i}");
        let slope = directional(&plain, i) * turn.transpose();
        let error = entries(directional(&found, k) - slope);
        assert!(error < 60.0 * tolerance, "{format}: colour by direction {error} of splat {i}");
        let error = wide(found.splats[k].color).distance(wide(splat.color));
        assert!(error < 10.0 * tolerance, "{format}: colour {error} of splat {i}");
    }
}

#[test]
fn files_near_zero_hold_the_similarity_itself() {
    // An SPZ holds coordinates, scales and slopes in steps.
    for (format, tolerances) in [
        (ModelFormat::Ply, [3e-6; 2]),
        (ModelFormat::Glb, [3e-6; 2]),
        (ModelFormat::Spz, [0.014, 8e-3]),
    ] {
        compare(format, [10.0, -4.0, 2.5], tolerances);
    }
}

/// The local origin has the digits that 32-bit positions lack, where the format can hold it.
#[test]
fn far_coordinates_are_exact_to_a_micrometre() {
    let registration = registration(FAR);
    for format in [ModelFormat::Ply, ModelFormat::Glb] {
        compare(format, FAR, [3e-6; 2]);
        let options = WriteOptions { registration: Some(&registration), ..options(format) };
        let model = read_bytes(&written(&scene(), &options)).unwrap();
        let error = model.local_origin.distance(DVec3::from_array(FAR));
        assert!(error < 1e-6, "{format}: {error}");
        let said = model.comments.join("\n");
        assert!(said.contains("vbgs coordinate system EPSG:25832"), "{said}");
        assert!(said.contains("vbgs registered by scale 1.7 rotation "), "{said}");
        assert_eq!(model.up(), Some(DVec3::Z), "{format}");
    }
    let options = WriteOptions { registration: Some(&registration), ..options(ModelFormat::Usda) };
    let text = String::from_utf8(written(&scene(), &options)).unwrap();
    let [x, y, z] = FAR;
    for line in [
        format!("xformOp:translate = ({x}, {z}, {})", -y),
        "# vbgs coordinate system EPSG:25832\n".to_owned(),
        "units known".to_owned(),
    ] {
        assert!(text.contains(&line), "{line} is missing in {}", &text[..900]);
    }
}

/// A registration that names no rotation leaves the axes of the world, with their up.
#[test]
fn scale_alone_keeps_the_axes() {
    let registration =
        Registration { rotation: [0.0, 0.0, 0.0, 1.0], ..registration([0.0, 0.0, 0.0]) };
    let options = WriteOptions { registration: Some(&registration), ..options(ModelFormat::Ply) };
    let model = read_bytes(&written(&scene(), &options)).unwrap();
    assert_eq!(model.up(), Some(DVec3::NEG_Y));
    for (a, b) in scene().iter().zip(model.splats.iter()) {
        assert!((1.7 * wide(a.mean)).distance(wide(b.mean)) < 1e-6);
    }
}

#[test]
fn one_registration_goes_on_from_another() {
    let mut rng = Rng::new(5, Purpose::Synthetic, 0);
    for _ in 0..50 {
        let [first, second] = [(); 2].map(|()| similarity(&mut rng, 30.0));
        let (both, p) = (first.then(&second), vector(&mut rng, 10.0));
        let apart = both.apply(p).distance(second.apply(first.apply(p)));
        assert!(apart < 1e-9 * (1.0 + second.scale * first.scale), "{apart}");
        assert_eq!(both.check(), Ok(()));
        let same = Registration::world(true).then(&second);
        assert!(same.apply(p).distance(second.apply(p)) < 1e-12 * (1.0 + second.scale));
        assert!(same.is_metric, "the unit is that of the first");
    }
}

#[test]
fn registrations_that_are_none_are_refused() {
    let good = registration([0.0; 3]);
    for (bad, found) in [
        (Registration { scale: 0.0, ..good.clone() }, "scale 0"),
        (Registration { rotation: [0.0; 4], ..good.clone() }, "rotation"),
        (Registration { translation: [f64::NAN, 0.0, 0.0], ..good.clone() }, "translation"),
        (Registration { system: Some("a\nend_header".into()), ..good.clone() }, "a\\nend_header"),
    ] {
        let options = WriteOptions { registration: Some(&bad), ..options(ModelFormat::Glb) };
        let path = tempfile::tempdir().unwrap().path().join("a.glb");
        let error = vbgs_studio::export::write(&path, &scene(), &options).unwrap_err().to_string();
        assert!(error.contains(found) && error.contains("expected"), "{error}");
    }
}

fn vector(rng: &mut Rng, reach: f64) -> DVec3 {
    DVec3::from_array([0; 3].map(|_| rng.range(-reach, reach)))
}

fn similarity(rng: &mut Rng, reach: f64) -> Registration {
    let rotation = DQuat::from_scaled_axis(vector(rng, 2.0));
    Registration {
        scale: rng.range(0.1, 10.0),
        rotation: rotation.to_array(),
        translation: vector(rng, reach).to_array(),
        system: None,
        is_metric: false,
    }
}

fn fit(pairs: Vec<[DVec3; 2]>) -> Result<Registration, String> {
    let references = References { pairs, ..References::default() };
    Registration::of(&references, DVec3::Z).map_err(|fault| fault.to_string())
}

#[test]
fn control_points_give_the_similarity_back() {
    let mut rng = Rng::new(1, Purpose::Synthetic, 0);
    // Near zero and in coordinates of a map; three points in a plane and more in space.
    for (reach, n, tolerance) in [(5.0, 3, 1e-10), (5.0, 20, 1e-12), (6e6, 3, 3e-8), (6e6, 9, 3e-8)]
    {
        for _ in 0..50 {
            let truth = similarity(&mut rng, reach);
            let points: Vec<DVec3> = (0..n).map(|_| vector(&mut rng, 4.0)).collect();
            let pairs: Vec<_> = points.iter().map(|p| [*p, truth.apply(*p)]).collect();
            let found = fit(pairs.clone()).unwrap();
            let ratio = found.scale / truth.scale;
            assert!((ratio - 1.0).abs() < 20.0 * tolerance, "{ratio}");
            let residuals = found.residuals(&pairs).unwrap();
            assert!(residuals.largest < tolerance * 10.0, "{residuals:?}");
        }
    }
}

/// The fit is the least-squares optimum: no small change of its seven parameters lowers the sum of squares.
#[test]
fn noisy_control_points_are_fitted_best() {
    let mut rng = Rng::new(2, Purpose::Synthetic, 0);
    for _ in 0..20 {
        let truth = similarity(&mut rng, 3.0);
        let pair = |_| {
            let p = vector(&mut rng, 4.0);
            [p, truth.apply(p) + vector(&mut rng, 0.5)]
        };
        let pairs: Vec<[DVec3; 2]> = (0..7).map(pair).collect();
        let found = fit(pairs.clone()).unwrap();
        let sum = |registration: &Registration| registration.residuals(&pairs).unwrap().rms;
        let least = sum(&found);
        for _ in 0..40 {
            let step = 1e-3;
            let turn = DQuat::from_scaled_axis(vector(&mut rng, step));
            let shift = vector(&mut rng, step) + DVec3::from_array(found.translation);
            let other = Registration {
                scale: found.scale * (1.0 + rng.range(-step, step)),
                rotation: (turn * DQuat::from_array(found.rotation)).normalize().to_array(),
                translation: shift.to_array(),
                ..found.clone()
            };
            assert!(sum(&other) >= least, "{} {least}", sum(&other));
        }
    }
}

#[test]
fn length_floor_and_place_are_met_together() {
    let mut rng = Rng::new(3, Purpose::Synthetic, 0);
    for _ in 0..50 {
        let [a, b, c, at, to] = [0; 5].map(|_| vector(&mut rng, 3.0));
        // Either side of the floor may be up.
        let normal = (b - a).cross(c - a).normalize();
        for up in [normal + 0.3 * (b - a).normalize(), -normal] {
            let references = References {
                length: Some(([a, b], 2.5)),
                floor: Some([a, b, c]),
                pairs: vec![[at, to]],
            };
            let found = Registration::of(&references, up).unwrap();
            let [a, b, c] = [a, b, c].map(|p| found.apply(p));
            assert!((a.distance(b) - 2.5).abs() < 1e-10);
            assert!((a.z - b.z).abs() < 1e-10 && (a.z - c.z).abs() < 1e-10);
            assert!(found.apply(at).distance(to) < 1e-10);
            assert_eq!(found.up(up.normalize()), DVec3::Z);
            assert!(found.apply(at + up).z > found.apply(at).z);
        }
    }
}

#[test]
fn references_that_determine_nothing_are_refused() {
    let line = |n: i32| (0..n).map(|i| [f64::from(i) * DVec3::X; 2]).collect::<Vec<_>>();
    let corners = [DVec3::X, DVec3::Y, DVec3::Z];
    assert!(fit(line(2)).unwrap_err().contains("one pair of control points, or three"));
    assert!(fit(line(5)).unwrap_err().contains("not on a line, found 5 on one"));
    // Coordinates on a line, and such without a number.
    let flat = corners.map(|p| [p, DVec3::X * p.x]).to_vec();
    assert!(fit(flat).unwrap_err().contains("not on a line"));
    let broken = corners.map(|p| [p, p * f64::NAN]).to_vec();
    assert!(fit(broken).unwrap_err().contains("not on a line"));
    let of =
        |references: References| Registration::of(&references, DVec3::Z).unwrap_err().to_string();
    let length = Some(([DVec3::X; 2], 1.0));
    assert!(of(References { length, ..References::default() }).contains("--scale-by"));
    let floor = Some([DVec3::X, 2.0 * DVec3::X, 3.0 * DVec3::X]);
    assert!(of(References { floor, ..References::default() }).contains("--up-by"));
    let pairs = corners.map(|p| [p, p]).to_vec();
    let references = References { floor: Some(corners), pairs, ..References::default() };
    assert!(of(references).contains("one pair of control points beside a floor"));
}

#[test]
fn positions_are_shifted_only_as_far_as_they_stay_exact() {
    let near = Registration {
        scale: 2.0,
        rotation: [0.0, 0.0, 0.0, 1.0],
        translation: [600.0, 0.0, 0.0],
        system: None,
        is_metric: false,
    };
    let far = Registration { translation: [700.0, 0.0, 0.0], ..near.clone() };
    let place = |r: &Registration| shift_and_origin(Some(r), DVec3::ZERO);
    assert_eq!(place(&near), [600.0 * DVec3::X, DVec3::ZERO]);
    assert_eq!(place(&far), [DVec3::ZERO, 700.0 * DVec3::X]);
    assert_eq!(shift_and_origin(None, DVec3::Y), [DVec3::ZERO, DVec3::Y]);
    // The zero of positions counts, not that of the world.
    let back = shift_and_origin(Some(&far), -350.0 * DVec3::X);
    assert_eq!(back, [DVec3::ZERO, DVec3::ZERO]);
}
