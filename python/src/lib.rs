//! `import vbgs_studio`: the engine of VBGS Studio for Python.
//!
//! Arrays come from and go to NumPy. Work on a frame runs without the interpreter's lock. Every error of the engine
//! becomes a Python exception with the same message.

mod arrays;
mod recording;
mod scene;

use pyo3::prelude::*;

/// Engine of VBGS Studio.
#[pymodule]
mod _engine {
    #[pymodule_export]
    use super::recording::{Frame, Recording, read};
    #[pymodule_export]
    use super::scene::Scene;
}
