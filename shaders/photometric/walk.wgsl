// Second walk: one workgroup per tile. Each lane holds one splat, and the pixels move from lane to lane: at
// every step lane `i` processes the pixel that lane `i − 1` processed before. Each pixel thus meets the
// splats in order, and the sums of a splat stay in its lane. No sums are combined across lanes, so results
// are bit-identical in every run and need only workgroup memory.

// Sums of one splat in one tile, in the order used by the CPU, in groups of four.
struct Sums {
    slope: vec4<f32>,
    slope_rest: vec2<f32>,
    bend: vec4<f32>,
    bend_rest: vec2<f32>,
    bend_third: vec4<f32>,
    bend_fourth: vec4<f32>,
    bend_last: f32,
    red: vec3<f32>,
    green: vec3<f32>,
    blue: vec3<f32>,
    color_bend: vec4<f32>,
    color_bend_rest: vec2<f32>,
    weight: f32,
}

@group(0) @binding(5) var<storage, read> pixels: array<Pixel>;
// Per splat-tile pair: whether a pixel of the tile shows the splat.
@group(0) @binding(6) var<storage, read_write> shown: array<u32>;
// Per visible pair: its sums, `N_QUARTERS` each.
@group(0) @binding(7) var<storage, read_write> partial_sums: array<vec4<f32>>;

const NONE: u32 = 0xffffffffu;

// Per pixel: transmittance (negative once finished) and the colour behind.
var<workgroup> open: array<vec4<f32>, GROUP>;
// Factor of crack filling, weighted residual.
var<workgroup> faces: array<vec4<f32>, GROUP>;
// Curvature share, final transmittance, missing coverage, weighted depth error.
var<workgroup> rests: array<vec4<f32>, GROUP>;
// Measured depth and inverse tolerance.
var<workgroup> depths: array<vec2<f32>, GROUP>;
// Depth error behind.
var<workgroup> wrong: array<f32, GROUP>;
var<workgroup> n_open: atomic<u32>;

// Splat held by a lane.
struct Own {
    splat: Splat,
    // Index of its sums; `NONE` without a splat.
    slot: u32,
    is_shown: bool,
}

@compute @workgroup_size(LANES)
fn walk(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let tile = group.xy;
    let range = entries_of(tile);
    if lane == 0u {
        atomicStore(&n_open, 0u);
    }
    workgroupBarrier();
    if range.x < range.y {
        begin(tile, lane);
    }
    let n_batches = (range.y - range.x + LANES - 1u) / LANES;
    var own: Own;
    own.slot = NONE;
    var sums: Sums;
    // One extra round, in which the last splats process their last pixels.
    for (var batch = 0u; batch <= n_batches; batch++) {
        // Once every pixel is finished, later splats are hidden.
        if workgroupUniformLoad(&n_open) == 0u {
            break;
        }
        // Loaded by all lanes at once, although each lane switches splats when its first pixel arrives.
        let next = own_of(tile, range.x + batch * LANES + lane, range.y);
        for (var step = 0u; step < LANES; step++) {
            if step == lane {
                store(own, sums);
                own = next;
                sums = Sums();
            }
            if own.slot != NONE {
                add_pixel(&own, &sums, tile, (step + LANES - lane) % LANES);
            }
            workgroupBarrier();
        }
    }
    store(own, sums);
}

fn begin(tile: vec2<u32>, lane: u32) {
    open[lane] = vec4<f32>(-1.0, 0.0, 0.0, 0.0);
    if !is_inside(tile, lane) {
        return;
    }
    let pixel = pixels[(tile.y * frame.columns + tile.x) * LANES + lane];
    open[lane] = vec4<f32>(1.0, pixel.behind);
    faces[lane] = vec4<f32>(pixel.fill, pixel.residual);
    rests[lane] = vec4<f32>(pixel.share, pixel.end, pixel.lacking, pixel.wronged);
    depths[lane] = vec2<f32>(pixel.depth, pixel.per_tolerance);
    wrong[lane] = pixel.wrong;
    atomicAdd(&n_open, 1u);
}

fn own_of(tile: vec2<u32>, entry: u32, end: u32) -> Own {
    var own: Own;
    own.slot = NONE;
    if entry < end {
        let rank = entries[entry];
        let place = places[rank];
        let at = tile - vec2<u32>(place.corner & 0xffffu, place.corner >> 16u);
        own.splat = splats[rank];
        own.slot = place.first + at.y * (place.size & 0xffffu) + at.x;
    }
    return own;
}

fn add_pixel(own: ptr<function, Own>, sums: ptr<function, Sums>, tile: vec2<u32>, i: u32) {
    let before = open[i];
    let front = before.x;
    if front <= 0.0 {
        return;
    }
    let offset = offset_of((*own).splat, tile, i);
    let seen = response((*own).splat, offset);
    if seen.exponent < (*own).splat.cut {
        return;
    }
    (*own).is_shown = true;
    let free = (*own).splat.opacity * exp2(seen.exponent);
    let alpha = min(free, ALPHA_CAP);
    let weight = alpha * front;
    let left = front - weight;
    if left < TRANSMITTANCE_STOP {
        open[i].x = -front;
        atomicSub(&n_open, 1u);
        return;
    }
    let face = faces[i];
    let rest = rests[i];
    let color = color_of((*own).splat, offset);
    let filled = face.x * weight;
    let behind = before.yzw - filled * color;
    open[i] = vec4<f32>(left, behind);
    // Derivative of the pixel's colour by alpha.
    let per_open = 1.0 / (1.0 - alpha);
    let change = face.x * front * color - behind * per_open;
    // Coverage is an extra channel in which every splat is 1 and the background is 0.
    let closing = rest.y * per_open;
    // Depth error is another extra channel, with target 0.
    let wrongness = wrongness_of((*own).splat, offset, depths[i].x, depths[i].y);
    let wrong_behind = wrong[i] - weight * wrongness;
    wrong[i] = wrong_behind;
    let wronging = front * wrongness - wrong_behind * per_open;
    let along = dot(change, face.yzw) + closing * rest.z - wronging * rest.w;
    let squared = dot(change, change) + frame.coverage * closing * closing
        + frame.depth * wronging * wronging;
    // `(A/w)^¾`: all splats of a pixel move at once, so exact blocks would overshoot.
    let root = sqrt(max(weight, MIN_WEIGHT));
    let share = rest.x / (root * sqrt(root));
    // While capped, alpha does not depend on position, shape or opacity.
    let moving = select(0.0, alpha, free <= ALPHA_CAP);
    let pull = filled * face.yzw;
    add_moments(sums, seen.at, along * moving, share * squared * moving * moving);
    add_color(sums, seen.at, pull, share * filled * filled);
    (*sums).weight += weight;
}

fn add_moments(sums: ptr<function, Sums>, at: vec2<f32>, slope: f32, bend: f32) {
    let p = at.x;
    let q = at.y;
    let pp = p * p;
    let pq = p * q;
    let qq = q * q;
    (*sums).slope += slope * vec4<f32>(1.0, p, q, pp);
    (*sums).slope_rest += slope * vec2<f32>(pq, qq);
    (*sums).bend += bend * vec4<f32>(1.0, p, q, pp);
    (*sums).bend_rest += bend * vec2<f32>(pq, qq);
    (*sums).bend_third += bend * vec4<f32>(pp * p, pp * q, p * qq, q * qq);
    (*sums).bend_fourth += bend * vec4<f32>(pp * pp, pp * pq, pp * qq, pq * qq);
    (*sums).bend_last += bend * (qq * qq);
}

fn add_color(sums: ptr<function, Sums>, at: vec2<f32>, pull: vec3<f32>, bend: f32) {
    let linear = vec3<f32>(1.0, at);
    (*sums).red += pull.x * linear;
    (*sums).green += pull.y * linear;
    (*sums).blue += pull.z * linear;
    (*sums).color_bend += bend * vec4<f32>(linear, at.x * at.x);
    (*sums).color_bend_rest += bend * vec2<f32>(at.x * at.y, at.y * at.y);
}

fn store(own: Own, sums: Sums) {
    if !own.is_shown {
        return;
    }
    shown[own.slot] = 1u;
    let to = own.slot * N_QUARTERS;
    partial_sums[to] = sums.slope;
    partial_sums[to + 1u] = vec4<f32>(sums.slope_rest, sums.bend.xy);
    partial_sums[to + 2u] = vec4<f32>(sums.bend.zw, sums.bend_rest);
    partial_sums[to + 3u] = sums.bend_third;
    partial_sums[to + 4u] = sums.bend_fourth;
    partial_sums[to + 5u] = vec4<f32>(sums.bend_last, sums.red);
    partial_sums[to + 6u] = vec4<f32>(sums.green, sums.blue.x);
    partial_sums[to + 7u] = vec4<f32>(sums.blue.yz, sums.color_bend.xy);
    partial_sums[to + 8u] = vec4<f32>(sums.color_bend.zw, sums.color_bend_rest);
    partial_sums[to + 9u] = vec4<f32>(sums.weight, 0.0, 0.0, 0.0);
}
