//! Golden pixels of `tests/golden/render_cases.json.zst`.

use super::oracle::{Sample, SplatF64};
use super::scenes::exact;
use glam::{DMat4, DQuat, DVec3};
use serde_json::Value;
use vbgs_studio::math::camera::{Camera, Intrinsics};
use vbgs_studio::math::pose::Pose;
use vbgs_studio::render::{Antialias, Lens, RenderOptions, Renderer, Response};

/// One scene with one renderer's expected pixels.
pub struct GoldenView {
    pub case: String,
    pub variant: &'static str,
    pub splats: Vec<SplatF64>,
    pub camera: Camera,
    pub options: RenderOptions,
    /// Largest rounding error of the background, which the options hold in f32 and the file in f64.
    pub background_rounding: f64,
    /// Column, row and expected sample.
    pub pixels: Vec<([usize; 2], Sample)>,
}

const VARIANTS: [&str; 5] = ["projected", "exact", "exact_line", "exact_ref", "exact_footprint"];

/// Returns every case with every renderer that can draw it.
pub fn golden_views() -> Vec<GoldenView> {
    let golden = golden_json();
    let cases = array(&golden["cases"]).iter();
    cases.flat_map(|case| VARIANTS.into_iter().filter_map(|v| view(case, v))).collect()
}

pub fn golden_json() -> Value {
    serde_json::from_slice(&super::golden::golden_unpacked("render_cases.json.zst")).unwrap()
}

fn view(case: &Value, variant: &'static str) -> Option<GoldenView> {
    let name = case["name"].as_str().unwrap();
    let lens = match case["camera"]["model"].as_str().unwrap() {
        "pinhole" => Lens::Pinhole,
        "fisheye_equidistant" => Lens::Fisheye,
        other => panic!("{name}: camera model {other}"),
    };
    let expected = &case["expected"][variant];
    if expected.is_null() {
        assert!(lens == Lens::Fisheye && variant.starts_with("projected"), "{name} {variant}");
        return None;
    }
    let background = numbers::<3>(&case["background"]);
    let rounding = background.map(|v| (f64::from(v as f32) - v).abs());
    let pixels = array(&case["pixels"]).iter().map(|p| numbers::<2>(p).map(|v| v as usize));
    Some(GoldenView {
        case: name.to_owned(),
        variant,
        splats: array(&case["splats"]).iter().map(splat).collect(),
        camera: camera(&case["camera"]),
        options: options(variant, lens, background.map(|v| v as f32)),
        background_rounding: rounding.into_iter().fold(0.0, f64::max),
        pixels: pixels.zip(array(expected).iter().map(sample)).collect(),
    })
}

fn options(variant: &str, lens: Lens, background: [f32; 3]) -> RenderOptions {
    let exact = |response, antialias| {
        RenderOptions::evaluation(exact(response, antialias, lens), background)
    };
    match (variant, lens) {
        ("projected", _) => RenderOptions::published(Renderer::Projected, background),
        ("exact_ref", Lens::Pinhole) => RenderOptions::published(Renderer::Exact, background),
        ("exact", _) => exact(Response::Ray, Antialias::None),
        ("exact_line", _) => exact(Response::Line, Antialias::None),
        ("exact_ref", Lens::Fisheye) => exact(Response::Line, Antialias::Reference),
        ("exact_footprint", _) => exact(Response::Ray, Antialias::Footprint),
        (other, _) => panic!("no variant {other}"),
    }
}

fn camera(camera: &Value) -> Camera {
    let number = |key: &str| camera[key].as_f64().unwrap();
    let rows: Vec<[f64; 4]> = array(&camera["c2w_opengl"]).iter().map(numbers).collect();
    let pose = DMat4::from_cols_array_2d(&rows.try_into().unwrap()).transpose();
    let intrinsics = Intrinsics {
        width: number("W") as u32,
        height: number("H") as u32,
        fx: number("fx"),
        fy: number("fy"),
        cx: number("cx"),
        cy: number("cy"),
    };
    Camera { intrinsics, pose: Pose::from_opengl(pose).unwrap() }
}

fn splat(splat: &Value) -> SplatF64 {
    let [w, x, y, z] = numbers(&splat["quat_wxyz"]);
    SplatF64 {
        mean: DVec3::from_array(numbers(&splat["mean"])),
        opacity: splat["opacity"].as_f64().unwrap(),
        color: DVec3::from_array(numbers(&splat["rgb"])),
        scale: DVec3::from_array(numbers(&splat["scale"])),
        rotation: DQuat::from_xyzw(x, y, z, w),
        appearance: None,
    }
}

fn sample(expected: &Value) -> Sample {
    Sample {
        rgba: numbers(&expected["rgba"]),
        depth: expected["depth"].as_f64().unwrap(),
        n_blended: expected["n"].as_u64().unwrap() as usize,
    }
}

fn array(value: &Value) -> &Vec<Value> {
    value.as_array().unwrap()
}

fn numbers<const N: usize>(value: &Value) -> [f64; N] {
    let values: Vec<f64> = array(value).iter().map(|v| v.as_f64().unwrap()).collect();
    values.try_into().unwrap()
}
