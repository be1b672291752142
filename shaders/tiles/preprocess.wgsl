// One lane a splat: its record, its key of depth, and the tiles it reaches.

@group(0) @binding(1) var<storage, read> counts: array<u32>;
@group(0) @binding(2) var<storage, read> splats: array<Splat>;
// All ones where nothing is drawn.
@group(0) @binding(3) var<storage, read_write> keys: array<u32>;
@group(0) @binding(4) var<storage, read_write> records: array<Packed>;
@group(0) @binding(5) var<storage, read_write> footprints: array<Footprint>;
@group(0) @binding(6) var<storage, read> appearances: array<Appearance>;
@group(0) @binding(7) var<storage, read_write> gradients: array<PackedGradient>;

// Whether there is one appearance a splat, and not a single one that nobody reads.
override has_appearance: bool;

@compute @workgroup_size(GROUP)
fn preprocess(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) n_groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let i = (group.y * n_groups.x + group.x) * GROUP + lane;
    if i >= counts[N_SPLATS] {
        return;
    }
    let splat = splats[i];
    var drawn = draw(splat);
    if !keep(i, drawn) {
        return;
    }
    if has_appearance {
        let appearance = appearances[i];
        drawn.record.color = directional_color(splat, appearance, drawn.placed);
        gradients[i] = pack_gradient(gradient_of(appearance, drawn));
    }
    records[i] = pack(drawn.record);
}

// Writes key and footprint; whether there is anything to draw.
fn keep(i: u32, drawn: Drawn) -> bool {
    var key = LARGEST;
    if drawn.visible {
        let footprint = footprint_of(drawn);
        if n_tiles_of(footprint) > 0u {
            footprints[i] = footprint;
            // Bits of positive floats compare as integers.
            key = bitcast<u32>(drawn.record.depth);
        }
    }
    keys[i] = key;
    return key != LARGEST;
}

fn footprint_of(drawn: Drawn) -> Footprint {
    // Pixels whose centres are inside the box.
    let end = view.viewport - 1.0;
    let low = vec2<u32>(clamp(ceil(drawn.outline.low - 0.5), vec2<f32>(0.0), end)) / TILE;
    let high = vec2<u32>(clamp(floor(drawn.outline.high - 0.5), vec2<f32>(0.0), end)) / TILE;
    // Without any pixel centre the box is upside down.
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
    for (var j = 0u; j < n_tiles; j++) {
        let tile = low + vec2<u32>(j % size.x, j / size.x);
        let first = vec2<f32>(tile * TILE) + 0.5;
        let last = min(first + f32(TILE - 1u), view.viewport - 0.5);
        if touches(drawn.record.conic, drawn.record.reach, first, last) {
            if j < 32u {
                out.mask_low |= 1u << j;
            } else {
                out.mask_high |= 1u << (j - 32u);
            }
        }
    }
    return out;
}
