//! Four-letter tags of the sections.

pub const CONFIG: [u8; 4] = *b"CONF";
pub const META: [u8; 4] = *b"META";
pub const NUMERICS: [u8; 4] = *b"NUMX";
pub const CURSOR: [u8; 4] = *b"CURS";
pub const HISTORY: [u8; 4] = *b"HIST";

pub const NORMALIZATION: [u8; 4] = *b"NORM";
pub const PRIOR: [u8; 4] = *b"PRIR";
pub const ALPHA: [u8; 4] = *b"DIRI";
pub const MEANS: [u8; 4] = *b"MINI";
pub const COUNTS: [u8; 4] = *b"STAN";
pub const FIRST: [u8; 4] = *b"STA1";
pub const SECOND: [u8; 4] = *b"STA2";
pub const CARRY_IDS: [u8; 4] = *b"CARI";
pub const CARRY_LIMBS: [u8; 4] = *b"CARL";

pub const ORIGIN: [u8; 4] = *b"ORIG";
pub const SEEDS: [u8; 4] = *b"SEED";
pub const COARSENED: [u8; 4] = *b"COAR";
pub const SHARES: [u8; 4] = *b"SHAR";
pub const SUMS: [u8; 4] = *b"SUMS";
pub const WIDE_IDS: [u8; 4] = *b"WIDI";
pub const WIDE_SUMS: [u8; 4] = *b"WIDE";
pub const VISIBILITY: [u8; 4] = *b"LOOK";
pub const COMPONENTS: [u8; 4] = *b"COMP";
pub const EXPOSURES: [u8; 4] = *b"EXPO";
pub const POSES: [u8; 4] = *b"POSE";
pub const POSE_ROTATIONS: [u8; 4] = *b"POSR";
pub const TRAJECTORY: [u8; 4] = *b"TRAJ";
pub const RETAINED: [u8; 4] = *b"KEPT";
pub const KEPT_SHOWN_IDS: [u8; 4] = *b"KESI";
pub const RETAINED_MEANS: [u8; 4] = *b"KESH";
pub const KEPT_IDS: [u8; 4] = *b"KETI";
pub const KEPT_SUMS: [u8; 4] = *b"KETS";
pub const PHOTO_SPLATS: [u8; 4] = *b"PHSP";
pub const PHOTO_APPEARANCE: [u8; 4] = *b"PHAP";
pub const PHOTO_SHAPE_PRECISION: [u8; 4] = *b"PHFO";
pub const PHOTO_COLOR: [u8; 4] = *b"PHCO";
pub const PHOTO_NOISE: [u8; 4] = *b"PHNO";
pub const PHOTO_POINTS: [u8; 4] = *b"PHPT";
pub const PHOTO_SEEN_THROUGH: [u8; 4] = *b"PHST";
pub const PHOTO_BUFFER: [u8; 4] = *b"PHWA";
pub const PHOTO_PIXELS: [u8; 4] = *b"PHPX";
pub const PHOTO_SCALES: [u8; 4] = *b"PHDS";
pub const PHOTO_DEPTHS: [u8; 4] = *b"PHDP";

/// Sections of every checkpoint.
const OF_ALL: [[u8; 4]; 5] = [CONFIG, META, NUMERICS, CURSOR, HISTORY];
/// Sections of mixtures only.
pub const OF_MIXTURES: [[u8; 4]; 9] =
    [NORMALIZATION, PRIOR, ALPHA, MEANS, COUNTS, FIRST, SECOND, CARRY_IDS, CARRY_LIMBS];
/// Sections of scenes only.
pub const OF_SCENES: [[u8; 4]; 29] = [
    ORIGIN,
    SEEDS,
    COARSENED,
    SHARES,
    SUMS,
    WIDE_IDS,
    WIDE_SUMS,
    COMPONENTS,
    VISIBILITY,
    EXPOSURES,
    POSES,
    POSE_ROTATIONS,
    TRAJECTORY,
    RETAINED,
    KEPT_SHOWN_IDS,
    RETAINED_MEANS,
    KEPT_IDS,
    KEPT_SUMS,
    PHOTO_SPLATS,
    PHOTO_APPEARANCE,
    PHOTO_SHAPE_PRECISION,
    PHOTO_COLOR,
    PHOTO_NOISE,
    PHOTO_POINTS,
    PHOTO_SEEN_THROUGH,
    PHOTO_BUFFER,
    PHOTO_PIXELS,
    PHOTO_SCALES,
    PHOTO_DEPTHS,
];

pub fn is_known(tag: [u8; 4]) -> bool {
    [&OF_ALL[..], &OF_MIXTURES, &OF_SCENES].iter().any(|tags| tags.contains(&tag))
}
