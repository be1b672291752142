// One lane per splat: computes its record, depth key and covered tiles.

@group(0) @binding(1) var<storage, read_write> counts: array<atomic<u32>>;
@group(0) @binding(2) var<storage, read> splats: array<Splat>;
// Depth keys; all ones for invisible splats.
@group(0) @binding(3) var<storage, read_write> keys: array<u32>;
@group(0) @binding(4) var<storage, read_write> records: array<Packed>;
@group(0) @binding(5) var<storage, read_write> footprints: array<Footprint>;
@group(0) @binding(6) var<storage, read> appearances: array<Appearance>;
@group(0) @binding(7) var<storage, read_write> gradients: array<PackedGradient>;
@group(0) @binding(8) var<storage, read_write> fews: array<u32>;

// True if there is one appearance per splat, false if the buffer is a placeholder.
override has_appearance: bool;

// Lanes that search the keys of a workgroup, and keys per such lane.
const SEEKERS: u32 = 16u;
const SOUGHT: u32 = GROUP / SEEKERS;

var<workgroup> group_keys: array<u32, GROUP>;
var<workgroup> ranges: array<vec2<u32>, SEEKERS>;

@compute @workgroup_size(GROUP)
fn preprocess(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) n_groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let i = (group.y * n_groups.x + group.x) * GROUP + lane;
    var key = LARGEST;
    if i < atomicLoad(&counts[N_SPLATS]) {
        key = prepare(i);
    }
    note(lane, key);
}

// Writes all outputs of a splat and returns its key.
fn prepare(i: u32) -> u32 {
    let splat = splats[i];
    var drawn = draw(splat);
    let key = keep(i, drawn);
    if key == LARGEST {
        return key;
    }
    if has_appearance {
        let appearance = appearances[i];
        drawn.record.color = directional_color(splat, appearance, drawn.placed);
        gradients[i] = pack_gradient(gradient_of(appearance, drawn));
    }
    records[i] = pack(drawn.record);
    return key;
}

// Extends the range of keys by those of the workgroup. Every lane must call it.
fn note(lane: u32, key: u32) {
    group_keys[lane] = key;
    workgroupBarrier();
    // Reduced by a few lanes and then one, because atomics of all lanes on one word would be serialised.
    if lane < SEEKERS {
        var range = vec2<u32>(LARGEST, 0u);
        for (var k = 0u; k < SOUGHT; k++) {
            let other = group_keys[k * SEEKERS + lane];
            if other != LARGEST {
                range = vec2<u32>(min(range.x, other), max(range.y, other));
            }
        }
        ranges[lane] = range;
    }
    workgroupBarrier();
    if lane > 0u {
        return;
    }
    var range = ranges[0];
    for (var k = 1u; k < SEEKERS; k++) {
        range = vec2<u32>(min(range.x, ranges[k].x), max(range.y, ranges[k].y));
    }
    if range.x < atomicLoad(&counts[NEAREST]) {
        atomicMin(&counts[NEAREST], range.x);
    }
    if range.y > atomicLoad(&counts[FARTHEST]) {
        atomicMax(&counts[FARTHEST], range.y);
    }
}

// Writes key and covered tiles. Returns the key, all ones for an invisible splat.
fn keep(i: u32, drawn: Drawn) -> u32 {
    var key = LARGEST;
    if drawn.visible {
        let footprint = footprint_of(drawn);
        if n_tiles_of(footprint) > 0u {
            let few = few_of(footprint);
            fews[i] = few;
            if few == 0u {
                footprints[i] = footprint;
            }
            // Bits of positive floats compare as integers.
            key = bitcast<u32>(drawn.record.depth);
        }
    }
    keys[i] = key;
    return key;
}

fn footprint_of(drawn: Drawn) -> Footprint {
    // Pixels whose centres lie inside the box.
    let end = view.viewport - 1.0;
    let low = vec2<u32>(clamp(ceil(drawn.outline.low - 0.5), vec2<f32>(0.0), end)) / TILE;
    let high = vec2<u32>(clamp(floor(drawn.outline.high - 0.5), vec2<f32>(0.0), end)) / TILE;
    // A box without any pixel centre is inverted.
    let size = max(high + 1u, low) - low;
    var out: Footprint;
    out.low = low.x | (low.y << 16u);
    out.size = size.x | (size.y << 16u);
    let n_tiles = size.x * size.y;
    if n_tiles <= 1u {
        out.mask_low = n_tiles;
        return out;
    }
    if n_tiles > MASKED_TILES {
        return out;
    }
    let reach = reach_from(drawn.record.conic, drawn.record.reach);
    for (var j = 0u; j < n_tiles; j++) {
        let tile = low + vec2<u32>(j % size.x, j / size.x);
        let first = vec2<f32>(tile * TILE) + 0.5;
        let last = min(first + f32(TILE - 1u), view.viewport - 0.5);
        if touches(reach, first, last) {
            if j < 32u {
                out.mask_low |= 1u << j;
            } else {
                out.mask_high |= 1u << (j - 32u);
            }
        }
    }
    return out;
}
