// Sparse update: record i of the list replaces the splat that it names.

@group(0) @binding(0) var<storage, read> changed: array<SparseSplat>;
@group(0) @binding(1) var<storage, read_write> splats: array<Splat>;

// `GROUP` in scatter.rs.
const GROUP: u32 = 64u;

@compute @workgroup_size(GROUP)
fn scatter(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) n_groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    // Two dimensions of groups, because one holds 65,535.
    let i = (group.y * n_groups.x + group.x) * GROUP + lane;
    if i < arrayLength(&changed) {
        splats[changed[i].index] = changed[i].splat;
    }
}
