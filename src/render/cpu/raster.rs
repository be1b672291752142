//! Blending sorted splats into one row of tiles (`rendering.md` (b) 6 to 8, (e) 4).

use super::buckets::Buckets;
use super::lanes::{LANES, any, exp2};
use super::prepare::Record;
use crate::render::{ALPHA_CAP, TILE, TRANSMITTANCE_STOP};
use wide::bytemuck::cast_slice;
use wide::f32x8;

/// Groups of lanes per row of a tile.
const GROUPS: usize = TILE / LANES;

/// Splats binned to tiles at a time: bounds a row's lists to this many entries per tile, whatever
/// the splats cover.
const BATCH: usize = 4096;

/// A row of tiles being drawn, with its lists; reused between images.
#[derive(Default)]
pub(super) struct RowCanvas {
    tiles: Vec<Tile>,
    by_tile: Buckets,
}

impl RowCanvas {
    /// Blends `list` (nearest first) into the tiles whose top pixel row is `top`.
    pub(super) fn draw(
        &mut self,
        top: usize,
        width: usize,
        height: usize,
        list: &[u32],
        records: &[Record],
    ) {
        self.tiles.clear();
        self.tiles.extend(
            (0..width).step_by(TILE).map(|left| Tile::new(left, top, width - left, height - top)),
        );
        for batch in list.chunks(BATCH) {
            if self.tiles.iter().all(Tile::is_finished) {
                break;
            }
            self.by_tile.fill(self.tiles.len(), batch.iter().copied(), |i| {
                records[i as usize].rect.tile_columns()
            });
            for (index, tile) in self.tiles.iter_mut().enumerate() {
                tile.blend_all(self.by_tile.get(index), records);
            }
        }
    }

    /// Composites the tiles over the background into the row's pixels.
    pub(super) fn write(
        &self,
        background: [f32; 3],
        width: usize,
        color: &mut [[f32; 3]],
        coverage: &mut [f32],
        depth: &mut [f32],
    ) {
        for (index, tile) in self.tiles.iter().enumerate() {
            let left = index * TILE;
            let columns = TILE.min(width - left);
            let planes = [&tile.transmittance, &tile.red, &tile.green, &tile.blue, &tile.depth]
                .map(|plane| cast_slice::<f32x8, f32>(plane));
            for row in 0..color.len() / width {
                for column in 0..columns {
                    let [t, r, g, b, z] = planes.map(|plane| plane[row * TILE + column]);
                    let t = t.abs();
                    let pixel = row * width + left + column;
                    color[pixel] = [
                        (r + t * background[0]).clamp(0.0, 1.0),
                        (g + t * background[1]).clamp(0.0, 1.0),
                        (b + t * background[2]).clamp(0.0, 1.0),
                    ];
                    coverage[pixel] = 1.0 - t;
                    depth[pixel] = if t < 1.0 { z / (1.0 - t) } else { 0.0 };
                }
            }
        }
    }
}

/// Planes of 16×16 pixels, group `GROUPS·row + half`; they stay in L1 while a tile is drawn.
struct Tile {
    left: f32,
    top: f32,
    /// Transmittance; negative once the pixel is finished, and outside the image.
    transmittance: [f32x8; TILE * GROUPS],
    red: [f32x8; TILE * GROUPS],
    green: [f32x8; TILE * GROUPS],
    blue: [f32x8; TILE * GROUPS],
    /// Sum of weight × view depth.
    depth: [f32x8; TILE * GROUPS],
    /// Bit per row with an unfinished pixel.
    open_rows: u32,
}

impl Tile {
    /// An empty tile at pixel `(left, top)` of which `columns` × `rows` pixels (or more) lie in the
    /// image; the others start finished.
    fn new(left: usize, top: usize, columns: usize, rows: usize) -> Self {
        let empty = [f32x8::splat(0.0); TILE * GROUPS];
        let transmittance = std::array::from_fn(|group| {
            let (row, first) = (group / GROUPS, group % GROUPS * LANES);
            let inside = |lane| row < rows && first + lane < columns;
            f32x8::new(std::array::from_fn(|lane| if inside(lane) { 1.0 } else { -1.0 }))
        });
        Self {
            left: left as f32,
            top: top as f32,
            transmittance,
            red: empty,
            green: empty,
            blue: empty,
            depth: empty,
            open_rows: (1 << rows.min(TILE)) - 1,
        }
    }

    fn is_finished(&self) -> bool {
        self.open_rows == 0
    }

    fn blend_all(&mut self, list: &[u32], records: &[Record]) {
        for &record in list {
            if self.is_finished() {
                break;
            }
            self.blend(&records[record as usize]);
        }
    }

    /// Adds one splat to the rows and groups inside its rectangle.
    fn blend(&mut self, splat: &Record) {
        let span = |lo: u32, hi: u32, first: f32| {
            let first = first as usize;
            let end = first + TILE;
            ((lo as usize).max(first) - first)..((hi as usize).min(end) - first)
        };
        let columns = span(splat.rect.x0, splat.rect.x1, self.left);
        let groups = columns.start / LANES..columns.end.div_ceil(LANES);
        let x = self.left + 0.5 - splat.u;
        let p_columns = LANE_COLUMNS
            .map(|column| (f32x8::new(column) + f32x8::splat(x)) * f32x8::splat(splat.p_x));
        for row in span(splat.rect.y0, splat.rect.y1, self.top) {
            if self.open_rows & (1 << row) == 0 {
                continue;
            }
            let y = self.top + row as f32 + 0.5 - splat.v;
            let p_row = f32x8::splat(splat.p_y * y);
            let q = splat.q_y * y;
            let minus_qq = f32x8::splat(-(q * q));
            let mut stopped = false;
            for group in groups.clone() {
                let p = p_columns[group] + p_row;
                stopped |=
                    self.blend_group(row * GROUPS + group, splat, p.mul_neg_add(p, minus_qq));
            }
            if stopped && self.row_is_finished(row) {
                self.open_rows &= !(1 << row);
            }
        }
    }

    /// Adds a splat to eight pixels where it has `alpha = opacity · 2^exponent`; whether a pixel
    /// was finished by it.
    #[inline(always)]
    fn blend_group(&mut self, group: usize, splat: &Record, exponent: f32x8) -> bool {
        let t = self.transmittance[group];
        let hit = exponent.simd_ge(f32x8::splat(splat.cut)) & t.simd_gt(f32x8::splat(0.0));
        if !any(hit) {
            return false;
        }
        let alpha = f32x8::splat(splat.opacity) * exp2(exponent);
        let alpha = alpha.fast_min(f32x8::splat(ALPHA_CAP as f32)) & hit;
        let mut weight = alpha * t;
        let mut next = t - weight;
        let stop = next.simd_lt(f32x8::splat(TRANSMITTANCE_STOP as f32)) & hit;
        let stopped = any(stop);
        if stopped {
            weight = stop.select(f32x8::splat(0.0), weight);
            next = stop.select(-t, next);
        }
        self.transmittance[group] = next;
        for (plane, value) in [
            (&mut self.red, splat.color[0]),
            (&mut self.green, splat.color[1]),
            (&mut self.blue, splat.color[2]),
            (&mut self.depth, splat.depth),
        ] {
            plane[group] = weight.mul_add(f32x8::splat(value), plane[group]);
        }
        stopped
    }

    fn row_is_finished(&self, row: usize) -> bool {
        let groups = &self.transmittance[row * GROUPS..(row + 1) * GROUPS];
        groups.iter().all(|t| !any(t.simd_gt(f32x8::splat(0.0))))
    }
}

/// Column of each lane within its tile.
const LANE_COLUMNS: [[f32; LANES]; GROUPS] =
    [[0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0], [8.0, 9.0, 10.0, 11.0, 12.0, 13.0, 14.0, 15.0]];
