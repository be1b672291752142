//! Conversion between NumPy arrays and the engine's types.

use glam::DMat4;
use numpy::ndarray::{Array1, Array2, Array3, Ix2, Ix3};
use numpy::{Element, IntoPyArray, PyReadonlyArray, PyUntypedArray, PyUntypedArrayMethods};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::borrow::Cow;
use std::fmt::Display;
use vbgs_studio::dataset::frame::DepthKind;
use vbgs_studio::math::camera::Intrinsics;

/// Converts an error of the engine to a `ValueError` with the same message.
pub fn value_error(error: impl Display) -> PyErr {
    PyValueError::new_err(error.to_string())
}

/// Describes an argument for messages: its type or, for an array, its element type and shape.
fn description(found: &Bound<'_, PyAny>) -> String {
    let array = found.cast::<PyUntypedArray>();
    let described = array.ok().and_then(|array| {
        let kind = array.dtype().str().ok()?;
        Some(format!("an array of {kind} with shape {:?}", array.shape()))
    });
    described.unwrap_or_else(|| match found.get_type().name() {
        Ok(name) => format!("a value of type {name}"),
        Err(_) => "another value".to_owned(),
    })
}

fn expected(argument: &str, expected: &str, found: &Bound<'_, PyAny>) -> PyErr {
    PyTypeError::new_err(format!("{argument}: expected {expected}, found {}", description(found)))
}

/// Images in memory, borrowed from NumPy if their rows are contiguous.
pub type Pixels<'a, T> = Cow<'a, [T]>;

/// Returns the values of an array in row-major order, without a copy if they are in that order already.
pub fn values<'a, T: Element + Clone, D: numpy::ndarray::Dimension>(
    array: &'a PyReadonlyArray<'_, T, D>,
) -> Pixels<'a, T> {
    match array.as_slice() {
        Ok(values) => Cow::Borrowed(values),
        Err(_) => Cow::Owned(array.as_array().iter().cloned().collect()),
    }
}

/// Returns a colour image of shape (height, width, 3 or 4), bytes.
pub fn color_image<'py>(color: &Bound<'py, PyAny>) -> PyResult<PyReadonlyArray<'py, u8, Ix3>> {
    let what = "an array of uint8 with shape (height, width, 3) or (height, width, 4)";
    let array: PyReadonlyArray<'py, u8, Ix3> =
        color.extract().map_err(|_| expected("color", what, color))?;
    match array.shape() {
        [_, _, 3 | 4] => Ok(array),
        _ => Err(expected("color", what, color)),
    }
}

/// Returns a depth image of shape (height, width) in world units.
pub fn depth_image<'py>(depth: &Bound<'py, PyAny>) -> PyResult<PyReadonlyArray<'py, f32, Ix2>> {
    let what = "an array of float32 with shape (height, width), in world units";
    depth.extract().map_err(|_| expected("depth", what, depth))
}

/// Checks that an image has the size (height, width) of the camera.
pub fn check_size(argument: &str, shape: &[usize], camera: &Intrinsics) -> PyResult<()> {
    let size = [camera.height as usize, camera.width as usize];
    if shape[..2] == size {
        return Ok(());
    }
    let [rows, columns] = size;
    Err(PyValueError::new_err(format!(
        "{argument}: expected {rows} rows and {columns} columns, found shape {shape:?}"
    )))
}

/// Returns a camera-to-world matrix from an array of shape (4, 4).
pub fn pose_matrix(pose: &Bound<'_, PyAny>) -> PyResult<DMat4> {
    let what = "an array of float64 with shape (4, 4): camera to world, x right, y down, z forward";
    let array: PyReadonlyArray<'_, f64, Ix2> =
        pose.extract().map_err(|_| expected("pose", what, pose))?;
    if array.shape() != [4, 4] {
        return Err(expected("pose", what, pose));
    }
    let rows: Vec<f64> = array.as_array().iter().copied().collect();
    Ok(DMat4::from_cols_slice(&rows).transpose())
}

/// Returns a matrix as an array of shape (4, 4).
pub fn pose_array(py: Python<'_>, pose: DMat4) -> Py<PyAny> {
    let rows = pose.transpose().to_cols_array();
    let array = Array2::from_shape_fn((4, 4), |(row, column)| rows[4 * row + column]);
    array.into_pyarray(py).into_any().unbind()
}

/// Returns intrinsics from (fx, fy, cx, cy) or a matrix of shape (3, 3), and (width, height).
pub fn intrinsics(given: &Bound<'_, PyAny>, [width, height]: [u32; 2]) -> PyResult<Intrinsics> {
    let of = |[fx, fy, cx, cy]: [f64; 4]| Intrinsics { width, height, fx, fy, cx, cy };
    if let Ok(four) = given.extract::<[f64; 4]>() {
        return Ok(of(four));
    }
    match given.extract::<[[f64; 3]; 3]>() {
        Ok([[fx, _, cx], [_, fy, cy], _]) => Ok(of([fx, fy, cx, cy])),
        Err(_) => Err(expected(
            "intrinsics",
            "(fx, fy, cx, cy) or a matrix of shape (3, 3), pixels",
            given,
        )),
    }
}

/// Returns the direction of depth by its name.
pub fn depth_kind(name: &str) -> PyResult<DepthKind> {
    match name {
        "z" => Ok(DepthKind::Z),
        "ray" => Ok(DepthKind::RayDistance),
        _ => Err(PyValueError::new_err(format!(
            "depth_kind: expected \"z\" (along the optical axis) or \"ray\" (along the pixel's ray), found {name:?}"
        ))),
    }
}

/// Arrays by name, returned as a dict.
pub struct Columns<'py> {
    dict: Bound<'py, PyDict>,
}

impl<'py> Columns<'py> {
    pub fn new(py: Python<'py>) -> Self {
        Self { dict: PyDict::new(py) }
    }

    /// Adds an array of shape (n,).
    pub fn add<T: Element>(&self, name: &str, values: Vec<T>) -> PyResult<()> {
        self.dict.set_item(name, Array1::from_vec(values).into_pyarray(self.dict.py()))
    }

    /// Adds an array of shape (n, N).
    pub fn add_rows<T: Element + Copy, const N: usize>(
        &self,
        name: &str,
        rows: &[[T; N]],
    ) -> PyResult<()> {
        let array = Array2::from_shape_fn((rows.len(), N), |(row, i)| rows[row][i]);
        self.dict.set_item(name, array.into_pyarray(self.dict.py()))
    }

    /// Adds an array of shape (n, 3, 3).
    pub fn add_matrices<T: Element + Copy>(
        &self,
        name: &str,
        matrices: &[[[T; 3]; 3]],
    ) -> PyResult<()> {
        let array = Array3::from_shape_fn((matrices.len(), 3, 3), |(n, i, j)| matrices[n][i][j]);
        self.dict.set_item(name, array.into_pyarray(self.dict.py()))
    }

    pub fn finish(self) -> Bound<'py, PyDict> {
        self.dict
    }
}
