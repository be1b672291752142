// Sparse updates: writes each record of a list to its index.

@group(0) @binding(0) var<storage, read> changed: array<SparseSplat>;
@group(0) @binding(1) var<storage, read_write> splats: array<Splat>;

@group(0) @binding(0) var<storage, read> changed_appearances: array<SparseAppearance>;
@group(0) @binding(1) var<storage, read_write> appearances: array<Appearance>;

@compute @workgroup_size(SCATTER_GROUP)
fn scatter_splats(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) n_groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let i = record_of(group, n_groups, lane);
    if i < arrayLength(&changed) {
        splats[changed[i].index] = changed[i].splat;
    }
}

@compute @workgroup_size(SCATTER_GROUP)
fn scatter_appearances(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) n_groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let i = record_of(group, n_groups, lane);
    if i < arrayLength(&changed_appearances) {
        appearances[changed_appearances[i].index] = changed_appearances[i].appearance;
    }
}

// Two grid dimensions, because each is limited to 65,535 groups.
fn record_of(group: vec3<u32>, n_groups: vec3<u32>, lane: u32) -> u32 {
    return (group.y * n_groups.x + group.x) * SCATTER_GROUP + lane;
}
