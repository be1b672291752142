// Inserts new seeds into the hash grid.

@group(0) @binding(2) var<storage, read_write> seeds: array<Seed>;
// Per bucket: its first seed plus 1.
@group(0) @binding(3) var<storage, read_write> heads: array<atomic<u32>>;

@compute @workgroup_size(GROUP)
fn file(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) n_groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let seed = settings.first_seed + lane_of(group, n_groups, lane);
    if seed < settings.n_seeds {
        let at = bucket(cell_of(seeds[seed].position));
        seeds[seed].next = atomicExchange(&heads[at], seed + 1u);
    }
}
