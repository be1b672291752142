//! Functions that take arbitrary bytes, one for every target of `cargo fuzz`. A test replays the inputs that
//! fuzzing found. Each function panics if the product panics or returns an impossible result.

mod bytes;
pub mod checkpoint;
mod folders;
mod models;
mod seeds;
mod settings;
mod training;

/// Function that processes bytes from outside.
pub struct Target {
    /// Name of its binary, of the folder of its seeds, and on the command line of `cargo fuzz`.
    pub name: &'static str,
    /// Processes an input.
    pub run: fn(&[u8]),
    /// Valid inputs, made by the library's own writers.
    pub seeds: fn() -> Vec<Vec<u8>>,
}

/// All targets.
pub const TARGETS: [Target; 16] = [
    Target { name: "layouts", run: folders::layout, seeds: seeds::layouts },
    Target { name: "poses", run: folders::poses, seeds: seeds::poses },
    Target { name: "images", run: folders::images, seeds: seeds::images },
    Target { name: "exr", run: folders::exr, seeds: seeds::exr },
    Target { name: "npy", run: folders::npy, seeds: seeds::npy },
    Target { name: "r3d", run: folders::r3d, seeds: seeds::r3d },
    Target { name: "mcap", run: folders::mcap, seeds: seeds::mcap },
    Target { name: "ply", run: models::ply, seeds: seeds::ply },
    Target { name: "compressed_ply", run: models::ply, seeds: seeds::compressed_ply },
    Target { name: "spz", run: models::spz, seeds: seeds::spz },
    Target { name: "sog", run: models::sog, seeds: seeds::sog },
    Target { name: "splat", run: models::splat, seeds: seeds::splat },
    Target { name: "glb", run: models::glb, seeds: seeds::glb },
    Target { name: "checkpoint", run: checkpoint::checkpoint, seeds: seeds::checkpoint },
    Target { name: "ron", run: settings::ron, seeds: seeds::ron },
    Target { name: "training", run: training::training, seeds: seeds::training },
];

/// Runs a target on an input.
///
/// # Panics
/// If the product panics, or for the name of no target.
#[allow(dead_code, reason = "the test goes through the list")]
pub fn run(name: &str, data: &[u8]) {
    let target = TARGETS.iter().find(|target| target.name == name);
    (target.unwrap_or_else(|| panic!("no target {name}")).run)(data);
}
