//! Views from beside and above the camera path: photometric training keeps colours and splat sizes
//! within what was observed.

use crate::common::shared;
use glam::{DMat4, DQuat, DVec3};
use std::path::Path;
use std::sync::Arc;
use vbgs_studio::dataset::frame::{ColorBuffer, DepthBuffer, DepthKind, Frame};
use vbgs_studio::dataset::surface::{Preparer, Sensor, SurfaceSettings};
use vbgs_studio::dataset::{self, LoadOptions};
use vbgs_studio::math::camera::{Camera, Intrinsics};
use vbgs_studio::math::pose::Pose;
use vbgs_studio::model::splat::appearance::SplatSet;
use vbgs_studio::observation::surface::Observation;
use vbgs_studio::pipeline::plan::Selection;
use vbgs_studio::pipeline::session::{Session, Step};
use vbgs_studio::pipeline::settings::scene::SceneOverrides;
use vbgs_studio::render::cpu::{CpuRenderer, Rendered};
use vbgs_studio::render::{RenderMethod, RenderOptions};
use vbgs_studio::train::learner::{Learner, Learns};
use vbgs_studio::train::scene::photometric::rule::{PhotometricMode, PhotometricRule};
use vbgs_studio::train::scene::{config::SceneConfig, trainer::SceneTrainer};

const FRAMES: usize = 16;
/// Half-width of the window whose colour range bounds a pixel, px, and the tolerance beyond that range.
const WINDOW: usize = 8;
const MARGIN: f32 = 0.15;

/// Splats by component, and the camera of the middle training frame.
fn trained(path: &Path, mode: PhotometricMode) -> (SplatSet, Camera) {
    let dataset = Arc::new(dataset::open(path, &LoadOptions::default()).unwrap());
    let asked = SceneOverrides { photometric: Some(mode), ..SceneOverrides::default() };
    let selection = Selection { max_frames: Some(FRAMES), ..Selection::all_frames() };
    let mut session = Session::new(dataset.clone(), asked, selection).unwrap();
    while !matches!(session.step().unwrap(), Step::Finished) {}
    let plan = session.plan();
    let middle = plan.frames[plan.frames.len() / 2];
    (session.splats(), dataset.splits[plan.split].frames[middle].camera)
}

/// Camera at half resolution, turned about the median depth in view by degrees about its vertical and
/// horizontal axes.
fn beside(camera: &Camera, splats: &SplatSet, [across, above]: [f64; 2]) -> Camera {
    let (pose, k) = (camera.pose, camera.intrinsics);
    let (eye, rotation) = (pose.centre(), pose.rotation());
    let mut depths: Vec<f64> = splats
        .iter()
        .filter(|splat| splat.opacity > 0.0)
        .map(|splat| rotation.transpose() * (DVec3::from_array(splat.mean.map(f64::from)) - eye))
        .filter(|p| p.z > 0.0 && p.x.abs() < 0.3 * p.z && p.y.abs() < 0.3 * p.z)
        .map(|p| p.z)
        .collect();
    depths.sort_by(f64::total_cmp);
    let pivot = eye + pose.forward() * depths[depths.len() / 2];
    let turn = DQuat::from_axis_angle(rotation.y_axis, across.to_radians())
        * DQuat::from_axis_angle(rotation.x_axis, -above.to_radians());
    let pose = Pose::look_at(pivot + turn * (eye - pivot), pivot, -rotation.y_axis).unwrap();
    let (width, height) = (k.width / 2, k.height / 2);
    let [fx, fy, cx, cy] = [k.fx, k.fy, k.cx, k.cy].map(|v| v / 2.0);
    Camera { intrinsics: Intrinsics { width, height, fx, fy, cx, cy }, pose }
}

/// Share of the pixels covered in both images whose colour in `light` leaves the range of `off` around it.
fn share_beyond(light: &Rendered, off: &Rendered) -> f64 {
    let (width, height) = (off.color.width, off.color.height);
    let (mut covered, mut beyond) = (0, 0);
    for (i, color) in light.color.data.iter().enumerate() {
        if light.coverage.data[i].min(off.coverage.data[i]) < 0.9 {
            continue;
        }
        let [column, row] = [i % width, i / width];
        let mut range = [[f32::INFINITY; 3], [f32::NEG_INFINITY; 3]];
        for y in row.saturating_sub(WINDOW)..(row + WINDOW + 1).min(height) {
            for x in column.saturating_sub(WINDOW)..(column + WINDOW + 1).min(width) {
                for (k, value) in off.color.data[y * width + x].into_iter().enumerate() {
                    range[0][k] = range[0][k].min(value);
                    range[1][k] = range[1][k].max(value);
                }
            }
        }
        let is_beyond =
            |k: usize| color[k] < range[0][k] - MARGIN || color[k] > range[1][k] + MARGIN;
        covered += 1;
        beyond += usize::from((0..3).any(is_beyond));
    }
    assert!(covered > 1000, "only {covered} pixels are covered");
    f64::from(beyond as u32) / f64::from(covered)
}

#[test]
fn photographs_keep_colours_and_splats_within_what_was_observed() {
    for (name, most) in [
        ("kinect_office", 0.02),
        ("tum_rpy", 0.02),
        ("lego400", 0.05),
        ("chair800", 0.02),
        ("open3d_sample", 0.02),
    ] {
        let Some(path) = shared(&format!("data/{name}")) else { return };
        let (off, camera) = trained(&path, PhotometricMode::Off);
        let (light, _) = trained(&path, PhotometricMode::Light);
        let longest = |set: &SplatSet, id: usize| set[id].scale.into_iter().fold(0.0, f32::max);
        let drawn = (0..off.len()).filter(|&id| off[id].opacity > 0.0 && light[id].opacity > 0.0);
        let longer = drawn.clone().filter(|&id| longest(&light, id) > 2.2 * longest(&off, id));
        let (longer, drawn) = (longer.count(), drawn.count());
        println!("{name}: {longer} of {drawn} splats are longer than their points allow");
        assert!(longer * 1000 <= drawn, "{name}: {longer} of {drawn}");
        let options = RenderOptions::evaluation(RenderMethod::PROJECTED, [0.0; 3]);
        for turn in [[30.0, 0.0], [-30.0, 0.0], [0.0, 35.0]] {
            let view = beside(&camera, &off, turn);
            let draw = |set: &SplatSet| CpuRenderer::new().render(set, &view, &options);
            let share = share_beyond(&draw(&light), &draw(&off));
            println!("{name}, {turn:?}: {:.2} % beyond observed colours", 100.0 * share);
            assert!(share < most, "{name}, {turn:?}: {share}");
        }
    }
}

/// Brightness of a synthetic wall in a frame, from the place on the wall and the camera's x, metres.
type Paint = fn(frame: usize, place: [f64; 2], eye: f64) -> f64;

/// Distance of the wall, metres, and image size, px.
const DISTANCE: f64 = 1.5;
const SIZE: [usize; 2] = [160, 120];

/// Splats of a wall that fills the image, and the camera of the first frame. The camera moves `step`
/// metres per frame along the wall.
fn wall(paint: Paint, frames: usize, step: f64, photometric: bool) -> (SplatSet, Camera) {
    let [width, height] = SIZE;
    let k = Intrinsics::from_horizontal_fov(width as u32, height as u32, 1.0);
    let rule = PhotometricRule::LIGHT;
    let photometric = photometric.then_some(rule);
    let config = SceneConfig { photometric, ..SceneConfig::coarse(0.03) };
    let mut surface = SurfaceSettings::of_sensor(Sensor::Kinect, DVec3::ZERO);
    surface.photograph = config.photometric.is_some();
    let mut scene = SceneTrainer::new(&config, surface.origin);
    let (mut preparer, mut seen) = (Preparer::new(), Observation::empty());
    let mut first = None;
    for i in 0..frames {
        let eye = step * i as f64;
        let color: Vec<u8> = (0..width * height)
            .flat_map(|pixel| {
                let x = eye + ((pixel % width) as f64 + 0.5 - k.cx) / k.fx * DISTANCE;
                let y = ((pixel / width) as f64 + 0.5 - k.cy) / k.fy * DISTANCE;
                let value = paint(i, [x, y], eye);
                [1.0, 0.9, 0.8].map(|tint| (255.0 * (tint * value).clamp(0.0, 1.0)) as u8)
            })
            .collect();
        let depth = vec![DISTANCE as f32; width * height];
        let pose = DMat4::from_translation(DVec3::X * eye);
        let lengths = DepthBuffer { lengths: &depth, kind: DepthKind::Z, trusted: [0.3, 4.0] };
        let color = ColorBuffer::Rgb8(&color);
        let frame = Frame::from_memory(&format!("{i}"), k, pose, color, Some(lengths)).unwrap();
        preparer.prepare(&frame, &surface, &mut seen).unwrap();
        first.get_or_insert(seen.camera);
        scene.learn(&seen).unwrap();
    }
    scene.settle();
    (scene.splats(), first.unwrap())
}

fn pattern([x, y]: [f64; 2]) -> f64 {
    0.45 + 0.2 * (14.0 * x).sin() * (11.0 * y).cos()
}

/// Wall with a mirror in its middle that shows stripes two metres behind the surface.
fn with_mirror(_: usize, place: [f64; 2], eye: f64) -> f64 {
    if place.into_iter().any(|v| v.abs() > 0.3) {
        return pattern(place);
    }
    let behind = eye + (place[0] - eye) * (DISTANCE + 2.0) / DISTANCE;
    if (4.0 * behind).sin() > 0.0 { 0.9 } else { 0.1 }
}

/// Wall under an exposure that changes from frame to frame.
fn exposed(frame: usize, place: [f64; 2], _: f64) -> f64 {
    (1.0 + 0.4 * (1.1 * frame as f64).sin()) * pattern(place)
}

#[test]
fn hard_recordings_keep_colours_within_what_was_observed_from_beside() {
    let cases: [(&str, Paint, usize, f64); 4] = [
        ("a mirror", with_mirror, 24, 0.02),
        ("a mirror, from one place", with_mirror, 24, 0.0),
        ("exposure before a still camera", exposed, 24, 0.0),
        ("a single frame", |_, place, _| pattern(place), 1, 0.0),
    ];
    for (name, paint, frames, step) in cases {
        let (off, camera) = wall(paint, frames, step, false);
        let (light, _) = wall(paint, frames, step, true);
        assert_eq!(off.len(), light.len(), "{name}: photographs changed the number of components");
        let options = RenderOptions::evaluation(RenderMethod::PROJECTED, [0.0; 3]);
        for turn in [[0.0, 0.0], [40.0, 0.0], [-40.0, 0.0], [0.0, 40.0]] {
            let view = beside(&camera, &off, turn);
            let draw = |set: &SplatSet| CpuRenderer::new().render(set, &view, &options);
            let (light, off) = (draw(&light), draw(&off));
            assert!(light.color.data.iter().flatten().all(|v| v.is_finite()), "{name}, {turn:?}");
            let share = share_beyond(&light, &off);
            println!("{name}, {turn:?}: {:.2} % beyond observed colours", 100.0 * share);
            assert!(share < 0.02, "{name}, {turn:?}: {share}");
        }
    }
}
