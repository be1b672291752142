//! The golden case `lego_small`: pixels of Lego frame 0 and their world points in both camera
//! conventions.

use crate::common::golden::golden_folder;
use crate::common::scratch::open_plain;
use crate::common::shared;
use glam::{DMat4, DVec3};
use std::path::Path;
use vbgs_studio::dataset::frame::{DepthCodes, DepthKind, Frame};
use vbgs_studio::dataset::unproject::{
    CameraConvention, EdgeFilter, UnprojectSettings, Unprojector, camera_point,
};
use vbgs_studio::math::camera::Intrinsics;
use vbgs_studio::math::measured_pixel::{COLOR_SCALE, Normalization};
use vbgs_studio::observation::points::Points;

fn f64s(folder: &Path, name: &str) -> Vec<f64> {
    let bytes = std::fs::read(folder.join(format!("{name}.f64.bin"))).unwrap();
    bytes.as_chunks::<8>().0.iter().map(|b| f64::from_le_bytes(*b)).collect()
}

fn u32s(folder: &Path, name: &str) -> Vec<u32> {
    let bytes = std::fs::read(folder.join(format!("{name}.u32.bin"))).unwrap();
    bytes.as_chunks::<4>().0.iter().map(|b| u32::from_le_bytes(*b)).collect()
}

fn f32s(folder: &Path, name: &str) -> Vec<f32> {
    let bytes = std::fs::read(folder.join(format!("{name}.f32.bin"))).unwrap();
    bytes.as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b)).collect()
}

/// Pixels of the golden case, their camera-space points, and the raw pose (not re-orthonormalised).
struct Golden {
    uv: Vec<u32>,
    depth: Vec<u32>,
    rgb: Vec<u32>,
    world_from_gl: DMat4,
    k: Intrinsics,
}

impl Golden {
    fn read(folder: &Path) -> Self {
        let c2w: [f64; 16] = f64s(folder, "f0_c2w").try_into().unwrap();
        let camera = f64s(folder, "camera");
        Self {
            uv: u32s(folder, "f0_uv"),
            depth: u32s(folder, "f0_depth"),
            rgb: u32s(folder, "f0_rgb"),
            world_from_gl: DMat4::from_cols_array(&c2w).transpose(),
            k: Intrinsics::from_horizontal_fov(camera[1] as u32, camera[2] as u32, camera[0]),
        }
    }

    fn pixel(&self, i: usize) -> [usize; 2] {
        [self.uv[2 * i] as usize, self.uv[2 * i + 1] as usize]
    }

    fn world(&self, i: usize, convention: CameraConvention) -> DVec3 {
        let length = 8.0 * (1.0 - f64::from(self.depth[i]) / 255.0);
        let kind = DepthKind::RayDistance;
        let p = camera_point(&self.k, convention, kind, self.pixel(i), length);
        self.world_from_gl.transform_point3(DVec3::new(p.x, -p.y, -p.z))
    }
}

#[test]
fn world_points_of_both_conventions_agree_to_1e_13() {
    let folder = golden_folder("lego_small");
    let golden = Golden::read(&folder);
    for (name, convention) in
        [("f0_world_paper", CameraConvention::Paper), ("f0_world_exact", CameraConvention::Exact)]
    {
        let expected = f64s(&folder, name);
        let mut worst = 0.0f64;
        for (i, e) in expected.as_chunks::<3>().0.iter().enumerate() {
            let error = golden.world(i, convention) - DVec3::from_array(*e);
            worst = worst.max(error.abs().max_element());
        }
        eprintln!("{name}: largest deviation {worst:.1e}");
        assert_eq!(expected.len(), 1500);
        assert!(worst < 1e-13, "{name}: {worst:e}");
    }
}

#[test]
fn normalised_golden_points_are_the_paper_convention() {
    let folder = golden_folder("lego_small");
    let golden = Golden::read(&folder);
    let normalization = Normalization::from_range(DVec3::NEG_ONE, DVec3::ONE);
    for (i, x) in f32s(&folder, "x0").as_chunks::<6>().0.iter().enumerate() {
        let p = normalization.normalize(golden.world(i, CameraConvention::Paper));
        let rgb = [0, 1, 2].map(|c| (f64::from(golden.rgb[3 * i + c]) / 255.0 - 0.5) / COLOR_SCALE);
        for (mine, theirs) in p.to_array().into_iter().chain(rgb).zip(x) {
            assert_eq!(mine as f32, *theirs, "point {i}");
        }
    }
}

#[test]
fn the_loader_gives_the_golden_points_in_tile_order() {
    let Some(lego) = shared("data/lego400") else { return };
    let folder = golden_folder("lego_small");
    let golden = Golden::read(&folder);
    let dataset = open_plain(&lego).unwrap();
    let frame = dataset.load(dataset.split_named("test").unwrap(), 0).unwrap();
    let kept = kept_by_the_letter(&frame);
    let points = unproject(&frame, CameraConvention::Paper);
    assert_eq!(points.len(), kept.len(), "as `dataset.md`, Edge filter");

    let order: std::collections::HashMap<[usize; 2], usize> =
        kept.iter().enumerate().map(|(i, pixel)| (*pixel, i)).collect();
    let x0 = f32s(&folder, "x0");
    for (i, x) in x0.as_chunks::<6>().0.iter().enumerate() {
        let at = *order.get(&golden.pixel(i)).expect("every golden pixel passes the filter");
        let [px, py, pz] = points.position(at);
        let [r, g, b] = points.color(at);
        for (axis, (mine, theirs)) in [px, py, pz, r, g, b].into_iter().zip(x).enumerate() {
            // The loader makes the file's pose (rounded to f32) a rotation again: 1e-7 at distance 4.
            let tolerance = if axis < 3 { 1e-6 } else { 0.0 };
            assert!((mine - theirs).abs() <= tolerance, "point {i}, {axis}: {mine} {theirs}");
        }
    }
}

/// `model.md`, Sufficient statistics and precision, was measured on 982 910 points of 20 Lego frames.
#[test]
fn twenty_frames_make_the_published_number_of_points() {
    let Some(lego) = shared("data/lego400") else { return };
    let dataset = open_plain(&lego).unwrap();
    let split = dataset.training_split().unwrap();
    let total: usize = (0..20)
        .map(|i| unproject(&dataset.load(split, i).unwrap(), CameraConvention::Paper).len())
        .sum();
    assert_eq!(total, 982_910);
}

fn unproject(frame: &Frame, convention: CameraConvention) -> Points<f32> {
    let mut points = Points::new();
    let settings = UnprojectSettings {
        convention,
        filter: EdgeFilter::DropMixed,
        normalization: Normalization::from_range(DVec3::NEG_ONE, DVec3::ONE),
    };
    Unprojector::new().unproject(frame, &settings, &mut points).unwrap();
    points
}

/// Pixels retained by `dataset.md`, Unprojection, one pixel at a time, sorted as in `dataset.md`, Tile order.
fn kept_by_the_letter(frame: &Frame) -> Vec<[usize; 2]> {
    let DepthCodes::Inverse8(codes) = &frame.depth.as_ref().unwrap().codes else {
        panic!("Lego has 8-bit depth");
    };
    let (width, height) = (codes.width as i64, codes.height as i64);
    let level = |u: i64, v: i64| {
        i32::from(*codes.at(u.clamp(0, width - 1) as usize, v.clamp(0, height - 1) as usize))
    };
    let mut kept = Vec::new();
    for v in 0..height {
        for u in 0..width {
            let d = level(u, v);
            let is_mixed = [(1, 0), (0, 1), (1, 1), (1, -1)].iter().any(|(du, dv)| {
                let (a, b) = (level(u - du, v - dv), level(u + du, v + dv));
                (a - b).abs() >= 6 && d >= a.min(b) + 2 && d <= a.max(b) - 2
            });
            if d > 0 && frame.color.at(u as usize, v as usize)[3] == 255 && !is_mixed {
                kept.push([u as usize, v as usize]);
            }
        }
    }
    kept.sort_by_key(|[u, v]| (v / 8, u / 8, v % 8 / 4, u % 8 / 4, v % 4, u % 4));
    kept
}
