//! Contents of the phone's scenes.

use crate::dataset::synthetic::fine_texture::FineTexture;
use crate::dataset::synthetic::params::PhoneScene;
use crate::dataset::synthetic::room::{FurnishedRoom, Lamp, Solid, WHITE, block, sphere};
use crate::dataset::synthetic::solid::{Capsule, Shape};
use crate::dataset::synthetic::texture::Texture;
use crate::math::rng::{Purpose, Rng};
use glam::{DVec3, dvec3, vec3};

pub fn furnish(scene: PhoneScene, seed: u64) -> FurnishedRoom {
    match scene {
        PhoneScene::Room => {
            let mut room = FurnishedRoom::new(seed);
            add_panels(&mut room.solids);
            add_cables(&mut room.solids);
            room
        }
        PhoneScene::Door => hallway(seed),
    }
}

fn add_panels(solids: &mut Vec<Solid>) {
    let oak = FineTexture::Grain(vec3(0.44, 0.27, 0.13));
    solids.extend([
        fine([-2.3, -2.2, 1.1], [-1.45, -2.19, 2.2], FineTexture::Poster),
        fine([1.3, -2.2, 0.0], [2.5, -2.19, 1.0], FineTexture::Tiles),
        fine([1.2, 2.185, 0.9], [2.2, 2.2, 2.3], oak),
        fine([-2.6, 1.2, 1.1], [-2.59, 1.75, 1.9], FineTexture::Poster),
        fine([2.59, 0.8, 1.45], [2.6, 1.7, 2.2], FineTexture::Printed(0.03)),
        fine([0.52, -0.42, 0.74], [0.73, -0.12, 0.742], FineTexture::Printed(0.0075)),
        fine([-2.2, -0.2, 0.42], [-1.9, 0.22, 0.423], FineTexture::Printed(0.012)),
        fine([-1.2, 0.75, 0.0122], [-0.78, 1.05, 0.014], FineTexture::Printed(0.02)),
        fine([-2.0, 2.17, 1.2], [-1.0, 2.2, 1.75], oak),
    ]);
}

fn add_cables(solids: &mut Vec<Solid>) {
    let black = FineTexture::Rubber(vec3(0.02, 0.02, 0.022));
    let white = FineTexture::Rubber(vec3(0.72, 0.72, 0.70));
    let red = FineTexture::Rubber(vec3(0.55, 0.05, 0.03));
    solids.push(rod(dvec3(0.05, 0.0, 2.55), dvec3(0.05, 0.0, 1.95), CABLE, black));
    solids.push(sphere([0.05, 0.0, 1.85], 0.1, Texture::Paint(vec3(0.70, 0.42, 0.10))));
    solids.extend(sagging_cable(dvec3(-2.5, 2.08, 2.3), dvec3(-0.8, 2.08, 2.1), 0.45, black));
    solids.extend(sagging_cable(dvec3(1.1, -2.1, 2.3), dvec3(2.5, -2.05, 1.9), 0.35, white));
    solids.extend(sagging_cable(dvec3(-0.3, -0.46, 0.745), dvec3(0.6, -0.46, 0.745), 0.4, red));
    let floor = [(-1.7, -1.3), (-1.1, -1.6), (-0.4, -1.55), (0.1, -1.75), (0.9, -1.6)];
    // The height of the rug plus the cable's radius.
    let at = |(x, y): (f64, f64)| dvec3(x, y, 0.018);
    solids.extend(floor.array_windows().map(|[a, b]| rod(at(*a), at(*b), 0.006, red)));
}

/// Radius of loose cables, metres.
pub(super) const CABLE: f64 = 0.004;
const PIECES: usize = 12;

pub(super) fn fine(lo: [f64; 3], hi: [f64; 3], texture: FineTexture) -> Solid {
    block(lo, hi, Texture::Fine(texture))
}

pub(super) fn rod(from: DVec3, to: DVec3, radius: f64, texture: FineTexture) -> Solid {
    Solid { shape: Shape::Cable(Capsule { from, to, radius }), texture: Texture::Fine(texture) }
}

pub(super) fn sagging_cable(
    from: DVec3,
    to: DVec3,
    sag: f64,
    texture: FineTexture,
) -> impl Iterator<Item = Solid> {
    let at = move |i: usize| {
        let part = i as f64 / PIECES as f64;
        // A parabola approximates a hanging cable.
        from.lerp(to, part) - DVec3::Z * (4.0 * sag * part * (1.0 - part))
    };
    (0..PIECES).map(move |i| rod(at(i), at(i + 1), CABLE, texture))
}

const LO: DVec3 = dvec3(-2.2, -2.8, 0.0);
const HI: DVec3 = dvec3(2.2, 0.0, 2.5);
/// Random stream of the furnishing, equal to that of the furnished room.
const STREAM: u64 = u64::MAX;

const WINDOW: Lamp = Lamp {
    // In front of the pane, which would otherwise block the light.
    corner: dvec3(-0.9, -2.75, 0.9),
    edges: [dvec3(1.8, 0.0, 0.0), dvec3(0.0, 0.0, 1.2)],
    normal: DVec3::Y,
    radiance: vec3(4.2, 4.6, 5.0),
};

const PANEL: Lamp = Lamp {
    // Below the panel, for the same reason.
    corner: dvec3(-0.6, -1.7, 2.45),
    edges: [dvec3(1.2, 0.0, 0.0), dvec3(0.0, 0.8, 0.0)],
    normal: DVec3::NEG_Z,
    radiance: vec3(7.6, 6.8, 5.6),
};

const FRAME: FineTexture = FineTexture::Grain(vec3(0.62, 0.53, 0.40));
const STEEL: FineTexture = FineTexture::Steel;

pub(super) fn hallway(seed: u64) -> FurnishedRoom {
    let mut rng = Rng::new(seed, Purpose::Synthetic, STREAM);
    let tone = rng.range(0.85, 1.15) as f32;
    let shell = Shape::Shell { lo: LO, hi: HI };
    let mut solids = vec![Solid { shape: shell, texture: Texture::Fine(FineTexture::Hallway) }];
    add_door(&mut solids, FineTexture::Grain(vec3(0.42, 0.24, 0.11) * tone));
    add_fittings(&mut solids);
    add_surroundings(&mut solids);
    FurnishedRoom { solids, lamps: vec![WINDOW, PANEL], seed: rng.next_u64() as u32 }
}

fn add_door(solids: &mut Vec<Solid>, wood: FineTexture) {
    solids.extend([
        fine([-0.43, -0.016, 0.01], [0.43, 0.0, 2.01], wood),
        fine([-0.515, -0.03, 0.0], [-0.434, 0.0, 2.095], FRAME),
        fine([0.434, -0.03, 0.0], [0.515, 0.0, 2.095], FRAME),
        fine([-0.434, -0.03, 2.014], [0.434, 0.0, 2.095], FRAME),
        fine([-0.434, -0.03, 0.0], [0.434, 0.0, 0.006], STEEL),
    ]);
    for z in [0.25, 1.0, 1.75] {
        let at = |z: f64| dvec3(-0.438, -0.036, z);
        solids.push(rod(at(z), at(z + 0.1), 0.008, STEEL));
    }
}

fn add_fittings(solids: &mut Vec<Solid>) {
    let lever = dvec3(0.352, -0.075, 1.1);
    solids.extend([
        fine([0.33, -0.024, 0.93], [0.375, -0.016, 1.17], STEEL),
        rod(dvec3(0.352, -0.02, 1.1), lever, 0.009, STEEL),
        rod(lever, dvec3(0.232, -0.075, 1.1), 0.009, STEEL),
        sphere([0.352, -0.02, 1.0], 0.009, Texture::Paint(vec3(0.02, 0.02, 0.02))),
        sphere([0.0, -0.012, 1.52], 0.012, Texture::Fine(STEEL)),
        fine([-0.09, -0.019, 1.58], [0.09, -0.016, 1.66], FineTexture::Printed(0.035)),
        fine([-0.2, -0.0175, 1.1], [0.01, -0.016, 1.397], FineTexture::Printed(0.0075)),
        fine([-0.4, -0.018, 0.04], [0.4, -0.016, 0.24], STEEL),
    ]);
}

fn add_surroundings(solids: &mut Vec<Solid>) {
    let black = FineTexture::Rubber(vec3(0.02, 0.02, 0.022));
    let white = FineTexture::Rubber(vec3(0.72, 0.72, 0.70));
    let oak = FineTexture::Grain(vec3(0.46, 0.29, 0.15));
    solids.extend([
        block([0.62, -0.012, 1.02], [0.7, 0.0, 1.1], WHITE),
        block([0.635, -0.018, 1.035], [0.685, -0.012, 1.085], WHITE),
        fine([-1.4, -0.006, 0.95], [-0.75, 0.0, 1.85], FineTexture::Poster),
        fine([0.85, -0.006, 1.25], [1.15, 0.0, 1.67], FineTexture::Printed(0.012)),
        fine([-2.2, -0.015, 0.0], [-0.515, 0.0, 0.09], oak),
        fine([0.515, -0.015, 0.0], [2.2, 0.0, 0.09], oak),
        block([-0.4, -0.75, 0.0], [0.4, -0.2, 0.012], Texture::Fabric(vec3(0.16, 0.14, 0.12))),
        fine([1.35, -0.3, 0.0], [1.95, 0.0, 0.9], oak),
        sphere([1.65, -0.16, 1.02], 0.13, Texture::Marble(vec3(0.10, 0.34, 0.38))),
        block([-0.6, -1.7, 2.46], [0.6, -0.9, 2.5], Texture::Glow(vec3(3.2, 2.9, 2.4))),
        block([-0.9, -2.8, 0.9], [0.9, -2.765, 2.1], Texture::Window),
        rod(dvec3(0.66, -0.007, 1.1), dvec3(0.66, -0.007, 2.5), 0.004, white),
        // A freely hanging bell cord with its knob.
        rod(dvec3(-0.62, -0.12, 2.5), dvec3(-0.62, -0.12, 1.2), 0.004, black),
        sphere([-0.62, -0.12, 1.18], 0.02, Texture::Fine(oak)),
    ]);
    solids.extend(sagging_cable(dvec3(0.75, -0.05, 2.2), dvec3(1.7, -0.05, 2.0), 0.35, black));
}
