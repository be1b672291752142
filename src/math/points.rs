//! Coloured points of one frame in structure-of-arrays form, and their normalisation.

use super::real::Real;
use glam::DVec3;

/// Points per tile when the source has no pixel structure.
const DEFAULT_TILE: usize = 64;

/// Points of one frame, normalised (see [`Normalization`]), grouped into tiles: sums are formed
/// tile by tile, so results depend on the tiles and never on how they are spread over threads.
///
/// ```
/// use vbgs_studio::math::points::Points;
///
/// let mut points = Points::<f32>::new();
/// points.push([0.0, 0.0, 1.0, 0.5, 0.5, 0.5]);
/// points.push([0.1, 0.0, 1.0, 0.5, 0.5, 0.5]);
/// points.close_tile();
/// assert_eq!((points.len(), points.n_tiles(), points.tile(0)), (2, 1, 0..2));
/// ```
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Points<R> {
    /// Position, first axis.
    pub x: Vec<R>,
    /// Position, second axis.
    pub y: Vec<R>,
    /// Position, third axis.
    pub z: Vec<R>,
    /// Red.
    pub r: Vec<R>,
    /// Green.
    pub g: Vec<R>,
    /// Blue.
    pub b: Vec<R>,
    /// Tile `t` holds the points `tiles[t]..tiles[t + 1]`; ascending, starts at 0 and ends at
    /// [`Points::len`] once closed. Tiles hold 1 to 64 points.
    pub tiles: Vec<u32>,
}

impl<R: Real> Points<R> {
    /// No points.
    pub fn new() -> Self {
        Self { tiles: vec![0], ..Self::default() }
    }

    /// Points from rows `[x, y, z, r, g, b]`, in tiles of 64.
    pub fn from_rows(rows: &[[f64; 6]]) -> Self {
        let mut points = Self::new();
        for chunk in rows.chunks(DEFAULT_TILE) {
            for row in chunk {
                points.push(row.map(R::of));
            }
            points.close_tile();
        }
        points
    }

    /// Number of points.
    pub fn len(&self) -> usize {
        self.x.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.x.is_empty()
    }

    /// Number of tiles.
    pub fn n_tiles(&self) -> usize {
        self.tiles.len().saturating_sub(1)
    }

    /// Index range of a tile's points.
    pub fn tile(&self, tile: usize) -> std::ops::Range<usize> {
        self.tiles[tile] as usize..self.tiles[tile + 1] as usize
    }

    /// Forgets the points, keeps the memory.
    pub fn clear(&mut self) {
        for column in [&mut self.x, &mut self.y, &mut self.z, &mut self.r, &mut self.g, &mut self.b]
        {
            column.clear();
        }
        self.tiles.clear();
        self.tiles.push(0);
    }

    /// Appends `[x, y, z, r, g, b]` to the open tile.
    #[inline]
    pub fn push(&mut self, row: [R; 6]) {
        self.x.push(row[0]);
        self.y.push(row[1]);
        self.z.push(row[2]);
        self.r.push(row[3]);
        self.g.push(row[4]);
        self.b.push(row[5]);
    }

    /// Ends the open tile; an empty one is not kept.
    pub fn close_tile(&mut self) {
        let end = self.len() as u32;
        if self.tiles.last() != Some(&end) {
            self.tiles.push(end);
        }
    }

    /// Position of a point.
    #[inline(always)]
    pub fn position(&self, i: usize) -> [R; 3] {
        [self.x[i], self.y[i], self.z[i]]
    }

    /// Colour of a point.
    #[inline(always)]
    pub fn color(&self, i: usize) -> [R; 3] {
        [self.r[i], self.g[i], self.b[i]]
    }

    /// The same points in another precision.
    pub fn cast<S: Real>(&self) -> Points<S> {
        let mut points = Points::new();
        self.cast_into(&mut points);
        points
    }

    /// Replaces `points` by the same points in another precision.
    pub fn cast_into<S: Real>(&self, points: &mut Points<S>) {
        let cast = |from: &[R], to: &mut Vec<S>| {
            to.clear();
            to.extend(from.iter().map(|v| S::of(v.to_f64())));
        };
        cast(&self.x, &mut points.x);
        cast(&self.y, &mut points.y);
        cast(&self.z, &mut points.z);
        cast(&self.r, &mut points.r);
        cast(&self.g, &mut points.g);
        cast(&self.b, &mut points.b);
        points.tiles.clone_from(&self.tiles);
    }
}

/// Affine map from world positions and colours in `[0, 1]` to the coordinates the model works in:
/// per axis the mean and standard deviation of a uniform law on a given range (`model.md`,
/// Normalisation).
///
/// ```
/// use glam::DVec3;
/// use vbgs_studio::math::points::Normalization;
///
/// let world = Normalization::from_range(DVec3::NEG_ONE, DVec3::ONE);
/// let corner = world.normalize(DVec3::ONE);
/// assert!((corner.x - 3f64.sqrt()).abs() < 1e-12);
/// assert!((world.denormalize(corner) - DVec3::ONE).length() < 1e-12);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Normalization {
    /// World position of the normalised origin.
    pub offset: [f64; 3],
    /// World units per normalised unit, per axis; positive.
    pub scale: [f64; 3],
}

/// Offset of the colour normalisation: the mean of a uniform law on `[0, 1]`.
pub const COLOR_OFFSET: f64 = 0.5;

/// Scale of the colour normalisation, `1/√12`.
pub const COLOR_SCALE: f64 = 0.288_675_134_594_812_9;

impl Normalization {
    /// From the range of positions, `lo < hi` on every axis.
    pub fn from_range(lo: DVec3, hi: DVec3) -> Self {
        let scale = (hi - lo) / 12f64.sqrt();
        Self { offset: ((lo + hi) * 0.5).to_array(), scale: scale.to_array() }
    }

    /// Normalised position of a world point.
    #[inline]
    pub fn normalize(&self, world: DVec3) -> DVec3 {
        (world - DVec3::from_array(self.offset)) / DVec3::from_array(self.scale)
    }

    /// World position of a normalised point.
    #[inline]
    pub fn denormalize(&self, normalized: DVec3) -> DVec3 {
        normalized * DVec3::from_array(self.scale) + DVec3::from_array(self.offset)
    }

    /// Normalised value of a colour channel in `[0, 1]`.
    #[inline]
    pub fn normalize_channel(channel: f64) -> f64 {
        (channel - COLOR_OFFSET) / COLOR_SCALE
    }

    /// Colour in `[0, 1]` (not clamped) of a normalised colour.
    #[inline]
    pub fn denormalize_color(color: DVec3) -> DVec3 {
        color * COLOR_SCALE + DVec3::splat(COLOR_OFFSET)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tiles_partition_the_points() {
        let rows: Vec<[f64; 6]> = (0..150).map(|i| [i as f64; 6]).collect();
        let points = Points::<f32>::from_rows(&rows);
        assert_eq!(points.tiles, vec![0, 64, 128, 150]);
        assert_eq!(points.tile(2), 128..150);
        assert_eq!(points.position(130), [130.0; 3]);
        assert_eq!(points.cast::<f64>().color(149), [149.0; 3]);
        assert_eq!(Points::<f32>::from_rows(&[]).n_tiles(), 0);
    }

    #[test]
    fn normalization_matches_the_published_constants() {
        let n = Normalization::from_range(DVec3::splat(-1.0), DVec3::ONE);
        assert!((n.scale[0] - 0.577350269).abs() < 1e-9);
        assert!((COLOR_SCALE - 1.0 / 12f64.sqrt()).abs() < 1e-16);
        let p = DVec3::new(0.3, -2.0, 0.7);
        assert!((n.denormalize(n.normalize(p)) - p).length() < 1e-15);
    }
}
