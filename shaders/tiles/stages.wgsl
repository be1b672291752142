// What the stages of the tile path share: workgroups of one size, slots of the counts that never
// leave the GPU within a frame, and the running sum of a workgroup.

const LARGEST: u32 = 0xffffffffu;

// Two halves, of which one is read while the other is written: one barrier a step.
var<workgroup> partial_sums: array<u32, 2u * GROUP>;

// 10⁷ splats on 10³ tiles each are more than a u32 counts.
fn saturating_sum(a: u32, b: u32) -> u32 {
    let sum = a + b;
    return select(sum, LARGEST, sum < a);
}

// Sum of the values of all lanes up to and including this one. Every lane must call it.
fn inclusive_scan(lane: u32, value: u32) -> u32 {
    // A lane may still read the sums of the call before.
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

// After `inclusive_scan`: the sum of all lanes.
fn scanned_total() -> u32 {
    // An even number of steps ends in the half where it began.
    return partial_sums[GROUP - 1u];
}
