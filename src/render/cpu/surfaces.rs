//! Surfaces that a view shows: for every pixel the splats with the largest weights, and where its ray meets
//! their planes. Training adds photographs to textures there.

use super::raster::{DrawRow, RowCanvas, RowInputs};
use super::renderer::CpuRenderer;
use super::rows::{ViewLists, longest_first};
use super::textures::{Owners, SurfacePlane, meet};
use super::tile::{GROUPS, Plane, Tile};
use super::view::CpuView;
use crate::math::camera::{Camera, Intrinsics};
use crate::math::simd::{Isa, Kernel, LANES, Vector};
use crate::model::splat::appearance::SplatView;
use crate::model::splat::texture::Lattice;
use crate::render::finish::Finish;
use crate::render::options::{RenderOptions, TILE};
use std::ops::Range;

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

/// View whose textured splats are listed and can be visited.
pub struct SurfaceView<'a> {
    lists: &'a ViewLists,
    canvases: &'a mut Vec<RowCanvas>,
    inputs: RowInputs<'a>,
}

/// Consecutive tiles of one row of tiles.
#[derive(Clone, Debug)]
pub struct TileRun {
    /// Number of the row from the top.
    pub row: usize,
    /// Numbers of the tiles from the left.
    pub columns: Range<usize>,
}

impl CpuRenderer {
    /// Lists the splats of a view; `None` for a view without pixels. `lattices` returns the lattice of a splat's
    /// texture.
    pub fn surfaces(
        &mut self,
        splats: SplatView<'_>,
        lattices: &(dyn Fn(usize) -> Option<Lattice> + Sync),
        camera: &Camera,
        options: &RenderOptions,
    ) -> Option<SurfaceView<'_>> {
        let view = CpuView::new(camera, options);
        if view.width == 0 || view.height == 0 {
            return None;
        }
        self.lists.prepare(splats, &view, Some(lattices));
        self.lists.bin(view.height);
        self.lists.sort();
        let inputs = RowInputs {
            records: &self.lists.records,
            intrinsics: camera.intrinsics,
            method: options.method,
            background: options.background,
            finish: Finish::NONE,
            textures: None,
            is_for_textures: true,
        };
        Some(SurfaceView { lists: &self.lists, canvases: &mut self.canvases, inputs })
    }
}

impl SurfaceView<'_> {
    /// Returns the textured splats among about `n` visible splats that are evenly spaced in the list of splats.
    pub fn sampled(&self, n: usize) -> Vec<u32> {
        let visible = self.lists.visible_runs().flatten();
        let some = visible.step_by(self.lists.n_visible() / n + 1);
        let planes = some.map(|record| &self.inputs.records.planes[record as usize]);
        planes.filter(|plane| plane.has_texture()).map(|plane| plane.splat).collect()
    }

    /// Draws some tiles, and calls `visit` for each of them that textured splats touch. Each run of tiles has a value
    /// for `visit`, and its tiles are visited from left to right.
    pub fn visit<T: Send>(
        self,
        runs: impl Iterator<Item = (TileRun, T)>,
        visit: impl Fn(&SurfaceTile<'_>, &mut T) + Sync,
    ) {
        let Self { lists, canvases, inputs } = self;
        let rows = &lists.rows;
        let tasks = runs.map(|(run, value)| {
            let work = rows.get(run.row).len() * run.columns.len();
            (work, (run, value))
        });
        longest_first(tasks, canvases, |(run, mut value), canvas: &mut RowCanvas| {
            let TileRun { row, columns } = run;
            let (top, left) = (row * TILE, columns.start);
            let records = &inputs.records.records;
            let touches = |record: &&u32| {
                !records[**record as usize].rect.columns_within(&columns).is_empty()
            };
            let list: Vec<u32> = rows.get(row).iter().filter(touches).copied().collect();
            let canvas_of_run = &mut *canvas;
            let columns = columns.clone();
            Isa::best().run(DrawRow {
                sheet: inputs,
                canvas: canvas_of_run,
                top,
                columns,
                list: &list,
            });
            let planes = &inputs.records.planes;
            for (column, tile) in (left..).zip(&canvas.tiles) {
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
