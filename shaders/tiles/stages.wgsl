// What the stages of the tile path share: workgroups of one size, slots of the counts that never
// leave the GPU within a frame, and the running sum of a workgroup.

const LARGEST: u32 = 0xffffffffu;

var<workgroup> partial_sums: array<u32, GROUP>;

// 10⁷ splats on 10³ tiles each are more than a u32 counts.
fn saturating_sum(a: u32, b: u32) -> u32 {
    let sum = a + b;
    return select(sum, LARGEST, sum < a);
}

// Sum of the values of all lanes up to and including this one. Every lane must call it.
fn inclusive_scan(lane: u32, value: u32) -> u32 {
    // A lane may still read the sums of the call before.
    workgroupBarrier();
    partial_sums[lane] = value;
    workgroupBarrier();
    for (var step = 1u; step < GROUP; step <<= 1u) {
        var before = 0u;
        if lane >= step {
            before = partial_sums[lane - step];
        }
        workgroupBarrier();
        partial_sums[lane] = saturating_sum(partial_sums[lane], before);
        workgroupBarrier();
    }
    return partial_sums[lane];
}

// After `inclusive_scan`: the sum of all lanes.
fn scanned_total() -> u32 {
    return partial_sums[GROUP - 1u];
}
