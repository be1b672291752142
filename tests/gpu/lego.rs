//! A whole view of a trained scene against the f64 oracle.

use super::device::Gpu;
use crate::common::oracle::Oracle;
use crate::common::shared;
use std::sync::Arc;
use vbgs_studio::dataset::{self, LoadOptions};
use vbgs_studio::math::camera::Camera;
use vbgs_studio::math::image::Image;
use vbgs_studio::model::splat::splats::Splat;
use vbgs_studio::pipeline::plan::Selection;
use vbgs_studio::pipeline::session::{Session, Step};
use vbgs_studio::render::cpu::CpuRenderer;
use vbgs_studio::render::{RenderMethod, RenderOptions};
use vbgs_studio::train::paper::config::{PaperConfig, PaperOverrides, ReassignPolicy};

/// Enough frames to cover every side.
const N_FRAMES: usize = 60;
/// Limits of the mean absolute error and the PSNR of a GPU image.
const MOST_MEAN_ERROR: f64 = 0.5 / 255.0;
const LEAST_PSNR: f64 = 50.0;

#[test]
#[ignore = "half a minute: the oracle draws two whole views"]
fn a_view_of_lego_is_what_the_oracle_sees() {
    let (Some(path), Some(gpu)) = (shared("data/lego400"), Gpu::new()) else { return };
    let (splats, mut camera) = trained(&path);
    // Half the size, because the oracle visits every splat for every pixel. Each pixel is still
    // covered by several splats.
    camera.intrinsics = camera.intrinsics.scaled(0.5);
    for method in [RenderMethod::PROJECTED, RenderMethod::EXACT] {
        let options = RenderOptions::evaluation(method, [0.0; 3]);
        let expected = Oracle::of(&splats, &camera, &options)
            .render()
            .map(|sample| [sample.rgba[0], sample.rgba[1], sample.rgba[2]]);
        let cpu = CpuRenderer::new().render(&splats, &camera, &options).color;
        report("CPU", method, &cpu.map(|&color| color.map(f64::from)), &expected);
        let image = gpu.image(&splats, &camera, &options);
        let found = image.map(|&[r, g, b, _]| [r, g, b].map(f64::from));
        let (mean, psnr) = report("GPU", method, &found, &expected);
        assert!(mean <= MOST_MEAN_ERROR && psnr >= LEAST_PSNR, "{mean:e}, {psnr}");
    }
    gpu.assert_no_faults();
}

/// Used splats of the paper's model without reassignment, and the first evaluation camera.
fn trained(path: &std::path::Path) -> (Vec<Splat>, Camera) {
    let dataset = Arc::new(dataset::open(path, &LoadOptions::default()).unwrap());
    let val = dataset.split_named("val").unwrap();
    let camera = dataset.splits[val].frames[0].camera;
    let selection = Selection { max_frames: Some(N_FRAMES), ..Selection::all_frames() };
    // Without reassignment a seventh of the components is used, few enough for the oracle.
    let overrides =
        PaperOverrides { reassign: Some(ReassignPolicy::Off), ..PaperOverrides::default() };
    let config = PaperConfig::paper().with(&overrides).unwrap();
    let mut session = Session::new(dataset, config, selection).unwrap();
    while !matches!(session.step().unwrap(), Step::Finished) {}
    let splats: Vec<Splat> =
        session.splats().into_splats().into_iter().filter(Splat::is_drawable).collect();
    println!("{} splats after {} frames", splats.len(), session.frames().len());
    (splats, camera)
}

fn report(
    who: &str,
    method: RenderMethod,
    found: &Image<[f64; 3]>,
    expected: &Image<[f64; 3]>,
) -> (f64, f64) {
    let pairs = found.data.iter().flatten().zip(expected.data.iter().flatten());
    let errors: Vec<f64> = pairs.map(|(found, expected)| (found - expected).abs()).collect();
    let n = errors.len() as f64;
    let mean = errors.iter().sum::<f64>() / n;
    let mse = errors.iter().map(|error| error * error).sum::<f64>() / n;
    let worst = errors.iter().fold(0.0f64, |worst, &error| worst.max(error));
    let psnr = -10.0 * mse.max(1e-12).log10();
    let renderer = method.renderer();
    println!(
        "{who}, {renderer}: mean {:.4}/255, PSNR {psnr:.1} dB, worst {worst:.1e}",
        mean * 255.0
    );
    (mean, psnr)
}
