// Stable radix sort of u32 keys with u32 values, one digit of up to 8 bits a pass: `histogram`, then
// `spine`, then `scatter`. The grid is fixed and every workgroup takes one strip of neighbouring
// keys, as long as the count (known to the GPU only) makes it, so no size comes from the CPU.
// No subgroups: a lane finds the equal digits before it in bit masks that all lanes set together.

struct Digit {
    shift: u32,
    n_values: u32,              // a power of two, at most GROUP
    source: u32,                // slot of `counts`: keys there are
    // Not 0 in the first pass over keys without values: the value of a key is its place, keys of
    // all ones are dropped, and `counts[sink]` gets how many are left.
    is_first: u32,
    sink: u32,
}

@group(0) @binding(0) var<uniform> digit: Digit;
@group(0) @binding(1) var<storage, read_write> counts: array<u32>;
@group(0) @binding(2) var<storage, read> keys_in: array<u32>;
@group(0) @binding(3) var<storage, read> values_in: array<u32>;
@group(0) @binding(4) var<storage, read_write> keys_out: array<u32>;
@group(0) @binding(5) var<storage, read_write> values_out: array<u32>;
// By digit, then by strip: how many keys; after `spine` how many in the strips before.
@group(0) @binding(6) var<storage, read_write> strips: array<u32>;
@group(0) @binding(7) var<storage, read_write> totals: array<u32>;

// N_STRIPS are the workgroups of `histogram` and `scatter`.
const STRIPS_PER_LANE: u32 = N_STRIPS / GROUP;
// Words of one bit a lane.
const N_WORDS: u32 = GROUP / 32u;

var<workgroup> tally: array<atomic<u32>, GROUP>;
// By word, then by digit, so that lanes with different digits meet different banks.
var<workgroup> masks: array<atomic<u32>, N_WORDS * GROUP>;
// Where the next key of each digit goes.
var<workgroup> places: array<u32, GROUP>;
var<workgroup> n_keys: u32;

@compute @workgroup_size(GROUP)
fn histogram(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    atomicStore(&tally[lane], 0u);
    let strip = strip_of(group.x, load_count(lane));
    if strip.x >= strip.y {
        return;
    }
    for (var i = strip.x + lane; i < strip.y; i += GROUP) {
        let key = keys_in[i];
        if is_kept(key) {
            atomicAdd(&tally[digit_of(key)], 1u);
        }
    }
    workgroupBarrier();
    if lane < digit.n_values {
        strips[lane * N_STRIPS + group.x] = atomicLoad(&tally[lane]);
    }
}

// One workgroup a digit.
@compute @workgroup_size(GROUP)
fn spine(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let count = load_count(lane);
    let length = strip_length(count);
    let first = lane * STRIPS_PER_LANE;
    var sums: array<u32, STRIPS_PER_LANE>;
    var sum = 0u;
    for (var i = 0u; i < STRIPS_PER_LANE; i++) {
        sums[i] = sum;
        // Strips without keys were not written.
        if (first + i) * length < count {
            sum += strips[group.x * N_STRIPS + first + i];
        }
    }
    let before = inclusive_scan(lane, sum) - sum;
    for (var i = 0u; i < STRIPS_PER_LANE; i++) {
        strips[group.x * N_STRIPS + first + i] = before + sums[i];
    }
    if lane == GROUP - 1u {
        totals[group.x] = before + sum;
    }
}

@compute @workgroup_size(GROUP)
fn scatter(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let strip = strip_of(group.x, load_count(lane));
    if strip.x >= strip.y && group.x > 0u {
        return;
    }
    var total = 0u;
    if lane < digit.n_values {
        total = totals[lane];
    }
    let up_to = inclusive_scan(lane, total);
    if digit.is_first != 0u && group.x == 0u && lane == GROUP - 1u {
        counts[digit.sink] = up_to;
    }
    if lane < digit.n_values {
        places[lane] = up_to - total + strips[lane * N_STRIPS + group.x];
    }
    for (var word = 0u; word < N_WORDS; word++) {
        atomicStore(&masks[word * GROUP + lane], 0u);
    }
    workgroupBarrier();

    // The next key is on its way while this one is placed.
    var coming = fetch(strip.x + lane, strip.y);
    for (var start = strip.x; start < strip.y; start += GROUP) {
        let pair = coming;
        coming = fetch(start + GROUP + lane, strip.y);
        place(lane, pair, start + lane < strip.y && is_kept(pair.x));
    }
}

// Moves the keys of one row of lanes behind the earlier ones of their digits. Every lane must call it.
fn place(lane: u32, pair: vec2<u32>, is_there: bool) {
    let value = digit_of(pair.x);
    let own_word = lane / 32u;
    let own_bit = 1u << (lane % 32u);
    if is_there {
        atomicOr(&masks[own_word * GROUP + value], own_bit);
    }
    workgroupBarrier();
    var n_before = 0u;
    var n_equal = 0u;
    if is_there {
        for (var word = 0u; word < N_WORDS; word++) {
            let mask = atomicLoad(&masks[word * GROUP + value]);
            n_equal += countOneBits(mask);
            let earlier = select(select(0u, LARGEST, word < own_word), own_bit - 1u, word == own_word);
            n_before += countOneBits(mask & earlier);
        }
        let to = places[value] + n_before;
        keys_out[to] = pair.x;
        values_out[to] = pair.y;
    }
    workgroupBarrier();
    if is_there {
        atomicStore(&masks[own_word * GROUP + value], 0u);
        if n_before + 1u == n_equal {
            places[value] += n_equal;
        }
    }
    workgroupBarrier();
}

fn fetch(i: u32, end: u32) -> vec2<u32> {
    if i >= end {
        return vec2<u32>(0u);
    }
    if digit.is_first != 0u {
        return vec2<u32>(keys_in[i], i);
    }
    return vec2<u32>(keys_in[i], values_in[i]);
}

fn load_count(lane: u32) -> u32 {
    if lane == 0u {
        n_keys = counts[digit.source];
    }
    return workgroupUniformLoad(&n_keys);
}

// First key of a strip and the one after its last; no keys where the first is not before the other.
fn strip_of(group: u32, count: u32) -> vec2<u32> {
    let length = strip_length(count);
    return vec2<u32>(group * length, min((group + 1u) * length, count));
}

// Whole rows of lanes; 0 when there are no keys.
fn strip_length(count: u32) -> u32 {
    return (count + (N_STRIPS * GROUP - 1u)) / (N_STRIPS * GROUP) * GROUP;
}

fn digit_of(key: u32) -> u32 {
    return (key >> digit.shift) & (digit.n_values - 1u);
}

fn is_kept(key: u32) -> bool {
    return digit.is_first == 0u || key != LARGEST;
}
