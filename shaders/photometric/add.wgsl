// Adds the sums of each splat over its tiles: one lane per `vec4` of its sums.

@group(0) @binding(5) var<storage, read> shown: array<u32>;
@group(0) @binding(6) var<storage, read> partial_sums: array<vec4<f32>>;
// Per splat: `N_IMAGE_SUMS` values.
@group(0) @binding(7) var<storage, read_write> totals: array<f32>;

@compute @workgroup_size(GROUP)
fn add(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) n_groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let i = (group.y * n_groups.x + group.x) * GROUP + lane;
    let rank = i / N_QUARTERS;
    let quarter = i % N_QUARTERS;
    if rank >= frame.n_splats {
        return;
    }
    let place = places[rank];
    let end = place.first + (place.size & 0xffffu) * (place.size >> 16u);
    var sum = vec4<f32>(0.0);
    for (var slot = place.first; slot < end; slot++) {
        if shown[slot] != 0u {
            sum += partial_sums[slot * N_QUARTERS + quarter];
        }
    }
    let to = rank * N_IMAGE_SUMS + quarter * 4u;
    for (var k = 0u; k < min(4u, N_IMAGE_SUMS - quarter * 4u); k++) {
        totals[to + k] = sum[k];
    }
}
