// Hash grid of seeds with cells as wide as the structural scale, used both for insertion and for search. The
// seeds of a bucket form a linked list whose order differs between runs. Results do not depend on it,
// because ties go to the older seed.

// Position and link. Links are seed indices plus 1; 0 ends the list.
struct Seed {
    position: vec3<f32>,
    next: u32,
}

fn lane_of(group: vec3<u32>, n_groups: vec3<u32>, lane: u32) -> u32 {
    return (group.y * n_groups.x + group.x) * GROUP + lane;
}

// Monotonic rounding, identical for seeds and queries: the range of cells of a range of positions contains
// all of its seeds.
fn cell_of(position: vec3<f32>) -> vec3<i32> {
    return vec3<i32>(floor(product3(position, vec3<f32>(settings.per_cell))));
}

fn bucket(cell: vec3<i32>) -> u32 {
    let c = bitcast<vec3<u32>>(cell) * vec3<u32>(0x9e3779b1u, 0x85ebca77u, 0xc2b2ae3du);
    let mixed = c.x ^ (c.y << 11u | c.y >> 21u) ^ (c.z << 21u | c.z >> 11u);
    return ((mixed ^ (mixed >> 15u)) * 0x2c1b3c6du >> 4u) & settings.bucket_mask;
}
