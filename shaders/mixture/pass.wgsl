// One pass over a frame (`training.md`, On a device): a workgroup per tile, a lane per point. All results are
// bit-identical to those of the CPU.

struct Frame {
    // Lower corner of the grid of means.
    lo: vec3<f32>,
    per_unit: f32,
    // Cells along each axis.
    dims: vec3<i32>,
    cell: f32,
    equal_share: vec4<f32>,
    equal_gain: vec4<f32>,
    color_ratio: f32,
    open_gap: f32,
    // −0.0, stored as a uniform so that no compiler can fold it.
    minus_zero: f32,
    candidates: u32,
    n_points: u32,
    n_tiles: u32,
    // Capacity for records.
    room: u32,
    with_sums: u32,
}

// Header and open tiles, read first by the CPU.
struct Outcome {
    n_records: atomic<u32>,
    n_open: atomic<u32>,
    open: array<u32>,
}

@group(0) @binding(0) var<uniform> frame: Frame;
// Six columns: position and colour.
@group(0) @binding(1) var<storage, read> points: array<f32>;
@group(0) @binding(2) var<storage, read> tiles: array<u32>;
@group(0) @binding(3) var<storage, read> starts: array<u32>;
// Bits of the position, and the component.
@group(0) @binding(4) var<storage, read> means: array<vec4<u32>>;
@group(0) @binding(5) var<storage, read> appearance: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read_write> distances: array<f32>;
@group(0) @binding(7) var<storage, read_write> records: array<u32>;
@group(0) @binding(8) var<storage, read_write> outcome: Outcome;

const NO_COMPONENT: u32 = 0xffffffffu;
// Larger than any squared distance between values that pass `is_number`.
const FAR: f32 = 3e38;
// Bits of 2¹⁶, the largest coordinate whose squares cannot overflow.
const LARGEST: u32 = 0x47800000u;
// Initial search radius, in cells.
const FIRST_RADIUS: f32 = 0.5;
// Margins of a radius: a hundred roundings, ten roundings of a coordinate, and underflow.
const RELATIVE_MARGIN: f32 = 1.00001;
const COORDINATE_MARGIN: f32 = 1e-6;
const MIN_MARGIN: f32 = 1e-18;
// Maximum means and cell rows visited per point. Beyond it the tile is left to the CPU, so that crowded
// cells do not block the GPU.
const MAX_LOOKS: u32 = 16384u;
const MAX_ROUNDS: u32 = 40u;

// Candidates of a point, nearest first; ties ordered by component.
struct Near {
    distance2: vec4<f32>,
    id: vec4<u32>,
    entry: vec4<u32>,
}

struct Answer {
    owners: vec4<u32>,
    entries: vec4<u32>,
    share: f32,
    q: f32,
    is_open: bool,
}

struct Sums {
    count: f32,
    first: vec3<f32>,
    second: vec3<f32>,
    second_rest: vec3<f32>,
    color: vec3<f32>,
}

var<workgroup> positions: array<vec3<f32>, TILE_POINTS>;
var<workgroup> colors: array<vec3<f32>, TILE_POINTS>;
// Components that share a point, one per candidate.
var<workgroup> owners: array<vec4<u32>, TILE_POINTS>;
var<workgroup> shares: array<f32, TILE_POINTS>;
var<workgroup> is_open: atomic<u32>;

// Product with its own rounding. Drivers may fuse a product with a following sum, but not this fma with −0,
// which changes no bit.
fn product(a: f32, b: f32) -> f32 {
    return fma(a, b, frame.minus_zero);
}

fn product3(a: vec3<f32>, b: vec3<f32>) -> vec3<f32> {
    return fma(a, b, vec3<f32>(frame.minus_zero));
}

fn squared_distance(a: vec3<f32>, b: vec3<f32>) -> f32 {
    let d = a - b;
    let squares = product3(d, d);
    return (squares.x + squares.y) + squares.z;
}

// Tested on bits, because compilers may assume that infinities do not occur.
fn is_number(v: vec3<f32>) -> bool {
    return all((bitcast<vec3<u32>>(v) & vec3<u32>(0x7fffffffu)) <= vec3<u32>(LARGEST));
}

fn cell_of(position: vec3<f32>) -> vec3<i32> {
    return cell_in(position, frame.lo, frame.per_unit, frame.dims);
}

fn insert(near: ptr<function, Near>, distance2: f32, id: u32, entry: u32) {
    let old = *near;
    let is_equal = old.distance2 == vec4<f32>(distance2);
    // Entries after the new one, always a suffix of the four.
    let behind = (old.distance2 > vec4<f32>(distance2)) | (is_equal & (old.id > vec4<u32>(id)));
    let moved = vec4<bool>(false, behind.xyz);
    let distances2 = select(vec4<f32>(distance2), vec4<f32>(0.0, old.distance2.xyz), moved);
    let ids = select(vec4<u32>(id), vec4<u32>(0u, old.id.xyz), moved);
    let entries = select(vec4<u32>(entry), vec4<u32>(0u, old.entry.xyz), moved);
    (*near).distance2 = select(old.distance2, distances2, behind);
    (*near).id = select(old.id, ids, behind);
    (*near).entry = select(old.entry, entries, behind);
}

// Finds the nearest means in the cells that intersect a box of half edge `radius`. Returns the number of
// means and rows visited.
fn gather(position: vec3<f32>, radius: f32, near: ptr<function, Near>) -> u32 {
    *near = Near(vec4<f32>(FAR), vec4<u32>(NO_COMPONENT), vec4<u32>(0u));
    let first = cell_of(position - vec3<f32>(radius));
    let last = cell_of(position + vec3<f32>(radius));
    var looks = 0u;
    for (var z = first.z; z <= last.z; z++) {
        for (var y = first.y; y <= last.y; y++) {
            let row = (z * frame.dims.y + y) * frame.dims.x;
            let end = starts[row + last.x + 1];
            var entry = starts[row + first.x];
            looks += 1u + end - entry;
            if looks > MAX_LOOKS {
                return looks;
            }
            for (; entry < end; entry++) {
                let mean = means[entry];
                let distance2 = squared_distance(position, bitcast<vec3<f32>>(mean.xyz));
                let is_equal = distance2 == (*near).distance2.w;
                if distance2 < (*near).distance2.w || (is_equal && mean.w < (*near).id.w) {
                    insert(near, distance2, mean.w, entry);
                }
            }
        }
    }
    return looks;
}

// Finds the candidates of a point. Returns true if they are proven to be the nearest.
fn search(position: vec3<f32>, near: ptr<function, Near>) -> bool {
    let size = abs(position);
    let slack = COORDINATE_MARGIN * max(size.x, max(size.y, size.z)) + MIN_MARGIN;
    let high = frame.lo + frame.cell * vec3<f32>(frame.dims);
    let outside = max(max(frame.lo - position, position - high), vec3<f32>(0.0));
    let gap = max(outside.x, max(outside.y, outside.z));
    var radius = FIRST_RADIUS * frame.cell;
    var looks = 0u;
    for (var round = 0u; round < MAX_ROUNDS; round++) {
        looks += gather(position, radius, near);
        if looks > MAX_LOOKS {
            return false;
        }
        let farthest2 = (*near).distance2[frame.candidates - 1u];
        if farthest2 < FAR {
            // All nearer means lie in this box.
            let needed = sqrt(farthest2) * RELATIVE_MARGIN + slack;
            if needed <= radius {
                return true;
            }
            radius = needed;
        } else {
            radius = max(2.0 * radius, gap + frame.cell);
        }
    }
    return false;
}

fn score(near: Near, color: vec3<f32>, place: u32) -> f32 {
    if place >= frame.candidates {
        return FAR;
    }
    let mean = appearance[near.entry[place]];
    let of_color = product(frame.color_ratio, squared_distance(color, mean.xyz));
    return (near.distance2[place] + of_color) - mean.w;
}

// Components that share a point; only equal scores share. Scores within the gap but not equal leave the tile
// to the CPU, and larger ones receive nothing.
fn assign(position: vec3<f32>, color: vec3<f32>) -> Answer {
    var answer = Answer(vec4<u32>(NO_COMPONENT), vec4<u32>(0u), 0.0, 0.0, true);
    var near: Near;
    if !is_number(position) || !is_number(color) || !search(position, &near) {
        return answer;
    }
    let q = vec4<f32>(
        score(near, color, 0u),
        score(near, color, 1u),
        score(near, color, 2u),
        score(near, color, 3u),
    );
    let least = min(min(q.x, q.y), min(q.z, q.w));
    let is_least = q == vec4<f32>(least);
    let is_near = (q - vec4<f32>(least)) <= vec4<f32>(frame.open_gap);
    if any(is_near & !is_least) {
        return answer;
    }
    let counted = select(vec4<u32>(0u), vec4<u32>(1u), is_least);
    let others = counted.x + counted.y + counted.z + counted.w - 1u;
    answer.owners = select(vec4<u32>(NO_COMPONENT), near.id, is_least);
    answer.entries = near.entry;
    answer.share = frame.equal_share[others];
    answer.q = least - frame.equal_gain[others];
    answer.is_open = false;
    return answer;
}

// True if an earlier lane's point of the tile is shared by this component.
fn is_known(id: u32, lane: u32) -> bool {
    for (var other = 0u; other < lane; other++) {
        if any(owners[other] == vec4<u32>(id)) {
            return true;
        }
    }
    return false;
}

// Sums of a component over the points of the tile from `first` on, in order.
fn summed(id: u32, mean: vec3<f32>, first: u32, n: u32) -> Sums {
    var sums: Sums;
    for (var at = first; at < n; at++) {
        if any(owners[at] == vec4<u32>(id)) {
            let share = vec3<f32>(shares[at]);
            let d = positions[at] - mean;
            let weighted = product3(share, d);
            sums.count += share.x;
            sums.first += weighted;
            sums.second += product3(weighted.xxx, d);
            sums.second_rest += product3(weighted.yyz, d.yzz);
            sums.color += product3(share, colors[at]);
        }
    }
    return sums;
}

fn write_record(id: u32, tile: u32, sums: Sums) {
    let place = atomicAdd(&outcome.n_records, 1u);
    if place >= frame.room {
        return;
    }
    let words = array<u32, RECORD_WORDS>(
        id,
        tile,
        bitcast<u32>(sums.count),
        bitcast<u32>(sums.first.x),
        bitcast<u32>(sums.first.y),
        bitcast<u32>(sums.first.z),
        bitcast<u32>(sums.second.x),
        bitcast<u32>(sums.second.y),
        bitcast<u32>(sums.second.z),
        bitcast<u32>(sums.second_rest.x),
        bitcast<u32>(sums.second_rest.y),
        bitcast<u32>(sums.second_rest.z),
        bitcast<u32>(sums.color.x),
        bitcast<u32>(sums.color.y),
        bitcast<u32>(sums.color.z),
    );
    for (var k = 0u; k < RECORD_WORDS; k++) {
        records[place * RECORD_WORDS + k] = words[k];
    }
}

@compute @workgroup_size(TILE_POINTS)
fn run(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) n_groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let tile = group.y * n_groups.x + group.x;
    if tile >= frame.n_tiles {
        return;
    }
    let first = tiles[tile];
    let n = tiles[tile + 1u] - first;
    if lane == 0u {
        atomicStore(&is_open, 0u);
    }
    workgroupBarrier();
    var answer = Answer(vec4<u32>(NO_COMPONENT), vec4<u32>(0u), 0.0, 0.0, false);
    if lane < n {
        let at = first + lane;
        let size = frame.n_points;
        let position = vec3<f32>(points[at], points[at + size], points[at + 2u * size]);
        let color = vec3<f32>(points[at + 3u * size], points[at + 4u * size], points[at + 5u * size]);
        answer = assign(position, color);
        positions[lane] = position;
        colors[lane] = color;
        if answer.is_open {
            atomicStore(&is_open, 1u);
        }
    }
    owners[lane] = answer.owners;
    shares[lane] = answer.share;
    workgroupBarrier();
    if atomicLoad(&is_open) != 0u {
        if lane == 0u {
            outcome.open[atomicAdd(&outcome.n_open, 1u)] = tile;
        }
        return;
    }
    if lane >= n {
        return;
    }
    distances[first + lane] = answer.q;
    if frame.with_sums == 0u {
        return;
    }
    for (var place = 0u; place < frame.candidates; place++) {
        let id = answer.owners[place];
        if id != NO_COMPONENT && !is_known(id, lane) {
            let mean = bitcast<vec3<f32>>(means[answer.entries[place]].xyz);
            write_record(id, tile, summed(id, mean, lane, n));
        }
    }
}
