// From splats in order of depth to entries, pairs of tile and splat: `count` and `offsets` say where
// the entries of 256 splats begin, `emit` writes them, still in order of depth, and after the sort
// by tile `ranges` finds the entries of each tile.

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read_write> counts: array<u32>;
@group(0) @binding(2) var<storage, read> order: array<u32>;
@group(0) @binding(3) var<storage, read> footprints: array<Footprint>;
// By 256 splats: their entries; after `offsets` the entries before them.
@group(0) @binding(4) var<storage, read_write> blocks: array<u32>;
@group(0) @binding(5) var<storage, read_write> entry_tiles: array<u32>;
@group(0) @binding(6) var<storage, read_write> entry_splats: array<u32>;
@group(0) @binding(7) var<storage, read> sorted_tiles: array<u32>;
// First entry of each tile, and at the end their number.
@group(0) @binding(8) var<storage, read_write> starts: array<u32>;

const BLOCKS_PER_LANE: u32 = 4u;

// Entries of this workgroup's splats up to and including each.
var<workgroup> ends: array<u32, GROUP>;
var<workgroup> prints: array<Footprint, GROUP>;
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
        n_tiles = n_tiles_of(footprints[order[rank]]);
    }
    let sum = inclusive_scan(lane, n_tiles);
    if lane == GROUP - 1u && block < arrayLength(&blocks) {
        blocks[block] = sum;
    }
}

// One workgroup.
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
        // Once saturated the difference means nothing, but then nothing more fits anyway.
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
        counts[N_ENTRIES] = min(carried, arrayLength(&entry_tiles));
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
        splats[lane] = order[rank];
        prints[lane] = footprints[splats[lane]];
        n_tiles = n_tiles_of(prints[lane]);
    }
    ends[lane] = inclusive_scan(lane, n_tiles);
    workgroupBarrier();
    let total = ends[GROUP - 1u];
    if total == 0u {
        return;
    }
    let base = blocks[block];
    let capacity = arrayLength(&entry_tiles);
    let room = capacity - min(base, capacity);
    let columns = (u32(view.viewport.x) + TILE - 1u) / TILE;
    // Neighbouring lanes write neighbouring entries, whatever the sizes of the splats.
    for (var i = lane; i < min(total, room); i += GROUP) {
        let source = owner_of(i);
        var first = 0u;
        if source > 0u {
            first = ends[source - 1u];
        }
        let tile = tile_of(prints[source], i - first);
        entry_tiles[base + i] = tile.y * columns + tile.x;
        entry_splats[base + i] = splats[source];
    }
}

// The first lane whose entries end after entry `i`.
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
    let n_tiles = arrayLength(&starts) - 1u;
    // One lane more than there are entries, for the tiles after the last.
    for (var i = group.x * GROUP + lane; i <= n_entries; i += n_groups.x * GROUP) {
        var low = 0u;
        if i > 0u {
            low = sorted_tiles[i - 1u] + 1u;
        }
        var high = n_tiles;
        if i < n_entries {
            high = sorted_tiles[i];
        }
        for (var tile = low; tile <= high; tile++) {
            starts[tile] = i;
        }
    }
}
