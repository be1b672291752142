//! Triangles of the user interface in the stored window image: the right pixels and no others.

use super::fixture::Fixture;
use super::readback;
use vbgs_studio::math::image::{Image, RgbImage};
use vbgs_studio::render::gpu::meshes::{
    MeshBatch, MeshKind, MeshList, MeshPainter, MeshSampling, MeshVertex, PixelRect,
};
use vbgs_studio::render::gpu::renderer::SplatTarget;

/// Columns and rows of the window.
const SIZE: [u32; 2] = [8, 4];
const WHOLE: PixelRect = PixelRect { min: [0; 2], max: SIZE };
const RED: [u8; 4] = [255, 0, 0, 255];
const WHITE: [u8; 4] = [255; 4];
/// Half-float rounding near 1.
const HALF_FLOAT: f32 = 1e-3;

struct Window<'a> {
    gpu: &'a Fixture,
    painter: MeshPainter,
}

impl<'a> Window<'a> {
    fn new(gpu: &'a Fixture) -> Self {
        Self { gpu, painter: MeshPainter::new(&gpu.device, wgpu::TextureFormat::Rgba16Float) }
    }

    /// Draws a list and returns the window's image.
    fn draw(&mut self, size: [u32; 2], list: &MeshList) -> Image<[f32; 4]> {
        let Fixture { device, queue, .. } = self.gpu;
        let target = SplatTarget::new(device, size[0], size[1]).unwrap();
        self.submit(size, list);
        readback::draw(device, queue, target.view(), |pass| self.painter.show(pass));
        self.gpu.assert_no_faults();
        readback::premultiplied(device, queue, &target)
    }

    fn submit(&mut self, size: [u32; 2], list: &MeshList) {
        let Fixture { device, queue, .. } = self.gpu;
        let mut encoder = device.create_command_encoder(&Default::default());
        self.painter.draw(device, queue, &mut encoder, size, list);
        queue.submit([encoder.finish()]);
    }

    /// A texture of two texels, black and white.
    fn set_texture(&mut self, key: u64, is_smooth: bool) {
        let Fixture { device, queue, .. } = self.gpu;
        let size = wgpu::Extent3d { width: 2, height: 1, depth_or_array_layers: 1 };
        let texture = device.create_texture(&wgpu::TextureDescriptor {
            label: None,
            size,
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: wgpu::TextureFormat::Rgba8Unorm,
            usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
            view_formats: &[],
        });
        let texels = [0, 0, 0, 255, 255, 255, 255, 255];
        queue.write_texture(texture.as_image_copy(), &texels, Default::default(), size);
        let sampling =
            MeshSampling { is_magnified_smoothly: is_smooth, is_minified_smoothly: is_smooth };
        self.painter.set_texture(device, key, &texture, sampling);
    }
}

/// Adds two triangles that cover the scissor rectangle.
fn cover(list: &mut MeshList, kind: MeshKind, scissor: PixelRect, color: [u8; 4]) {
    let corners = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]];
    let (vertex, index) = (list.vertices.len() as u32, list.indices.len() as u32);
    list.vertices.extend(corners.map(|[u, v]| MeshVertex {
        position: [2.0 * u - 1.0, 1.0 - 2.0 * v],
        uv: [u, v],
        color,
    }));
    list.indices.extend([0, 1, 2, 2, 1, 3].map(|corner| vertex + corner));
    list.batches.push(MeshBatch { kind, scissor, indices: index..index + 6 });
}

fn row(shown: &Image<[f32; 4]>) -> Vec<[f32; 4]> {
    shown.data[..shown.width].to_vec()
}

#[track_caller]
fn assert_near(found: &[[f32; 4]], expected: &[[f32; 4]]) {
    assert_eq!(found.len(), expected.len());
    let is_near = found.iter().flatten().zip(expected.iter().flatten());
    assert!(is_near.into_iter().all(|(a, b)| (a - b).abs() < HALF_FLOAT), "{found:?}");
}

#[test]
fn batches_are_drawn_in_order_within_their_scissors() {
    let Some(gpu) = Fixture::shared() else { return };
    let mut window = Window::new(&gpu);
    window.set_texture(7, false);
    let mut list = MeshList::default();
    cover(&mut list, MeshKind::Opaque, WHOLE, RED);
    let columns = |from, to| PixelRect { min: [from, 0], max: [to, 2] };
    // Blue at half opacity over red, and green at half opacity times the texture.
    cover(&mut list, MeshKind::Blended, columns(1, 3), [0, 0, 128, 128]);
    cover(&mut list, MeshKind::Textured(7), columns(3, 6), [0, 128, 0, 128]);
    // A missing texture draws nothing and keeps the rest.
    cover(&mut list, MeshKind::Textured(8), WHOLE, WHITE);
    let shown = window.draw(SIZE, &list);
    let half = 128.0 / 255.0;
    let (red, blue) = ([1.0, 0.0, 0.0, 1.0], [1.0 - half, 0.0, half, 1.0]);
    let (black, green) = ([1.0 - half, 0.0, 0.0, 1.0], [1.0 - half, half, 0.0, 1.0]);
    assert_near(&row(&shown), &[red, blue, blue, black, green, green, red, red]);
    assert_near(&shown.data[3 * shown.width..], &[red; 8]);
}

#[test]
fn drawing_on_a_lost_device_does_not_panic() {
    let Some(gpu) = Fixture::own(|_| ()) else { return };
    let mut window = Window::new(&gpu);
    let mut list = MeshList::default();
    cover(&mut list, MeshKind::Opaque, WHOLE, RED);
    window.draw(SIZE, &list);
    gpu.device.destroy();
    let _ = gpu.device.poll(wgpu::PollType::Poll);
    assert!(gpu.faults.is_lost());
    window.submit(SIZE, &list);
}

#[test]
fn what_is_not_drawn_again_stays_until_the_size_changes() {
    let Some(gpu) = Fixture::shared() else { return };
    let mut window = Window::new(&gpu);
    assert_eq!(window.painter.size(), None);
    let mut list = MeshList::default();
    cover(&mut list, MeshKind::Opaque, WHOLE, RED);
    window.draw(SIZE, &list);
    assert_eq!(window.painter.size(), Some(SIZE));
    let mut corner = MeshList::default();
    cover(&mut corner, MeshKind::Opaque, PixelRect { min: [0; 2], max: [2, 1] }, WHITE);
    let (red, white) = ([1.0, 0.0, 0.0, 1.0], [1.0; 4]);
    let expected = [white, white, red, red, red, red, red, red];
    assert_near(&row(&window.draw(SIZE, &corner)), &expected);
    assert_near(&row(&window.draw(SIZE, &MeshList::default())), &expected);
    let other = [3, 1];
    let mut all = MeshList::default();
    cover(&mut all, MeshKind::Opaque, PixelRect { min: [0; 2], max: other }, WHITE);
    assert_near(&row(&window.draw(other, &all)), &[white; 3]);
}

#[test]
fn textures_are_read_as_they_ask_for() {
    let Some(gpu) = Fixture::shared() else { return };
    let mut window = Window::new(&gpu);
    let mut list = MeshList::default();
    cover(&mut list, MeshKind::Textured(1), WHOLE, WHITE);
    let mut gray = |is_smooth| {
        window.set_texture(1, is_smooth);
        row(&window.draw(SIZE, &list)).iter().map(|pixel| pixel[0]).collect::<Vec<f32>>()
    };
    assert_eq!(gray(false), [0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0]);
    // Linear interpolation between the centres of the texels.
    let smooth = gray(true);
    let expected = [0.0, 0.0, 0.125, 0.375, 0.625, 0.875, 1.0, 1.0];
    // Sampler weights have eight bits.
    let is_near = smooth.iter().zip(expected).all(|(a, b): (&f32, f32)| (a - b).abs() < 0.01);
    assert!(is_near, "{smooth:?}");
    window.painter.retain_textures(|_| false);
    let mut black = MeshList::default();
    cover(&mut black, MeshKind::Opaque, WHOLE, [0, 0, 0, 255]);
    window.draw(SIZE, &black);
    let forgotten: RgbImage = window.draw(SIZE, &list).map(|&[r, g, b, _]| [r, g, b]);
    assert!(forgotten.data.iter().all(|pixel| *pixel == [0.0; 3]), "{forgotten:?}");
}
