//! Textures as small splats (`files.md`, Textures as splats).
//!
//! A splat with a texture is replaced by flat splats on its plane, one for each square of a quadtree over the
//! texture's lattice: large squares where the colour is even, single texels where it is not. A place of a
//! surface belongs to the splat with the largest response there, so that overlapping textures are written once.

use super::gaussian::{Gaussian, color_change, drawable, from_rows};
use crate::model::splat::appearance::{OPAQUE, SplatView};
use crate::model::splat::texture::{Lattice, Texture};
use glam::{DMat3, DQuat, DVec3};
use rayon::prelude::*;
use std::collections::HashMap;

/// Opacity from which a splat counts as a surface.
const MIN_OPACITY: f64 = 0.5;
/// Response of a splat, relative to its opacity, at the border of what it shows.
const MIN_RESPONSE: f64 = 0.1;
/// Response of a splat, relative to its opacity, below which it is neglected.
const NEGLIGIBLE: f64 = 0.01;
/// Least cosine between the normals of splats of one surface.
const MIN_TOWARDS: f64 = 0.5;
/// Standard deviations of a square's splat along and across its plane, in sides of the square.
// Of 0.4 to 1, 0.7 had the highest PSNR on a phone's door: narrower splats leave gaps, wider ones blur.
const SPREAD: [f64; 3] = [0.7, 0.7, 0.1];
/// Integral of a square's response over its plane, in areas of the square.
const OVERLAP: f64 = std::f64::consts::TAU * SPREAD[0] * SPREAD[1];
/// Largest number of halvings of the interval of prices.
const STEPS: usize = 50;

/// Small splats that replace splats with textures.
#[derive(Default)]
pub(super) struct Detail {
    /// Small splats by the number of the splat that they replace.
    of: HashMap<usize, Vec<Gaussian>>,
}

impl Detail {
    /// Chooses about `most` small splats for all textures of a scene, at least one for each textured surface.
    pub fn new(view: SplatView, most: usize) -> Self {
        let Some(textures) = &view.finishing().textures else { return Self::default() };
        let texture = |i: usize| textures.get(i)?.as_deref();
        let largest = textures.iter().flatten().map(|texture| f64::from(texture.lattice.half));
        let surfaces = Surfaces::new(view, 2.0 * largest.fold(0.0, f64::max));
        let textured: Vec<Patch<'_>> = surfaces
            .all()
            // Others keep their blending with what is behind them.
            .filter(|surface| surface.splat.opacity >= MIN_OPACITY)
            .filter_map(|own| Some(Patch { own, plane: Plane::new(own, texture(own.number)?) }))
            .collect();
        let trees = textured.into_par_iter().filter_map(|patch| {
            let tree = patch.squares(&surfaces.around(&patch), surfaces.full_coverage)?;
            Some((patch, tree))
        });
        let mut trees: Vec<(Patch<'_>, Square)> = trees.collect();
        // A hash map has a random order, and sums of errors depend on it.
        trees.sort_unstable_by_key(|(patch, _)| patch.own.number);
        let price = price(&trees, most);
        let small = trees.par_iter().map(|(patch, tree)| {
            let (mut splats, around) = (Vec::new(), surfaces.around(patch));
            tree.leaves(price, &mut |square| splats.push(patch.small_splat(square, &around)));
            (patch.own.number, splats)
        });
        Self { of: small.collect() }
    }

    /// Returns the splats that replace splat `i`; `None` if it is written as it is.
    pub fn of(&self, i: usize) -> Option<&[Gaussian]> {
        self.of.get(&i).map(Vec::as_slice)
    }
}

/// Returns the price of a splat, in squared colour errors summed over texels, at which about `most` are chosen.
fn price(trees: &[(Patch<'_>, Square)], most: usize) -> f64 {
    let count = |price: f64| trees.par_iter().map(|(_, tree)| tree.cost(price).1).sum::<usize>();
    // At the price of all errors together every tree is one splat.
    let mut high = trees.iter().map(|(_, tree)| tree.error).sum::<f64>().max(f64::MIN_POSITIVE);
    let mut low = 0.0;
    if count(low) <= most {
        return low;
    }
    for _ in 0..STEPS {
        // Geometric, since prices range over many orders of magnitude.
        let middle = if low > 0.0 { (low * high).sqrt() } else { 1e-12 * high };
        if low == 0.0 && count(middle) <= most {
            return middle;
        }
        if count(middle) > most { low = middle } else { high = middle }
    }
    high
}

/// Splat of a scene, with its colour seen from the mean of the observed directions.
struct Surface {
    number: usize,
    splat: Gaussian,
    color: DVec3,
    gradient: DMat3,
    normal: DVec3,
    /// Rotation to the splat's axes, in standard deviations.
    whiten: DMat3,
}

impl Surface {
    fn new(number: usize, splat: Gaussian, gradient: DMat3) -> Self {
        let axes = DMat3::from_quat(splat.rotation);
        let thin = splat.scale.min_position();
        let mut scale = splat.scale.to_array();
        // As thick as it is wide: the planes of neighbours differ by more than the thickness of a surface.
        if let Some(thin) = scale.get_mut(thin) {
            *thin = splat.scale.max_element();
        }
        let whiten = DMat3::from_diagonal(DVec3::from_array(scale).recip()) * axes.transpose();
        let color = splat.color + splat.directional * splat.seen;
        Self { number, splat, color, gradient, normal: axes.col(thin), whiten }
    }

    /// Returns the response at a point.
    fn response(&self, point: DVec3) -> f64 {
        let offset = self.whiten * (point - self.splat.mean);
        self.splat.opacity * (-0.5 * offset.length_squared()).exp()
    }

    /// Returns the distance from the mean beyond which the response is below a fraction of the opacity.
    fn reach(&self, least: f64) -> f64 {
        (-2.0 * least.ln()).sqrt() * self.splat.scale.max_element()
    }

    fn color(&self, point: DVec3) -> DVec3 {
        self.color + color_change(self.gradient, point - self.splat.mean)
    }
}

/// Plane of a splat with a texture.
struct Plane<'a> {
    mean: DVec3,
    normal: DVec3,
    /// Rotation from the axes of the lattice and the normal to the world.
    rotation: DQuat,
    lattice: Lattice,
    texture: &'a Texture,
}

impl<'a> Plane<'a> {
    fn new(&Surface { ref splat, normal, .. }: &Surface, texture: &'a Texture) -> Self {
        let [along, _] = texture.lattice.axes.map(|axis| DVec3::from_array(axis.map(f64::from)));
        let along = along.reject_from_normalized(normal);
        // A lattice at right angles to the splat has no direction on its plane.
        let along = along.try_normalize().unwrap_or(normal.any_orthonormal_vector());
        let axes = DMat3::from_cols(along, normal.cross(along), normal);
        let rotation = DQuat::from_mat3(&axes);
        Self { mean: splat.mean, normal, rotation, lattice: texture.lattice, texture }
    }

    /// Returns the point of the plane at a place of the lattice, world units.
    fn point(&self, place: [f64; 2]) -> DVec3 {
        let point = self.lattice.point_at(place);
        point - self.normal * self.normal.dot(point - self.mean)
    }
}

/// Textured splat and its plane.
struct Patch<'a> {
    own: &'a Surface,
    plane: Plane<'a>,
}

impl Patch<'_> {
    /// Returns the squares where no other splat shows more; `None` if there are none. `around` are the splats
    /// nearby.
    fn squares(&self, around: &[&Surface], full_coverage: f64) -> Option<Square> {
        let Self { own, plane } = self;
        let texel = |[x, y]: [usize; 2]| {
            let centre = [x as f64 + 0.5, y as f64 + 0.5];
            let point = plane.point(centre);
            let shown = own.response(point);
            if shown < MIN_RESPONSE * own.splat.opacity {
                return None;
            }
            // What is drawn without textures: neighbours blend where they overlap.
            let (mut sum, mut drawn) = (shown, shown * own.color(point));
            let mut passed = 1.0 - shown.min(OPAQUE);
            for other in around {
                let response = other.response(point);
                // Of equal splats the first.
                if (response, own.number) > (shown, other.number) {
                    return None;
                }
                sum += response;
                drawn += response * other.color(point);
                passed *= 1.0 - response.min(OPAQUE);
            }
            let sample = plane.texture.sample(centre.map(|v| v as f32));
            let textured = DVec3::from_array(sample.color.map(f64::from));
            let color = textured + (1.0 - f64::from(sample.share)) * drawn / sum;
            let coverage = ((1.0 - passed) / full_coverage).min(OPAQUE);
            Some(Square { centre, n: 1.0, color, coverage, error: 0.0, parts: Vec::new() })
        };
        tree([0, 0], plane.lattice.side(), &texel)
    }

    /// Returns the splat of a square. It lies on the mean of the planes that blend there: if each lay on its
    /// own, dark slits would open between those of two planes.
    fn small_splat(&self, square: &Square, around: &[&Surface]) -> Gaussian {
        let Self { own, plane } = self;
        let point = plane.point(square.centre);
        let (mut sum, mut height, mut normal) = (0.0, 0.0, DVec3::ZERO);
        let (mut slope, mut shift) = (DMat3::ZERO, DVec3::ZERO);
        for surface in std::iter::once(own).chain(around) {
            let towards = surface.normal.dot(plane.normal);
            if towards.abs() < MIN_TOWARDS {
                continue;
            }
            let weight = surface.response(point);
            sum += weight;
            height += weight * surface.normal.dot(surface.splat.mean - point) / towards;
            normal += weight * towards.signum() * surface.normal;
            slope += weight * surface.splat.directional;
            shift += weight * surface.splat.directional * surface.splat.seen;
        }
        // Where the texture is shown, its splat alone sets the colour by direction.
        let share = f64::from(plane.texture.sample(square.centre.map(|v| v as f32)).share);
        let splat = &own.splat;
        let slope = share * splat.directional + (1.0 - share) / sum * slope;
        let shift = share * splat.directional * splat.seen + (1.0 - share) / sum * shift;
        let turn = DQuat::from_rotation_arc(plane.normal, normal.normalize_or(plane.normal));
        let side = square.n.sqrt() / plane.lattice.per_unit();
        let color = square.color.clamp(DVec3::ZERO, DVec3::ONE);
        Gaussian {
            mean: point + height / sum * plane.normal,
            // Splats of neighbouring squares overlap.
            opacity: (-(1.0 - square.coverage).ln() / OVERLAP).min(OPAQUE),
            // Textures and colours are those seen from the mean of the observed directions.
            color: color - shift,
            scale: DVec3::from_array(SPREAD.map(|factor| factor * side)),
            rotation: (turn * plane.rotation).normalize(),
            directional: slope,
            seen: splat.seen,
        }
    }
}

/// Node of a quadtree over a lattice.
struct Square {
    /// Mean of the centres of its texels, in texels from the lattice's corner.
    centre: [f64; 2],
    /// Number of texels that show the surface, at least 1.
    n: f64,
    /// Mean colour of the texels.
    color: DVec3,
    /// Mean fraction of the light that the scene holds back there.
    coverage: f64,
    /// Sum of squared differences of the texels' colours to the mean.
    error: f64,
    parts: Vec<Square>,
}

impl Square {
    fn joined(parts: Vec<Square>) -> Option<Self> {
        let n: f64 = parts.iter().map(|part| part.n).sum();
        if n == 0.0 {
            return None;
        }
        let color = parts.iter().map(|part| part.n * part.color).sum::<DVec3>() / n;
        let coverage = parts.iter().map(|part| part.n * part.coverage).sum::<f64>() / n;
        let error_of = |part: &Square| part.error + part.n * part.color.distance_squared(color);
        let error = parts.iter().map(error_of).sum();
        let centre = parts.iter().fold([0.0; 2], |[x, y], part| {
            let [px, py] = part.centre;
            [x + part.n * px, y + part.n * py]
        });
        let centre = centre.map(|sum| sum / n);
        Some(Self { centre, n, color, coverage, error, parts })
    }

    /// Returns the least sum of squared errors and prices of splats, and its number of splats.
    fn cost(&self, price: f64) -> (f64, usize) {
        self.cost_of_parts(price).unwrap_or((self.error + price, 1))
    }

    /// Returns the cost of the parts; `None` if the whole square costs no more.
    fn cost_of_parts(&self, price: f64) -> Option<(f64, usize)> {
        let parts = self.parts.iter().map(|part| part.cost(price));
        parts.reduce(|a, b| (a.0 + b.0, a.1 + b.1)).filter(|(sum, _)| *sum < self.error + price)
    }

    /// Calls `f` for the squares of [`Self::cost`].
    fn leaves(&self, price: f64, f: &mut impl FnMut(&Self)) {
        if self.cost_of_parts(price).is_some() {
            self.parts.iter().for_each(|part| part.leaves(price, f));
        } else {
            f(self);
        }
    }
}

/// Splats by place.
struct Surfaces {
    /// Side of a cell, world units.
    cell: f64,
    by_cell: HashMap<[i64; 3], Vec<Surface>>,
    /// Coverage from which the scene counts a place as fully covered.
    full_coverage: f64,
}

impl Surfaces {
    fn new(view: SplatView, cell: f64) -> Self {
        let mut surfaces = Self {
            cell,
            by_cell: HashMap::new(),
            full_coverage: f64::from(view.finishing().full_coverage),
        };
        for (number, splat) in drawable(view) {
            let look = view.appearance().get(number).copied().unwrap_or_default();
            let cell = surfaces.cell_of(splat.mean);
            let surface = Surface::new(number, splat, from_rows(look.gradient));
            surfaces.by_cell.entry(cell).or_default().push(surface);
        }
        surfaces
    }

    fn all(&self) -> impl Iterator<Item = &Surface> {
        self.by_cell.values().flatten()
    }

    fn cell_of(&self, point: DVec3) -> [i64; 3] {
        (point / self.cell).floor().as_i64vec3().to_array()
    }

    /// Returns the splats that may overlap a textured splat.
    fn around(&self, Patch { own, plane }: &Patch<'_>) -> Vec<&Surface> {
        let [x, y, z] = self.cell_of(plane.mean);
        let cells = (0..27).map(|n| [x + n % 3 - 1, y + n / 3 % 3 - 1, z + n / 9 - 1]);
        let near = cells.filter_map(|cell| self.by_cell.get(&cell)).flatten();
        let overlaps = |other: &&Surface| {
            let reach = own.reach(MIN_RESPONSE) + other.reach(NEGLIGIBLE);
            other.splat.mean.distance_squared(plane.mean) < reach * reach
        };
        near.filter(|other| other.number != own.number).filter(overlaps).collect()
    }
}

/// Returns the quadtree of `side` by `side` texels from the corner `[x, y]`; `None` if no texel shows the surface.
fn tree(
    [x, y]: [usize; 2],
    side: usize,
    texel: &impl Fn([usize; 2]) -> Option<Square>,
) -> Option<Square> {
    if side == 1 {
        return texel([x, y]);
    }
    let half = side / 2;
    let corners = [[x, y], [x + half, y], [x, y + half], [x + half, y + half]];
    Square::joined(corners.into_iter().filter_map(|corner| tree(corner, half, texel)).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::splat::texture::{Sample, TEXELS, Texel};

    fn texture(anchor: DVec3) -> Texture {
        let axes = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
        let anchor = anchor.as_vec3().to_array();
        let lattice = Lattice { anchor, axes, half: 1.0, level: 0 };
        let patches = vec![[Texel::new([0.5, 0.25, 0.75], 16.0 / 31.0); TEXELS]];
        Texture { lattice, index: vec![0], patches }
    }

    fn surface(number: usize, mean: DVec3, opacity: f64, width: f64) -> Surface {
        let scale = DVec3::new(width, width, 0.01);
        let splat = Gaussian { mean, opacity, scale, ..Gaussian::INVISIBLE };
        let splat = Gaussian { color: DVec3::new(0.2, 0.4, 0.6), ..splat };
        Surface::new(number, splat, DMat3::from_diagonal(DVec3::splat(0.1)))
    }

    /// Squares of `own` beside a splat held in a neighbouring cell.
    fn squares(own: &Surface, other: Surface, shift: [i64; 3]) -> Option<Square> {
        let mut surfaces = Surfaces { cell: 2.0, by_cell: HashMap::new(), full_coverage: 1.0 };
        let [x, y, z] = surfaces.cell_of(own.splat.mean);
        let cell = [x + shift[0], y + shift[1], z + shift[2]];
        surfaces.by_cell.insert(cell, vec![other]);
        let texture = texture(own.splat.mean);
        let patch = Patch { own, plane: Plane::new(own, &texture) };
        patch.squares(&surfaces.around(&patch), 1.0)
    }

    fn square(error: f64, parts: Vec<Square>) -> Square {
        Square { centre: [0.0; 2], n: 1.0, color: DVec3::ZERO, coverage: 0.9, error, parts }
    }

    const MEAN: DVec3 = DVec3::new(6.5, -3.5, 10.5);

    #[test]
    fn a_price_limits_the_number_of_splats() {
        let texture = texture(MEAN);
        let own = surface(0, MEAN, 1.0, 1.0);
        let of = |errors: [f64; 2], most: usize| {
            let even = || (0..4).map(|_| square(0.0, Vec::new())).collect();
            let patch = || Patch { own: &own, plane: Plane::new(&own, &texture) };
            let trees = errors.map(|error| (patch(), square(error, even())));
            price(&trees, most)
        };
        // Four parts instead of a whole are worth three prices.
        let found = of([1.0, 100.0], 5);
        assert!((found - 1.0 / 3.0).abs() < 1e-9, "{found}");
        assert_eq!(of([1.0, 100.0], 8), 0.0);
        assert_eq!(of([3e-14, 100.0], 5), 1e-12 * (3e-14 + 100.0));
        let tree = square(10.0, vec![square(2.0, Vec::new()), square(3.0, Vec::new())]);
        assert_eq!((tree.cost(4.0), tree.cost(5.0)), ((13.0, 2), (15.0, 1)));
    }

    #[test]
    fn responses_and_colours_follow_the_place() {
        let narrow = surface(0, DVec3::new(1.0, 2.0, 3.0), 0.8, 0.5);
        let splat = Gaussian { scale: DVec3::new(0.5, 2.0, 0.01), ..narrow.splat };
        let own = Surface::new(0, splat, narrow.gradient);
        let point = DVec3::new(2.0, 4.0, 5.0);
        assert!((own.response(point) - 0.8 * (-3.0f64).exp()).abs() < 1e-12);
        assert!(own.color(point).distance(DVec3::new(0.3, 0.6, 0.8)) < 1e-12);
        let above = texture(own.splat.mean + 0.5 * DVec3::Z);
        let at = Plane::new(&own, &above).point([2.0, 2.0]);
        assert!(at.distance(own.splat.mean) < 1e-12, "{at}");
        let surfaces = Surfaces { cell: 0.5, by_cell: HashMap::new(), full_coverage: 1.0 };
        assert_eq!(surfaces.cell_of(DVec3::new(1.2, -0.3, 0.6)), [2, -1, 1]);
    }

    #[test]
    fn texels_blend_with_neighbours_and_end_where_a_splat_does() {
        let own = surface(0, MEAN, 0.8, 1.0);
        let beside = |number| surface(number, MEAN + 0.5 * DVec3::X, 0.3, 1.0);
        let tree = squares(&own, Surface { color: DVec3::ONE, ..beside(1) }, [0; 3]).unwrap();
        assert_eq!(tree.n, 16.0);
        let offset = DVec3::new(-0.75, -0.75, 0.0);
        let [shown, other] = [0.8 * (-0.5625f64).exp(), 0.3 * (-1.0625f64).exp()];
        let colors = [own.color + 0.1 * offset, DVec3::ONE + 0.1 * (offset - 0.5 * DVec3::X)];
        let drawn = (shown * colors[0] + other * colors[1]) / (shown + other);
        let Sample { share, color } = texture(MEAN).sample([0.5; 2]);
        let expected = DVec3::from_array(color.map(f64::from)) + (1.0 - f64::from(share)) * drawn;
        let found = tree.parts[0].parts[0].color;
        assert!(found.distance(expected) < 1e-9, "{found} {expected}");
        // The corners of the lattice are beyond a tenth of the largest response.
        let narrow = surface(0, MEAN, 0.5, 0.45);
        let far = surface(1, MEAN + 9.0 * DVec3::Z, 0.5, 0.45);
        assert_eq!(squares(&narrow, far, [0; 3]).unwrap().n, 12.0);
    }

    #[test]
    fn small_splats_lie_between_planes_and_keep_the_colour_by_direction() {
        let own = surface(0, MEAN, 0.8, 1.0);
        let slope = DMat3::from_diagonal(DVec3::new(0.1, 0.2, 0.3));
        let splat = Gaussian {
            mean: MEAN + 0.4 * DVec3::Z,
            directional: slope,
            seen: DVec3::new(0.0, 0.6, 0.8),
            ..own.splat
        };
        let above = Surface::new(1, splat, own.gradient);
        // A wall beside the surface has another normal.
        let rotation = DQuat::from_rotation_y(1.3);
        let wall = Surface::new(2, Gaussian { rotation, ..own.splat }, own.gradient);
        let texture = texture(MEAN);
        let patch = Patch { own: &own, plane: Plane::new(&own, &texture) };
        let square = Square { centre: [2.0; 2], n: 4.0, ..square(0.0, Vec::new()) };
        let small = patch.small_splat(&square, &[&above, &wall]);
        let weights = [0.8, 0.8 * (-0.5 * 0.16f64).exp()];
        let part = weights[1] / (weights[0] + weights[1]);
        assert!(small.mean.distance(MEAN + part * 0.4 * DVec3::Z) < 1e-9, "{}", small.mean);
        let share = f64::from(texture.sample([2.0; 2]).share);
        let kept = (1.0 - share) * part * slope;
        assert!(small.directional.abs_diff_eq(kept, 1e-9), "{}", small.directional);
        let from_there = small.color + small.directional * above.splat.seen;
        assert!(from_there.distance(square.color) < 1e-9, "seen from the mean direction");
        // Four texels of half a unit: one unit wide.
        assert!((small.scale - DVec3::new(0.7, 0.7, 0.1)).length() < 1e-9, "{}", small.scale);
        // Responses that add up to the coverage of the scene where squares overlap.
        let passed = (-OVERLAP * small.opacity).exp();
        assert!((1.0 - passed - square.coverage).abs() < 1e-9);
    }

    #[test]
    fn splats_of_all_cells_around_hide_texels() {
        for [own, other] in [[0, 1], [1, 0]] {
            let [own, other] = [own, other].map(|number| surface(number, MEAN, 0.8, 1.0));
            assert_eq!(squares(&own, other, [0; 3]).is_some(), own.number == 0);
        }
        let own = surface(0, MEAN, 0.5, 1.0);
        for n in 0..125 {
            let shift = [n % 5 - 2, n / 5 % 5 - 2, n / 25 - 2];
            let is_hidden = squares(&own, surface(1, MEAN, 1.0, 9.0), shift).is_none();
            assert_eq!(is_hidden, shift.iter().all(|d: &i64| d.abs() < 2), "{shift:?}");
        }
    }
}
