//! Contents of the phone's scenes.

use super::door;
use super::parts::{CABLE, fine, rod, sagging_cable};
use crate::dataset::synthetic::fine_texture::FineTexture;
use crate::dataset::synthetic::params::PhoneScene;
use crate::dataset::synthetic::room::{FurnishedRoom, Solid, sphere};
use crate::dataset::synthetic::texture::Texture;
use glam::{dvec3, vec3};

pub fn furnish(scene: PhoneScene, seed: u64) -> FurnishedRoom {
    match scene {
        PhoneScene::Room => {
            let mut room = FurnishedRoom::new(seed);
            add_panels(&mut room.solids);
            add_cables(&mut room.solids);
            room
        }
        PhoneScene::Door => door::hallway(seed),
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
    let at = |(x, y): (f64, f64)| dvec3(x, y, 0.018);
    solids.extend(floor.array_windows().map(|[a, b]| rod(at(*a), at(*b), 0.006, red)));
}
