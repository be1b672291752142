//! Numbering of the components used by one tile, in order of appearance.

/// Maps keys below a bound to slots. A stamp per tile avoids clearing the table.
#[derive(Debug, Default)]
pub(super) struct Slots {
    /// By key: the tile that used it last, and its slot there.
    stamps: Vec<(u32, u32)>,
    tile: u32,
    n: u32,
}

impl Slots {
    /// Begins a tile whose keys are below `bound`.
    #[inline(always)]
    pub fn begin(&mut self, bound: usize) {
        // When the stamp wraps, slots of early tiles could be mistaken for this one's, so it is reset.
        if self.stamps.len() < bound || self.tile == u32::MAX {
            self.stamps.clear();
            self.stamps.resize(bound, (0, 0));
            self.tile = 0;
        }
        self.tile += 1;
        self.n = 0;
    }

    /// Returns the slot of `key`, assigning the next one if it is new.
    #[inline(always)]
    pub fn find(&mut self, key: u32) -> usize {
        let seen = &mut self.stamps[key as usize];
        if seen.0 != self.tile {
            *seen = (self.tile, self.n);
            self.n += 1;
        }
        seen.1 as usize
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_are_numbered_in_order_of_appearance() {
        let mut slots = Slots::default();
        for tile in 0..3 {
            if tile == 2 {
                slots.tile = u32::MAX; // the stamp starts over
            }
            slots.begin(100_001);
            let found = [7, 9, 7, 100_000, 9, 0].map(|key| slots.find(key));
            assert_eq!(found, [0, 1, 0, 2, 1, 3]);
        }
    }
}
