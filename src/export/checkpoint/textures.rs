//! Sections of textures: a row for each textured component, then flat arrays of all their patches.

use super::check::value_defect;
use super::container::{Container, Section};
use super::error::{Defect, tag_text};
use super::sections::*;
use crate::export::error::try_with_capacity;
use crate::model::scene::photometric::PhotometricState;
use crate::model::scene::texels::{
    MAX_TEXEL_WEIGHT, MOST_FORMER, MOST_PER_WEIGHT, TexelSums, TextureSums,
};
use crate::model::splat::texture::{ABSENT, Lattice, MAX_LEVEL, PATCH, TEXELS};
use std::sync::Arc;

/// Number of stored values of a lattice: anchor, directions of columns and rows, half the side.
const N_LATTICE: usize = 10;
/// Number of stored values of a texture's size: level, number of patches.
const N_SIZE: usize = 2;
/// Number of stored values of a texture's predictions: two sums for each of two priors.
const N_PREDICTED: usize = 4;
/// Number of stored values of a patch: weight, red, green and blue of each texel.
const N_PATCH: usize = 4 * TEXELS;
/// Maximum number of doublings of the pitch. Beyond, every texture has the coarsest lattice.
const MAX_STEPS: u32 = 1 << 16;
/// Largest sum of predictions: two billion pixels of the largest product. Beyond, additions could overflow.
const MAX_PREDICTED: u64 = 1 << 62;
/// Largest error of an axis' length and of the cosine between the axes.
const AXIS_TOLERANCE: f64 = 1e-3;

type Textures = Vec<Option<Arc<TextureSums>>>;

/// Returns the sections of the textures; none if no component has one.
pub(super) fn sections(state: &PhotometricState) -> Vec<Section<'_>> {
    let mut sections = Vec::new();
    if state.texture_steps > 0 {
        sections.push(Section::owned::<u32>(TEXTURE_STEPS, vec![state.texture_steps]));
    }
    let textures = || state.textures.iter().flatten();
    if textures().next().is_none() {
        return sections;
    }
    let all = || state.textures.iter().enumerate();
    let ids = all().filter(|(_, texture)| texture.is_some()).map(|(id, _)| id as u32);
    let lattices: Vec<[f32; N_LATTICE]> = textures().map(|t| lattice_row(&t.lattice)).collect();
    let size = |t: &Arc<TextureSums>| [t.lattice.level.into(), t.patches.len() as u32];
    let sizes: Vec<[u32; N_SIZE]> = textures().map(size).collect();
    let predicted: Vec<[[i64; 2]; 2]> = textures().map(|t| t.predicted).collect();
    // Borrowed: textures may hold hundreds of megabytes.
    let indices = textures().map(|t| bytemuck::cast_slice(&t.index));
    let texels = textures().map(|t| bytemuck::cast_slice(&t.patches[..]));
    sections.extend([
        Section::owned::<u32>(TEXTURE_IDS, ids.collect()),
        Section::owned::<f32>(TEXTURE_LATTICES, lattices.into_flattened()),
        Section::owned::<u32>(TEXTURE_SIZES, sizes.into_flattened()),
        Section::owned::<i64>(TEXTURE_PREDICTED, predicted.into_flattened().into_flattened()),
        Section::from_runs::<u16>(TEXTURE_INDICES, indices),
        Section::from_runs::<i32>(TEXTURE_TEXELS, texels),
    ]);
    let former = all().flat_map(|(id, texture)| {
        let former = texture.iter().flat_map(|texture| &texture.former);
        former.map(move |lattice| ([id as u32, lattice.level.into()], lattice_row(lattice)))
    });
    let (of, former): (Vec<_>, Vec<_>) = former.unzip();
    if !of.is_empty() {
        sections.push(Section::owned::<u32>(TEXTURE_FORMER, of.into_flattened()));
        sections.push(Section::owned::<f32>(TEXTURE_FORMER_LATTICES, former.into_flattened()));
    }
    sections
}

fn lattice_row(Lattice { anchor, axes, half, .. }: &Lattice) -> [f32; N_LATTICE] {
    let [[a, b, c], [d, e, f]] = *axes;
    let [x, y, z] = *anchor;
    [x, y, z, a, b, c, d, e, f, *half]
}

/// Reads the number of doublings of the pitch; 0 if the file has none.
pub(super) fn read_steps(sections: &Container) -> Result<u32, Defect> {
    let steps = |tag| sections.elements::<u32>(tag, Some(1));
    let steps = sections.optional(TEXTURE_STEPS, || steps(TEXTURE_STEPS))?;
    Ok(steps.first().copied().unwrap_or(0))
}

/// Reads the textures of a scene with `n` components; none if the file has none. Values are checked by
/// [`check()`].
pub(super) fn read(sections: &Container, n: usize) -> Result<Textures, Defect> {
    if !sections.has(TEXTURE_IDS) {
        return Ok(Vec::new());
    }
    let ids = sections.elements::<u32>(TEXTURE_IDS, None)?;
    super::check::check_ascending(TEXTURE_IDS, ids.iter().copied(), n)?;
    let count = Some(ids.len());
    let lattices = sections.rows::<f32, N_LATTICE>(TEXTURE_LATTICES, count)?;
    let sizes = sections.rows::<u32, N_SIZE>(TEXTURE_SIZES, count)?;
    let predicted = sections.rows::<i64, N_PREDICTED>(TEXTURE_PREDICTED, count)?;
    let sizes = checked_sizes(&ids, sizes)?;
    // Both are at most 1,024 for each texture that the file lists, so neither sum overflows.
    let n_places = sizes.iter().map(|[places, _]| places).sum();
    let n_patches = sizes.iter().map(|[_, patches]| patches).sum::<usize>();
    let mut indices = sections.bytes::<u16>(TEXTURE_INDICES, Some(n_places))?;
    let mut texels = sections.bytes::<i32>(TEXTURE_TEXELS, Some(N_PATCH * n_patches))?;
    // Ids are below the number of components, whose rows the file holds.
    let length = ids.last().map_or(0, |&id| id as usize + 1);
    let mut textures: Textures = try_with_capacity(length).map_err(Defect::Memory)?;
    for (((id, row), [places, patches]), predicted) in
        ids.into_iter().zip(lattices).zip(sizes).zip(predicted)
    {
        let index = rows::<u16, 1>(taken(&mut indices, places * size_of::<u16>()))?;
        let patches =
            rows::<i32, N_PATCH>(taken(&mut texels, patches * size_of::<[i32; N_PATCH]>()))?;
        // A lattice of `4·2^level` texels a side has `4^level` patches.
        let level = (places.trailing_zeros() / 2) as u8;
        textures.resize(id as usize, None);
        textures.push(Some(Arc::new(TextureSums {
            lattice: lattice_of(row, level),
            former: Vec::new(),
            predicted: bytemuck::cast(predicted),
            index: index.into_flattened(),
            patches: Arc::new(bytemuck::cast_vec::<_, [TexelSums; TEXELS]>(patches)),
        })));
    }
    read_former(sections, &mut textures)?;
    Ok(textures)
}

/// Reads the former lattices of textures: component and level of each, ascending, and the lattices.
fn read_former(sections: &Container, textures: &mut Textures) -> Result<(), Defect> {
    if !sections.has(TEXTURE_FORMER) {
        return Ok(());
    }
    let of = sections.rows::<u32, 2>(TEXTURE_FORMER, None)?;
    let rows = sections.rows::<f32, N_LATTICE>(TEXTURE_FORMER_LATTICES, Some(of.len()))?;
    for ([id, level], row) in of.into_iter().zip(rows) {
        let id = id as usize;
        // Shared by nothing yet, so nothing is copied.
        let texture = textures.get_mut(id).and_then(Option::as_mut).and_then(Arc::get_mut);
        let Some(texture) = texture.filter(|texture| texture.former.len() < MOST_FORMER) else {
            let expected = format!("components with textures, each at most {MOST_FORMER} times");
            return Err(Defect::malformed(tag_text(TEXTURE_FORMER), expected, id.to_string()));
        };
        // A level that no lattice can have is refused by the check.
        texture.former.push(lattice_of(row, level.try_into().unwrap_or(u8::MAX)));
    }
    Ok(())
}

fn lattice_of(row: [f32; N_LATTICE], level: u8) -> Lattice {
    let [x, y, z, a, b, c, d, e, f, half] = row;
    Lattice { anchor: [x, y, z], axes: [[a, b, c], [d, e, f]], half, level }
}

/// Returns the numbers of places for patches and of patches for each texture, from levels and numbers of
/// patches.
fn checked_sizes(ids: &[u32], sizes: Vec<[u32; N_SIZE]>) -> Result<Vec<[usize; 2]>, Defect> {
    let checked = |(&id, [level, patches]): (&u32, [u32; N_SIZE])| {
        let refuse = |name, expected: String, found: u32| {
            Err(value_defect(TEXTURE_SIZES, id as usize, name, &expected, found.into()))
        };
        if level > MAX_LEVEL.into() {
            return refuse("level", format!("at most {MAX_LEVEL}"), level);
        }
        let places = 1 << (2 * level);
        if patches > places {
            return refuse("patches", format!("at most {places} at level {level}"), patches);
        }
        Ok([places, patches].map(|n| n as usize))
    };
    ids.iter().zip(sizes).map(checked).collect()
}

/// Splits off the first `n` bytes; all if there are fewer.
fn taken<'a>(bytes: &mut &'a [u8], n: usize) -> &'a [u8] {
    let (first, rest) = bytes.split_at_checked(n).unwrap_or((bytes, &[]));
    *bytes = rest;
    first
}

/// Checks the values of all textures.
pub(super) fn check(state: &PhotometricState) -> Result<(), Defect> {
    if state.texture_steps > MAX_STEPS {
        let expected = format!("at most {MAX_STEPS}");
        let found = state.texture_steps.to_string();
        return Err(Defect::malformed(tag_text(TEXTURE_STEPS), expected, found));
    }
    if state.textures.len() > state.splats.len() {
        let expected = format!("components below {}", state.splats.len());
        let found = (state.textures.len() - 1).to_string();
        return Err(Defect::malformed(tag_text(TEXTURE_IDS), expected, found));
    }
    let mut textures = state.textures.iter().enumerate();
    textures.try_for_each(|(id, texture)| texture.as_ref().map_or(Ok(()), |t| check_one(id, t)))
}

fn check_one(id: usize, texture: &TextureSums) -> Result<(), Defect> {
    let TextureSums { lattice, former, predicted, index, patches } = texture;
    check_lattice(id, lattice, [TEXTURE_LATTICES, TEXTURE_SIZES])?;
    let of_former = [TEXTURE_FORMER_LATTICES, TEXTURE_FORMER];
    former.iter().try_for_each(|lattice| check_lattice(id, lattice, of_former))?;
    let is_odd = |sum: &&i64| sum.unsigned_abs() > MAX_PREDICTED;
    if let Some(&sum) = predicted.as_flattened().iter().find(is_odd) {
        let expected = "at most 2^62";
        return Err(value_defect(TEXTURE_PREDICTED, id, "prediction", expected, sum as f64));
    }
    if let Some([_, power]) = predicted.iter().find(|[_, power]| *power < 0) {
        let expected = "0 or more";
        return Err(value_defect(TEXTURE_PREDICTED, id, "square", expected, *power as f64));
    }
    let places = (lattice.side() / PATCH).pow(2);
    if index.len() != places {
        let expected = format!("{places} entries at level {}", lattice.level);
        return Err(value_defect(TEXTURE_INDICES, id, "size", &expected, index.len() as f64));
    }
    // A patch at two places would be counted twice, one at no place would never be shown.
    let mut is_used = vec![false; patches.len()];
    for &entry in index.iter().filter(|&&entry| entry != ABSENT) {
        match is_used.get_mut(usize::from(entry)) {
            Some(used) if !*used => *used = true,
            _ => {
                let expected = format!("each of {} patches once", patches.len());
                return Err(value_defect(TEXTURE_INDICES, id, "patch", &expected, entry.into()));
            }
        }
    }
    if let Some(unused) = is_used.iter().position(|used| !used) {
        let expected = "a place for every patch";
        return Err(value_defect(TEXTURE_INDICES, id, "unused patch", expected, unused as f64));
    }
    patches.as_flattened().iter().try_for_each(|texel| check_texel(id, texel))
}

/// Checks a lattice of a component. `tags` name the sections of its place and of its level.
fn check_lattice(id: usize, lattice: &Lattice, tags: [[u8; 4]; 2]) -> Result<(), Defect> {
    let refuse = |name, expected, found: f64| Err(value_defect(tags[0], id, name, expected, found));
    if lattice.level > MAX_LEVEL {
        let (expected, found) = (format!("at most {MAX_LEVEL}"), lattice.level);
        return Err(value_defect(tags[1], id, "level", &expected, found.into()));
    }
    if let Some(&found) = lattice.anchor.iter().find(|x| !x.is_finite()) {
        return refuse("anchor", "a finite number", found.into());
    }
    let dot = |a: [f32; 3], b: [f32; 3]| -> f64 {
        a.iter().zip(b).map(|(a, b)| f64::from(*a) * f64::from(b)).sum()
    };
    // Negated, so that NaN is refused as well.
    let is_near = |x: f64, to: f64| (x - to).abs() <= AXIS_TOLERANCE;
    let [u, v] = lattice.axes;
    if let Some(length) =
        [u, v].map(|axis| dot(axis, axis).sqrt()).into_iter().find(|l| !is_near(*l, 1.0))
    {
        return refuse("axis", "a unit vector", length);
    }
    let cosine = dot(u, v);
    if !is_near(cosine, 0.0) {
        return refuse("axes", "perpendicular directions", cosine);
    }
    if !(lattice.half.is_finite() && lattice.half > 0.0) {
        return refuse("half", "a positive number", lattice.half.into());
    }
    Ok(())
}

fn check_texel(id: usize, texel: &TexelSums) -> Result<(), Defect> {
    if texel.weight > MAX_TEXEL_WEIGHT {
        let expected = format!("0 to {MAX_TEXEL_WEIGHT}");
        // As the file holds it: a signed number.
        let found = f64::from(texel.weight.cast_signed());
        return Err(value_defect(TEXTURE_TEXELS, id, "weight", &expected, found));
    }
    let most = u64::from(texel.weight) * u64::from(MOST_PER_WEIGHT);
    match texel.color.iter().find(|color| u64::from(color.unsigned_abs()) > most) {
        None => Ok(()),
        Some(&found) => {
            let expected = format!("at most {MOST_PER_WEIGHT} per weight, for {}", texel.weight);
            Err(value_defect(TEXTURE_TEXELS, id, "colour", &expected, found.into()))
        }
    }
}
