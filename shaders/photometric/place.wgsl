// Where the sums of a splat lie among those of all pairs of splat and tile: tile by tile, row by row.

struct Place {
    // Pairs of splat and tile of the splats before.
    first: u32,
    // First column of tiles; first row, times 2¹⁶.
    corner: u32,
    // Columns of tiles; rows, times 2¹⁶.
    size: u32,
}

@group(0) @binding(4) var<storage, read> places: array<Place>;
