//! Splats that the viewport shows, in learned colours or coloured by an attribute.

use super::splat_updates::{SplatChange, SplatUpdate, apply};
use crate::model::attributes::ComponentAttributes;
use crate::model::splat::appearance::{Finishing, SplatSet};
use crate::model::splat::splats::Splat;
use crate::model::splat::texture::{Textures, painted_by_share};
use crate::render::attributes::{Attribute, Range};
use crate::render::finish::ramp;
use std::sync::Arc;

#[derive(Default)]
pub struct Palette {
    learned: Arc<SplatSet>,
    /// Attribute whose values colour the splats; `None` for learned colours.
    attribute: Option<Attribute>,
    /// Attributes of each splat. Empty unless they colour the splats or are requested.
    attributes: Vec<ComponentAttributes>,
    is_asked: bool,
    /// Attribute values at the ends of the colour ramp, while `attribute` is set.
    range: Option<Range>,
    /// Splats coloured by `attribute`; empty if `attribute` is `None`.
    // Without gradients and learned textures: a colour that encodes a value does not vary with the view.
    shown: Arc<SplatSet>,
    /// Learned textures, and the same painted by share, while those are shown.
    textures: [Arc<Textures>; 2],
}

impl Palette {
    /// Applies an update from the trainer. Returns the resulting change to be painted.
    pub fn change(&mut self, update: SplatUpdate) -> SplatChange {
        let SplatUpdate { change, attributes, .. } = update;
        let changed = apply(&mut self.learned, change.clone());
        if self.attribute.is_none() && !self.is_asked {
            return change;
        }
        self.attributes.resize(self.learned.len(), ComponentAttributes::default());
        match &changed {
            // The worker sent this update before it received the request for attributes.
            None if attributes.is_empty() => self.attributes.fill(ComponentAttributes::default()),
            None => self.attributes = attributes,
            Some(ids) => {
                for (&id, new) in ids.iter().zip(attributes) {
                    if let Some(slot) = self.attributes.get_mut(id as usize) {
                        *slot = new;
                    }
                }
            }
        }
        if self.attribute.is_none() {
            return change;
        }
        // Another range changes the colour of every splat, even of unchanged ones.
        let all_differ = self.update_range();
        match changed {
            Some(ids) if !all_differ => self.color(ids),
            _ => self.color_all(),
        }
    }

    /// Selects the attribute that colours the splats. Returns the resulting change to be painted, if any.
    pub fn set_attribute(&mut self, attribute: Option<Attribute>) -> Option<SplatChange> {
        if attribute == self.attribute {
            return None;
        }
        self.attribute = attribute;
        self.textures = Default::default();
        if attribute.is_some() {
            self.attributes.resize(self.learned.len(), ComponentAttributes::default());
            self.update_range();
            return Some(self.color_all());
        }
        // A second copy of the scene is stored only while it is displayed.
        (self.range, self.shown) = (None, Arc::default());
        if !self.is_asked {
            self.attributes = Vec::new();
        }
        Some(SplatChange::All(self.learned.clone()))
    }

    /// Sets whether attributes are stored even if they do not colour the splats.
    pub fn set_stores_attributes(&mut self, is_asked: bool) {
        self.is_asked = is_asked;
        if !is_asked && self.attribute.is_none() {
            self.attributes = Vec::new();
        }
    }

    /// Returns the attributes of each splat. Empty if they are not requested; default values until they are
    /// received.
    pub fn attributes(&self) -> &[ComponentAttributes] {
        &self.attributes
    }

    pub fn splats(&self) -> &Arc<SplatSet> {
        if self.attribute.is_some() { &self.shown } else { &self.learned }
    }

    /// Returns the splats in learned colours. Other threads may share them.
    pub fn learned(&self) -> &Arc<SplatSet> {
        &self.learned
    }

    /// Returns the displayed attribute, with the values at the ends of the colour ramp if any are known.
    /// `None` for learned colours.
    pub fn legend(&self) -> Option<(Attribute, Option<Range>)> {
        Some((self.attribute?, self.range))
    }

    /// Updates the range of the colour ramp if it no longer fits the attribute values; returns true if
    /// it changed.
    fn update_range(&mut self) -> bool {
        let fresh = self.attribute.and_then(|a| Range::of(a, &self.attributes));
        let stays = match (&self.range, &fresh) {
            (Some(range), Some(fresh)) => range.is_similar_to(fresh),
            (range, fresh) => range.is_none() && fresh.is_none(),
        };
        if !stays {
            self.range = fresh;
        }
        !stays
    }

    fn colored(&self, slot: usize) -> Splat {
        let unknown = crate::render::attributes::UNKNOWN;
        let color = self.range.map_or(unknown, |range| range.color(&self.attributes[slot]));
        Splat { color, ..self.learned[slot] }
    }

    fn color(&mut self, ids: Arc<[u32]>) -> SplatChange {
        let splats: Vec<Splat> = ids.iter().map(|&id| self.colored(id as usize)).collect();
        let splats = SplatSet::from(splats).finished(self.finishing());
        Arc::make_mut(&mut self.shown).replace(&ids, &splats);
        SplatChange::Some { ids, splats: Arc::new(splats) }
    }

    fn color_all(&mut self) -> SplatChange {
        let all: Vec<Splat> = (0..self.learned.len()).map(|slot| self.colored(slot)).collect();
        self.shown = Arc::new(SplatSet::from(all).finished(self.finishing()));
        SplatChange::All(self.shown.clone())
    }

    /// Returns the finishing parameters of splats coloured by `attribute`.
    fn finishing(&mut self) -> Finishing {
        let learned = self.learned.finishing();
        let shown =
            learned.textures.as_ref().filter(|_| self.attribute == Some(Attribute::Texture));
        let textures = shown.map(|textures| {
            let [old, painted] = &self.textures;
            if !Arc::ptr_eq(old, textures) {
                let painted = painted_by_share(textures, [old, painted], ramp);
                self.textures = [textures.clone(), Arc::new(painted)];
            }
            self.textures[1].clone()
        });
        Finishing { textures, ..learned.without_textures() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::app::splat_updates::RunMoment;
    use crate::model::splat::texture::{Lattice, TEXELS, Texel, Texture};
    use crate::render::attributes::UNKNOWN;

    fn born(frame: Option<u32>) -> ComponentAttributes {
        ComponentAttributes { birth: frame, ..ComponentAttributes::default() }
    }

    fn all(n: usize) -> SplatChange {
        let splat = Splat { color: [0.5, 0.2, 0.1], opacity: 1.0, ..Splat::default() };
        SplatChange::all(vec![splat; n])
    }

    #[test]
    fn colours_follow_the_mode_and_come_back() {
        let mut palette = Palette::default();
        palette.change(all(3).into());
        assert!(palette.legend().is_none());
        let unknown = palette.set_attribute(Some(Attribute::Birth)).unwrap();
        assert!(matches!(unknown, SplatChange::All(s) if s.iter().all(|s| s.color == UNKNOWN)));
        assert!(palette.set_attribute(Some(Attribute::Birth)).is_none());
        let attributes = vec![born(Some(0)), born(None), born(Some(10))];
        palette.change(SplatUpdate { change: all(3), attributes, after: RunMoment::default() });
        let colors: Vec<_> = palette.splats().iter().map(|s| s.color).collect();
        assert_eq!(colors, [ramp(0.0), UNKNOWN, ramp(1.0)]);
        palette.set_attribute(None);
        assert!(palette.splats().iter().all(|s| s.color == [0.5, 0.2, 0.1]));
    }

    #[test]
    fn textures_do_not_cover_the_colours_of_an_attribute() {
        let textures = Some(Arc::new(vec![None; 2]));
        let finishing = Finishing { textures, ..Finishing::default() };
        let learned = SplatSet::from(vec![Splat::default(); 2]).finished(finishing);
        let mut palette = Palette::default();
        palette.change(SplatChange::all(learned.clone()).into());
        palette.set_attribute(Some(Attribute::Birth));
        assert!(palette.splats().finishing().textures.is_none());
        palette.change(SplatChange::some(vec![1], learned).into());
        assert!(palette.splats().finishing().textures.is_none());
        palette.set_attribute(None);
        assert!(palette.splats().finishing().textures.is_some());
    }

    #[test]
    fn texels_are_coloured_by_share_and_splats_as_0() {
        let texture = |share: f32| {
            let axes = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
            let lattice = Lattice { anchor: [0.0; 3], axes, half: 1.0, level: 0 };
            let patches = vec![[Texel::new([0.5; 3], share); TEXELS]];
            Some(Arc::new(Texture { lattice, index: vec![0], patches }))
        };
        let learned = |textures: Textures| {
            let finishing =
                Finishing { textures: Some(Arc::new(textures)), ..Finishing::default() };
            SplatSet::from(vec![Splat::default(); 2]).finished(finishing)
        };
        let of = |palette: &Palette, splat: usize| {
            palette.splats().finishing().textures.as_ref().unwrap()[splat].clone()
        };
        let ramped = |share| Some([Texel::new(ramp(share), 1.0); TEXELS]);
        let texels =
            |palette: &Palette, splat| of(palette, splat).map(|texture| texture.patches[0]);
        let (first, mut palette) = (texture(1.0), Palette::default());
        palette.change(SplatChange::all(learned(vec![first.clone(), None])).into());
        palette.set_attribute(Some(Attribute::Texture));
        assert!(palette.splats().iter().all(|splat| splat.color == ramp(0.0)));
        assert_eq!([0, 1].map(|splat| texels(&palette, splat)), [ramped(1.0), None]);
        let before = of(&palette, 0);
        // A change of one splat comes with all textures.
        let change = SplatChange::some(vec![1], learned(vec![first, texture(0.0)]));
        assert!(matches!(palette.change(change.into()), SplatChange::Some { .. }));
        assert_eq!([0, 1].map(|splat| texels(&palette, splat)), [ramped(1.0), ramped(0.0)]);
        assert!(Arc::ptr_eq(&before.unwrap(), &of(&palette, 0).unwrap()), "painted once");
        palette.set_attribute(Some(Attribute::Birth));
        assert!(palette.splats().finishing().textures.is_none());
        assert!(palette.textures.iter().all(|textures| textures.is_empty()));
    }

    #[test]
    fn a_small_change_stays_small_while_the_range_holds() {
        let mut palette = Palette::default();
        palette.change(all(4).into());
        palette.set_attribute(Some(Attribute::Birth));
        let attributes = vec![born(Some(0)), born(None), born(Some(10)), born(None)];
        palette.change(SplatUpdate { change: all(4), attributes, after: RunMoment::default() });
        let change = |palette: &mut Palette, id, frame| {
            let change = SplatChange::some(vec![id], vec![Splat::default()]);
            let attributes = vec![born(Some(frame))];
            palette.change(SplatUpdate { change, attributes, after: RunMoment::default() })
        };
        let within = change(&mut palette, 1, 5);
        assert!(matches!(&within, SplatChange::Some { ids, splats }
            if ids[..] == [1] && splats[0].color == ramp(0.5)));
        assert!(matches!(change(&mut palette, 3, 1000), SplatChange::All(_)));
        assert_eq!(palette.splats()[2].color, ramp(10.0 / 1000.0));
        assert_eq!(palette.learned()[3], Splat::default());
    }
}
