// Colours that are not the splat's own. `src/render/paint.rs` has the same numbers and says where
// they come from; `tests/shaders.rs` compares them.

const RAMP = array<vec3<f32>, 7>(
    vec3<f32>(0.2777273, 0.005407345, 0.3340998),
    vec3<f32>(0.10509304, 1.4046135, 1.3845902),
    vec3<f32>(-0.33086183, 0.21484756, 0.09509516),
    vec3<f32>(-4.6342305, -5.799101, -19.33244),
    vec3<f32>(6.22827, 14.179934, 56.690552),
    vec3<f32>(4.776385, -13.745145, -65.35303),
    vec3<f32>(-5.435456, 4.6458526, 26.312435),
);

// Colour of a share from 0 (dark violet) to 1 (yellow); others are clamped.
fn ramp(share: f32) -> vec3<f32> {
    let t = clamp(share, 0.0, 1.0);
    let upper = ((RAMP[6] * t + RAMP[5]) * t + RAMP[4]) * t + RAMP[3];
    let sum = ((upper * t + RAMP[2]) * t + RAMP[1]) * t + RAMP[0];
    return clamp(sum, vec3<f32>(0.0), vec3<f32>(1.0));
}
