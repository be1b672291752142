//! Blends sorted splats into one tile (`rendering.md`, Blending).
//!
//! The 256 pixels of a tile are stored in planes of eight lanes. They remain in the L1 cache while splats are
//! blended, nearest first. Finished groups are masked, finished rows are skipped, and blending stops when all
//! rows are finished. So hidden splats cost almost nothing. SIMD is explicit, because the autovectorised loop
//! was 4 to 5 times slower (`rendering.md`, CPU renderer). A negative transmittance marks pixels that are
//! finished or outside the image, so that one comparison tests both.

use super::record::{ConicRecord, Gradient, Records, Rect, TangentFrame};
use super::textures::{Owners, SurfacePlane, add_textures};
use crate::math::camera::Intrinsics;
use crate::math::simd::{LANES, SET_LANE, Vector};
use crate::model::splat::appearance::GRADIENT_LIMIT;
use crate::model::splat::texture::ShownTextures;
use crate::render::options::{ALPHA_CAP, Lens, TILE, TRANSMITTANCE_STOP};
use glam::DVec2;
use std::ops::Range;

pub(super) const GROUPS: usize = TILE / LANES;

// Avoids `0/0` in the direction opposite to a splat's centre.
const MIN_NUMERATOR: f32 = 1e-20;

/// Kinds of projection, as values of a const generic: the compiler generates one loop for each.
pub(super) struct ProjectionForm;

impl ProjectionForm {
    /// Projected renderer: `D² = N`, offsets in pixels from the centre.
    pub(super) const PROJECTED: u8 = 0;
    /// Exact renderer through a pinhole: offsets in pixels from the centre.
    pub(super) const PINHOLE: u8 = 1;
    /// Exact renderer through a fisheye: offsets in direction cosines along the splat's tangent frame,
    /// computed from one ray per pixel.
    pub(super) const FISHEYE: u8 = 2;
}

/// One value per pixel of a 16×16 tile, in groups of eight adjacent pixels of a row. Pixel row `row`
/// has the groups `GROUPS·row` (left half) and `GROUPS·row + 1` (right half).
pub(super) type Plane = [[f32; LANES]; TILE * GROUPS];

/// Pixel planes of a tile; they remain in L1 while the tile is drawn.
pub(super) struct Tile {
    left: usize,
    top: usize,
    /// Transmittance of each pixel; negative if the pixel is finished or outside the image.
    transmittance: Plane,
    color: [Plane; 3],
    /// Sum of weight × depth. For the exact renderer and a pinhole, depth is the parameter `t` of the
    /// ray `(x, y, 1)·t`.
    depth: Plane,
    /// Unit ray of every pixel in camera axes; only for a fisheye.
    // Boxed, because most views have none and the planes of a tile share L1.
    rays: Option<Box<[Plane; 3]>>,
    /// Splats with the largest weights; only if textures are read.
    owners: Option<Box<Owners>>,
    /// One bit per row with an unfinished pixel.
    open_rows: u32,
}

/// Response of a splat in eight pixels.
struct Response<V> {
    /// Exponent of 2: `alpha = opacity · 2^exponent`.
    exponent: V,
    /// Position of the largest response on the ray, in units of the splat's depth or distance.
    tau: V,
    /// `τ·c − 1` with the ray's component `c` along the centre's direction.
    tau_minus_one: V,
    /// Offset `δ` from the splat's centre: pixels (pinhole) or direction cosines (fisheye).
    offset: [V; 2],
}

impl Tile {
    /// Creates an empty tile at pixel `(left, top)`. Pixels beyond `columns` × `rows` lie outside the
    /// image and are marked finished.
    pub(super) fn new(left: usize, top: usize, columns: usize, rows: usize) -> Self {
        let rows = rows.min(TILE);
        let empty = [[0.0; LANES]; TILE * GROUPS];
        let mut transmittance = [[-1.0; LANES]; TILE * GROUPS];
        for (group, pixels) in transmittance[..rows * GROUPS].iter_mut().enumerate() {
            *pixels = initial_transmittance(group % GROUPS * LANES, columns);
        }
        let open_rows = (1 << rows) - 1;
        Self {
            left,
            top,
            transmittance,
            color: [empty; 3],
            depth: empty,
            rays: None,
            owners: None,
            open_rows,
        }
    }

    /// Adds a unit ray per pixel for an equidistant fisheye. Pixels at an angle of more than π to the
    /// optical axis are marked finished.
    pub(super) fn with_fisheye_rays(mut self, k: &Intrinsics) -> Self {
        let mut rays = Box::new([[[0.0; LANES]; TILE * GROUPS]; 3]);
        for group in 0..TILE * GROUPS {
            for lane in 0..LANES {
                let column = self.left + group % GROUPS * LANES + lane;
                let row = self.top + group / GROUPS;
                let centre = DVec2::new(column as f64 + 0.5, row as f64 + 0.5);
                let ray = Lens::Fisheye.ray(k, centre);
                if ray.is_none() {
                    self.transmittance[group][lane] = -1.0;
                }
                for (plane, value) in rays.iter_mut().zip(ray.unwrap_or_default().to_array()) {
                    plane[group][lane] = value as f32;
                }
            }
        }
        self.rays = Some(rays);
        self
    }

    /// Records the splats with the largest weights from now on.
    pub(super) fn record_owners(&mut self) {
        self.owners = Some(Owners::new());
    }

    pub(super) fn owners(&self) -> Option<&Owners> {
        self.owners.as_deref()
    }

    /// Marks the tile as finished, so that it accepts no splats.
    pub(super) fn finish(&mut self) {
        self.open_rows = 0;
    }

    pub(super) fn is_finished(&self) -> bool {
        self.open_rows == 0
    }

    /// Returns the planes of transmittance (only its absolute value is valid), red, green, blue and
    /// summed depth.
    pub(super) fn planes(&self) -> [&Plane; 5] {
        let [red, green, blue] = &self.color;
        [&self.transmittance, red, green, blue, &self.depth]
    }

    /// Returns the rays of eight pixels in camera axes, of any length.
    #[inline(always)]
    pub(super) fn group_rays<V: Vector>(&self, k: &Intrinsics, group: usize) -> [V; 3] {
        if let Some(rays) = &self.rays {
            let [x, y, z] = &**rays;
            return [V::load(&x[group]), V::load(&y[group]), V::load(&z[group])];
        }
        let x0 = (self.left as f64 + 0.5 - k.cx) as f32;
        let y = (((self.top + group / GROUPS) as f64 + 0.5 - k.cy) / k.fy) as f32;
        let x = V::load(&LANE_COLUMNS[group % GROUPS]) + V::splat(x0);
        [x * V::splat(k.fx.recip() as f32), V::splat(y), V::splat(1.0)]
    }

    /// Adds the textures of the splats with the largest weights to the drawn colours.
    #[inline(always)]
    pub(super) fn add_textures<V: Vector>(
        &mut self,
        k: &Intrinsics,
        planes: &[SurfacePlane],
        textures: ShownTextures<'_>,
    ) {
        let Some(owners) = self.owners.as_deref().filter(|_| !planes.is_empty()) else { return };
        for group in 0..TILE * GROUPS {
            let [r, g, b] = &self.color;
            let colors = [V::load(&r[group]), V::load(&g[group]), V::load(&b[group])];
            // The sign of a transmittance only marks the pixel as finished.
            let passed = V::load(&self.transmittance[group]).replace_low_bits(!(1 << 31), 0);
            let (coverage, rays) = (V::splat(1.0) - passed, self.group_rays(k, group));
            let owners = (owners, group);
            let textured = add_textures(colors, coverage, owners, rays, planes, textures);
            let Some(textured) = textured else { continue };
            for (plane, textured) in self.color.iter_mut().zip(textured) {
                textured.store(&mut plane[group]);
            }
        }
    }

    /// Blends the listed splats into the tile, nearest first. If `min_front` is 0, the largest response
    /// is searched in front of the camera. If it is `−∞`, the whole line is searched.
    /// `numbers` holds the record number in the view of every entry of `all`.
    #[inline(always)]
    pub(super) fn blend_all<V: Vector, const FORM: u8, const SHADED: bool>(
        &mut self,
        list: &[u32],
        all: &Records,
        numbers: &[u32],
        min_front: f32,
    ) {
        for &index in list {
            // Tested per splat rather than per batch: behind a wall, the rest of a long list costs nothing.
            if self.is_finished() {
                break;
            }
            let index = index as usize;
            let splat = &all.records[index];
            let gradient = if SHADED { Some(&all.gradients[index]) } else { None };
            let frame =
                if FORM == ProjectionForm::FISHEYE { Some(&all.frames[index]) } else { None };
            self.blend::<V, FORM>(splat, numbers[index], gradient, frame, min_front);
        }
    }

    /// Blends one splat into the rows and groups inside its rectangle.
    #[inline(always)]
    fn blend<V: Vector, const FORM: u8>(
        &mut self,
        splat: &ConicRecord,
        number: u32,
        gradient: Option<&Gradient>,
        frame: Option<&TangentFrame>,
        min_front: f32,
    ) {
        let (rows, groups) = covered_rows_and_groups(&splat.rect, [self.left, self.top]);
        let x0 = self.left as f32 + 0.5 - splat.u;
        // Unrolled by hand: closures over vectors are not compiled for the selected instruction set.
        let x =
            [V::load(&LANE_COLUMNS[0]) + V::splat(x0), V::load(&LANE_COLUMNS[1]) + V::splat(x0)];
        for row in rows {
            if self.open_rows & (1 << row) == 0 {
                continue;
            }
            let y = V::splat((self.top + row) as f32 + 0.5 - splat.v);
            let mut stopped = false;
            for half in groups.clone() {
                let group = row * GROUPS + half;
                let response = match (frame, &self.rays) {
                    (Some(frame), Some(rays)) => {
                        let [x, y, z] = &**rays;
                        let ray = [V::load(&x[group]), V::load(&y[group]), V::load(&z[group])];
                        through_fisheye(splat, frame, ray, min_front)
                    }
                    _ => through_plane::<V, FORM>(splat, [x[half], y], min_front),
                };
                stopped |= self.blend_group::<V, FORM>(group, splat, number, gradient, &response);
            }
            if stopped && row_is_finished(&self.transmittance, row) {
                self.open_rows &= !(1 << row);
            }
        }
    }

    /// Blends a splat into eight pixels. Returns true if a pixel became finished, so that it accepts no
    /// further splats.
    #[inline(always)]
    fn blend_group<V: Vector, const FORM: u8>(
        &mut self,
        group: usize,
        splat: &ConicRecord,
        number: u32,
        gradient: Option<&Gradient>,
        response: &Response<V>,
    ) -> bool {
        let group = group % (TILE * GROUPS); // no-op that removes the bounds checks
        let transmittance = &mut self.transmittance[group];
        let Some(passed) = attenuate(transmittance, splat, response.exponent) else { return false };
        let BlendStep { weight, stopped, .. } = passed;
        for channel in 0..3 {
            let value = match gradient {
                Some(gradient) => gradient_color(splat.color[channel], gradient, channel, response),
                None => V::splat(splat.color[channel]),
            };
            add(&mut self.color[channel][group], weight * value);
        }
        let depth = match FORM {
            ProjectionForm::PROJECTED => V::splat(splat.reach),
            _ => V::splat(splat.reach) * response.tau,
        };
        add(&mut self.depth[group], weight * depth);
        if let Some(owners) = &mut self.owners {
            owners.offer(group, weight, number);
        }
        stopped
    }
}

/// Returns the initial transmittance of a group of eight pixels: 1 inside the image, negative outside.
/// `first` is the group's first column; the image ends before column `columns`. Both are relative to
/// the tile.
pub(super) fn initial_transmittance(first: usize, columns: usize) -> [f32; LANES] {
    std::array::from_fn(|lane| if first + lane < columns { 1.0 } else { -1.0 })
}

/// Contribution of a splat to eight pixels.
pub(super) struct BlendStep<V> {
    /// Alpha before the cap; 0 in a pixel where the splat is invisible.
    pub uncapped_alpha: V,
    /// Alpha times the transmittance in front of the splat.
    pub weight: V,
    /// True if a pixel became finished: it accepts no further splats.
    pub stopped: bool,
}

/// Attenuates eight pixels by one splat with `alpha = opacity · 2^exponent`. Returns `None` if the
/// splat is invisible in all eight pixels. All loops over a tile use this function, so that they blend
/// the same splats.
#[inline(always)]
pub(super) fn attenuate<V: Vector>(
    transmittance: &mut [f32; LANES],
    splat: &ConicRecord,
    exponent: V,
) -> Option<BlendStep<V>> {
    let front = V::load(transmittance);
    let visible = V::splat(splat.min_exponent).mask_at_most(exponent);
    let hit = visible.and(V::splat(f32::MIN_POSITIVE).mask_at_most(front));
    // Most groups of a splat's rectangle lie outside its ellipse, and the exponential is expensive.
    if hit.sign_bits() == 0 {
        return None;
    }
    let mut free = (V::splat(splat.opacity) * exp2(exponent)).and(hit);
    let mut weight = cap_alpha(free) * front;
    let mut next = front - weight;
    let open = V::splat(TRANSMITTANCE_STOP as f32).mask_at_most(next);
    // Lanes without a hit cannot be stopped.
    let stopped = hit.sign_bits() & !open.sign_bits() & 0xFF;
    // This case is rare, so the common path avoids the selects. A stopped pixel's transmittance changes sign
    // but keeps its magnitude, which the coverage still needs.
    if stopped != 0 {
        let goes_on = V::select(hit, open, V::splat(SET_LANE));
        (free, weight) = (free.and(goes_on), weight.and(goes_on));
        next = V::select(goes_on, next, V::splat(0.0) - front);
    }
    next.store(transmittance);
    Some(BlendStep { uncapped_alpha: free, weight, stopped: stopped != 0 })
}

/// Limits alpha to [`ALPHA_CAP`].
#[inline(always)]
pub(super) fn cap_alpha<V: Vector>(free: V) -> V {
    free.min(V::splat(ALPHA_CAP as f32))
}

/// True if no pixel of the row accepts more splats.
pub(super) fn row_is_finished(transmittance: &Plane, row: usize) -> bool {
    let groups = &transmittance[row * GROUPS..(row + 1) * GROUPS];
    // The same bound as in `attenuate`, so both agree on which pixels are open.
    groups.iter().flatten().all(|&t| t < f32::MIN_POSITIVE)
}

/// Returns the rows and the lane groups that a rectangle covers, relative to a tile at pixel
/// `(left, top)`.
#[inline(always)]
pub(super) fn covered_rows_and_groups(
    rect: &Rect,
    [left, top]: [usize; 2],
) -> (Range<usize>, Range<usize>) {
    let columns = span(rect.x0, rect.x1, left);
    (span(rect.y0, rect.y1, top), columns.start / LANES..columns.end.div_ceil(LANES))
}

/// Returns the pixels of `lo..hi` inside the tile that starts at pixel `first`, relative to `first`.
#[inline(always)]
fn span(lo: u16, hi: u16, first: usize) -> Range<usize> {
    let end = first + TILE;
    ((lo as usize).max(first) - first)..((hi as usize).min(end) - first)
}

#[inline(always)]
fn add<V: Vector>(plane: &mut [f32; LANES], value: V) {
    (V::load(plane) + value).store(plane);
}

/// Computes the response of a splat to pixels of a pinhole camera. The formulas of [`super::record`]
/// apply with `δ = offset` in pixels and `c = 1`.
#[inline(always)]
fn through_plane<V: Vector, const FORM: u8>(
    splat: &ConicRecord,
    offset: [V; 2],
    min_front: f32,
) -> Response<V> {
    let numerator = numerator(splat, offset);
    let one = V::splat(1.0);
    match FORM {
        ProjectionForm::PROJECTED => {
            let exponent = V::splat(0.0) - numerator;
            Response { exponent, tau: one, tau_minus_one: V::splat(0.0), offset }
        }
        _ => evaluate_response(splat, offset, numerator, one, min_front),
    }
}

/// Computes the response of a splat to pixels of a fisheye camera. In the formulas of [`super::record`],
/// `δ` and `c` are the unit ray's components in the splat's tangent frame.
#[inline(always)]
fn through_fisheye<V: Vector>(
    splat: &ConicRecord,
    frame: &TangentFrame,
    ray: [V; 3],
    min_front: f32,
) -> Response<V> {
    let [to_x, to_y, ahead] = frame.rows;
    let offset = [project_ray(to_x, ray), project_ray(to_y, ray)];
    evaluate_response(splat, offset, numerator(splat, offset), project_ray(ahead, ray), min_front)
}

#[inline(always)]
fn project_ray<V: Vector>(axis: [f32; 3], ray: [V; 3]) -> V {
    ray[0] * V::splat(axis[0]) + ray[1] * V::splat(axis[1]) + ray[2] * V::splat(axis[2])
}

#[inline(always)]
fn numerator<V: Vector>(splat: &ConicRecord, [x, y]: [V; 2]) -> V {
    let p = V::splat(splat.p_x) * x + V::splat(splat.p_y) * y;
    let q = V::splat(splat.q_y) * y;
    p * p + q * q
}

#[inline(always)]
fn evaluate_response<V: Vector>(
    splat: &ConicRecord,
    [x, y]: [V; 2],
    numerator: V,
    share: V,
    min_front: f32,
) -> Response<V> {
    let [l_x, l_y] = splat.linear;
    let front = share + (V::splat(l_x) * x + V::splat(l_y) * y);
    let front = front.max(V::splat(min_front));
    // In the direction opposite to the centre, front and numerator are both 0.
    let numerator = numerator.max(V::splat(MIN_NUMERATOR));
    let across = V::splat(splat.w) * numerator;
    let inverse = V::splat(1.0) / (front * front + across);
    Response {
        exponent: V::splat(0.0) - numerator * inverse,
        tau: front * inverse,
        tau_minus_one: (front * (share - front) - across) * inverse,
        offset: [x, y],
    }
}

/// Returns one channel of a projected splat's colour at an offset in pixels from the splat's centre.
#[inline(always)]
pub(super) fn offset_color<V: Vector>(
    color: f32,
    gradient: &Gradient,
    channel: usize,
    offset: [V; 2],
) -> V {
    let [x, y] = gradient.across[channel];
    apply_color_change(color, V::splat(x) * offset[0] + V::splat(y) * offset[1])
}

/// Returns one channel of a splat's colour at the point of largest response, including the colour
/// gradient (`rendering.md`, Native appearance).
#[inline(always)]
fn gradient_color<V: Vector>(
    color: f32,
    gradient: &Gradient,
    channel: usize,
    at: &Response<V>,
) -> V {
    let [x, y] = gradient.across[channel];
    let across = at.tau * (V::splat(x) * at.offset[0] + V::splat(y) * at.offset[1]);
    apply_color_change(color, V::splat(gradient.along[channel]) * at.tau_minus_one + across)
}

/// Adds a colour change to the colour at the centre. The change is limited to ±[`GRADIENT_LIMIT`] and
/// the result to at least 0.
#[inline(always)]
fn apply_color_change<V: Vector>(color: f32, change: V) -> V {
    let limit = GRADIENT_LIMIT as f32;
    // Away from its training points the gradient extrapolates; the model defines the limit.
    let change = change.max(V::splat(-limit)).min(V::splat(limit));
    (V::splat(color) + change).max(V::splat(0.0))
}

pub(super) const LANE_COLUMNS: [[f32; LANES]; GROUPS] =
    [[0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0], [8.0, 9.0, 10.0, 11.0, 12.0, 13.0, 14.0, 15.0]];

// 1.5·2²³: adding it rounds to the nearest integer, which then occupies the low mantissa bits; subtracting it
// gives that integer.
const ROUND: f32 = 12_582_912.0;

// Minimax polynomial of `2^f` on `[−½, ½]`, constant first. Maximum relative error in f32: 2.3e-7
// (`rendering.md`, CPU renderer).
const EXP2: [f32; 6] =
    [1.000_000_1, 0.693_146_97, 0.240_221_2, 0.055_507_13, 0.009_675_541, 0.001_327_647_2];

// Smallest exponent of a normal `f32`.
pub(super) const EXP2_MIN: f32 = -126.0;

/// Returns `2^x` for `x` from [`EXP2_MIN`] to 126. Lanes outside this range are undefined and must be
/// masked by the caller.
#[inline(always)]
pub(super) fn exp2<V: Vector>(x: V) -> V {
    // Rounding by addition works in every instruction set; a rounding instruction is not always available.
    let shifted = x + V::splat(ROUND);
    let f = x - (shifted - V::splat(ROUND));
    let mut sum = V::splat(EXP2[5]);
    for &coefficient in EXP2[..5].iter().rev() {
        // No fused multiply-add: results must be bit-identical on every instruction set.
        sum = sum * f + V::splat(coefficient);
    }
    sum.scale_by_power_of_two(shifted)
}

#[cfg(test)]
mod lanes_tests {
    use super::*;
    use crate::math::simd::{Isa, Kernel, LANES};

    struct Exp2(f32);

    impl Kernel for Exp2 {
        type Output = f32;

        #[inline(always)]
        fn run<V: Vector>(self) -> f32 {
            exp2(V::load(&[self.0; LANES])).to_array()[0]
        }
    }

    #[test]
    fn exp2_is_right_to_three_units_in_the_last_place() {
        let mut worst = 0f64;
        for i in 0..200_000 {
            let x = EXP2_MIN + i as f32 * (252.0 / 200_000.0);
            let got = Isa::best().run(Exp2(x));
            let want = f64::from(x).exp2();
            worst = worst.max((f64::from(got) / want - 1.0).abs());
        }
        assert!(worst < 3.0e-7, "{worst:e}");
    }
}
