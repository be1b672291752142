// Sums of the points of every slot: a workgroup processes SUM_GROUP points, with one lane per sum. Points
// arrive in tiles, so neighbours mostly share a slot, and a lane adds them up before one atomic addition.
// Integer quanta wrap around and give the same sum in any order.

// Per point: its slot and the bits of its shift.
@group(0) @binding(2) var<storage, read> fits: array<vec2<u32>>;
// Per slot: the seed that its sums are relative to.
@group(0) @binding(3) var<storage, read> references: array<vec4<f32>>;
// Per slot: its sums.
@group(0) @binding(4) var<storage, read_write> sums: array<atomic<i32>>;

// Per point: 1, offset, colour, normal and direction.
const N_NUMBERS: u32 = 13u;

var<workgroup> numbers: array<f32, SUM_GROUP * N_NUMBERS>;
var<workgroup> slots: array<u32, SUM_GROUP>;

fn put(at: u32, vector: vec3<f32>) {
    numbers[at] = vector.x;
    numbers[at + 1u] = vector.y;
    numbers[at + 2u] = vector.z;
}

fn load(i: u32, lane: u32) {
    let fit = fits[i];
    slots[lane] = fit.x;
    if fit.x == NO_SEED {
        return;
    }
    let point = points[i];
    let seed = references[fit.x].xyz;
    let shift = vec3<f32>(bitcast<f32>(fit.y));
    let offset = (point.position - seed) + product3(shift, point.direction);
    let most = vec3<f32>(MAX_OFFSET);
    let at = lane * N_NUMBERS;
    numbers[at] = 1.0;
    put(at + 1u, clamp(product3(offset, vec3<f32>(settings.per_h)), -most, most));
    put(at + 4u, min(product3(point.color, settings.gain), vec3<f32>(1.0)));
    put(at + 7u, point.normal);
    put(at + 10u, point.direction);
}

// Term of a point in integer quanta, ties rounded to even.
fn quanta(at: u32, factors: vec2<u32>) -> i32 {
    let term = product(settings.weight, product(numbers[at + factors.x], numbers[at + factors.y]));
    return i32(round(term * QUANTA));
}

fn add(slot: u32, lane: u32, sum: i32) {
    if slot != NO_SEED && lane < N_SUMS {
        atomicAdd(&sums[slot * N_SUMS + lane], sum);
    }
}

@compute @workgroup_size(SUM_GROUP)
fn sum(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) n_groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let i = (group.y * n_groups.x + group.x) * SUM_GROUP + lane;
    slots[lane] = NO_SEED;
    if i < settings.n_points {
        load(i, lane);
    }
    workgroupBarrier();
    var all_factors = TERM_FACTORS;
    let factors = all_factors[min(lane, N_SUMS - 1u)];
    var current = NO_SEED;
    var sum = 0;
    for (var other = 0u; other < SUM_GROUP; other++) {
        let slot = slots[other];
        if slot != current {
            add(current, lane, sum);
            current = slot;
            sum = 0;
        }
        if slot != NO_SEED {
            sum += quanta(other * N_NUMBERS, factors);
        }
    }
    add(current, lane, sum);
}
