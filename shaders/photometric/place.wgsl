// Location of a splat's sums among those of all splat-tile pairs, ordered by tile row and column.

struct Place {
    // Number of pairs of all preceding splats.
    first: u32,
    // First tile column, plus first tile row times 2¹⁶.
    corner: u32,
    // Number of tile columns, plus number of tile rows times 2¹⁶.
    size: u32,
}

@group(0) @binding(4) var<storage, read> places: array<Place>;
