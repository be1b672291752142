//! Flat parts, rods and cables.

use crate::dataset::synthetic::capsule::Capsule;
use crate::dataset::synthetic::fine_texture::FineTexture;
use crate::dataset::synthetic::room::{Solid, block};
use crate::dataset::synthetic::solid::Shape;
use crate::dataset::synthetic::texture::Texture;
use glam::DVec3;

/// Radius of loose cables, metres.
pub(super) const CABLE: f64 = 0.004;
/// Straight segments of a sagging cable.
const PIECES: usize = 12;

pub(super) fn fine(lo: [f64; 3], hi: [f64; 3], texture: FineTexture) -> Solid {
    block(lo, hi, Texture::Fine(texture))
}

pub(super) fn rod(from: DVec3, to: DVec3, radius: f64, texture: FineTexture) -> Solid {
    Solid { shape: Shape::Cable(Capsule { from, to, radius }), texture: Texture::Fine(texture) }
}

/// Cable that sags by `sag` metres between its ends.
pub(super) fn sagging_cable(
    from: DVec3,
    to: DVec3,
    sag: f64,
    texture: FineTexture,
) -> impl Iterator<Item = Solid> {
    let at = move |i: usize| {
        let part = i as f64 / PIECES as f64;
        from.lerp(to, part) - DVec3::Z * (4.0 * sag * part * (1.0 - part))
    };
    (0..PIECES).map(move |i| rod(at(i), at(i + 1), CABLE, texture))
}
