//! glTF 2.0 with `KHR_gaussian_splatting` (`files.md`, GLB). Files are y-up, splats in memory z-up.
//! Writing maps `(x, y, z)` to `(x, z, −y)`, and reading always inverts this mapping.

mod container;
mod import;
#[expect(clippy::indexing_slicing, reason = "all indices come from the mesh's own lists")]
pub(super) mod mesh;
pub(super) mod read;
mod schema;
pub(super) mod write;

const POSITION: &str = "POSITION";
const COLOR_0: &str = "COLOR_0";
const ROTATION: &str = "KHR_gaussian_splatting:ROTATION";
const SCALE: &str = "KHR_gaussian_splatting:SCALE";
const OPACITY: &str = "KHR_gaussian_splatting:OPACITY";
const SH_0: &str = "KHR_gaussian_splatting:SH_DEGREE_0_COEF_0";
const SH_1: [&str; 3] = [
    "KHR_gaussian_splatting:SH_DEGREE_1_COEF_0",
    "KHR_gaussian_splatting:SH_DEGREE_1_COEF_1",
    "KHR_gaussian_splatting:SH_DEGREE_1_COEF_2",
];
const SH_PREFIX: &str = "KHR_gaussian_splatting:SH_DEGREE_";
const EXTENSION: &str = "KHR_gaussian_splatting";
const KERNEL: &str = "ellipse";
const SRGB: &str = "srgb_rec709_display";
const LINEAR: &str = "lin_rec709_display";
const POINTS: u32 = 0;
