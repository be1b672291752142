//! What is fed with arbitrary bytes: one function for every target of `cargo fuzz` and for the test
//! that replays what was found. Each panics where the product does, or where it says something that
//! cannot be right.

mod bytes;
pub mod checkpoint;
mod folders;
mod models;
mod seeds;
mod settings;
mod training;

/// A place where bytes from outside come in.
pub struct Target {
    /// As the command line of `cargo fuzz`, the folder of its seeds and its binary call it.
    pub name: &'static str,
    /// What it is fed to.
    pub run: fn(&[u8]),
    /// Sound inputs to begin with, made by the library's own writers.
    pub seeds: fn() -> Vec<Vec<u8>>,
}

/// All of them.
pub const TARGETS: [Target; 14] = [
    Target { name: "layouts", run: folders::layout, seeds: seeds::layouts },
    Target { name: "poses", run: folders::poses, seeds: seeds::poses },
    Target { name: "images", run: folders::images, seeds: seeds::images },
    Target { name: "exr", run: folders::exr, seeds: seeds::exr },
    Target { name: "npy", run: folders::npy, seeds: seeds::npy },
    Target { name: "r3d", run: folders::r3d, seeds: seeds::r3d },
    Target { name: "ply", run: models::ply, seeds: seeds::ply },
    Target { name: "compressed_ply", run: models::ply, seeds: seeds::compressed_ply },
    Target { name: "spz", run: models::spz, seeds: seeds::spz },
    Target { name: "splat", run: models::splat, seeds: seeds::splat },
    Target { name: "glb", run: models::glb, seeds: seeds::glb },
    Target { name: "checkpoint", run: checkpoint::checkpoint, seeds: seeds::checkpoint },
    Target { name: "ron", run: settings::ron, seeds: seeds::ron },
    Target { name: "training", run: training::training, seeds: seeds::training },
];

/// Feeds a target.
///
/// # Panics
/// Where the product does, and for a name that is no target's.
#[allow(dead_code, reason = "the test goes through the list")]
pub fn run(name: &str, data: &[u8]) {
    let target = TARGETS.iter().find(|target| target.name == name);
    (target.unwrap_or_else(|| panic!("no target {name}")).run)(data);
}
