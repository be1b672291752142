//! Training with photographs must not lower the quality of views away from the camera path.

use super::runner::Scratch;

/// PSNR over covered pixels, on the camera path and from free viewpoints.
fn quality(scratch: &Scratch, mode: &str) -> [f64; 2] {
    scratch.run(&format!("train phone --out {mode} --photometric {mode}")).succeeds();
    ["eval", "free"].map(|split| {
        let eval = format!("eval {mode}/checkpoint.vbgs phone/free --split {split} --json");
        let found = scratch.run(&eval).succeeds().json();
        found["eval"][0]["psnr_covered_mean"].as_f64().unwrap()
    })
}

#[test]
fn photographs_of_a_phone_never_harm_a_view() {
    let scratch = Scratch::empty();
    let phone = "synth phone --camera phone --scene door --size 384x512 --frames 32 --eval-frames 4 --free-frames 8";
    scratch.run(phone).succeeds();
    let [off, light, full] = ["off", "light", "full"].map(|mode| quality(&scratch, mode));
    println!("way, free: off {off:.2?}, light {light:.2?}, full {full:.2?} dB");
    for i in 0..2 {
        assert!(light[i] > off[i] - TOLERANCE, "off {off:.2?}, light {light:.2?}");
        assert!(full[i] > light[i] - TOLERANCE, "light {light:.2?}, full {full:.2?}");
    }
}

/// Tolerance in dB: photographs extend the coverage, and pixels at the rim are the worst.
const TOLERANCE: f64 = 0.3;
