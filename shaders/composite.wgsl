// Finishes the premultiplied splat image and composites it over a background, C + (1 − A)·bg clamped to
// [0, 1]. Combines it with a second image by the formulas of `src/render/compare.rs`.
// All values are sRGB-encoded; only a target that encodes on write (`*Srgb`) needs them decoded first.

@group(0) @binding(0) var<uniform> composite: Composite;
@group(0) @binding(1) var image: texture_2d<f32>;
@group(0) @binding(2) var image_sampler: sampler;
// Another splat image or an opaque photograph; the first image if nothing is compared.
@group(0) @binding(3) var second_image: texture_2d<f32>;

struct Fragment {
    @builtin(position) position: vec4<f32>,
    @location(0) uv: vec2<f32>,
}

// One triangle that covers the viewport.
@vertex
fn vertex(@builtin(vertex_index) index: u32) -> Fragment {
    let uv = vec2<f32>(f32((index << 1u) & 2u), f32(index & 2u));
    var out: Fragment;
    out.position = vec4<f32>(uv.x * 2.0 - 1.0, 1.0 - uv.y * 2.0, 0.0, 1.0);
    out.uv = uv;
    return out;
}

@fragment
fn fragment_encoded(in: Fragment) -> @location(0) vec4<f32> {
    return vec4<f32>(combined(in.uv), 1.0);
}

@fragment
fn fragment_linear(in: Fragment) -> @location(0) vec4<f32> {
    return vec4<f32>(linear_from_srgb(combined(in.uv)), 1.0);
}

fn combined(uv: vec2<f32>) -> vec3<f32> {
    // Both are sampled before any branch, as WGSL requires uniform control flow.
    let inner = (uv - composite.area_min) / (composite.area_max - composite.area_min);
    let first = over_background(textureSample(image, image_sampler, uv),
        composite.exposure, composite.full_coverage);
    let second =
        over_background(textureSample(second_image, image_sampler, inner),
        composite.second_exposure, composite.second_full_coverage);
    if composite.mode == COMPARE_NOTHING {
        return first;
    }
    if any(uv < composite.area_min) || any(uv >= composite.area_max) {
        return OUTSIDE * first;
    }
    if composite.mode == COMPARE_DIFFERENCE {
        return min(composite.amount * abs(first - second), vec3<f32>(1.0));
    }
    return select(second, first, uv.x < composite.amount);
}

// Finishing as in `src/render/finish.rs`; the minimum coverage avoids 1/0.
fn over_background(open: vec4<f32>, exposure: vec3<f32>, full_coverage: f32) -> vec3<f32> {
    let over =
        open * min(1.0 / full_coverage, 1.0 / max(open.a, 1e-6)) * vec4<f32>(exposure, 1.0);
    return clamp(over.rgb + (1.0 - over.a) * composite.background, vec3<f32>(0.0), vec3<f32>(1.0));
}

// IEC 61966-2-1.
fn linear_from_srgb(encoded: vec3<f32>) -> vec3<f32> {
    let curve = pow((encoded + 0.055) / 1.055, vec3<f32>(2.4));
    return select(curve, encoded / 12.92, encoded <= vec3<f32>(0.04045));
}
