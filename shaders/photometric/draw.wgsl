// First walk: one workgroup per tile, one lane per chosen pixel. Draws the tile's splats front to back and
// compares the pixel with the photograph.

// Measured pixel.
struct Measured {
    // Colour over black.
    red: f32,
    green: f32,
    blue: f32,
    // Bits of the coverage; NaN if unknown.
    coverage: u32,
    depth: f32,
    // 0 if depth is unknown.
    per_tolerance: f32,
}

// Only the chosen rows.
@group(0) @binding(4) var<storage, read> photograph: array<Measured>;
@group(0) @binding(5) var<storage, read_write> pixels: array<Pixel>;
// Per tile: squared error over covered pixels, and their number.
@group(0) @binding(6) var<storage, read_write> errors: array<vec2<f32>>;

const ONE_BITS: u32 = 0x3f800000u;
// Splats loaded into workgroup memory at a time.
const BATCH: u32 = 128u;

var<workgroup> staged: array<Splat, BATCH>;
var<workgroup> sums: array<vec2<f32>, GROUP>;
// Number of batches completed with some pixel unfinished.
var<workgroup> last_live: atomic<u32>;

struct Drawn {
    color: vec3<f32>,
    // Negative if the pixel is finished or outside the image.
    transmittance: f32,
    wrong: f32,
}

@compute @workgroup_size(LANES)
fn draw(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let tile = group.xy;
    let range = entries_of(tile);
    let step = min(LANES, BATCH);
    let is_inside = is_inside(tile, lane);
    var drawn = Drawn(vec3<f32>(0.0), select(-1.0, 1.0, is_inside), 0.0);
    var measured: Measured;
    if range.x < range.y && is_inside {
        measured = measured_at(tile, lane);
    }
    if lane == 0u {
        atomicStore(&last_live, 0u);
    }
    var batch = 0u;
    for (var start = range.x; start < range.y; start += step) {
        if workgroupUniformLoad(&last_live) < batch {
            break;
        }
        if lane < step && start + lane < range.y {
            staged[lane] = splats[entries[start + lane]];
        }
        workgroupBarrier();
        if drawn.transmittance > 0.0 {
            blend(&drawn, measured, tile, lane, min(step, range.y - start));
        }
        batch++;
        if drawn.transmittance > 0.0 {
            atomicStore(&last_live, batch);
        }
        // Finished lanes must not overwrite splats that other lanes still read.
        workgroupBarrier();
    }
    var error = vec2<f32>(0.0);
    if range.x < range.y && is_inside {
        error = compare(drawn, measured, tile, lane);
    }
    add_up(tile, lane, error);
}

fn measured_at(tile: vec2<u32>, lane: u32) -> Measured {
    let row = (tile.y * TILE + row_of(lane) - frame.first) / frame.every;
    return photograph[row * frame.size.x + tile.x * TILE + lane % TILE];
}

fn blend(
    drawn: ptr<function, Drawn>,
    measured: Measured,
    tile: vec2<u32>,
    lane: u32,
    n: u32,
) {
    for (var i = 0u; i < n; i++) {
        let splat = staged[i];
        let offset = offset_of(splat, tile, lane);
        let seen = response(splat, offset);
        if seen.exponent < splat.cut {
            continue;
        }
        let alpha = min(splat.opacity * exp2(seen.exponent), ALPHA_CAP);
        let weight = alpha * (*drawn).transmittance;
        let left = (*drawn).transmittance - weight;
        if left < TRANSMITTANCE_STOP {
            // The magnitude remains, because coverage needs it.
            (*drawn).transmittance = -(*drawn).transmittance;
            return;
        }
        (*drawn).color += weight * color_of(splat, offset);
        (*drawn).wrong +=
            weight * wrongness_of(splat, offset, measured.depth, measured.per_tolerance);
        (*drawn).transmittance = left;
    }
}

// Stores the pixel state of the second walk. Returns the squared error and 1 if the pixel counts, else 0.
fn compare(drawn: Drawn, measured: Measured, tile: vec2<u32>, lane: u32) -> vec2<f32> {
    let left = abs(drawn.transmittance);
    let covered = 1.0 - left;
    let fill = 1.0 / max(covered, frame.full_coverage);
    // Derivative of `1/A` in a filled pixel, times the final transmittance.
    let filled = select(0.0, left / max(covered * covered, 1e-12), covered > frame.full_coverage);
    let color = vec3<f32>(measured.red, measured.green, measured.blue);
    let residual = color - drawn.color * fill;
    let squared = dot(residual, residual);
    // Pixels that are left out have a coverage of -1: they count nothing and weigh nothing.
    let is_left_out = measured.coverage == 0xbf800000u;
    let rho = select(1.0 / (1.0 + squared * frame.per_tau), 0.0, is_left_out);
    var pixel: Pixel;
    pixel.behind = drawn.color * (fill + filled);
    pixel.fill = fill;
    pixel.residual = rho * residual;
    pixel.share = rho * sqrt(covered) * sqrt(sqrt(covered));
    // NaN is tested on bits, because shaders may assume that it does not occur.
    let is_unknown = (measured.coverage & 0x7fffffffu) > 0x7f800000u;
    // Without a known coverage, a mostly covered pixel is assumed to lie inside a surface.
    if !is_unknown || covered >= SEEN {
        let wanted = select(measured.coverage, ONE_BITS, is_unknown);
        pixel.end = left;
        pixel.lacking = rho * frame.coverage * (bitcast<f32>(wanted) - covered);
    }
    pixel.wrong = drawn.wrong;
    pixel.wronged = rho * frame.depth * drawn.wrong;
    pixel.depth = measured.depth;
    pixel.per_tolerance = measured.per_tolerance;
    pixels[(tile.y * frame.columns + tile.x) * LANES + lane] = pixel;
    // Pixels with little coverage carry no information about noise.
    let counts = covered >= SEEN && !is_left_out;
    return select(vec2<f32>(0.0), vec2<f32>(squared, 1.0), counts);
}

// Sums in a fixed order, for reproducible bits. Every lane must call it.
fn add_up(tile: vec2<u32>, lane: u32, error: vec2<f32>) {
    sums[lane] = error;
    workgroupBarrier();
    for (var half = LANES / 2u; half > 0u; half /= 2u) {
        if lane < half {
            sums[lane] += sums[lane + half];
        }
        workgroupBarrier();
    }
    if lane == 0u {
        errors[tile.y * frame.columns + tile.x] = sums[0];
    }
}
