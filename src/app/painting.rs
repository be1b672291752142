//! Choice of the painter of the scene.

/// Painter of the scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Painting {
    /// The GPU if it is a real one, else the CPU renderer, which is faster than a software adapter.
    Auto,
    /// The GPU, even if it is a software adapter.
    Gpu,
}
