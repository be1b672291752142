//! Places for texts beside their marks where they cover neither each other nor a mark.

/// Width of a character and height of a line, pixels.
const CHARACTER: [i32; 2] = [8, 15];
/// Half the side of a mark, pixels.
const MARK: i32 = 6;
/// Steps up and down that are tried.
const STEPS: i32 = 14;

#[derive(Clone, Copy)]
struct Rect {
    lo: [i32; 2],
    hi: [i32; 2],
}

impl Rect {
    fn meets(&self, other: &Self) -> bool {
        (0..2).all(|i| self.lo[i] < other.hi[i] && other.lo[i] < self.hi[i])
    }

    fn is_within(&self, lo: [i32; 2], hi: [i32; 2]) -> bool {
        (0..2).all(|i| self.lo[i] >= lo[i] && self.hi[i] <= hi[i])
    }
}

/// Upper left corner of every text, in the order given; `marks` are centres in pixels, `area` the
/// corners that the texts must stay between.
pub fn place(marks: &[([i32; 2], &str)], area: [[i32; 2]; 2]) -> Vec<[i32; 2]> {
    let around = |[x, y]: [i32; 2]| Rect { lo: [x - MARK, y - MARK], hi: [x + MARK, y + MARK] };
    // All marks before the first text, or a text could cover a mark that comes later.
    let mut taken: Vec<Rect> = marks.iter().map(|(at, _)| around(*at)).collect();
    let mut corners = Vec::with_capacity(marks.len());
    for (at, text) in marks {
        let width = CHARACTER[0] * text.chars().count() as i32;
        let choices: Vec<Rect> = candidates(*at, width).collect();
        let free =
            |r: &&Rect| r.is_within(area[0], area[1]) && !taken.iter().any(|other| other.meets(r));
        // Where everything is taken, the first place inside is as good as any.
        let chosen = choices
            .iter()
            .find(free)
            .or_else(|| choices.iter().find(|r| r.is_within(area[0], area[1])))
            .unwrap_or(&choices[0]);
        taken.push(*chosen);
        corners.push(chosen.lo);
    }
    corners
}

/// Beside the mark, then ever further up and down.
fn candidates([x, y]: [i32; 2], width: i32) -> impl Iterator<Item = Rect> {
    let [_, height] = CHARACTER;
    let shifts = (0..STEPS).flat_map(move |i| [-i * height, (i + 1) * height]);
    shifts.flat_map(move |shift| {
        let top = y + shift - height - 1;
        [x + MARK + 3, x - MARK - 3 - width]
            .map(|left| Rect { lo: [left, top], hi: [left + width, top + height] })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texts_of_equal_marks_do_not_cover_each_other() {
        let marks = [([50, 50], "one"), ([50, 50], "two"), ([52, 50], "three")];
        let corners = place(&marks, [[0, 0], [200, 200]]);
        let rects: Vec<Rect> = corners
            .iter()
            .zip(marks)
            .map(|(&lo, (_, text))| Rect {
                lo,
                hi: [lo[0] + 8 * text.len() as i32, lo[1] + CHARACTER[1]],
            })
            .collect();
        for (i, a) in rects.iter().enumerate() {
            assert!(rects[..i].iter().all(|b| !a.meets(b)), "{corners:?}");
        }
    }

    #[test]
    fn texts_stay_inside() {
        let [corner] = place(&[([195, 50], "long text")], [[0, 0], [200, 200]])[..] else {
            panic!()
        };
        assert!(corner[0] + 9 * 8 <= 195, "{corner:?}");
    }
}
