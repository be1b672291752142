// Sorts means into the cells of their grid (`train.md`, On a device), a counting sort in five kernels: means
// that have moved are replaced, cells counted, counts summed up in two steps, means put in their places.
// Atomics leave the order within a cell open, on which no result depends: candidates are told apart by
// distance and component.

struct Index {
    // Lower corner of the grid.
    lo: vec3<f32>,
    per_unit: f32,
    // Cells along each axis.
    dims: vec3<i32>,
    n_means: u32,
    n_moved: u32,
    // Cells, and one for the end of the last.
    n_starts: u32,
}

// Bits, since nothing here may round; of a mean that has moved also its component.
struct Mean {
    position: vec3<u32>,
    weight: u32,
    color: vec3<u32>,
    id: u32,
}

@group(0) @binding(0) var<uniform> index: Index;
@group(0) @binding(1) var<storage, read> moved: array<Mean>;
// By component.
@group(0) @binding(2) var<storage, read_write> components: array<Mean>;
// Counts of cells, then where each cell starts.
@group(0) @binding(3) var<storage, read_write> starts: array<atomic<u32>>;
// By component its place within its cell.
@group(0) @binding(4) var<storage, read_write> places: array<u32>;
// By strip of cells its means.
@group(0) @binding(5) var<storage, read_write> strips: array<u32>;
// What the pass reads: bits of the position and component, then colour and weight.
@group(0) @binding(6) var<storage, read_write> means: array<vec4<u32>>;
@group(0) @binding(7) var<storage, read_write> appearance: array<vec4<u32>>;

// Cells of a lane in a strip.
const LANE_CELLS: u32 = STRIP_CELLS / GROUP;

var<workgroup> partial: array<u32, GROUP>;

fn lane_of(group: vec3<u32>, n_groups: vec3<u32>, lane: u32) -> u32 {
    return (group.y * n_groups.x + group.x) * GROUP + lane;
}

fn cell_of(mean: Mean) -> u32 {
    let cell = cell_in(bitcast<vec3<f32>>(mean.position), index.lo, index.per_unit, index.dims);
    return u32((cell.z * index.dims.y + cell.y) * index.dims.x + cell.x);
}

// The sum of a value of each lane.
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
    // What follows writes there anew.
    workgroupBarrier();
    return sum;
}

// The sum of a value of each lane up to this one.
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
