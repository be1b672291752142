//! Surfaces that a view shows: for every pixel the splats with the largest weights, and where its ray meets
//! their planes. Training adds photographs to textures there.

use super::raster::{DrawRow, RowCanvas, RowInputs};
use super::renderer::CpuRenderer;
use super::rows::longest_first;
use super::textures::{Owners, SurfacePlane, meet};
use super::tile::{GROUPS, Plane, Tile};
use super::view::CpuView;
use crate::math::camera::{Camera, Intrinsics};
use crate::math::simd::{Isa, Kernel, LANES, Vector};
use crate::model::splat::appearance::SplatView;
use crate::model::splat::texture::Lattice;
use crate::render::finish::Finish;
use crate::render::options::{RenderOptions, TILE};

/// A textured splat in a pixel.
#[derive(Clone, Copy, Debug)]
pub struct ShownSurface {
    /// Number of the splat.
    pub splat: u32,
    /// Blending weight of the splat.
    pub weight: f32,
    /// Place in the splat's lattice where the ray meets it, in texels from the corner; may lie outside.
    pub place: [f32; 2],
    /// Depth of the surface along the optical axis, world units.
    pub depth: f32,
    /// Colour of the splat in this view minus its colour seen from the mean of the observed directions.
    pub shift: [f32; 3],
}

/// One drawn tile that shows textured splats.
pub struct SurfaceTile<'a> {
    tile: &'a Tile,
    owners: &'a Owners,
    planes: &'a [SurfacePlane],
    met: [MetPlanes; 2],
    /// First pixel column and row in the image.
    pub first: [usize; 2],
}

/// Where the rays of a tile meet the planes of one splat a pixel.
struct MetPlanes {
    place: [Plane; 2],
    /// Not a number where a plane is not met.
    depth: Plane,
}

struct MeetTile<'a> {
    tile: &'a Tile,
    owners: &'a Owners,
    planes: &'a [SurfacePlane],
    intrinsics: &'a Intrinsics,
}

impl Kernel for MeetTile<'_> {
    type Output = [MetPlanes; 2];

    #[inline(always)]
    fn run<V: Vector>(self) -> [MetPlanes; 2] {
        let Self { tile, owners, planes, intrinsics } = self;
        let empty = [[f32::NAN; LANES]; TILE * GROUPS];
        let mut met = [0, 1].map(|_| MetPlanes { place: [empty; 2], depth: empty });
        for group in 0..TILE * GROUPS {
            let rays = tile.group_rays::<V>(intrinsics, group);
            for (which, to) in met.iter_mut().enumerate() {
                let (weights, planes) = owners.of(group, which, planes);
                if V::load(&weights).at_most(V::splat(0.0)) == (1 << LANES) - 1 {
                    continue;
                }
                let met = meet(planes, rays);
                met.place[0].store(&mut to.place[0][group]);
                met.place[1].store(&mut to.place[1][group]);
                let depth = V::select(met.is_met, met.depth, V::splat(f32::NAN));
                depth.store(&mut to.depth[group]);
            }
        }
        met
    }
}

impl SurfaceTile<'_> {
    /// Returns the coverage of the pixel `[column, row]` of the tile.
    #[inline(always)]
    pub fn coverage(&self, at: [usize; 2]) -> f32 {
        1.0 - value(self.tile.planes()[0], at).abs()
    }

    /// Returns the drawn colour of a pixel without textures, not premultiplied.
    #[inline(always)]
    pub fn color(&self, at: [usize; 2]) -> [f32; 3] {
        let per = 1.0 / self.coverage(at).max(f32::MIN_POSITIVE);
        let [_, r, g, b, _] = self.tile.planes();
        [value(r, at) * per, value(g, at) * per, value(b, at) * per]
    }

    /// Returns one of the two surfaces of a pixel if its weight is at least `least`; `which` is 0 for the
    /// largest weight.
    #[inline(always)]
    pub fn at(&self, at: [usize; 2], which: usize, least: f32) -> Option<ShownSurface> {
        let (weight, number) = self.owners.one(group_and_lane(at), which);
        let MetPlanes { place, depth } = &self.met[which];
        let depth = value(depth, at);
        // Number and weight are 0 where no splat was drawn.
        if weight < least || weight <= 0.0 || depth.is_nan() {
            return None;
        }
        let SurfacePlane { splat, shift, .. } = self.planes[number];
        let place = [value(&place[0], at), value(&place[1], at)];
        Some(ShownSurface { splat, weight, place, depth, shift })
    }
}

#[inline(always)]
fn group_and_lane([column, row]: [usize; 2]) -> [usize; 2] {
    [row * GROUPS + column / LANES, column % LANES]
}

#[inline(always)]
fn value(plane: &Plane, at: [usize; 2]) -> f32 {
    let [group, lane] = group_and_lane(at);
    plane[group][lane]
}

impl CpuRenderer {
    /// Draws some rows of tiles of a view, and calls `visit` for every tile that textured splats touch, from left
    /// to right. `rows` lists the numbers of the rows from the top, ascending, each with a value for `visit`.
    /// `lattices` returns the lattice of a splat's texture.
    pub fn visit_surfaces<T: Send>(
        &mut self,
        splats: SplatView<'_>,
        lattices: &(dyn Fn(usize) -> Option<Lattice> + Sync),
        camera: &Camera,
        options: &RenderOptions,
        rows: impl Iterator<Item = (usize, T)>,
        visit: impl Fn(&SurfaceTile<'_>, &mut T) + Sync,
    ) {
        let view = CpuView::new(camera, options);
        if view.width == 0 || view.height == 0 {
            return;
        }
        self.lists.prepare(splats, &view, Some(lattices));
        self.lists.bin(view.height);
        self.lists.sort();
        let lists = &self.lists.rows;
        let inputs = RowInputs {
            records: &self.lists.records,
            intrinsics: camera.intrinsics,
            method: options.method,
            background: options.background,
            finish: Finish::NONE,
            textures: None,
            is_for_textures: true,
        };
        let tasks = rows.map(|(row, value)| (lists.get(row).len(), (row, value)));
        longest_first(tasks, &mut self.canvases, |(row, mut value), canvas: &mut RowCanvas| {
            let (top, list) = (row * TILE, lists.get(row));
            Isa::best().run(DrawRow { sheet: inputs, canvas: &mut *canvas, top, list });
            let planes = &inputs.records.planes;
            for (column, tile) in canvas.tiles.iter().enumerate() {
                let Some(owners) = tile.owners().filter(|owners| owners.has_any()) else {
                    continue;
                };
                let intrinsics = &inputs.intrinsics;
                let met = Isa::best().run(MeetTile { tile, owners, planes, intrinsics });
                let first = [column * TILE, top];
                visit(&SurfaceTile { tile, owners, planes, met, first }, &mut value);
            }
        });
    }
}
