//! Reads GPU images back to the CPU, for tests and screenshots. All functions block until the GPU is done.
//!
//! Buffer rows must be a multiple of 256 bytes apart, which image rows rarely are. They are copied with
//! padding and packed on the CPU. Half floats are widened here to avoid a dependency for one
//! function; the conversion is exact.

use super::composite::Compositor;
use super::error::GpuError;
use super::renderer::SplatTarget;
use crate::math::image::Image;
use std::future::Future;
use std::sync::mpsc;
use std::task::{Context, Poll, Waker};
use std::time::Duration;

/// Timeout after which the GPU counts as lost.
const WAIT_TIMEOUT: Duration = Duration::from_secs(30);

/// Premultiplied, sRGB-encoded colour and coverage after finishing, without background.
pub fn read_premultiplied(
    device: &wgpu::Device,
    queue: &wgpu::Queue,
    image: &SplatTarget,
) -> Result<Image<[f32; 4]>, GpuError> {
    let (width, height) = image.size();
    let halves = read_texels::<[u16; 4]>(device, queue, image.texture(), width, height)?;
    let finish = image.finish();
    Ok(halves.map(|texel| finish.apply(texel.map(f32_from_f16))))
}

/// Bytes as displayed: `image` over an sRGB-encoded background, opaque RGBA. `format` is
/// `Rgba8Unorm` or `Rgba8UnormSrgb`; both give the same bytes.
pub fn read_composited(
    device: &wgpu::Device,
    queue: &wgpu::Queue,
    image: &SplatTarget,
    background: [f32; 3],
    format: wgpu::TextureFormat,
) -> Result<Image<[u8; 4]>, GpuError> {
    let (width, height) = image.size();
    let screen = device.create_texture(&wgpu::TextureDescriptor {
        label: Some("screenshot"),
        size: image.texture().size(),
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format,
        usage: wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::COPY_SRC,
        view_formats: &[],
    });
    let mut compositor = Compositor::new(device, format);
    compositor.prepare(device, queue, image, background);
    let mut encoder = device.create_command_encoder(&Default::default());
    let view = screen.create_view(&Default::default());
    let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
        label: Some("screenshot"),
        color_attachments: &[Some(wgpu::RenderPassColorAttachment {
            view: &view,
            depth_slice: None,
            resolve_target: None,
            ops: Default::default(),
        })],
        ..Default::default()
    });
    compositor.draw(&mut pass);
    drop(pass);
    queue.submit([encoder.finish()]);
    read_texels(device, queue, &screen, width, height)
}

/// Reads the upper left `width` by `height` texels, each a `T`.
fn read_texels<T: bytemuck::AnyBitPattern>(
    device: &wgpu::Device,
    queue: &wgpu::Queue,
    texture: &wgpu::Texture,
    width: u32,
    height: u32,
) -> Result<Image<T>, GpuError> {
    if width == 0 || height == 0 {
        return Ok(Image::from_vec(width as usize, height as usize, Vec::new()));
    }
    let row_bytes = width as usize * size_of::<T>();
    // wgpu requires row strides that are multiples of 256 bytes.
    let stride = row_bytes.next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT as usize);
    let staging = device.create_buffer(&wgpu::BufferDescriptor {
        label: Some("readback"),
        size: (stride * height as usize) as u64,
        usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
        mapped_at_creation: false,
    });
    let mut encoder = device.create_command_encoder(&Default::default());
    encoder.copy_texture_to_buffer(
        texture.as_image_copy(),
        wgpu::TexelCopyBufferInfo {
            buffer: &staging,
            layout: wgpu::TexelCopyBufferLayout {
                offset: 0,
                bytes_per_row: Some(stride as u32),
                rows_per_image: None,
            },
        },
        wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
    );
    let submission = queue.submit([encoder.finish()]);
    let failed = |reason: String| GpuError::Readback { width, height, reason };
    let map = (&staging, wgpu::MapMode::Read, staging.size());
    wait_mapped(device, submission, &[map]).map_err(failed)?;
    let bytes = staging.get_mapped_range(..).map_err(|error| failed(error.to_string()))?;
    let data = bytes
        .chunks_exact(stride)
        .flat_map(|row| row[..row_bytes].chunks_exact(size_of::<T>()))
        .map(bytemuck::pod_read_unaligned)
        .collect();
    Ok(Image::from_vec(width as usize, height as usize, data))
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

/// Polls a future once. Native wgpu futures resolve immediately; `None` if this one does not.
pub(super) fn poll_once<T>(future: impl Future<Output = T>) -> Option<T> {
    match std::pin::pin!(future).poll(&mut Context::from_waker(Waker::noop())) {
        Poll::Ready(value) => Some(value),
        Poll::Pending => None,
    }
}

/// Waits for a submission and maps the first bytes of each buffer, with mode and length as given.
///
/// # Errors
/// Message from wgpu or the driver.
pub(super) fn wait_mapped(
    device: &wgpu::Device,
    submission: wgpu::SubmissionIndex,
    maps: &[(&wgpu::Buffer, wgpu::MapMode, u64)],
) -> Result<(), String> {
    let (sender, receiver) = mpsc::sync_channel(maps.len());
    for &(buffer, mode, bytes) in maps {
        let sender = sender.clone();
        buffer.map_async(mode, ..bytes, move |result| {
            // The receiver is gone only if the wait below has already failed.
            let _ = sender.send(result);
        });
    }
    let patiently =
        wgpu::PollType::Wait { submission_index: Some(submission), timeout: Some(WAIT_TIMEOUT) };
    device.poll(patiently).map_err(|error| error.to_string())?;
    // All callbacks have run by now, or never will.
    let mut n_mapped = 0;
    for result in receiver.try_iter() {
        result.map_err(|error| error.to_string())?;
        n_mapped += 1;
    }
    if n_mapped < maps.len() { Err("a buffer was never mapped".to_owned()) } else { Ok(()) }
}

#[cfg(test)]
mod tests {
    use super::f32_from_f16;

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
}
