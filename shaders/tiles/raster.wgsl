// Blends the splats of a tile front to back: one workgroup per tile, one lane per pixel. Splats are processed
// in batches of 256. Each block of 4×4 unfinished pixels visits only the splats that cover it, listed in
// bit masks that the lanes build together while loading.

// Per tile: first entry and one past the last.
@group(0) @binding(1) var<storage, read> ends_of_tiles: array<vec2<u32>>;
// Tile and splat.
@group(0) @binding(2) var<storage, read> entries: array<vec2<u32>>;
@group(0) @binding(3) var<storage, read> records: array<Packed>;
@group(0) @binding(4) var target_image: texture_storage_2d<rgba16float, write>;
@group(0) @binding(5) var<storage, read> gradients: array<PackedGradient>;
@group(0) @binding(6) var<storage, read> splats: array<Splat>;
@group(0) @binding(7) var<storage, read> appearances: array<Appearance>;
// Layout: see `src/render/gpu/textures.rs`.
@group(0) @binding(8) var<storage, read> textures: array<u32>;

// True if there is one gradient and one appearance per splat, false if the buffers are placeholders.
override has_appearance: bool;
// True if textures are drawn, false if their buffer is a placeholder.
override has_textures: bool;

// Half a warp of 32 lanes, which run together. They take as long as the longer of two lists, which is still
// shorter than one list for twice the pixels.
const BLOCK: vec2<u32> = vec2<u32>(4u, 4u);
const BLOCK_LANES: u32 = 16u;
const BLOCK_COLUMNS: u32 = TILE / 4u;
const N_BLOCKS: u32 = GROUP / BLOCK_LANES;
const N_WORDS: u32 = GROUP / 32u;

var<workgroup> anchors: array<vec4<f32>, GROUP>;
var<workgroup> factors: array<vec4<f32>, GROUP>;
var<workgroup> half_l_colors: array<vec4<f32>, GROUP>;
var<workgroup> blues: array<f32, GROUP>;
var<workgroup> sources: array<u32, GROUP>;
// Indexed by block, then by word of 32 splats. One list is read while the other is cleared.
var<workgroup> lists: array<array<atomic<u32>, N_BLOCKS * N_WORDS>, 2>;
// Number of batches completed with some pixel unfinished, for the tile and for each block.
var<workgroup> last_live: atomic<u32>;
var<workgroup> block_live: array<atomic<u32>, N_BLOCKS>;

struct Pixel {
    at: vec2<u32>,
    sight: vec3<f32>,
    color: vec3<f32>,
    transmittance: f32,
    is_live: bool,
    // The two largest weights, largest first, and their splats; only if textures are drawn.
    weights: vec2<f32>,
    owners: vec2<u32>,
}

// Texture at one place.
struct Sample {
    // Colour of the surface times the share.
    color: vec3<f32>,
    // Share of the drawn colour that the texture replaces.
    share: f32,
}

@compute @workgroup_size(GROUP)
fn raster(@builtin(workgroup_id) tile: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    var pixel = begin(tile.xy, lane);
    let range = range_of(tile.xy);
    var batch = 0u;
    for (var start = range.x; start < range.y; start += GROUP) {
        if workgroupUniformLoad(&last_live) < batch {
            break;
        }
        load(tile.xy, lane, vec2<u32>(start, range.y), batch);
        if pixel.is_live {
            blend(&pixel, lane / BLOCK_LANES, batch & 1u);
        }
        batch++;
        if pixel.is_live {
            atomicStore(&last_live, batch);
            atomicStore(&block_live[lane / BLOCK_LANES], batch);
        }
    }
    finish(pixel);
}

fn begin(tile: vec2<u32>, lane: u32) -> Pixel {
    if lane < N_BLOCKS * N_WORDS {
        atomicStore(&lists[0][lane], 0u);
    }
    if lane < N_BLOCKS {
        atomicStore(&block_live[lane], 0u);
    }
    if lane == 0u {
        atomicStore(&last_live, 0u);
    }
    let in_block = lane % BLOCK_LANES;
    var out: Pixel;
    out.at = tile * TILE + corner_of(lane / BLOCK_LANES) + vec2<u32>(in_block % BLOCK.x, in_block / BLOCK.x);
    let sight = sight_of(vec2<f32>(out.at) + 0.5);
    out.sight = sight.xyz;
    out.transmittance = 1.0;
    out.is_live = sight.w > 0.0 && all(vec2<f32>(out.at) < view.viewport);
    return out;
}

fn finish(pixel: Pixel) {
    if all(vec2<f32>(pixel.at) < view.viewport) {
        var color = pixel.color;
        if has_textures {
            color = textured(pixel);
        }
        textureStore(target_image, pixel.at, vec4<f32>(color, 1.0 - pixel.transmittance));
    }
}

fn range_of(tile: vec2<u32>) -> vec2<u32> {
    let i = tile.y * ((u32(view.viewport.x) + TILE - 1u) / TILE) + tile.x;
    return ends_of_tiles[i];
}

fn corner_of(block: u32) -> vec2<u32> {
    return vec2<u32>(block % BLOCK_COLUMNS, block / BLOCK_COLUMNS) * BLOCK;
}

// Loads the first 256 splats of a range and lists them by block. Every lane must call it.
fn load(tile: vec2<u32>, lane: u32, range: vec2<u32>, batch: u32) {
    let side = batch & 1u;
    if range.x + lane < range.y {
        let source = entries[range.x + lane].y;
        let packed = records[source];
        anchors[lane] = packed.anchor;
        factors[lane] = packed.factor;
        half_l_colors[lane] = packed.half_l_color;
        blues[lane] = packed.blue_reach.x;
        sources[lane] = source;
        let reach = reach_from(conic_from(packed), packed.blue_reach.y);
        for (var block = 0u; block < N_BLOCKS; block++) {
            let low = vec2<f32>(tile * TILE + corner_of(block)) + 0.5;
            let is_live = atomicLoad(&block_live[block]) == batch;
            if is_live && touches(reach, low, low + vec2<f32>(BLOCK - 1u)) {
                atomicOr(&lists[side][block * N_WORDS + lane / 32u], 1u << (lane % 32u));
            }
        }
    }
    workgroupBarrier();
    if lane < N_BLOCKS * N_WORDS {
        atomicStore(&lists[1u - side][lane], 0u);
    }
}

fn blend(pixel: ptr<function, Pixel>, block: u32, side: u32) {
    for (var word = 0u; word < N_WORDS; word++) {
        var bits = atomicLoad(&lists[side][block * N_WORDS + word]);
        while bits != 0u {
            let i = word * 32u + firstTrailingBit(bits);
            bits &= bits - 1u;
            let seen = response(conic_at(i), (*pixel).sight);
            let alpha = alpha_of(seen, factors[i].w);
            if alpha >= ALPHA_CUT {
                var color = vec3<f32>(half_l_colors[i].zw, blues[i]);
                if has_appearance {
                    color = color_of(seen, color, gradient_from(gradients[sources[i]]));
                }
                let weight = alpha * (*pixel).transmittance;
                if !add(pixel, alpha, color) {
                    return;
                }
                if has_textures {
                    offer(pixel, weight, sources[i]);
                }
            }
        }
    }
}

// Blends a splat. Returns false, without blending, if it would take the transmittance below the stop.
fn add(pixel: ptr<function, Pixel>, alpha: f32, color: vec3<f32>) -> bool {
    let left = (*pixel).transmittance * (1.0 - alpha);
    if left < TRANSMITTANCE_STOP {
        (*pixel).is_live = false;
        return false;
    }
    (*pixel).color += color * (alpha * (*pixel).transmittance);
    (*pixel).transmittance = left;
    return true;
}

fn conic_at(i: u32) -> Conic {
    return Conic(anchors[i].xyz, anchors[i].w, factors[i].xyz, half_l_colors[i].xy);
}

// -------------------------------------------------------------------------------------------------
// Textures

// Keeps the splat if its weight is among the two largest.
fn offer(pixel: ptr<function, Pixel>, weight: f32, splat: u32) {
    let weights = (*pixel).weights;
    if weight <= weights.y {
        return;
    }
    if weight >= weights.x {
        (*pixel).weights = vec2<f32>(weight, weights.x);
        (*pixel).owners = vec2<u32>(splat, (*pixel).owners.x);
    } else {
        (*pixel).weights.y = weight;
        (*pixel).owners.y = splat;
    }
}

// Premultiplied colour with the textures of the pixel's owners.
fn textured(pixel: Pixel) -> vec3<f32> {
    var seen = pixel.sight;
    if view.lens != LENS_FISHEYE {
        seen = vec3<f32>((pixel.sight.xy - view.principal) / view.focal, 1.0);
    }
    let ray = view.right * seen.x + view.down * seen.y + view.forward * seen.z;
    let drawn = pixel.color / max(1.0 - pixel.transmittance, 1e-30);
    var color = pixel.color;
    for (var i = 0u; i < 2u; i++) {
        // Weight and number are 0 without an owner.
        if pixel.weights[i] > 0.0 {
            color += pixel.weights[i] * correction(pixel.owners[i], ray, drawn);
        }
    }
    return max(color, vec3<f32>(0.0));
}

// Change of the colour `drawn` by a splat's texture where a ray, in world axes, meets the splat's plane.
fn correction(id: u32, ray: vec3<f32>, drawn: vec3<f32>) -> vec3<f32> {
    if id >= textures[0] {
        return vec3<f32>(0.0);
    }
    let at = textures[1u + id];
    let splat = splats[id];
    // A marked splat keeps its colour.
    if at == 0u || all(splat.color == MARK) {
        return vec3<f32>(0.0);
    }
    // Subtracting the camera first preserves f32 precision far from the world origin.
    let to_mean = (splat.mean - view.centre) - view.centre_rest;
    let normal = normal_of(splat);
    let distance = dot(normal, to_mean);
    let facing = dot(normal, ray);
    // Negated, so that NaN counts as grazing.
    if !(sign(distance) * facing >= MIN_COSINE * length(ray)) {
        return vec3<f32>(0.0);
    }
    let to_anchor = (vector_at(at) - view.centre) - view.centre_rest;
    let from_anchor = ray * (distance / facing) - to_anchor;
    let along = vec2<f32>(dot(vector_at(at + 3u), from_anchor), dot(vector_at(at + 6u), from_anchor));
    let side = textures[at + 10u];
    let sample = sample_of(at, side, along * bitcast<f32>(textures[at + 9u]) + 0.5 * f32(side));
    var shift = vec3<f32>(0.0);
    if has_appearance {
        shift = directional_shift(splat, appearances[id], normalize(to_mean));
    }
    return sample.color - sample.share * (drawn - shift);
}

fn vector_at(at: u32) -> vec3<f32> {
    return bitcast<vec3<f32>>(vec3<u32>(textures[at], textures[at + 1u], textures[at + 2u]));
}

// Texture at a place in texels from the lattice's corner, bilinearly interpolated; the share is 0 outside.
fn sample_of(at: u32, side: u32, place: vec2<f32>) -> Sample {
    var out: Sample;
    if !(all(place >= vec2<f32>(0.0)) && all(place <= vec2<f32>(f32(side)))) {
        return out;
    }
    let from_first = max(place - 0.5, vec2<f32>(0.0));
    let low = min(vec2<u32>(from_first), vec2<u32>(side - 1u));
    let high = min(low + 1u, vec2<u32>(side - 1u));
    let part = min(from_first - vec2<f32>(low), vec2<f32>(1.0));
    let rest = 1.0 - part;
    add_texel(&out, texel_at(at, side, low), rest.x * rest.y);
    add_texel(&out, texel_at(at, side, vec2<u32>(high.x, low.y)), part.x * rest.y);
    add_texel(&out, texel_at(at, side, vec2<u32>(low.x, high.y)), rest.x * part.y);
    add_texel(&out, texel_at(at, side, high), part.x * part.y);
    return out;
}

// Bits of a texel; 0 in a patch without texels.
fn texel_at(at: u32, side: u32, texel: vec2<u32>) -> u32 {
    let patch_at = texel / PATCH;
    let first = textures[at + LATTICE_WORDS + patch_at.y * (side / PATCH) + patch_at.x];
    if first == 0u {
        return 0u;
    }
    let within = texel % PATCH;
    return textures[at + first + within.y * PATCH + within.x];
}

// From the lowest bit three colour channels, then the share.
fn add_texel(sample: ptr<function, Sample>, bits: u32, part: f32) {
    let channels = vec3<u32>(bits, bits >> CHANNEL_BITS, bits >> (2u * CHANNEL_BITS));
    let color = vec3<f32>(channels & vec3<u32>(CHANNEL_MAX)) / f32(COLOR_ONE);
    let share = part * f32(bits >> (3u * CHANNEL_BITS)) / f32(SHARE_ONE);
    (*sample).color += share * color;
    (*sample).share += share;
}
