// Converts splats in depth order to entries, pairs of tile and splat. `count` and `offsets` compute where the
// entries of each block of 256 splats begin, and `emit` writes them in depth order. After the sort by
// tile, `ranges` finds the entries of each tile.

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read_write> counts: array<u32>;
// Sorted by depth: key and splat.
@group(0) @binding(2) var<storage, read> order: array<vec2<u32>>;
@group(0) @binding(3) var<storage, read> footprints: array<Footprint>;
// Per block of 256 splats: number of entries; after `offsets`, number of entries before the block.
@group(0) @binding(4) var<storage, read_write> blocks: array<u32>;
// Tile and splat.
@group(0) @binding(5) var<storage, read_write> entries: array<vec2<u32>>;
@group(0) @binding(6) var<storage, read> fews: array<u32>;
@group(0) @binding(7) var<storage, read> sorted: array<vec2<u32>>;
// Per tile: first entry and one past the last; zeros before `ranges`.
@group(0) @binding(8) var<storage, read_write> ends_of_tiles: array<vec2<u32>>;

const BLOCKS_PER_LANE: u32 = 16u;

// Inclusive prefix sum of the entries of this workgroup's splats.
var<workgroup> ends: array<u32, GROUP>;
var<workgroup> words: array<u32, GROUP>;
var<workgroup> splats: array<u32, GROUP>;

@compute @workgroup_size(GROUP)
fn count(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) n_groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let block = group.y * n_groups.x + group.x;
    let rank = block * GROUP + lane;
    var n_tiles = 0u;
    if rank < counts[N_VISIBLE] {
        n_tiles = n_tiles_at(order[rank].y);
    }
    let sum = inclusive_scan(lane, n_tiles);
    if lane == GROUP - 1u && block < arrayLength(&blocks) {
        blocks[block] = sum;
    }
}

// Runs as a single workgroup.
@compute @workgroup_size(GROUP)
fn offsets(@builtin(local_invocation_index) lane: u32) {
    let n_blocks = (counts[N_VISIBLE] + GROUP - 1u) / GROUP;
    var carried = 0u;
    for (var start = 0u; start < n_blocks; start += GROUP * BLOCKS_PER_LANE) {
        let first = start + lane * BLOCKS_PER_LANE;
        var sums: array<u32, BLOCKS_PER_LANE>;
        var sum = 0u;
        for (var i = 0u; i < BLOCKS_PER_LANE; i++) {
            sums[i] = sum;
            if first + i < n_blocks {
                sum = saturating_sum(sum, blocks[first + i]);
            }
        }
        let up_to = inclusive_scan(lane, sum);
        // After saturation the difference is meaningless, but then no more entries fit anyway.
        let before = select(saturating_sum(carried, up_to - sum), LARGEST, up_to == LARGEST);
        for (var i = 0u; i < BLOCKS_PER_LANE; i++) {
            if first + i < n_blocks {
                blocks[first + i] = saturating_sum(before, sums[i]);
            }
        }
        carried = saturating_sum(carried, scanned_total());
    }
    if lane == 0u {
        counts[N_NEEDED] = carried;
        counts[N_ENTRIES] = min(carried, arrayLength(&entries));
    }
}

@compute @workgroup_size(GROUP)
fn emit(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) n_groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let block = group.y * n_groups.x + group.x;
    let rank = block * GROUP + lane;
    var n_tiles = 0u;
    if rank < counts[N_VISIBLE] {
        let splat = order[rank].y;
        splats[lane] = splat;
        words[lane] = fews[splat];
        n_tiles = n_tiles_at(splat);
    }
    ends[lane] = inclusive_scan(lane, n_tiles);
    workgroupBarrier();
    let total = ends[GROUP - 1u];
    if total == 0u {
        return;
    }
    let base = blocks[block];
    let capacity = arrayLength(&entries);
    let room = capacity - min(base, capacity);
    let columns = (u32(view.viewport.x) + TILE - 1u) / TILE;
    // Neighbouring lanes write neighbouring entries, independent of the splats' sizes.
    for (var i = lane; i < min(total, room); i += GROUP) {
        let source = owner_of(i);
        var first = 0u;
        if source > 0u {
            first = ends[source - 1u];
        }
        let splat = splats[source];
        var tile: vec2<u32>;
        if words[source] != 0u {
            tile = few_tile_of(words[source], i - first);
        } else {
            tile = tile_of(footprints[splat], i - first);
        }
        entries[base + i] = vec2<u32>(tile.y * columns + tile.x, splat);
    }
}

fn n_tiles_at(splat: u32) -> u32 {
    let few = fews[splat];
    if few != 0u {
        return countOneBits(few >> FEW_SHIFT);
    }
    return n_tiles_of(footprints[splat]);
}

// First lane whose entries end after entry `i`.
fn owner_of(i: u32) -> u32 {
    var at = 0u;
    for (var step = GROUP / 2u; step > 0u; step >>= 1u) {
        if ends[at + step - 1u] <= i {
            at += step;
        }
    }
    return at;
}

@compute @workgroup_size(GROUP)
fn ranges(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) n_groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let n_entries = counts[N_ENTRIES];
    for (var i = group.x * GROUP + lane; i < n_entries; i += n_groups.x * GROUP) {
        let tile = sorted[i].x;
        if i == 0u || sorted[i - 1u].x != tile {
            ends_of_tiles[tile].x = i;
        }
        if i + 1u == n_entries || sorted[i + 1u].x != tile {
            ends_of_tiles[tile].y = i + 1u;
        }
    }
}
