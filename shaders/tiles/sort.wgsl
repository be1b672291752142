// Stable radix sort of pairs of u32 key and u32 value. Each pass sorts a digit of up to 8 bits by the kernels
// `histogram`, `spine` and `scatter`. The grid is fixed: every workgroup takes one strip of consecutive keys,
// whose length depends on the count that only the GPU knows. Key and value are stored side by side, because
// scattering costs per location written rather than per word. Subgroups are not used: a lane finds equal
// digits before it in bit masks that all lanes set together.

struct Digit {
    shift: u32,
    n_values: u32,              // a power of two, at most GROUP
    source: u32,                // slot of `counts`: number of keys
    // Not 0 in the first pass over keys without values: the value of a key is its index, keys of all ones
    // are dropped, and `counts[sink]` receives the number of retained keys.
    is_first: u32,
    sink: u32,
    // For that pass: slots of the smallest and largest retained key, and the number of bits that the range
    // of keys is reduced to.
    least: u32,
    largest: u32,
    n_bits: u32,
}

@group(0) @binding(0) var<uniform> digit: Digit;
@group(0) @binding(1) var<storage, read_write> counts: array<u32>;
// Keys without values in such a first pass, otherwise pairs.
@group(0) @binding(2) var<storage, read> keys_in: array<u32>;
@group(0) @binding(3) var<storage, read_write> pairs_out: array<vec2<u32>>;
// Per digit and strip: number of keys; after `spine`, number of keys in preceding strips.
@group(0) @binding(4) var<storage, read_write> strips: array<u32>;
@group(0) @binding(5) var<storage, read_write> totals: array<u32>;

// `histogram` and `scatter` run N_STRIPS workgroups.
const STRIPS_PER_LANE: u32 = N_STRIPS / GROUP;
// Words that hold one bit per lane.
const N_WORDS: u32 = GROUP / 32u;

// Offset and shift that reduce keys without values to their number of bits.
struct Cut {
    least: u32,
    shift: u32,
}

var<workgroup> tally: array<atomic<u32>, GROUP>;
// Indexed by word, then by digit, so that lanes with different digits use different banks.
var<workgroup> masks: array<atomic<u32>, N_WORDS * GROUP>;
// Destination of the next key of each digit.
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
    let cut = load_cut();
    for (var i = strip.x + lane; i < strip.y; i += GROUP) {
        let key = keys_in[i * select(2u, 1u, digit.is_first != 0u)];
        if is_kept(key) {
            atomicAdd(&tally[digit_of(narrowed(key, cut))], 1u);
        }
    }
    workgroupBarrier();
    if lane < digit.n_values {
        strips[lane * N_STRIPS + group.x] = atomicLoad(&tally[lane]);
    }
}

// One workgroup per digit value.
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

    let cut = load_cut();
    // Prefetches the next key while the current one is placed.
    var coming = fetch(strip.x + lane, strip.y);
    for (var start = strip.x; start < strip.y; start += GROUP) {
        let pair = coming;
        coming = fetch(start + GROUP + lane, strip.y);
        let is_there = start + lane < strip.y && is_kept(pair.x);
        place(lane, vec2<u32>(narrowed(pair.x, cut), pair.y), is_there);
    }
}

// Stores one row of lanes after the earlier keys of their digits. Every lane must call it.
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
        pairs_out[places[value] + n_before] = pair;
    }
    workgroupBarrier();
    if is_there {
        // Clears only its own bit, so that no lane waits for others before setting the next one.
        atomicAnd(&masks[own_word * GROUP + value], ~own_bit);
        if n_before + 1u == n_equal {
            places[value] += n_equal;
        }
    }
}

fn fetch(i: u32, end: u32) -> vec2<u32> {
    if i >= end {
        return vec2<u32>(0u);
    }
    if digit.is_first != 0u {
        return vec2<u32>(keys_in[i], i);
    }
    return vec2<u32>(keys_in[2u * i], keys_in[2u * i + 1u]);
}

fn load_count(lane: u32) -> u32 {
    if lane == 0u {
        n_keys = counts[digit.source];
    }
    return workgroupUniformLoad(&n_keys);
}

fn load_cut() -> Cut {
    if digit.is_first == 0u {
        return Cut(0u, 0u);
    }
    let least = counts[digit.least];
    let n_used = 32u - countLeadingZeros(max(counts[digit.largest], least) - least);
    return Cut(least, max(n_used, digit.n_bits) - digit.n_bits);
}

// Reduces a key while preserving order. Keys that differ only in dropped bits become equal.
fn narrowed(key: u32, cut: Cut) -> u32 {
    return (key - cut.least) >> cut.shift;
}

// First key of a strip and one past its last; empty if the first is not smaller.
fn strip_of(group: u32, count: u32) -> vec2<u32> {
    let length = strip_length(count);
    return vec2<u32>(group * length, min((group + 1u) * length, count));
}

// Keys per strip, a multiple of GROUP; 0 if there are no keys.
fn strip_length(count: u32) -> u32 {
    return (count + (N_STRIPS * GROUP - 1u)) / (N_STRIPS * GROUP) * GROUP;
}

fn digit_of(key: u32) -> u32 {
    return (key >> digit.shift) & (digit.n_values - 1u);
}

fn is_kept(key: u32) -> bool {
    return digit.is_first == 0u || key != LARGEST;
}
