// Draws splats as instanced quads, back to front: one instance per splat, four vertices per quad.

@group(0) @binding(1) var<storage, read> splats: array<Splat>;
@group(0) @binding(2) var<storage, read> order: array<u32>;
@group(0) @binding(3) var<storage, read> appearances: array<Appearance>;

// Half-extent in px beyond which rasterisers clip and lose sub-pixel precision; larger quads are cut to the
// viewport.
const LARGEST_QUAD: f32 = 8192.0;

// All varyings are flat and the fragment uses its own pixel centre. Interpolation over the quad would carry
// the snapping of its corners (1/256 px) into alpha.
struct Fragment {
    @builtin(position) position: vec4<f32>,
    @location(0) @interpolate(flat) anchor: vec4<f32>,      // conic.anchor, 1/|p|²
    @location(1) @interpolate(flat) factor: vec4<f32>,      // conic.factor, opacity
    @location(2) @interpolate(flat) half_l: vec2<f32>,
    @location(3) @interpolate(flat) color: vec3<f32>,
}

struct ShadedFragment {
    @builtin(position) position: vec4<f32>,
    @location(0) @interpolate(flat) anchor: vec4<f32>,
    @location(1) @interpolate(flat) factor: vec4<f32>,
    @location(2) @interpolate(flat) half_l: vec2<f32>,
    @location(3) @interpolate(flat) color: vec3<f32>,
    @location(4) @interpolate(flat) along: vec3<f32>,
    @location(5) @interpolate(flat) across_x: vec3<f32>,
    @location(6) @interpolate(flat) across_y: vec3<f32>,
}

@vertex
fn vertex(@builtin(vertex_index) corner: u32, @builtin(instance_index) instance: u32) -> Fragment {
    return fragment_of(draw(splats[order[instance]]), corner);
}

// Splats without appearance.
@fragment
fn fragment(in: Fragment) -> @location(0) vec4<f32> {
    let response = response_at(in);
    let alpha = alpha_of(response, in.factor.w);
    if !(alpha >= ALPHA_CUT) {
        discard;
    }
    return vec4<f32>(in.color * alpha, alpha);
}

@vertex
fn vertex_shaded(
    @builtin(vertex_index) corner: u32,
    @builtin(instance_index) instance: u32,
) -> ShadedFragment {
    let index = order[instance];
    let splat = splats[index];
    let drawn = draw(splat);
    let plain = fragment_of(drawn, corner);
    var out: ShadedFragment;
    out.position = plain.position;
    if !drawn.visible {
        return out;
    }
    let appearance = appearances[index];
    let gradient = gradient_of(appearance, drawn);
    out.anchor = plain.anchor;
    out.factor = plain.factor;
    out.half_l = plain.half_l;
    out.color = directional_color(splat, appearance, drawn.placed);
    out.along = gradient.along;
    out.across_x = gradient.across_x;
    out.across_y = gradient.across_y;
    return out;
}

// Splats with appearance.
@fragment
fn fragment_shaded(
    in: Fragment,
    @location(4) @interpolate(flat) along: vec3<f32>,
    @location(5) @interpolate(flat) across_x: vec3<f32>,
    @location(6) @interpolate(flat) across_y: vec3<f32>,
) -> @location(0) vec4<f32> {
    let response = response_at(in);
    let alpha = alpha_of(response, in.factor.w);
    if !(alpha >= ALPHA_CUT) {
        discard;
    }
    let color = color_of(response, in.color, Gradient(along, across_x, across_y));
    return vec4<f32>(color * alpha, alpha);
}

fn fragment_of(drawn: Drawn, corner: u32) -> Fragment {
    var out: Fragment;
    // Invisible splats: four equal corners outside the clip volume.
    out.position = vec4<f32>(2.0, 2.0, 0.0, 1.0);
    if drawn.visible {
        let sign = vec2<f32>(f32(corner & 1u), f32(corner >> 1u)) * 2.0 - 1.0;
        let ndc = corner_of(drawn.outline, sign) / view.viewport * 2.0 - 1.0;
        let record = drawn.record;
        out.position = vec4<f32>(ndc.x, -ndc.y, 0.0, 1.0);
        out.anchor = vec4<f32>(record.conic.anchor, record.conic.inverse_p2);
        out.factor = vec4<f32>(record.conic.factor, record.opacity);
        out.half_l = record.conic.half_l;
        out.color = record.color;
    }
    return out;
}

// Corner, in px, of the ellipse's oriented rectangle, or of the bounding box clipped to the viewport.
fn corner_of(outline: Outline, sign: vec2<f32>) -> vec2<f32> {
    let half_size = 0.5 * (outline.high - outline.low);
    let fits = all(half_size < vec2<f32>(LARGEST_QUAD))
        && all(abs(outline.centre) < vec2<f32>(2.0 * LARGEST_QUAD));
    if !(outline.det > 0.0 && fits) {
        let low = max(outline.low, vec2<f32>(0.0));
        let high = min(outline.high, view.viewport);
        return mix(low, high, sign * 0.5 + 0.5);
    }
    let xx = outline.matrix.x;
    let xy = outline.matrix.y;
    let yy = outline.matrix.z;
    let half_difference = 0.5 * (xx - yy);
    let radius = length(vec2<f32>(half_difference, xy));
    let larger = 0.5 * (xx + yy) + radius;
    // Column of the matrix minus its smaller eigenvalue, chosen so that no near-equal numbers are subtracted.
    var axis = vec2<f32>(1.0, 0.0);
    if radius > 1e-6 * larger {
        axis = normalize(select(
            vec2<f32>(xy, radius - half_difference),
            vec2<f32>(half_difference + radius, xy),
            half_difference >= 0.0,
        ));
    }
    let semi = sqrt(vec2<f32>(larger, outline.det / larger));
    let reach = sign * (semi + slack(semi));
    return outline.centre + reach.x * axis + reach.y * vec2<f32>(-axis.y, axis.x);
}

fn response_at(in: Fragment) -> Response {
    let conic = Conic(in.anchor.xyz, in.anchor.w, in.factor.xyz, in.half_l);
    let sight = sight_of(in.position.xy);
    var out = response(conic, sight.xyz);
    // A fisheye shows nothing outside its circle.
    out.d2 = select(FAR_AWAY, out.d2, sight.w > 0.0);
    return out;
}
