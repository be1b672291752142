//! Contents of the room: large plain walls, fine and coarse patterns, curved and thin objects, with
//! occlusions.
//!
//! The seed varies textures and the colours of small objects, never shapes. So the camera path is free
//! of obstacles for every seed.

use super::solid::{Hit, Ray, Shape};
use super::texture::Texture;
use crate::math::rng::{Purpose, Rng};
use glam::{DVec3, Vec3, dvec3, vec3};

/// Corner of the room with the lowest coordinates, metres.
pub(super) const LO: DVec3 = dvec3(-2.6, -2.2, 0.0);
pub(super) const HI: DVec3 = dvec3(2.6, 2.2, 2.6);

/// Random stream of the furnishing. The noise streams of frames are numbered from 0.
const FURNISHING: u64 = u64::MAX;

#[derive(Clone, Copy, Debug)]
pub(super) struct Solid {
    pub shape: Shape,
    pub texture: Texture,
}

/// Solids and lamps of the room. The first solid is the shell of the room.
#[derive(Debug)]
pub(super) struct FurnishedRoom {
    pub solids: Vec<Solid>,
    pub lamps: Vec<Lamp>,
    pub seed: u32,
}

#[derive(Clone, Copy, Debug)]
pub(super) struct Lamp {
    pub corner: DVec3,
    pub edges: [DVec3; 2],
    pub normal: DVec3,
    /// Emitted radiance, linear RGB.
    pub radiance: Vec3,
}

const WINDOW_LIGHT: Lamp = Lamp {
    // In front of the pane, which would otherwise block the light.
    corner: dvec3(-0.9, -2.15, 0.9),
    edges: [dvec3(1.8, 0.0, 0.0), dvec3(0.0, 0.0, 1.2)],
    normal: DVec3::Y,
    radiance: vec3(5.2, 5.9, 6.6),
};

const CEILING_LIGHT: Lamp = Lamp {
    // Below the panel, for the same reason.
    corner: dvec3(-0.7, -0.5, 2.55),
    edges: [dvec3(1.4, 0.0, 0.0), dvec3(0.0, 1.0, 0.0)],
    normal: DVec3::NEG_Z,
    radiance: vec3(6.4, 5.5, 4.3),
};

impl FurnishedRoom {
    pub fn new(seed: u64) -> Self {
        let mut rng = Rng::new(seed, Purpose::Synthetic, FURNISHING);
        let mut solids =
            vec![Solid { shape: Shape::Shell { lo: LO, hi: HI }, texture: Texture::Walls }];
        add_fittings(&mut solids);
        add_table(&mut solids, &mut rng);
        add_furniture(&mut solids, &mut rng);
        let lamps = vec![WINDOW_LIGHT, CEILING_LIGHT];
        Self { solids, lamps, seed: rng.next_u64() as u32 }
    }

    pub fn bounds(&self) -> (DVec3, DVec3) {
        self.solids.first().map_or((LO, HI), |shell| shell.shape.bounds())
    }

    /// True if a solid other than the room's shell blocks `ray` for ray parameters between 0 and 1.
    pub fn is_blocked(&self, ray: &Ray) -> bool {
        // The surface at the end of the ray does not block it.
        let nearer = |hit: Hit| hit.t < 1.0 - 1e-6;
        // The shell encloses every ray that ends inside, so it never blocks.
        self.solids[1..].iter().any(|s| s.shape.intersect(ray).is_some_and(nearer))
    }
}

pub(super) fn block(lo: [f64; 3], hi: [f64; 3], texture: Texture) -> Solid {
    Solid { shape: Shape::Block { lo: lo.into(), hi: hi.into() }, texture }
}

pub(super) fn sphere(centre: [f64; 3], radius: f64, texture: Texture) -> Solid {
    Solid { shape: Shape::Sphere { centre: centre.into(), radius }, texture }
}

pub(super) fn cylinder(base: [f64; 3], radius: f64, height: f64, texture: Texture) -> Solid {
    Solid { shape: Shape::Cylinder { base: base.into(), radius, height }, texture }
}

pub(super) const OAK: Texture = Texture::Wood(vec3(0.46, 0.28, 0.14));
const WALNUT: Texture = Texture::Wood(vec3(0.24, 0.13, 0.07));
pub(super) const WHITE: Texture = Texture::Paint(vec3(0.78, 0.77, 0.74));

fn add_fittings(solids: &mut Vec<Solid>) {
    solids.extend([
        block([-1.0, -2.2, 0.8], [1.0, -2.18, 2.2], WHITE),
        block([-0.9, -2.2, 0.9], [0.9, -2.165, 2.1], Texture::Window),
        block([-1.05, -2.2, 0.76], [1.05, -2.05, 0.8], WHITE),
        block([-0.7, -0.5, 2.56], [0.7, 0.5, 2.6], Texture::Glow(vec3(3.2, 2.9, 2.4))),
        block([-0.72, 2.175, 1.1], [0.72, 2.2, 2.04], Texture::Wood(vec3(0.62, 0.42, 0.12))),
        block([-0.64, 2.165, 1.18], [0.64, 2.19, 1.96], Texture::Landscape),
        block([-2.6, -0.56, 1.16], [-2.58, 0.56, 1.96], WALNUT),
        block([-2.6, -0.5, 1.22], [-2.57, 0.5, 1.9], Texture::Abstract),
        cylinder([0.0, 0.0, 0.0], 1.45, 0.012, Texture::Rug),
    ]);
}

fn add_table(solids: &mut Vec<Solid>, rng: &mut Rng) {
    const TOP: f64 = 0.74;
    solids.push(block([-0.75, -0.45, 0.70], [0.75, 0.45, TOP], OAK));
    // The legs end on the rug, which is 12 mm thick.
    for (x, y) in [(-0.7, -0.4), (0.64, -0.4), (-0.7, 0.34), (0.64, 0.34)] {
        solids.push(block([x, y, 0.012], [x + 0.06, y + 0.06, 0.70], OAK));
    }
    // Colours are drawn in sequence: inserting an object recolours those after it.
    let ring = Shape::Torus { centre: dvec3(0.3, -0.16, TOP + 0.055), major: 0.15, minor: 0.055 };
    solids.extend([
        sphere([-0.38, 0.1, TOP + 0.16], 0.16, Texture::Marble(bright(rng))),
        Solid { shape: ring, texture: Texture::Candy(bright(rng)) },
        block([0.24, 0.12, TOP], [0.5, 0.34, TOP + 0.2], Texture::Checker(bright(rng))),
        cylinder([-0.02, 0.2, TOP], 0.075, 0.3, Texture::Glaze(bright(rng))),
        sphere([-0.02, 0.2, TOP + 0.4], 0.14, Texture::Leaves),
        cylinder([-0.12, -0.26, TOP], 0.05, 0.11, Texture::Glaze(bright(rng))),
        block([-0.6, -0.34, TOP], [-0.34, -0.14, TOP + 0.035], Texture::Cover(bright(rng))),
        block([-0.58, -0.33, TOP + 0.035], [-0.36, -0.16, TOP + 0.06], Texture::Cover(bright(rng))),
    ]);
}

fn add_furniture(solids: &mut Vec<Solid>, rng: &mut Rng) {
    let sofa = Texture::Fabric(vec3(0.10, 0.24, 0.30));
    let pillow = Texture::Fabric(vec3(0.70, 0.42, 0.10));
    solids.extend([
        block([-2.5, -0.95, 0.08], [-1.75, 0.95, 0.42], sofa),
        block([-2.58, -0.95, 0.08], [-2.32, 0.95, 0.86], sofa),
        block([-2.5, -1.12, 0.08], [-1.75, -0.95, 0.6], sofa),
        block([-2.5, 0.95, 0.08], [-1.75, 1.12, 0.6], sofa),
        block([-2.32, -0.85, 0.42], [-2.16, -0.42, 0.76], pillow),
        block([-2.32, 0.4, 0.42], [-2.16, 0.82, 0.76], Texture::Checker(vec3(0.62, 0.16, 0.13))),
        block([2.28, -1.05, 0.0], [2.6, 0.55, 1.95], Texture::Books),
        cylinder([2.3, 1.2, 0.0], 0.17, 0.34, Texture::Glaze(vec3(0.72, 0.30, 0.16))),
        sphere([2.3, 1.2, 0.72], 0.34, Texture::Leaves),
        sphere([2.24, 1.16, 1.14], 0.22, Texture::Leaves),
        block([-0.95, 1.78, 0.1], [0.95, 2.2, 0.8], Texture::Drawers),
        block([-0.9, 1.84, 0.0], [0.9, 2.2, 0.1], WALNUT),
        cylinder([0.7, 1.98, 0.8], 0.07, 0.2, Texture::Glaze(bright(rng))),
        sphere([0.7, 1.98, 1.12], 0.15, Texture::Leaves),
        sphere([-0.68, 1.98, 0.93], 0.13, Texture::Marble(vec3(0.75, 0.73, 0.70))),
        sphere([-1.75, 1.6, 0.3], 0.3, Texture::Ball(bright(rng))),
        cylinder([1.5, -1.6, 0.0], 0.24, 0.45, Texture::Fabric(vec3(0.55, 0.20, 0.16))),
        block([-2.3, -1.95, 0.0], [-1.6, -1.4, 0.5], Texture::Checker(vec3(0.16, 0.32, 0.42))),
    ]);
}

fn bright(rng: &mut Rng) -> Vec3 {
    let hue = rng.range(0.0, 6.0) as f32;
    let channel = |shift: f32| {
        // Hues between 0.09 and 0.55, neither black nor white.
        let distance = ((hue + shift) % 6.0 - 3.0).abs() - 1.0;
        0.09 + 0.46 * distance.clamp(0.0, 1.0)
    };
    vec3(channel(0.0), channel(4.0), channel(2.0))
}
