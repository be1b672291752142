//! Lost devices, and errors that no call returns.

use super::compare::largest_difference;
use super::device::{Gpu, PLAIN, outside, random_scene};

#[test]
fn a_lost_device_is_reported_and_rebuilt_from_the_splats() {
    let Some(gpu) = Gpu::to_be_lost() else { return };
    let view = outside(64, 48);
    let splats = random_scene(13, 100, 0.3);
    let scene = gpu.scene(&splats);
    let mut renderer = gpu.renderer();
    let before = gpu.drawn(&mut renderer, &scene, &view, &PLAIN);
    assert!(!gpu.faults.is_lost());
    gpu.device.destroy();
    let _ = gpu.device.poll(wgpu::PollType::Poll);
    assert!(gpu.faults.is_lost());
    assert_eq!(gpu.faults.take_new().len(), 1);
    // Drawing on a lost device neither panics nor hangs.
    gpu.draw(&mut renderer, &scene, &view, &PLAIN);

    drop((renderer, scene, gpu));
    let fresh = Gpu::to_be_lost().unwrap();
    assert_eq!(largest_difference(&before, &fresh.image(&splats, &view, &PLAIN)), 0.0);
}

#[test]
fn uncaptured_errors_reach_the_sink() {
    let Some(gpu) = Gpu::new() else { return };
    for _ in 0..3 {
        // Invalid usage: without MAPPABLE_PRIMARY_BUFFERS, MAP_WRITE allows COPY_SRC only.
        let _ = gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("invalid"),
            size: 4,
            usage: wgpu::BufferUsages::MAP_WRITE | wgpu::BufferUsages::STORAGE,
            mapped_at_creation: false,
        });
    }
    let faults = gpu.faults.take_new();
    assert_eq!(faults.len(), 1, "{faults:?}");
}
