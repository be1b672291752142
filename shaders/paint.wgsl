// Colours of the display modes. `src/render/paint.rs` documents the origin of `RAMP`.

// Maps 0 to dark violet and 1 to yellow; other values are clamped.
fn ramp(share: f32) -> vec3<f32> {
    let t = clamp(share, 0.0, 1.0);
    let upper = ((RAMP[6] * t + RAMP[5]) * t + RAMP[4]) * t + RAMP[3];
    let sum = ((upper * t + RAMP[2]) * t + RAMP[1]) * t + RAMP[0];
    return clamp(sum, vec3<f32>(0.0), vec3<f32>(1.0));
}
