// Seeds in a hash grid of cells as wide as the structural scale, for whoever files them and whoever looks them
// up. The seeds of a bucket are a chain, in an order that differs from run to run and alters nothing: equal
// distances go to the older seed.

// Where it is, and where the chain goes on. Seeds count from 1 in chains, and 0 ends them.
struct Seed {
    position: vec3<f32>,
    next: u32,
}

fn lane_of(group: vec3<u32>, n_groups: vec3<u32>, lane: u32) -> u32 {
    return (group.y * n_groups.x + group.x) * GROUP + lane;
}

// Rounds seeds and places alike, and never down what is farther along: a range of cells holds every seed of a
// range of places.
fn cell_of(position: vec3<f32>) -> vec3<i32> {
    return vec3<i32>(floor(product3(position, vec3<f32>(settings.per_cell))));
}

fn bucket(cell: vec3<i32>) -> u32 {
    let c = bitcast<vec3<u32>>(cell) * vec3<u32>(0x9e3779b1u, 0x85ebca77u, 0xc2b2ae3du);
    let mixed = c.x ^ (c.y << 11u | c.y >> 21u) ^ (c.z << 21u | c.z >> 11u);
    return ((mixed ^ (mixed >> 15u)) * 0x2c1b3c6du >> 4u) & settings.bucket_mask;
}
