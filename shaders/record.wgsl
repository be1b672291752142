// Converts a splat to a record, and evaluates records in pixels. One record serves the projected renderer
// and the exact renderer with either lens (`rendering.md`, Rational conic). Prepended, after `common.wgsl`, to
// every file that draws splats.
//
// The record is a rational conic in the splat's tangent frame. The whitening is M = diag(1/s)(R·Q)ᵀ. A ray
// `ahead` points to the mean (p = M·mean = span·g, g = M·ahead), and two directions e lie across it
// (A = M·e). For a ray ahead·c + e·δ:
//
//     num = |factor·δ|²      h = c + half_l·δ      D² = num / (max(h, 0)² + num/|p|²)
//
// with half_l = Aᵀg/|g|². Because G − ¼llᵀ = Q/|p|², this equals δᵀQδ/(1 + l·δ + δᵀGδ), but as a quotient of
// sums of squares, in which nothing cancels. h = 0 gives |p|², the value at the camera, which is the maximum
// response on a ray that points away from the splat. The projected renderer is half_l = 1/|p|² = 0.

@group(0) @binding(0) var<uniform> view: View;

// Farther than any image extends, px or tangent; its square still fits in f32.
const FAR_AWAY: f32 = 1e15;
// Slack of bounds for f32 rounding: px, and a fraction of the size. Alpha at the border is only 1/255.
const SLACK: f32 = 0.05;
const SLACK_SHARE: f32 = 2e-4;
const PI: f32 = 3.14159265;
// −½ log₂e, because GPUs provide powers of two.
const HALF_IN_TWOS: f32 = -0.72134752;

struct Conic {
    // Pinhole: projected centre in px, and 0. Fisheye: unit direction to the mean, camera axes.
    anchor: vec3<f32>,
    inverse_p2: f32,
    // p_x, p_y, q_y: num = (p_x·δx + p_y·δy)² + (q_y·δy)².
    factor: vec3<f32>,
    half_l: vec2<f32>,
}

struct Record {
    conic: Conic,
    color: vec3<f32>,
    // Peak opacity, after antialiasing.
    opacity: f32,
    // View depth z (projected) or distance (exact); positive. Splats with smaller values are in front.
    depth: f32,
    // Support in standard deviations.
    reach: f32,
}

// Bounding box, in px, of the region where alpha can reach the cut. Not clipped; values beyond FAR_AWAY are
// unbounded.
struct Outline {
    low: vec2<f32>,
    high: vec2<f32>,
}

// Splat in camera coordinates.
struct Placed {
    from_camera: vec3<f32>,     // vector to the mean, world axes
    mean: vec3<f32>,            // vector to the mean, camera axes
    distance: f32,
    axes: mat3x3<f32>,          // camera to splat axes
    scale: vec3<f32>,           // standard deviations, world units, after factor and floor
    opacity: f32,
}

struct Drawn {
    record: Record,
    outline: Outline,
    placed: Placed,
    // If false, the other members are undefined.
    visible: bool,
}

// Colour gradient over a splat, by channel: `along`·(τc − 1) + τ·(`across_x`·δx + `across_y`·δy).
struct Gradient {
    along: vec3<f32>,
    across_x: vec3<f32>,
    across_y: vec3<f32>,
}

// Response of a conic along one ray.
struct Response {
    // Squared Mahalanobis distance of the ray from the mean.
    d2: f32,
    // Inputs of the gradient: δ, τ and τc − 1.
    offset: vec2<f32>,
    tau: f32,
    tau_less: f32,
}

// -------------------------------------------------------------------------------------------------
// Splat to record

// Record of a splat in its stored or painted colour, without appearance.
fn draw(splat: Splat) -> Drawn {
    var out: Drawn;
    if (splat.flags & FLAG_LIVE) == 0u || splat.opacity < view.opacity_cut {
        return out;
    }
    out.placed = place(splat);
    let depth = select(out.placed.distance, out.placed.mean.z, view.renderer == RENDERER_PROJECTED);
    let ahead = select(out.placed.mean.z, out.placed.distance, view.lens == LENS_FISHEYE);
    if !(ahead > view.near) {
        return out;
    }
    out.record.depth = depth;
    out.record.color = painted(splat, out.placed);
    if view.renderer == RENDERER_PROJECTED {
        draw_projected(&out);
    } else {
        draw_exact(&out);
    }
    let outline = out.outline;
    let inside = all(outline.high > vec2<f32>(0.0)) && all(outline.low < view.viewport);
    let conic = out.record.conic;
    let sound = all(abs(conic.anchor) < vec3<f32>(FAR_AWAY)) && all(abs(conic.factor) < vec3<f32>(FAR_AWAY))
        && all(abs(conic.half_l) < vec2<f32>(FAR_AWAY));
    out.visible = inside && sound && out.record.opacity >= ALPHA_CUT;
    return out;
}

fn place(splat: Splat) -> Placed {
    var out: Placed;
    // Subtracting the camera first preserves f32 precision far from the world origin.
    let d = (splat.mean - view.centre) - view.centre_rest;
    out.from_camera = d;
    out.mean = vec3<f32>(dot(view.right, d), dot(view.down, d), dot(view.forward, d));
    out.distance = length(out.mean);
    let to_splat = to_splat_axes(splat.rotation);
    out.axes = mat3x3<f32>(to_splat * view.right, to_splat * view.down, to_splat * view.forward);
    let scale = splat.scale * view.scale;
    let most = largest(scale);
    let least = max(min(SCALE_FLOOR * max(1.0, most), FLATTEST * most), POINT_SCALE);
    out.scale = max(scale, vec3<f32>(least));
    out.opacity = splat.opacity;
    return out;
}

fn draw_projected(out: ptr<function, Drawn>) {
    let placed = (*out).placed;
    let z = placed.mean.z;
    let tangent = placed.mean.xy / z;
    let clamped = clamp(tangent, view.tangent_min, view.tangent_max);
    // Rows of J R Q diag(s): Sigma2 = rows·rowsᵀ, without forming a 3x3 covariance.
    let scaled = view.focal / z;
    let row_u = placed.scale * (placed.axes * vec3<f32>(scaled.x, 0.0, -scaled.x * clamped.x));
    let row_v = placed.scale * (placed.axes * vec3<f32>(0.0, scaled.y, -scaled.y * clamped.y));
    // Scaled so that the determinant fits f32 for splats of any size.
    let unit = 1.0 / max(1.0, max(length(row_u), length(row_v)));
    let u = unit * row_u;
    let v = unit * row_v;
    let low_pass = LOW_PASS * unit * unit;
    let xx = dot(u, u) + low_pass;
    let yy = dot(v, v) + low_pass;
    let xy = dot(u, v);
    // Lagrange's identity: xx·yy − xy² would lose a needle's width to cancellation.
    let minors = cross(u, v);
    let det = dot(minors, minors) + low_pass * (xx + yy - low_pass);

    let centre = view.focal * tangent + view.principal;
    var opacity = placed.opacity;
    if view.is_antialiased == 1u {
        opacity *= length(minors) / sqrt(det);
    }
    (*out).record.opacity = opacity;
    (*out).record.reach = reach_of(opacity);
    (*out).record.conic.anchor = vec3<f32>(centre, 0.0);
    (*out).record.conic.factor =
        unit * vec3<f32>(sqrt(yy / det), -xy / sqrt(yy * det), 1.0 / sqrt(yy));
    let k = (*out).record.reach / unit;
    let half_box = k * sqrt(vec2<f32>(xx, yy));
    (*out).outline = widened_box(centre, centre - half_box, centre + half_box);
}

fn draw_exact(out: ptr<function, Drawn>) {
    let placed = widened((*out).placed);
    (*out).placed = placed;
    (*out).record.opacity = placed.opacity;
    (*out).record.reach = reach_of(placed.opacity);
    if view.lens == LENS_FISHEYE {
        let toward = placed.mean / placed.distance;
        let across = across_of(toward);
        (*out).record.conic = conic_of(placed, toward, across[0], across[1], placed.distance);
        (*out).record.conic.anchor = toward;
        (*out).outline = outline_of_cone(placed, (*out).record.reach);
    } else {
        let tangent = placed.mean.xy / placed.mean.z;
        let e1 = vec3<f32>(1.0 / view.focal.x, 0.0, 0.0);
        let e2 = vec3<f32>(0.0, 1.0 / view.focal.y, 0.0);
        let centre = view.focal * tangent + view.principal;
        (*out).record.conic = conic_of(placed, vec3<f32>(tangent, 1.0), e1, e2, placed.mean.z);
        (*out).record.conic.anchor = vec3<f32>(centre, 0.0);
        (*out).outline = outline_of_ellipsoid(placed, centre, tangent, (*out).record.reach);
    }
}

// Applies the exact renderer's antialiasing.
fn widened(placed: Placed) -> Placed {
    var out = placed;
    if view.antialias == ANTIALIAS_FOOTPRINT {
        let d = placed.distance;
        let variance = FOOTPRINT * d * d / (view.focal.x * view.focal.y);
        out.scale = sqrt(placed.scale * placed.scale + variance);
        if view.is_antialiased == 1u {
            // In units of the largest scale, all products fit f32.
            let unit = 1.0 / largest(out.scale);
            let toward = placed.axes * (placed.mean / d);
            out.opacity *= sqrt(shadow(unit * placed.scale, toward) / shadow(unit * out.scale, toward));
        }
    } else if view.antialias == ANTIALIAS_REFERENCE {
        out.scale = sqrt(placed.scale * placed.scale + REFERENCE_VARIANCE);
        let gain = placed.scale / out.scale;
        out.opacity *= gain.x * gain.y * gain.z;
    }
    return out;
}

// Squared area of a splat's shadow along a direction in its own axes, up to a constant factor.
fn shadow(scale: vec3<f32>, toward: vec3<f32>) -> f32 {
    let side = scale.yzx * scale.zxy * toward;
    return dot(side, side);
}

// Conic in the frame of the ray `ahead` to the mean, which is `span` long, and two directions across it.
// Cofactors of M are applied to cross products taken before whitening, which avoids cancellation.
fn conic_of(placed: Placed, ahead: vec3<f32>, e1: vec3<f32>, e2: vec3<f32>, span: f32) -> Conic {
    // In units of the largest scale, all values here and their inverses fit f32.
    let unit = largest(placed.scale);
    let inverse = unit / placed.scale;
    let cofactor = inverse.yzx * inverse.zxy;
    let g = inverse * (placed.axes * ahead);
    let a1 = inverse * (placed.axes * e1);
    let a2 = inverse * (placed.axes * e2);
    let b1 = cofactor * (placed.axes * cross(e1, ahead));
    let b2 = cofactor * (placed.axes * cross(e2, ahead));
    let norm_g = length(g);
    let norm_b = length(b1);
    let volume = inverse.x * inverse.y * inverse.z * dot(ahead, cross(e1, e2));
    let depth = span / unit;
    var out: Conic;
    out.factor = depth * vec3<f32>(norm_b / norm_g, dot(b1, b2) / (norm_b * norm_g), volume / norm_b);
    out.half_l = vec2<f32>(dot(a1, g), dot(a2, g)) / (norm_g * norm_g);
    let inverse_p = 1.0 / (depth * norm_g);
    out.inverse_p2 = inverse_p * inverse_p;
    return out;
}

// Two unit directions that complete a unit vector to a right-handed frame (Duff et al. 2017).
fn across_of(n: vec3<f32>) -> mat2x3<f32> {
    let s = select(-1.0, 1.0, n.z >= 0.0);
    let a = -1.0 / (s + n.z);
    let b = n.x * n.y * a;
    return mat2x3<f32>(
        vec3<f32>(1.0 + s * n.x * n.x * a, s * b, -s * n.x),
        vec3<f32>(b, s + n.y * n.y * a, -n.y),
    );
}

// Support in standard deviations: o·exp(−k²/2) = 1/255.
fn reach_of(opacity: f32) -> f32 {
    return sqrt(max(2.0 * log(255.0 * opacity), 0.0));
}

// -------------------------------------------------------------------------------------------------
// Outlines

fn widened_box(centre: vec2<f32>, low: vec2<f32>, high: vec2<f32>) -> Outline {
    return Outline(low - slack(low - centre), high + slack(high - centre));
}

fn slack(size: vec2<f32>) -> vec2<f32> {
    return vec2<f32>(SLACK) + SLACK_SHARE * abs(size);
}

// Tight bounds of the ellipsoid of k standard deviations through a pinhole (`rendering.md`, Tight
// bounds). ρ are the rows of the scaled axes over z, v = ρ₀ − tan_x·ρ₂ and β = k²|ρ₂|². With
// e = tan − tan_x the quadratic becomes (β − 1)e² − 2k²(v·ρ₂)e + k²|v|² = 0. β < 1 means that the ellipsoid
// lies entirely in front of the camera.
fn outline_of_ellipsoid(placed: Placed, centre: vec2<f32>, tangent: vec2<f32>, k: f32) -> Outline {
    let reach = k * placed.scale / placed.mean.z;
    let ahead = reach * placed.axes[2];
    let u = reach * (placed.axes * vec3<f32>(1.0, 0.0, -tangent.x));
    let v = reach * (placed.axes * vec3<f32>(0.0, 1.0, -tangent.y));
    let margin = 1.0 - dot(ahead, ahead);
    let range_x = tangent_range(u, ahead, margin);
    let range_y = tangent_range(v, ahead, margin);
    let low = centre + view.focal * vec2<f32>(range_x.x, range_y.x);
    let high = centre + view.focal * vec2<f32>(range_x.y, range_y.y);
    return widened_box(centre, low, high);
}

// Range of tan − tan_x over an ellipsoid. Unbounded if the camera is in its shadow or if it crosses the
// camera's plane.
fn tangent_range(v: vec3<f32>, ahead: vec3<f32>, margin: f32) -> vec2<f32> {
    let size = max(length(v), 1e-20);
    let slope = dot(v, ahead) / size;
    let square = slope * slope + margin;
    if square <= 1e-4 * slope * slope {
        return vec2<f32>(-FAR_AWAY, FAR_AWAY);
    }
    let q = abs(slope) + sqrt(square);
    let close = size / q;
    let far = select(FAR_AWAY, size * q / margin, margin > 0.0);
    return select(vec2<f32>(-far, close), vec2<f32>(-close, far), slope < 0.0);
}

// Bounding box of a cone around the mean through a fisheye: an annular sector around the principal point.
fn outline_of_cone(placed: Placed, k: f32) -> Outline {
    let sine = k * largest(placed.scale) / placed.distance;
    let lateral = length(placed.mean.xy);
    let theta = atan2(lateral, placed.mean.z);
    // Inverse trigonometric functions in WGSL may have an error of 5e-4.
    let psi = asin(min(sine, 1.0)) * 1.001 + 5e-4 * theta;
    var low = vec2<f32>(-FAR_AWAY);
    var high = vec2<f32>(FAR_AWAY);
    if sine < 1.0 {
        let outer = min(theta + psi, PI);
        low = vec2<f32>(-outer);
        high = vec2<f32>(outer);
        let sine_phi = sin(psi) * placed.distance / lateral;
        if theta > psi && theta + psi < PI && sine_phi < 1.0 {
            let inner = (theta - psi) * sqrt(1.0 - sine_phi * sine_phi);
            let radial = placed.mean.xy / lateral;
            let middle = 0.5 * (inner + outer) * radial;
            let half_box = 0.5 * (outer - inner) * abs(radial) + outer * sine_phi * abs(radial.yx);
            low = middle - half_box;
            high = middle + half_box;
        }
    }
    return widened_box(view.principal, view.principal + view.focal * low,
        view.principal + view.focal * high);
}

// -------------------------------------------------------------------------------------------------
// Colour

fn painted(splat: Splat, placed: Placed) -> vec3<f32> {
    if all(splat.color == MARK) {
        return MARK;
    }
    switch view.paint {
        case PAINT_DEPTH: {
            let ends = view.depth_range;
            return ramp((placed.distance - ends.x) / (ends.y - ends.x));
        }
        case PAINT_NORMAL: {
            return normal_color(splat, placed);
        }
        default: {
            return max(splat.color, vec3<f32>(0.0));
        }
    }
}

// Maps 0 to dark violet and 1 to yellow; other values are clamped.
fn ramp(share: f32) -> vec3<f32> {
    let t = clamp(share, 0.0, 1.0);
    let upper = ((RAMP[6] * t + RAMP[5]) * t + RAMP[4]) * t + RAMP[3];
    let sum = ((upper * t + RAMP[2]) * t + RAMP[1]) * t + RAMP[0];
    return clamp(sum, vec3<f32>(0.0), vec3<f32>(1.0));
}

// Colour of the shortest axis (the first of equals), turned towards the camera.
fn normal_color(splat: Splat, placed: Placed) -> vec3<f32> {
    let normal = normal_of(splat);
    let turn = select(-0.5, 0.5, dot(normal, placed.from_camera) <= 0.0);
    return vec3<f32>(0.5) + turn * normal;
}

// World direction of the shortest axis (the first of equals).
fn normal_of(splat: Splat) -> vec3<f32> {
    var axis = 0u;
    if splat.scale.y < splat.scale[axis] {
        axis = 1u;
    }
    if splat.scale.z < splat.scale[axis] {
        axis = 2u;
    }
    return transpose(to_splat_axes(splat.rotation))[axis];
}

// Returns the direction if it lies within the observed cone, otherwise the edge of the cone towards it.
fn within_observed(appearance: Appearance, direction: vec3<f32>) -> vec3<f32> {
    let mean = vec3<f32>(appearance.observed[0], appearance.observed[1], appearance.observed[2]);
    let o = direction - mean;
    let c = appearance.cone;
    let rows = vec3<f32>(
        c[0] * o.x + c[1] * o.y + c[2] * o.z,
        c[1] * o.x + c[3] * o.y + c[4] * o.z,
        c[2] * o.x + c[4] * o.y + c[5] * o.z,
    );
    return mean + o / sqrt(max(dot(o, rows), 1.0));
}

// Colour of a splat with appearance, viewed from the camera.
fn directional_color(splat: Splat, appearance: Appearance, placed: Placed) -> vec3<f32> {
    if view.paint != PAINT_STORED {
        return painted(splat, placed);
    }
    let direction = placed.from_camera / placed.distance;
    return color_along(splat, appearance, within_observed(appearance, direction));
}

// Colour of a splat with appearance along a unit direction, world axes.
fn color_along(splat: Splat, appearance: Appearance, direction: vec3<f32>) -> vec3<f32> {
    let turned = channels(appearance.directional, direction);
    return clamp(splat.color + turned, vec3<f32>(0.0), vec3<f32>(1.0));
}

// Colour along a unit direction minus the colour along the mean of the observed directions.
fn directional_shift(splat: Splat, appearance: Appearance, direction: vec3<f32>) -> vec3<f32> {
    let o = appearance.observed;
    return color_along(splat, appearance, within_observed(appearance, direction))
        - color_along(splat, appearance, vec3<f32>(o[0], o[1], o[2]));
}

fn gradient_of(appearance: Appearance, drawn: Drawn) -> Gradient {
    var out: Gradient;
    if view.paint != PAINT_STORED {
        return out;
    }
    let placed = drawn.placed;
    if view.lens == LENS_FISHEYE {
        let across = across_of(drawn.record.conic.anchor);
        let to_world = mat3x3<f32>(view.right, view.down, view.forward);
        out.along = channels(appearance.gradient, placed.from_camera);
        out.across_x = channels(appearance.gradient, placed.distance * (to_world * across[0]));
        out.across_y = channels(appearance.gradient, placed.distance * (to_world * across[1]));
        return out;
    }
    var step_x = placed.mean.z / view.focal.x * view.right;
    var step_y = placed.mean.z / view.focal.y * view.down;
    if view.renderer == RENDERER_PROJECTED {
        // Linearised in the pixel: the point of maximum response also moves along the ray.
        let half_l = half_l_of(placed);
        step_x -= half_l.x * placed.from_camera;
        step_y -= half_l.y * placed.from_camera;
    } else {
        out.along = channels(appearance.gradient, placed.from_camera);
    }
    out.across_x = channels(appearance.gradient, step_x);
    out.across_y = channels(appearance.gradient, step_y);
    return out;
}

fn half_l_of(placed: Placed) -> vec2<f32> {
    let inverse = largest(placed.scale) / placed.scale;
    let g = inverse * (placed.axes * (placed.mean / placed.mean.z));
    let a1 = inverse * placed.axes[0] / view.focal.x;
    let a2 = inverse * placed.axes[1] / view.focal.y;
    return vec2<f32>(dot(a1, g), dot(a2, g)) / dot(g, g);
}

// Product of a 3x3 matrix, one row per channel, and a vector.
fn channels(rows: array<f32, 9>, v: vec3<f32>) -> vec3<f32> {
    return vec3<f32>(
        dot(vec3<f32>(rows[0], rows[1], rows[2]), v),
        dot(vec3<f32>(rows[3], rows[4], rows[5]), v),
        dot(vec3<f32>(rows[6], rows[7], rows[8]), v),
    );
}

// -------------------------------------------------------------------------------------------------
// Record to pixel

// Line of sight of a pixel, given its centre in px: the pixel itself for a pinhole, a unit ray in camera
// axes for a fisheye. `w` is 0 outside the fisheye's circle.
fn sight_of(pixel: vec2<f32>) -> vec4<f32> {
    if view.lens != LENS_FISHEYE {
        return vec4<f32>(pixel, 1.0, 1.0);
    }
    let rho = (pixel - view.principal) / view.focal;
    let theta = length(rho);
    let sine_share = select(sin(theta) / theta, 1.0, theta < 1e-4);
    return vec4<f32>(rho * sine_share, cos(theta), select(1.0, 0.0, theta > PI));
}

fn response(conic: Conic, sight: vec3<f32>) -> Response {
    var out: Response;
    if view.renderer == RENDERER_PROJECTED {
        // half_l = 1/|p|² = 0, so no division is needed.
        out.offset = sight.xy - conic.anchor.xy;
        out.d2 = num_at(conic.factor, out.offset);
        out.tau = 1.0;
        return out;
    }
    var ahead = 1.0;
    if view.lens == LENS_FISHEYE {
        let across = across_of(conic.anchor);
        out.offset = vec2<f32>(dot(sight, across[0]), dot(sight, across[1]));
        ahead = dot(sight, conic.anchor);
    } else {
        out.offset = sight.xy - conic.anchor.xy;
    }
    // Avoids 0/0 where the ray points away from the mean, and ∞/∞.
    let num = clamp(num_at(conic.factor, out.offset), 1e-20, 1e30);
    let turn = dot(conic.half_l, out.offset);
    let h = max(ahead + turn, 0.0);
    let rest = num * conic.inverse_p2;
    let inverse = 1.0 / (h * h + rest);
    out.d2 = num * inverse;
    out.tau = h * inverse;
    out.tau_less = -(h * turn + rest) * inverse;
    return out;
}

fn num_at(factor: vec3<f32>, offset: vec2<f32>) -> f32 {
    let p = factor.x * offset.x + factor.y * offset.y;
    let q = factor.z * offset.y;
    return p * p + q * q;
}

// The result is not compared with ALPHA_CUT.
fn alpha_of(response: Response, opacity: f32) -> f32 {
    return min(ALPHA_CAP, opacity * exp2(HALF_IN_TWOS * response.d2));
}

fn color_of(response: Response, color: vec3<f32>, gradient: Gradient) -> vec3<f32> {
    let across = gradient.across_x * response.offset.x + gradient.across_y * response.offset.y;
    let change = gradient.along * response.tau_less + across * response.tau;
    let limit = vec3<f32>(GRADIENT_LIMIT);
    return max(color + clamp(change, -limit, limit), vec3<f32>(0.0));
}

// -------------------------------------------------------------------------------------------------

fn largest(v: vec3<f32>) -> f32 {
    return max(v.x, max(v.y, v.z));
}

// Rotation from world to splat axes: transposed matrix of a unit quaternion x y z w.
fn to_splat_axes(q: vec4<f32>) -> mat3x3<f32> {
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
