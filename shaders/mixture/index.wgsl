// Sorts means into grid cells (`training.md`, On a device) by a counting sort of five kernels: replace moved
// means, count cells, prefix sum in two steps, store means in order. Atomics leave the order within a
// cell undefined. No result depends on it, because candidates are ordered by distance and component.

struct Index {
    // Lower corner of the grid.
    lo: vec3<f32>,
    per_unit: f32,
    // Cells along each axis.
    dims: vec3<i32>,
    n_means: u32,
    n_moved: u32,
    // Number of cells plus one, for the end of the last cell.
    n_starts: u32,
}

// Values as bits, because nothing here may be rounded. `id` is the component, set for moved means.
struct Mean {
    position: vec3<u32>,
    weight: u32,
    color: vec3<u32>,
    id: u32,
}

@group(0) @binding(0) var<uniform> index: Index;
@group(0) @binding(1) var<storage, read> moved: array<Mean>;
// Indexed by component.
@group(0) @binding(2) var<storage, read_write> components: array<Mean>;
// Counts of cells, later the start of each cell.
@group(0) @binding(3) var<storage, read_write> starts: array<atomic<u32>>;
// Per component: index within its cell.
@group(0) @binding(4) var<storage, read_write> places: array<u32>;
// Per strip of cells: number of means.
@group(0) @binding(5) var<storage, read_write> strips: array<u32>;
// Input of the pass: bits of position and component, then colour and weight.
@group(0) @binding(6) var<storage, read_write> means: array<vec4<u32>>;
@group(0) @binding(7) var<storage, read_write> appearance: array<vec4<u32>>;

// Cells per lane in a strip.
const LANE_CELLS: u32 = STRIP_CELLS / GROUP;

var<workgroup> partial: array<u32, GROUP>;

fn lane_of(group: vec3<u32>, n_groups: vec3<u32>, lane: u32) -> u32 {
    return (group.y * n_groups.x + group.x) * GROUP + lane;
}

fn cell_of(mean: Mean) -> u32 {
    let cell = cell_in(bitcast<vec3<f32>>(mean.position), index.lo, index.per_unit, index.dims);
    return u32((cell.z * index.dims.y + cell.y) * index.dims.x + cell.x);
}

// Sum of `value` over all lanes.
fn summed(lane: u32, value: u32) -> u32 {
    partial[lane] = value;
    workgroupBarrier();
    for (var width = GROUP / 2u; width > 0u; width /= 2u) {
        if lane < width {
            partial[lane] += partial[lane + width];
        }
        workgroupBarrier();
    }
    let sum = partial[0];
    // Later calls overwrite `partial`.
    workgroupBarrier();
    return sum;
}

// Inclusive prefix sum of `value` over the lanes.
fn summed_up(lane: u32, value: u32) -> u32 {
    partial[lane] = value;
    workgroupBarrier();
    for (var step = 1u; step < GROUP; step *= 2u) {
        var before = 0u;
        if lane >= step {
            before = partial[lane - step];
        }
        workgroupBarrier();
        partial[lane] += before;
        workgroupBarrier();
    }
    return partial[lane];
}

@compute @workgroup_size(GROUP)
fn renew(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) n_groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let i = lane_of(group, n_groups, lane);
    if i < index.n_moved {
        let mean = moved[i];
        components[mean.id] = mean;
    }
}

@compute @workgroup_size(GROUP)
fn count(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) n_groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let id = lane_of(group, n_groups, lane);
    if id < index.n_means {
        places[id] = atomicAdd(&starts[cell_of(components[id])], 1u);
    }
}

@compute @workgroup_size(GROUP)
fn add(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let first = group.x * STRIP_CELLS;
    var own = 0u;
    for (var at = first + lane; at < min(first + STRIP_CELLS, index.n_starts); at += GROUP) {
        own += atomicLoad(&starts[at]);
    }
    let sum = summed(lane, own);
    if lane == 0u {
        strips[group.x] = sum;
    }
}

@compute @workgroup_size(GROUP)
fn scan(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    var before = 0u;
    for (var strip = lane; strip < group.x; strip += GROUP) {
        before += strips[strip];
    }
    before = summed(lane, before);
    let first = group.x * STRIP_CELLS + lane * LANE_CELLS;
    let end = min(first + LANE_CELLS, index.n_starts);
    var own = 0u;
    for (var at = first; at < end; at++) {
        own += atomicLoad(&starts[at]);
    }
    var next = before + summed_up(lane, own) - own;
    for (var at = first; at < end; at++) {
        let count = atomicLoad(&starts[at]);
        atomicStore(&starts[at], next);
        next += count;
    }
}

@compute @workgroup_size(GROUP)
fn place(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) n_groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let id = lane_of(group, n_groups, lane);
    if id < index.n_means {
        let mean = components[id];
        let entry = atomicLoad(&starts[cell_of(mean)]) + places[id];
        means[entry] = vec4<u32>(mean.position, id);
        appearance[entry] = vec4<u32>(mean.color, mean.weight);
    }
}
