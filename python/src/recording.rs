//! Recordings on disk, in every layout that the program opens.

use crate::arrays::{pose_array, value_error};
use crate::scene::Scene;
use numpy::ndarray::{Array2, Array3};
use numpy::{IntoPyArray, PyArray2, PyArray3};
use pyo3::exceptions::{PyIndexError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::path::PathBuf;
use std::sync::Arc;
use vbgs_studio::dataset::{Dataset, LoadOptions, frame, open, synthetic};

/// Frames of a recording, in order; see the stub file for shapes and units.
#[pyclass(frozen, module = "vbgs_studio")]
pub struct Recording {
    dataset: Arc<Dataset>,
    split: usize,
}

/// A frame of a recording.
#[pyclass(frozen, module = "vbgs_studio")]
pub struct Frame {
    pub frame: frame::Frame,
}

/// Opens a recording. `split` names a split of the recording; the training frames without one. The path `demo` is the
/// built-in synthetic room.
#[pyfunction]
#[pyo3(signature = (path, split = None))]
pub fn read(py: Python<'_>, path: PathBuf, split: Option<&str>) -> PyResult<Recording> {
    let dataset = py.detach(|| match path.to_str() {
        Some("demo") => synthetic::demo().map_err(value_error),
        _ => open(&path, &LoadOptions::default()).map_err(value_error),
    })?;
    let split = match split {
        None => dataset.training_split().map_err(value_error)?,
        Some(name) => {
            dataset.splits.iter().position(|split| split.name == name).ok_or_else(|| {
                let names: Vec<_> =
                    dataset.splits.iter().map(|split| split.name.as_str()).collect();
                PyValueError::new_err(format!(
                    "split: expected one of {}, found {name:?}",
                    names.join(", ")
                ))
            })?
        }
    };
    Ok(Recording { dataset: Arc::new(dataset), split })
}

#[pymethods]
impl Recording {
    fn __len__(&self) -> usize {
        self.dataset.splits[self.split].frames.len()
    }

    fn __getitem__(&self, py: Python<'_>, index: isize) -> PyResult<Frame> {
        let n = self.__len__();
        let at = if index < 0 { index + n as isize } else { index };
        let at = usize::try_from(at).ok().filter(|at| *at < n).ok_or_else(|| {
            PyIndexError::new_err(format!("expected a frame below {n}, found {index}"))
        })?;
        let (dataset, split) = (&self.dataset, self.split);
        let frame = py.detach(|| dataset.load(split, at)).map_err(value_error)?;
        Ok(Frame { frame })
    }

    fn __repr__(&self) -> String {
        let Dataset { name, layout, splits, .. } = &*self.dataset;
        let split = &splits[self.split];
        format!(
            "<Recording {name}: {}, {} frames of {}>",
            layout.name(),
            split.frames.len(),
            split.name
        )
    }

    /// Names of the splits.
    #[getter]
    fn splits(&self) -> Vec<String> {
        self.dataset.splits.iter().map(|split| split.name.clone()).collect()
    }

    /// Creates an empty scene with the settings that the program chooses for this recording.
    #[pyo3(signature = (**settings))]
    fn scene(&self, py: Python<'_>, settings: Option<&Bound<'_, PyDict>>) -> PyResult<Scene> {
        Scene::of_recording(py, &self.dataset, self.split, settings)
    }
}

#[pymethods]
impl Frame {
    #[getter]
    fn name(&self) -> &str {
        &self.frame.name
    }

    /// Colour image, uint8 of shape (height, width, 4).
    #[getter]
    fn color<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray3<u8>> {
        let image = &*self.frame.color;
        let pixel = |(row, column, i)| image.at(column, row)[i];
        Array3::from_shape_fn((image.height, image.width, 4), pixel).into_pyarray(py)
    }

    /// Depth along the optical axis in world units, float32 of shape (height, width); 0 where unknown.
    #[getter]
    fn depth<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyArray2<f32>>> {
        let image = self.frame.depth_z()?;
        let pixel = |(row, column)| *image.at(column, row);
        Some(Array2::from_shape_fn((image.height, image.width), pixel).into_pyarray(py))
    }

    /// Camera-to-world matrix of the depth camera, float64 of shape (4, 4).
    #[getter]
    fn pose(&self, py: Python<'_>) -> Py<PyAny> {
        pose_array(py, self.frame.camera.pose.to_opencv())
    }

    /// (fx, fy, cx, cy) of the depth camera, pixels.
    #[getter]
    fn intrinsics(&self) -> [f64; 4] {
        let k = self.frame.camera.intrinsics;
        [k.fx, k.fy, k.cx, k.cy]
    }

    /// (width, height) of the depth image, pixels.
    #[getter]
    fn size(&self) -> [u32; 2] {
        let k = self.frame.camera.intrinsics;
        [k.width, k.height]
    }
}
