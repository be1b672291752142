//! Coloured points of one frame in structure-of-arrays form: training data of the published algorithm.

use crate::math::real::Real;

/// Number of points per tile if the points do not come from an image.
// As many as in a tile of 8×8 pixels.
const DEFAULT_TILE: usize = 64;

/// Points of one frame, normalised (see [`Normalization`](crate::math::measured_pixel::Normalization)),
/// grouped into tiles. Sums are formed per tile, so results depend on the tiles but not on the number of
/// threads.
///
/// ```
/// use vbgs_studio::observation::points::Points;
///
/// let mut points = Points::<f32>::new();
/// points.push([0.0, 0.0, 1.0, 0.5, 0.5, 0.5]);
/// points.push([0.1, 0.0, 1.0, 0.5, 0.5, 0.5]);
/// points.close_tile();
/// assert_eq!((points.len(), points.n_tiles(), points.tile(0)), (2, 1, 0..2));
/// ```
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Points<R> {
    /// Normalised x coordinate of each point.
    pub x: Vec<R>,
    /// Normalised y coordinate of each point.
    pub y: Vec<R>,
    /// Normalised z coordinate of each point.
    pub z: Vec<R>,
    /// Red value of each point, normalised per channel.
    pub r: Vec<R>,
    /// Green value of each point, normalised per channel.
    pub g: Vec<R>,
    /// Blue value of each point, normalised per channel.
    pub b: Vec<R>,
    /// Bounds of the tiles in ascending order: tile `t` consists of the points `tiles[t]..tiles[t + 1]`.
    /// The first bound is 0; the last one is [`Points::len`] once all tiles are closed. A tile has 1 to
    /// 64 points.
    pub tiles: Vec<u32>,
}

impl<R: Real> Points<R> {
    /// Creates an empty list.
    pub fn new() -> Self {
        // Bounds of tiles include the start of the first.
        Self { tiles: vec![0], ..Self::default() }
    }

    /// Creates points from rows `[x, y, z, r, g, b]`, in tiles of 64 points.
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

    /// Returns the number of points.
    pub fn len(&self) -> usize {
        self.x.len()
    }

    /// True if there are no points.
    pub fn is_empty(&self) -> bool {
        self.x.is_empty()
    }

    /// Returns the number of closed tiles.
    pub fn n_tiles(&self) -> usize {
        self.tiles.len().saturating_sub(1)
    }

    /// Returns the range of point indices of a tile.
    pub fn tile(&self, tile: usize) -> std::ops::Range<usize> {
        self.tiles[tile] as usize..self.tiles[tile + 1] as usize
    }

    /// Removes all points; retains the allocated memory.
    pub fn clear(&mut self) {
        self.columns_mut().into_iter().for_each(Vec::clear);
        // The first bound always exists.
        self.tiles.clear();
        self.tiles.push(0);
    }

    /// Reserves memory for `points` more points in `tiles` more tiles. Without this, the columns grow
    /// in turn and leave gaps in memory of up to half their size.
    pub fn reserve(&mut self, points: usize, tiles: usize) {
        self.columns_mut().into_iter().for_each(|column| column.reserve(points));
        self.tiles.reserve(tiles);
    }

    /// Appends a point `[x, y, z, r, g, b]` to the open tile.
    #[inline]
    pub fn push(&mut self, row: [R; 6]) {
        self.x.push(row[0]);
        self.y.push(row[1]);
        self.z.push(row[2]);
        self.r.push(row[3]);
        self.g.push(row[4]);
        self.b.push(row[5]);
    }

    /// Appends a tile of points, given as columns `[x, y, z, r, g, b]` of equal length, and closes it.
    #[inline]
    pub fn push_tile(&mut self, columns: [&[R]; 6]) {
        for (own, column) in self.columns_mut().into_iter().zip(columns) {
            own.extend_from_slice(column);
        }
        self.close_tile();
    }

    /// Closes the open tile; an empty tile is dropped.
    pub fn close_tile(&mut self) {
        let end = self.len() as u32;
        // An empty tile would be summed needlessly and counted.
        if self.tiles.last() != Some(&end) {
            self.tiles.push(end);
        }
    }

    /// Returns the normalised position of a point.
    #[inline(always)]
    pub fn position(&self, i: usize) -> [R; 3] {
        [self.x[i], self.y[i], self.z[i]]
    }

    /// Returns the normalised colour of a point.
    #[inline(always)]
    pub fn color(&self, i: usize) -> [R; 3] {
        [self.r[i], self.g[i], self.b[i]]
    }

    /// Returns the points and tiles in another precision.
    pub fn cast<S: Real>(&self) -> Points<S> {
        let mut points = Points::new();
        self.cast_into(&mut points);
        points
    }

    /// Copies all points and tiles to `points` in another precision; replaces the previous content of
    /// `points`.
    pub fn cast_into<S: Real>(&self, points: &mut Points<S>) {
        let own = [&self.x, &self.y, &self.z, &self.r, &self.g, &self.b];
        for (from, to) in own.into_iter().zip(points.columns_mut()) {
            to.clear();
            to.extend(from.iter().map(|v| S::of(v.to_f64())));
        }
        points.tiles.clone_from(&self.tiles);
    }

    fn columns_mut(&mut self) -> [&mut Vec<R>; 6] {
        [&mut self.x, &mut self.y, &mut self.z, &mut self.r, &mut self.g, &mut self.b]
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
}
