// Records in memory between preprocessing and blending, and conservative tests of the pixels they cover.

// 64 bytes.
struct Packed {
    anchor: vec4<f32>,          // conic.anchor, conic.inverse_p2
    factor: vec4<f32>,          // conic.factor, opacity
    half_l_color: vec4<f32>,    // conic.half_l, red, green
    blue_reach: vec4<f32>,      // blue, reach, 0, 0
}

// 48 bytes; only for scenes with appearance.
struct PackedGradient {
    along: vec4<f32>,           // along, across_y.x
    across_x: vec4<f32>,        // across_x, across_y.y
    across_y: vec4<f32>,        // across_y.z, 0, 0, 0
}

// Slack of the reach for f32 rounding, as a fraction of its square.
const REACH_SLACK: f32 = 0.01;

fn pack(record: Record) -> Packed {
    let conic = record.conic;
    return Packed(
        vec4<f32>(conic.anchor, conic.inverse_p2),
        vec4<f32>(conic.factor, record.opacity),
        vec4<f32>(conic.half_l, record.color.rg),
        vec4<f32>(record.color.b, record.reach, 0.0, 0.0),
    );
}

fn conic_from(packed: Packed) -> Conic {
    return Conic(packed.anchor.xyz, packed.anchor.w, packed.factor.xyz, packed.half_l_color.xy);
}

fn pack_gradient(g: Gradient) -> PackedGradient {
    return PackedGradient(
        vec4<f32>(g.along, g.across_y.x),
        vec4<f32>(g.across_x, g.across_y.y),
        vec4<f32>(g.across_y.z, 0.0, 0.0, 0.0),
    );
}

fn gradient_from(packed: PackedGradient) -> Gradient {
    let across_y = vec3<f32>(packed.along.w, packed.across_x.w, packed.across_y.x);
    return Gradient(packed.along.xyz, packed.across_x.xyz, across_y);
}

// Support of a splat, precomputed so that testing many boxes needs no division.
struct Reach {
    centre: vec2<f32>,
    half_l: vec2<f32>,
    factor: vec3<f32>,
    k2: f32,                    // squared reach
    rest: f32,                  // 1 − k²/|p|²
    slopes: vec2<f32>,          // minimum of num: x = slopes.x·y for fixed y, y = slopes.y·x for fixed x
}

fn reach_from(conic: Conic, reach: f32) -> Reach {
    let factor = conic.factor;
    let square = factor.y * factor.y + factor.z * factor.z;
    let slopes = vec2<f32>(-factor.y / factor.x, -factor.x * factor.y / square);
    let k2 = reach * reach;
    let rest = 1.0 - k2 * conic.inverse_p2;
    return Reach(conic.anchor.xy, conic.half_l, factor, k2, rest, slopes);
}

// True if alpha may reach the cut somewhere in a box of pixel centres; never wrongly false.
// D² ≤ k² is equivalent to num·(1 − k²/|p|²) ≤ k²·h², and h is linear, so its maximum is at a corner.
fn touches(reach: Reach, low: vec2<f32>, high: vec2<f32>) -> bool {
    if view.lens == LENS_FISHEYE {
        // The conic is not linear in fisheye pixels, so only the bounding box of the cone applies.
        return true;
    }
    let a = low - reach.centre;
    let b = high - reach.centre;
    let turn = max(reach.half_l * a, reach.half_l * b);
    let h = max(1.0 + turn.x + turn.y, 0.0);
    // Negated, so that NaN counts as covered.
    return !(least_num(reach, a, b) * reach.rest > (1.0 + REACH_SLACK) * reach.k2 * h * h);
}

// Minimum of num in a box. num is convex and 0 at the origin. If the origin is outside the box, the minimum
// lies on a side that faces it.
fn least_num(reach: Reach, a: vec2<f32>, b: vec2<f32>) -> f32 {
    let nearest = clamp(vec2<f32>(0.0), a, b);
    if all(nearest == vec2<f32>(0.0)) {
        return 0.0;
    }
    let other = clamp(reach.slopes * nearest.yx, a, b);
    return min(
        num_at(reach.factor, vec2<f32>(nearest.x, other.y)),
        num_at(reach.factor, vec2<f32>(other.x, nearest.y)),
    );
}
