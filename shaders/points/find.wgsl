// Finds the nearest seed of every point.

@group(0) @binding(2) var<storage, read> seeds: array<Seed>;
// Per bucket: its first seed plus 1.
@group(0) @binding(3) var<storage, read> heads: array<u32>;
// Per point.
@group(0) @binding(4) var<storage, read_write> nearest: array<u32>;

// Bits of infinity, the smallest pattern that is not a finite number.
const INFINITY: u32 = 0x7f800000u;
// Maximum seeds visited per point. Beyond it the point is left to the CPU, so that crowded cells do not
// block the driver.
const MAX_LOOKS: u32 = 16384u;

fn squared_distance(a: vec3<f32>, b: vec3<f32>) -> f32 {
    let d = a - b;
    let squares = product3(d, d);
    return (squares.x + squares.y) + squares.z;
}

// True if a position is finite and within the range of cells, by the same test as on the CPU.
fn is_within(position: vec3<f32>) -> bool {
    let bits = bitcast<vec3<u32>>(position) & vec3<u32>(0x7fffffffu);
    // Tested on bits, because compilers may assume that all values are finite.
    let are_numbers = all(bits < vec3<u32>(INFINITY));
    let cells = abs(product3(position, vec3<f32>(settings.per_cell)));
    return are_numbers && all(cells < vec3<f32>(settings.max_cells));
}

fn search(position: vec3<f32>) -> u32 {
    let first = cell_of(position - vec3<f32>(settings.radius));
    let last = cell_of(position + vec3<f32>(settings.radius));
    // `found` starts above every index, so that a seed at exactly the limit counts.
    var best = settings.limit;
    var found = NO_SEED;
    var looks = 0u;
    for (var z = first.z; z <= last.z; z++) {
        for (var y = first.y; y <= last.y; y++) {
            for (var x = first.x; x <= last.x; x++) {
                var next = heads[bucket(vec3<i32>(x, y, z))];
                while next != 0u {
                    looks++;
                    if looks > MAX_LOOKS {
                        return OPEN;
                    }
                    let seed = seeds[next - 1u];
                    let distance2 = squared_distance(position, seed.position);
                    if distance2 < best || (distance2 == best && next - 1u < found) {
                        best = distance2;
                        found = next - 1u;
                    }
                    next = seed.next;
                }
            }
        }
    }
    return found;
}

@compute @workgroup_size(GROUP)
fn find(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) n_groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let i = lane_of(group, n_groups, lane);
    if i < settings.n_points {
        let position = points[i].position;
        nearest[i] = NO_SEED;
        if is_within(position) {
            nearest[i] = search(position);
        }
    }
}
