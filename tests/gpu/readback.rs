//! Reads images of a device back to the CPU. All functions wait until the device is done.

use vbgs_studio::math::image::Image;
use vbgs_studio::render::gpu::composite::Compositor;
use vbgs_studio::render::gpu::renderer::SplatTarget;

/// Premultiplied, sRGB-encoded colour and coverage after finishing, without background.
pub fn premultiplied(
    device: &wgpu::Device,
    queue: &wgpu::Queue,
    image: &SplatTarget,
) -> Image<[f32; 4]> {
    let (width, height) = image.size();
    let halves = texels::<[u16; 4]>(device, queue, image.texture(), width, height);
    halves.map(|texel| image.finish().apply(texel.map(f32_from_f16)))
}

/// Bytes as displayed: `image` over an sRGB-encoded background, opaque RGBA. `format` is `Rgba8Unorm` or
/// `Rgba8UnormSrgb`.
pub fn composited(
    device: &wgpu::Device,
    queue: &wgpu::Queue,
    image: &SplatTarget,
    background: [f32; 3],
    format: wgpu::TextureFormat,
) -> Image<[u8; 4]> {
    let (width, height) = image.size();
    let screen = device.create_texture(&wgpu::TextureDescriptor {
        label: None,
        size: image.texture().size(),
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format,
        usage: wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::COPY_SRC,
        view_formats: &[],
    });
    let mut compositor = Compositor::new(device, format);
    compositor.prepare(device, queue, image, background, None);
    draw(device, queue, &screen.create_view(&Default::default()), |pass| compositor.draw(pass));
    texels(device, queue, &screen, width, height)
}

/// Runs a render pass over a cleared view.
pub fn draw(
    device: &wgpu::Device,
    queue: &wgpu::Queue,
    view: &wgpu::TextureView,
    record: impl FnOnce(&mut wgpu::RenderPass<'_>),
) {
    let mut encoder = device.create_command_encoder(&Default::default());
    let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
        color_attachments: &[Some(wgpu::RenderPassColorAttachment {
            view,
            depth_slice: None,
            resolve_target: None,
            ops: Default::default(),
        })],
        ..Default::default()
    });
    record(&mut pass);
    drop(pass);
    queue.submit([encoder.finish()]);
}

/// Reads the upper left `width` by `height` texels, each a `T`.
fn texels<T: bytemuck::AnyBitPattern>(
    device: &wgpu::Device,
    queue: &wgpu::Queue,
    texture: &wgpu::Texture,
    width: u32,
    height: u32,
) -> Image<T> {
    if width == 0 || height == 0 {
        return Image::from_vec(width as usize, height as usize, Vec::new());
    }
    let row_bytes = width as usize * size_of::<T>();
    // wgpu requires row strides that are multiples of 256 bytes.
    let stride = row_bytes.next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT as usize);
    let staging = device.create_buffer(&wgpu::BufferDescriptor {
        label: None,
        size: (stride * height as usize) as u64,
        usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
        mapped_at_creation: false,
    });
    let layout = wgpu::TexelCopyBufferLayout {
        offset: 0,
        bytes_per_row: Some(stride as u32),
        rows_per_image: None,
    };
    let mut encoder = device.create_command_encoder(&Default::default());
    encoder.copy_texture_to_buffer(
        texture.as_image_copy(),
        wgpu::TexelCopyBufferInfo { buffer: &staging, layout },
        wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
    );
    queue.submit([encoder.finish()]);
    staging.map_async(wgpu::MapMode::Read, .., Result::unwrap);
    device.poll(wgpu::PollType::wait_indefinitely()).unwrap();
    let bytes = staging.get_mapped_range(..).unwrap();
    let rows = bytes.chunks_exact(stride);
    let texels = rows.flat_map(|row| row[..row_bytes].chunks_exact(size_of::<T>()));
    let data = texels.map(bytemuck::pod_read_unaligned).collect();
    Image::from_vec(width as usize, height as usize, data)
}

/// Converts IEEE 754 half precision to f32 exactly.
fn f32_from_f16(bits: u16) -> f32 {
    let sign = u32::from(bits >> 15) << 31;
    let exponent = u32::from(bits >> 10) & 0x1f;
    let fraction = u32::from(bits) & 0x3ff;
    let magnitude = match exponent {
        // Subnormal halves, below 2⁻¹⁴, have no implicit one; their unit is 2⁻²⁴.
        0 => (fraction as f32 * 2f32.powi(-24)).to_bits(),
        0x1f => 0x7f80_0000 | fraction << 13,
        _ => (exponent + 112) << 23 | fraction << 13,
    };
    f32::from_bits(sign | magnitude)
}

#[test]
fn halves_widen_exactly() {
    for (bits, value) in [
        (0x0000, 0.0),
        (0x3c00, 1.0),
        (0xc000, -2.0),
        (0x3555, 0.333_251_95),
        (0x7bff, 65504.0),
        (0x0001, 5.960_464_5e-8),
        (0x03ff, 6.097_555e-5),
        (0x7c00, f32::INFINITY),
    ] {
        assert_eq!(f32_from_f16(bits), value, "{bits:#06x}");
    }
    assert!(f32_from_f16(0x7e00).is_nan());
}
