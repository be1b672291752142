// User interface triangles, and the presentation of the resulting image. Colours are sRGB-encoded and
// premultiplied throughout. Work is done per vertex where possible, because software adapters run every
// fragment on the CPU.

// Texture of a batch of triangles, or the image to present.
@group(0) @binding(0) var image: texture_2d<f32>;
@group(0) @binding(1) var image_sampler: sampler;

struct Vertex {
    // Position in clip space.
    @location(0) position: vec2<f32>,
    @location(1) uv: vec2<f32>,
    @location(2) color: vec4<f32>,
}

struct PlainFragment {
    @builtin(position) position: vec4<f32>,
    @location(0) @interpolate(linear) color: vec4<f32>,
}

struct TexturedFragment {
    @builtin(position) position: vec4<f32>,
    @location(0) @interpolate(linear) color: vec4<f32>,
    @location(1) @interpolate(linear) uv: vec2<f32>,
}

struct PictureFragment {
    @builtin(position) position: vec4<f32>,
    @location(0) @interpolate(linear) uv: vec2<f32>,
}

@vertex
fn vertex_plain(in: Vertex) -> PlainFragment {
    return PlainFragment(vec4<f32>(in.position, 0.0, 1.0), in.color);
}

@fragment
fn fragment_plain(in: PlainFragment) -> @location(0) vec4<f32> {
    return in.color;
}

@vertex
fn vertex_textured(in: Vertex) -> TexturedFragment {
    return TexturedFragment(vec4<f32>(in.position, 0.0, 1.0), in.color, in.uv);
}

@fragment
fn fragment_textured(in: TexturedFragment) -> @location(0) vec4<f32> {
    return in.color * textureSample(image, image_sampler, in.uv);
}

@vertex
fn vertex_picture(in: Vertex) -> PictureFragment {
    return PictureFragment(vec4<f32>(in.position, 0.0, 1.0), in.uv);
}

@fragment
fn fragment_picture(in: PictureFragment) -> @location(0) vec4<f32> {
    return textureSample(image, image_sampler, in.uv);
}

// One triangle that covers the target.
@vertex
fn vertex_whole(@builtin(vertex_index) index: u32) -> @builtin(position) vec4<f32> {
    let corner = vec2<f32>(f32((index << 1u) & 2u), f32(index & 2u));
    return vec4<f32>(corner.x * 2.0 - 1.0, 1.0 - corner.y * 2.0, 0.0, 1.0);
}

// Copied texel by texel, because the image has the size of the target.
@fragment
fn fragment_whole(@builtin(position) position: vec4<f32>) -> @location(0) vec4<f32> {
    return textureLoad(image, vec2<i32>(position.xy), 0);
}
