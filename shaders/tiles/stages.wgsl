// Common to the stages of the tile path: maximum of u32, and the prefix sum of a workgroup.

const LARGEST: u32 = 0xffffffffu;

// Two halves, one read and one written per step, so that each step needs one barrier.
var<workgroup> partial_sums: array<u32, 2u * GROUP>;

// The number of entries may exceed u32, for example with 10⁷ splats on 10³ tiles each.
fn saturating_sum(a: u32, b: u32) -> u32 {
    let sum = a + b;
    return select(sum, LARGEST, sum < a);
}

// Inclusive prefix sum over the lanes, saturating. Every lane must call it.
fn inclusive_scan(lane: u32, value: u32) -> u32 {
    // Other lanes may still read the sums of the previous call.
    workgroupBarrier();
    var sum = value;
    var half = 0u;
    partial_sums[lane] = sum;
    for (var step = 1u; step < GROUP; step <<= 1u) {
        workgroupBarrier();
        if lane >= step {
            sum = saturating_sum(sum, partial_sums[half + lane - step]);
        }
        half = GROUP - half;
        partial_sums[half + lane] = sum;
    }
    workgroupBarrier();
    return sum;
}

// Total of the last `inclusive_scan`.
fn scanned_total() -> u32 {
    // The number of steps is even, so the result is in the half where it started.
    return partial_sums[GROUP - 1u];
}
