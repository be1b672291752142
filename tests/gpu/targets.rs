//! Render targets: formats, part of a foreign pass, and timing.

use super::device::{Gpu, PLAIN, outside, random_scene};
use super::readback;
use vbgs_studio::render::gpu::adapters::GpuCaps;
use vbgs_studio::render::gpu::composite::Compositor;
use vbgs_studio::render::gpu::renderer::SplatTarget;

#[test]
fn every_target_format_shows_the_same_values() {
    let Some(gpu) = Gpu::new() else { return };
    let view = outside(70, 50);
    let splats = random_scene(10, 200, 0.3);
    let scene = gpu.scene(&splats);
    let mut renderer = gpu.renderer();
    gpu.draw(&mut renderer, &scene, &view, &PLAIN);
    let background = [0.9, 0.1, 0.3];
    let image = gpu.read(&renderer);
    let shown = |format| {
        readback::composited(&gpu.device, &gpu.queue, renderer.target(), background, format)
    };
    let plain = shown(wgpu::TextureFormat::Rgba8Unorm);
    let encoding = shown(wgpu::TextureFormat::Rgba8UnormSrgb);
    for ((texel, plain), encoding) in image.data.iter().zip(&plain.data).zip(&encoding.data) {
        for channel in 0..3 {
            let value = texel[channel] + (1.0 - texel[3]) * background[channel];
            let expected = value.clamp(0.0, 1.0) * 255.0;
            // GPUs may blend and round differently, by at most one level.
            assert!((f32::from(plain[channel]) - expected).abs() <= 1.0, "{plain:?} {expected}");
            assert!(plain[channel].abs_diff(encoding[channel]) <= 1, "{plain:?} {encoding:?}");
        }
        assert_eq!((plain[3], encoding[3]), (255, 255));
    }
    gpu.assert_no_faults();
}

#[test]
fn composites_into_part_of_a_foreign_pass() {
    let Some(gpu) = Gpu::new() else { return };
    let view = outside(16, 12);
    let splats = random_scene(11, 60, 0.5);
    let scene = gpu.scene(&splats);
    let mut renderer = gpu.renderer();
    gpu.draw(&mut renderer, &scene, &view, &PLAIN);
    let (device, queue) = (&gpu.device, &gpu.queue);
    let alone = gpu.read(&renderer);

    // A window in Rgba16Float, so that the same readback works; the image is at (5, 3).
    let window = SplatTarget::new(device, 40, 30).unwrap();
    let mut compositor = Compositor::new(device, wgpu::TextureFormat::Rgba16Float);
    compositor.prepare(device, queue, renderer.target(), [0.0, 0.0, 1.0], None);
    readback::draw(device, queue, window.view(), |pass| {
        pass.set_viewport(5.0, 3.0, 16.0, 12.0, 0.0, 1.0);
        compositor.draw(pass);
    });
    let shown = readback::premultiplied(device, queue, &window);
    for row in 0..30 {
        for column in 0..40 {
            let inside = (5..21).contains(&column) && (3..15).contains(&row);
            let expected = if inside {
                let [r, g, b, a] = *alone.at(column - 5, row - 3);
                [r, g, b + 1.0 - a, 1.0]
            } else {
                [0.0; 4]
            };
            for (found, expected) in shown.at(column, row).iter().zip(expected) {
                assert!((found - expected).abs() < 1e-3, "{column},{row}: {found} for {expected}");
            }
        }
    }
    gpu.assert_no_faults();
}

#[test]
fn pass_times_come_back_where_the_adapter_has_them() {
    let Some(gpu) = Gpu::new() else { return };
    let caps = GpuCaps::new(&gpu.adapter, &gpu.device);
    let view = outside(64, 48);
    let splats = random_scene(12, 300, 0.3);
    let scene = gpu.scene(&splats);
    let mut renderer = gpu.renderer();
    for _ in 0..8 {
        gpu.draw(&mut renderer, &scene, &view, &PLAIN);
        gpu.device.poll(wgpu::PollType::wait_indefinitely()).unwrap();
    }
    // Encoders that are never submitted must not exhaust the timer's slots.
    for _ in 0..8 {
        let mut lost = gpu.device.create_command_encoder(&Default::default());
        renderer.render(&gpu.device, &gpu.queue, &mut lost, &scene, &view, &PLAIN).unwrap();
    }
    println!("splat pass: {:?}", renderer.gpu_times());
    assert_eq!(renderer.gpu_times().is_some(), caps.has_timestamps);
    if let Some(times) = renderer.gpu_times() {
        assert!((0.0..10_000.0).contains(&times.draw), "{times:?}");
    }
    gpu.assert_no_faults();
}
