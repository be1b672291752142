//! Which of the two painters draws the scene.

/// Who draws the scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Painting {
    /// The GPU if it is a real one, else the CPU renderer, which is faster than a software GPU.
    Auto,
    /// The GPU whatever it is.
    Gpu,
}
