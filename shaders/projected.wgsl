// The projected renderer (`rendering.md` (b)): one instance is one splat, four vertices its quad.

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> splats: array<Splat>;
@group(0) @binding(2) var<storage, read> order: array<u32>;

const LOW_PASS: f32 = 0.3;              // px², added to both variances
const ALPHA_CAP: f32 = 0.99;
const ALPHA_CUT: f32 = 1.0 / 255.0;
// Beyond this half-extent (px) rasterisers clip and lose sub-pixel precision: cover the viewport.
const LARGEST_QUAD: f32 = 8192.0;

// Everything is flat, so the fragment measures from its own pixel centre: interpolating over the
// quad would carry the snapping of its corners (1/256 px) into alpha.
struct Fragment {
    @builtin(position) position: vec4<f32>,
    @location(0) @interpolate(flat) centre: vec2<f32>,
    // Rows W with K = WᵀW. The conic itself cancels along a needle, W does not.
    @location(1) @interpolate(flat) whitening: vec4<f32>,
    @location(2) @interpolate(flat) color: vec4<f32>,
}

struct Footprint {
    centre: vec2<f32>,
    // Unit eigenvector of the larger variance, px.
    axis: vec2<f32>,
    // Standard deviations along `axis` and across it, px.
    deviation: vec2<f32>,
    // Standard deviations along columns and rows, px.
    extent: vec2<f32>,
    valid: bool,
}

@vertex
fn vertex(@builtin(vertex_index) corner: u32, @builtin(instance_index) instance: u32) -> Fragment {
    let splat = splats[order[instance]];
    var out: Fragment;
    // Culled until proven visible: four equal corners outside the clip volume.
    out.position = vec4<f32>(2.0, 2.0, 0.0, 1.0);
    if (splat.flags & FLAG_LIVE) == 0u || splat.opacity < ALPHA_CUT {
        return out;
    }
    let footprint = project(splat);
    if !footprint.valid {
        return out;
    }
    // Exact support of the alpha cut: o exp(-k²/2) = 1/255.
    let k = min(sqrt(2.0 * log(255.0 * splat.opacity)), view.extent_cap);
    let half_box = k * footprint.extent;
    if any(footprint.centre + half_box < vec2<f32>(0.0))
        || any(footprint.centre - half_box > view.viewport) {
        return out;
    }

    let sign = vec2<f32>(f32(corner & 1u), f32(corner >> 1u)) * 2.0 - 1.0;
    let across = vec2<f32>(-footprint.axis.y, footprint.axis.x);
    var pixel = (sign * 0.5 + 0.5) * view.viewport;
    if k * footprint.deviation.x < LARGEST_QUAD && all(abs(footprint.centre) < vec2<f32>(2.0 * LARGEST_QUAD)) {
        let reach = sign * k * footprint.deviation;
        pixel = footprint.centre + reach.x * footprint.axis + reach.y * across;
    }
    let ndc = pixel / view.viewport * 2.0 - 1.0;
    out.position = vec4<f32>(ndc.x, -ndc.y, 0.0, 1.0);
    out.centre = footprint.centre;
    out.whitening = vec4<f32>(
        footprint.axis / footprint.deviation.x,
        across / footprint.deviation.y,
    );
    out.color = vec4<f32>(splat.color, splat.opacity);
    return out;
}

@fragment
fn fragment(in: Fragment) -> @location(0) vec4<f32> {
    let offset = in.position.xy - in.centre;
    let white = vec2<f32>(dot(in.whitening.xy, offset), dot(in.whitening.zw, offset));
    let alpha = min(ALPHA_CAP, in.color.a * exp(-0.5 * dot(white, white)));
    if alpha < ALPHA_CUT {
        discard;
    }
    return vec4<f32>(in.color.rgb * alpha, alpha);
}

fn project(splat: Splat) -> Footprint {
    var out: Footprint;
    // Subtracting the camera first keeps f32 exact far from the world's origin.
    let d = splat.mean - view.centre;
    let m = vec3<f32>(dot(view.right, d), dot(view.down, d), dot(view.forward, d));
    if !(m.z > view.near) {
        return out;
    }
    let tangent = m.xy / m.z;
    let clamped = clamp(tangent, view.tangent_min, view.tangent_max);

    // Rows of J R Q diag(s): Sigma2 = rows·rowsᵀ without ever forming a 3x3 covariance.
    let scaled = view.focal / m.z;
    let to_splat = rotation_rows(splat.rotation);
    let row_u = splat.scale * (to_splat * (scaled.x * (view.right - clamped.x * view.forward)));
    let row_v = splat.scale * (to_splat * (scaled.y * (view.down - clamped.y * view.forward)));
    let xx = dot(row_u, row_u) + LOW_PASS;
    let yy = dot(row_v, row_v) + LOW_PASS;
    let xy = dot(row_u, row_v);
    // Lagrange's identity: xx·yy − xy² would lose a needle's width to cancellation.
    let minors = cross(row_u, row_v);
    let det = dot(minors, minors) + LOW_PASS * (xx + yy - LOW_PASS);

    let half_difference = 0.5 * (xx - yy);
    let radius = length(vec2<f32>(half_difference, xy));
    let larger = 0.5 * (xx + yy) + radius;
    let smaller = max(det / larger, LOW_PASS);
    if !(det > 0.0 && det < 1e37 && larger < 1e18) {
        return out;
    }
    // The column of Sigma2 − smaller·I without a difference of near-equal numbers.
    var axis = vec2<f32>(1.0, 0.0);
    if radius > 1e-6 * larger {
        axis = normalize(select(
            vec2<f32>(xy, radius - half_difference),
            vec2<f32>(half_difference + radius, xy),
            half_difference >= 0.0,
        ));
    }
    out.centre = view.focal * tangent + view.principal;
    out.axis = axis;
    out.deviation = sqrt(vec2<f32>(larger, smaller));
    out.extent = sqrt(vec2<f32>(xx, yy));
    out.valid = true;
    return out;
}

// World to splat axes: the transpose of the matrix of a unit quaternion x y z w.
fn rotation_rows(q: vec4<f32>) -> mat3x3<f32> {
    let v = 2.0 * q.xyz;
    let w = q.w * v;
    let x = q.x * v;
    let yy = q.y * v.y;
    let yz = q.y * v.z;
    let zz = q.z * v.z;
    return mat3x3<f32>(
        vec3<f32>(1.0 - yy - zz, x.y - w.z, x.z + w.y),
        vec3<f32>(x.y + w.z, 1.0 - x.x - zz, yz - w.x),
        vec3<f32>(x.z - w.y, yz + w.x, 1.0 - x.x - yy),
    );
}
