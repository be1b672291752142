//! Wide sums by component, for rows that could overflow.

use crate::model::scene::sums::N_SUMS;

// Marks a component without wide sums.
const NONE: u32 = u32::MAX;

/// Wide sums of some components. They are looked up for every point of a frame, so the index is a direct
/// table by component.
#[derive(Default)]
pub struct WideSums {
    /// Index into `rows` by component, up to the last with wide sums.
    places: Vec<u32>,
    rows: Vec<(u32, [f64; N_SUMS])>,
}

impl WideSums {
    /// Number of components with wide sums.
    pub fn len(&self) -> usize {
        self.rows.len()
    }

    /// Iterates over these components.
    pub fn ids(&self) -> impl Iterator<Item = u32> {
        self.rows.iter().map(|(id, _)| *id)
    }

    /// Returns the wide sums of a component, if any.
    #[inline(always)]
    pub fn get(&self, id: u32) -> Option<&[f64; N_SUMS]> {
        let place = *self.places.get(id as usize)?;
        self.rows.get(place as usize).map(|(_, sums)| sums)
    }

    /// Returns the wide sums of a component, if any.
    pub fn get_mut(&mut self, id: u32) -> Option<&mut [f64; N_SUMS]> {
        let place = *self.places.get(id as usize)?;
        self.rows.get_mut(place as usize).map(|(_, sums)| sums)
    }

    /// Adds to the wide sums of a component.
    pub fn add(&mut self, id: u32, sums: &[f64; N_SUMS]) {
        match self.get_mut(id) {
            // Integer quanta below 2⁵³ are exact in f64, hence independent of the order.
            Some(wide) => wide.iter_mut().zip(sums).for_each(|(wide, sum)| *wide += sum),
            None => {
                let n = self.places.len().max(id as usize + 1);
                self.places.resize(n, NONE);
                self.places[id as usize] = self.rows.len() as u32;
                self.rows.push((id, *sums));
            }
        }
    }

    /// Removes the wide sums of a component.
    pub fn remove(&mut self, id: u32) {
        let Some(place) = self.places.get_mut(id as usize) else { return };
        let place = std::mem::replace(place, NONE) as usize;
        if place < self.rows.len() {
            self.rows.swap_remove(place);
            if let Some((moved, _)) = self.rows.get(place) {
                self.places[*moved as usize] = place as u32;
            }
        }
    }
}

impl FromIterator<(u32, [f64; N_SUMS])> for WideSums {
    fn from_iter<I: IntoIterator<Item = (u32, [f64; N_SUMS])>>(rows: I) -> Self {
        let mut wide = Self::default();
        rows.into_iter().for_each(|(id, sums)| wide.add(id, &sums));
        wide
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sums_stay_with_their_component() {
        let sums = |value: f64| [value; N_SUMS];
        let mut wide: WideSums =
            [(7, sums(1.0)), (2, sums(2.0)), (9, sums(3.0))].into_iter().collect();
        wide.add(2, &sums(0.5));
        wide.remove(7);
        wide.remove(7);
        wide.remove(100);
        let found = [2, 7, 9, 100].map(|id| wide.get(id).map(|sums| sums[N_SUMS - 1]));
        assert_eq!((found, wide.len()), ([Some(2.5), None, Some(3.0), None], 2));
        wide.add(7, &sums(4.0));
        *wide.get_mut(9).unwrap() = sums(5.0);
        let found = [2, 7, 9].map(|id| wide.get(id).map(|sums| sums[0]));
        assert_eq!(found, [Some(2.5), Some(4.0), Some(5.0)]);
        assert!(wide.get_mut(8).is_none());
    }
}
