// Tiles covered by a splat. Most splats cover at most 2×2 tiles, which fit in one word; only others need a
// footprint. Gathering words in depth order reads a quarter of the memory, which remains in the caches.

// Layout of a word: column and row of the first of 2×2 tiles, 12 bits each (more than any image needs), then
// one bit per covered tile. 0 means that the footprint must be read.
const ROW_SHIFT: u32 = 12u;
const FEW_SHIFT: u32 = 24u;
const TILE_MASK: u32 = 0xfffu;

// 16 bytes.
struct Footprint {
    low: u32,                   // first column and row of a tile rectangle, 16 bits each
    size: u32,                  // columns and rows, 16 bits each
    // Covered tiles of the rectangle, row by row; rectangles of more than 64 tiles count as fully covered.
    mask_low: u32,
    mask_high: u32,
}

const MASKED_TILES: u32 = 64u;

fn n_tiles_of(footprint: Footprint) -> u32 {
    let n_tiles = (footprint.size & 0xffffu) * (footprint.size >> 16u);
    if n_tiles > MASKED_TILES {
        return n_tiles;
    }
    return countOneBits(footprint.mask_low) + countOneBits(footprint.mask_high);
}

// Column and row of the covered tile number `which`.
fn tile_of(footprint: Footprint, which: u32) -> vec2<u32> {
    let columns = footprint.size & 0xffffu;
    var j = which;
    if columns * (footprint.size >> 16u) <= MASKED_TILES {
        let n_low = countOneBits(footprint.mask_low);
        if which < n_low {
            j = place_of_bit(footprint.mask_low, which);
        } else {
            j = 32u + place_of_bit(footprint.mask_high, which - n_low);
        }
    }
    return vec2<u32>(footprint.low & 0xffffu, footprint.low >> 16u)
        + vec2<u32>(j % columns, j / columns);
}

// Position of the set bit with `rank` set bits below it.
fn place_of_bit(mask: u32, rank: u32) -> u32 {
    var rest = mask;
    var left = rank;
    var at = 0u;
    for (var width = 16u; width > 0u; width >>= 1u) {
        let n_below = countOneBits(rest & ((1u << width) - 1u));
        if left >= n_below {
            left -= n_below;
            rest >>= width;
            at += width;
        }
    }
    return at;
}

// Word of a footprint; 0 if it covers more than 2×2 tiles.
fn few_of(footprint: Footprint) -> u32 {
    let columns = footprint.size & 0xffffu;
    let rows = footprint.size >> 16u;
    if columns > 2u || rows > 2u {
        return 0u;
    }
    // The word has two columns per row, so the second row of a single column moves up by one bit.
    let few = select(
        footprint.mask_low,
        (footprint.mask_low & 1u) | ((footprint.mask_low & 2u) << 1u),
        columns == 1u,
    );
    let column = footprint.low & 0xffffu;
    let row = footprint.low >> 16u;
    return column | (row << ROW_SHIFT) | (few << FEW_SHIFT);
}

// Column and row of the covered tile number `which` of a word.
fn few_tile_of(few: u32, which: u32) -> vec2<u32> {
    let j = place_of_bit(few >> FEW_SHIFT, which);
    return vec2<u32>(few & TILE_MASK, (few >> ROW_SHIFT) & TILE_MASK) + vec2<u32>(j % 2u, j / 2u);
}
