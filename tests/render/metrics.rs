//! PSNR, SSIM and depth errors.

use crate::common::golden::golden_folder;
use crate::common::render_cases::golden_json;
use vbgs_studio::eval::metrics::MetricError;
use vbgs_studio::eval::metrics::{depth_error, mean_std, psnr, psnr_masked};
use vbgs_studio::eval::ssim::ssim;
use vbgs_studio::math::image::{Image, RgbImage};

#[test]
fn golden_metrics() {
    let golden = golden_json();
    let value = |key: &str| golden["metrics"][key].as_f64().unwrap();
    let (truth, prediction) = formula_images();
    let found = [("psnr", psnr(&prediction, &truth)), ("ssim_valid", ssim(&prediction, &truth))];
    for (key, found) in found {
        let (found, expected) = (found.unwrap(), value(key));
        assert!((found - expected).abs() < 1e-9, "{key}: {found} for {expected}");
    }
    let narrow = |image: &Image<[f64; 3]>| -> RgbImage { image.map(|p| p.map(|v| v as f32)) };
    let (truth, prediction) = (narrow(&truth), narrow(&prediction));
    assert!((psnr(&prediction, &truth).unwrap() - value("psnr")).abs() < 1e-5);
    let similarity = ssim(&prediction, &truth).unwrap();
    assert!((similarity - value("ssim_valid")).abs() < 1e-6);
}

/// The two images defined by `image_formula` of the golden file.
fn formula_images() -> (Image<[f64; 3]>, Image<[f64; 3]>) {
    let (width, height) = (32, 24);
    let pixel = |i: usize| ((i % width) as f64, (i / width) as f64);
    let a = (0..width * height).map(|i| {
        let (x, y) = pixel(i);
        let red = 0.5 + 0.4 * (0.3 * x + 0.2 * y).sin();
        [red, 0.5 + 0.4 * (0.25 * x - 0.1 * y).cos(), (x + y) / 56.0]
    });
    let a = Image::from_vec(width, height, a.collect());
    let b = (0..width * height).map(|i| {
        let (x, y) = pixel(i);
        let noise = 0.05 * (1.7 * x).sin() * (1.3 * y).cos();
        a.data[i].map(|v: f64| (v + noise).clamp(0.0, 1.0))
    });
    let b = Image::from_vec(width, height, b.collect());
    (a, b)
}

#[test]
fn golden_psnr_of_the_reference() {
    let folder = golden_folder("splat");
    let bytes = |name: &str| std::fs::read(folder.join(name)).unwrap();
    let image = |name: &str| -> RgbImage {
        let bytes = bytes(name);
        let values: Vec<f32> = chunks::<4>(&bytes).map(f32::from_le_bytes).collect();
        Image::from_vec(16, 16, chunks3(&values))
    };
    let expected = f64::from_le_bytes(chunks::<8>(&bytes("psnr.f64.bin")).next().unwrap());
    let found = psnr(&image("psnr_pred.f32.bin"), &image("psnr_gt.f32.bin")).unwrap();
    assert!((found - expected).abs() < 1e-5, "{found} for {expected}");
}

fn chunks<const N: usize>(bytes: &[u8]) -> impl Iterator<Item = [u8; N]> {
    bytes.chunks_exact(N).map(|chunk| chunk.try_into().unwrap())
}

fn chunks3(values: &[f32]) -> Vec<[f32; 3]> {
    values.chunks_exact(3).map(|chunk| chunk.try_into().unwrap()).collect()
}

#[test]
fn psnr_edges() {
    let grey = Image::filled(6, 5, [0.5f32; 3]);
    assert_eq!(psnr(&grey, &grey).unwrap(), 120.0);
    let glare = Image::filled(6, 5, [7.0f32; 3]);
    assert!((psnr(&glare, &grey).unwrap() - 6.0206).abs() < 1e-4, "the prediction is clamped");
    let mut broken = grey.clone();
    broken.data[3][1] = f32::NAN;
    assert!(psnr(&broken, &grey).unwrap().is_nan(), "NaN is not a perfect score");

    let mut half_wrong = grey.clone();
    half_wrong.data[..6].fill([0.0; 3]);
    let mut mask = Image::filled(6, 5, true);
    mask.data[..6].fill(false);
    assert_eq!(psnr_masked(&half_wrong, &grey, &mask).unwrap(), 120.0);
    let inverse = mask.map(|kept| !kept);
    assert!((psnr_masked(&half_wrong, &grey, &inverse).unwrap() - 6.0206).abs() < 1e-4);
    let nothing = Image::filled(6, 5, false);
    assert_eq!(psnr_masked(&grey, &grey, &nothing), Err(MetricError::NoPixels));
    assert_eq!(
        psnr(&Image::filled(0, 0, [0f32; 3]), &Image::filled(0, 0, [0f32; 3])),
        Err(MetricError::NoPixels)
    );
}

#[test]
fn sizes_that_differ_are_named() {
    let (small, large) = (Image::filled(12, 11, [0f32; 3]), Image::filled(12, 13, [0f32; 3]));
    let plane = |height| Image::filled(12, height, 1f32);
    let mask = Image::filled(12, 13, true);
    let errors = [
        psnr(&small, &large).unwrap_err(),
        psnr_masked(&small, &small, &mask).unwrap_err(),
        ssim(&small, &large).unwrap_err(),
        depth_error(&plane(11), &plane(11), &plane(13)).unwrap_err(),
        depth_error(&plane(11), &plane(13), &plane(11)).unwrap_err(),
    ];
    for (error, what) in errors.iter().zip([
        "ground truth",
        "mask",
        "ground truth",
        "ground truth depth",
        "coverage",
    ]) {
        let message = error.to_string();
        assert!(message.starts_with(&format!("{what}: expected 12x11")), "{message}");
        assert!(message.contains("found 12x13"), "{message}");
    }
}

#[test]
fn ssim_edges() {
    let (a, b) = formula_images();
    assert!((ssim(&a, &a).unwrap() - 1.0).abs() < 1e-14);
    let forth = ssim(&a, &b).unwrap();
    assert!((forth - ssim(&b, &a).unwrap()).abs() < 1e-14, "symmetric");
    let tiny = Image::filled(10, 40, [0.3f32; 3]);
    assert_eq!(ssim(&tiny, &tiny), Err(MetricError::TooSmall { width: 10, height: 40 }));
    let none = Image::filled(0, 4, [0f32; 3]);
    assert_eq!(ssim(&none, &none), Err(MetricError::NoPixels));
}

#[test]
fn depth_errors_by_hand() {
    // Valid truths are 1, 2, 4 and 5, all covered but the last. Errors are 0.1, 0 and 2.
    let truth = Image::from_vec(3, 2, vec![1.0, 2.0, 4.0, 5.0, 0.0, f32::NAN]);
    let found = Image::from_vec(3, 2, vec![1.1, 2.0, 6.0, 5.0, 3.0, 3.0]);
    let coverage = Image::from_vec(3, 2, vec![0.5, 1.0, 0.9, 0.49, 1.0, 1.0]);
    let error = depth_error(&found, &coverage, &truth).unwrap();
    assert!((error - 2.1 / 3.0).abs() < 1e-7, "{error}");
    let uncovered = depth_error(&found, &Image::filled(3, 2, 0.0), &truth).unwrap();
    assert!(uncovered.is_nan());
    let no_truth = Image::filled(3, 2, -1.0);
    assert_eq!(depth_error(&found, &coverage, &no_truth), Err(MetricError::NoPixels));
}

#[test]
fn spread_is_that_of_the_population() {
    let (mean, std) = mean_std(&[2.0, 4.0, 4.0, 4.0, 5.0, 5.0, 7.0, 9.0]);
    assert_eq!((mean, std), (5.0, 2.0));
    assert!(mean_std(&[]).0.is_nan());
}
