//! A scene that learns frame by frame.

use crate::arrays::{
    Columns, check_size, color_image, depth_image, depth_kind, intrinsics, pose_matrix,
    value_error, values,
};
use crate::recording::Frame as RecordedFrame;
use glam::{DMat4, DVec3};
use numpy::IntoPyArray;
use numpy::PyUntypedArrayMethods;
use numpy::ndarray::{Array2, Array3};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::ffi::OsStr;
use std::path::PathBuf;
use std::sync::{Mutex, MutexGuard, PoisonError};
use vbgs_studio::dataset::Dataset;
use vbgs_studio::dataset::frame::{ColorBuffer, DepthBuffer, DepthKind, Frame};
use vbgs_studio::dataset::surface::{Preparer, Sensor, SurfaceSettings};
use vbgs_studio::export::{ModelFormat, WriteOptions, write};
use vbgs_studio::math::camera::{Camera, Intrinsics};
use vbgs_studio::math::image::Image;
use vbgs_studio::math::measured_pixel::Normalization;
use vbgs_studio::math::pose::Pose;
use vbgs_studio::model::splat::appearance::SplatSet;
use vbgs_studio::observation::surface::Observation;
use vbgs_studio::pipeline::plan::{Plan, Selection};
use vbgs_studio::pipeline::settings::scene::{SceneOverrides, SceneRun};
use vbgs_studio::render::cpu::{CpuRenderer, Rendered};
use vbgs_studio::render::{RenderMethod, RenderOptions};
use vbgs_studio::train::learner::{Learner, Learns, Status};
use vbgs_studio::train::outcome::{FrameOutcome, FrameTracking};
use vbgs_studio::train::scene::trainer::SceneTrainer;
use vbgs_studio::train::setting::table::SettingLayer;

/// A scene that learns frame by frame; see the stub file for shapes and units. Calls from several threads take turns.
#[pyclass(frozen, module = "vbgs_studio")]
pub struct Scene {
    /// Camera of frames given as arrays; `None` for a scene of a recording, whose frames bring their own.
    camera: Option<ArrayCamera>,
    normalization: Normalization,
    inner: Mutex<Inner>,
}

#[derive(Clone, Copy)]
struct ArrayCamera {
    intrinsics: Intrinsics,
    kind: DepthKind,
    trusted: [f64; 2],
}

struct Inner {
    trainer: SceneTrainer,
    surface: SurfaceSettings,
    preparer: Preparer,
    observation: Observation,
    renderer: CpuRenderer,
    n_frames: usize,
}

impl Scene {
    fn new(run: &SceneRun, camera: Option<ArrayCamera>) -> Self {
        let surface = run.prepared_surface();
        let inner = Inner {
            trainer: SceneTrainer::new(&run.engine, surface.origin),
            surface,
            preparer: Preparer::new(),
            observation: Observation::empty(),
            renderer: CpuRenderer::new(),
            n_frames: 0,
        };
        Self { camera, normalization: run.normalization(), inner: Mutex::new(inner) }
    }

    /// Creates a scene with the settings that the program chooses for a recording.
    pub fn of_recording(
        py: Python<'_>,
        dataset: &Dataset,
        split: usize,
        settings: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<Self> {
        let overrides = overrides(settings)?;
        let split = Some(dataset.splits[split].name.clone());
        let selection = Selection { split, ..Selection::all_frames() };
        let run = py.detach(|| {
            let plan = Plan::new(dataset, &selection, 0).map_err(value_error)?;
            SceneRun::new(dataset, &plan, &overrides).map_err(value_error)
        })?;
        Ok(Self::new(&run, None))
    }

    // A panic of another thread leaves a scene that may be drawn and saved.
    fn lock(&self) -> MutexGuard<'_, Inner> {
        self.inner.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Returns a frame in memory from arrays.
    fn frame_of_arrays(
        &self,
        color: &Bound<'_, PyAny>,
        depth: &Bound<'_, PyAny>,
        pose: &Bound<'_, PyAny>,
    ) -> PyResult<Frame> {
        let Some(ArrayCamera { intrinsics, kind, trusted }) = self.camera else {
            return Err(PyTypeError::new_err(
                "learn: a scene of a recording learns its frames, learn(recording[i]); for arrays create Scene(intrinsics, size, scale)",
            ));
        };
        let (color, depth, pose) = (color_image(color)?, depth_image(depth)?, pose_matrix(pose)?);
        check_size("color", color.shape(), &intrinsics)?;
        check_size("depth", depth.shape(), &intrinsics)?;
        let (bytes, lengths) = (values(&color), values(&depth));
        let bytes = match color.shape()[2] {
            4 => ColorBuffer::Rgba8(&bytes),
            _ => ColorBuffer::Rgb8(&bytes),
        };
        let lengths = DepthBuffer { lengths: &lengths, kind, trusted };
        Frame::from_memory("learn", intrinsics, pose, bytes, Some(lengths)).map_err(value_error)
    }

    fn splat_set(&self, py: Python<'_>) -> SplatSet {
        py.detach(|| {
            let mut inner = self.lock();
            inner.trainer.settle();
            inner.trainer.splats()
        })
    }
}

impl Inner {
    fn learn(&mut self, frame: &Frame) -> Result<(FrameOutcome, usize), String> {
        let Self { trainer, surface, preparer, observation, n_frames, .. } = self;
        preparer.prepare(frame, surface, observation).map_err(|error| error.to_string())?;
        let outcome = trainer.learn(observation).map_err(|error| error.to_string())?;
        *n_frames += 1;
        Ok((outcome, trainer.status().used))
    }
}

/// Returns settings by name, as `--set NAME=VALUE` of the command line takes them.
fn overrides(settings: Option<&Bound<'_, PyDict>>) -> PyResult<SceneOverrides> {
    let mut overrides = SceneOverrides::default();
    for (name, value) in settings.into_iter().flatten() {
        let name: String = name.extract()?;
        let setting = SceneOverrides::TABLE.iter().find(|setting| setting.about.field == name);
        let Some(setting) = setting else {
            let known: Vec<_> =
                SceneOverrides::TABLE.iter().map(|setting| setting.about.field).collect();
            return Err(PyTypeError::new_err(format!(
                "{name}: expected one of the settings {}",
                known.join(", ")
            )));
        };
        let text = value.str()?.to_string();
        // Python writes True and False.
        let text = if value.extract::<bool>().is_ok() { text.to_lowercase() } else { text };
        (setting.parse)(&mut overrides, OsStr::new(&text))
            .map_err(|error| PyValueError::new_err(format!("{name}: {error}")))?;
    }
    Ok(overrides)
}

#[pymethods]
impl Scene {
    #[new]
    #[pyo3(signature = (
        intrinsics, size, scale, *, sensor = "lidar", depth_kind = "z", depth_range = [0.0, f64::INFINITY],
        origin = [0.0; 3], **settings
    ))]
    #[allow(clippy::too_many_arguments, reason = "keyword arguments of Python")]
    fn of_camera(
        intrinsics: &Bound<'_, PyAny>,
        size: [u32; 2],
        scale: f64,
        sensor: &str,
        depth_kind: &str,
        depth_range: [f64; 2],
        origin: [f64; 3],
        settings: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<Self> {
        let intrinsics = self::intrinsics(intrinsics, size)?;
        let kind = self::depth_kind(depth_kind)?;
        let Ok(sensor) = sensor.parse::<Sensor>() else {
            return Err(PyValueError::new_err(format!(
                "sensor: expected lidar, kinect, exact or inverse8-ray, found {sensor:?}"
            )));
        };
        let overrides = overrides(settings)?;
        let (n_pixels, origin) = (intrinsics.n_pixels(), DVec3::from_array(origin));
        let run = SceneRun::of_memory(sensor, n_pixels, scale, origin, &overrides)
            .map_err(value_error)?;
        Ok(Self::new(&run, Some(ArrayCamera { intrinsics, kind, trusted: depth_range })))
    }

    /// Learns a frame: `learn(color, depth, pose)` or `learn(recording[i])`.
    #[pyo3(signature = (color, depth = None, pose = None))]
    fn learn<'py>(
        &self,
        py: Python<'py>,
        color: &Bound<'py, PyAny>,
        depth: Option<&Bound<'py, PyAny>>,
        pose: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let recorded = color.cast::<RecordedFrame>().ok();
        let (outcome, used) = match (recorded, depth, pose) {
            (Some(recorded), None, None) => {
                let frame = &recorded.get().frame;
                py.detach(|| self.lock().learn(frame))
            }
            (None, Some(depth), Some(pose)) => {
                let frame = self.frame_of_arrays(color, depth, pose)?;
                py.detach(|| self.lock().learn(&frame))
            }
            _ => {
                return Err(PyTypeError::new_err(
                    "learn: expected color, depth and pose, or one frame of a recording",
                ));
            }
        }
        .map_err(PyValueError::new_err)?;
        let report = PyDict::new(py);
        report.set_item("points", outcome.points)?;
        report.set_item("elbo", outcome.elbo_mean)?;
        report.set_item("new_components", outcome.new_components)?;
        report.set_item("components", used)?;
        report.set_item("is_lost", matches!(outcome.tracking, Some(FrameTracking::Lost(_))))?;
        report.set_item("train_ms", outcome.ms.train)?;
        Ok(report)
    }

    fn __len__(&self) -> usize {
        self.lock().trainer.status().used
    }

    fn __repr__(&self) -> String {
        let inner = self.lock();
        let Status { used, .. } = inner.trainer.status();
        format!("<Scene: {used} components, {} frames>", inner.n_frames)
    }

    /// Splats as drawn, arrays by name.
    fn splats<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let set = self.splat_set(py);
        let drawn = || (0..set.len()).filter(|&i| set[i].is_drawable());
        let columns = Columns::new(py);
        columns.add_rows("mean", &drawn().map(|i| set[i].mean).collect::<Vec<_>>())?;
        columns.add_rows("scale", &drawn().map(|i| set[i].scale).collect::<Vec<_>>())?;
        columns.add_rows("rotation", &drawn().map(|i| set[i].rotation).collect::<Vec<_>>())?;
        columns.add("opacity", drawn().map(|i| set[i].opacity).collect())?;
        columns.add_rows("color", &drawn().map(|i| set[i].color).collect::<Vec<_>>())?;
        let look = |i| set.appearance_of(i);
        columns.add_matrices("gradient", &drawn().map(|i| look(i).gradient).collect::<Vec<_>>())?;
        columns.add_matrices(
            "directional",
            &drawn().map(|i| look(i).directional).collect::<Vec<_>>(),
        )?;
        Ok(columns.finish())
    }

    /// Posterior of the components with points, arrays by name.
    fn posterior<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let found: Vec<_> = py.detach(|| {
            let trainer = &self.lock().trainer;
            let used = (0..trainer.status().components).filter(|&id| trainer.evidence(id) > 0.0);
            used.map(|id| trainer.component(id)).collect()
        });
        let (normalization, columns) = (&self.normalization, Columns::new(py));
        columns.add("count", found.iter().map(|c| c.posterior.count).collect())?;
        let mean =
            found.iter().map(|c| normalization.denormalize(c.posterior.mean_space).to_array());
        columns.add_rows("mean", &mean.collect::<Vec<_>>())?;
        let covariance = found.iter().map(|c| {
            let sigma = c.posterior.world_covariance(normalization);
            [
                [sigma.xx, sigma.xy, sigma.xz],
                [sigma.xy, sigma.yy, sigma.yz],
                [sigma.xz, sigma.yz, sigma.zz],
            ]
        });
        columns.add_matrices("covariance", &covariance.collect::<Vec<_>>())?;
        let color = found
            .iter()
            .map(|c| Normalization::denormalize_color(c.posterior.mean_color).to_array());
        columns.add_rows("color", &color.collect::<Vec<_>>())?;
        let normal =
            found.iter().map(|c| c.normal.map_or([f64::NAN; 3], |normal| normal.to_array()));
        columns.add_rows("normal", &normal.collect::<Vec<_>>())?;
        Ok(columns.finish())
    }

    /// Writes the splats to a file, by its ending; returns the number of splats and of bytes.
    fn save(&self, py: Python<'_>, path: PathBuf) -> PyResult<(usize, u64)> {
        let format = ModelFormat::from_path(&path).map_err(value_error)?;
        let set = self.splat_set(py);
        let written =
            py.detach(|| write(&path, &set, &WriteOptions::new(format))).map_err(value_error)?;
        Ok((written.n_written, written.bytes))
    }

    /// Renders the scene on the CPU; returns colour, depth and coverage by name.
    #[pyo3(signature = (pose, intrinsics = None, size = None, *, renderer = "projected", background = [0.0; 3]))]
    fn render<'py>(
        &self,
        py: Python<'py>,
        pose: &Bound<'py, PyAny>,
        intrinsics: Option<&Bound<'py, PyAny>>,
        size: Option<[u32; 2]>,
        renderer: &str,
        background: [f32; 3],
    ) -> PyResult<Bound<'py, PyDict>> {
        let own = self.camera.map(|camera| camera.intrinsics);
        let intrinsics = match (intrinsics, size.or(own.map(|k| [k.width, k.height]))) {
            (Some(given), Some(size)) => self::intrinsics(given, size)?,
            (None, Some([width, height]))
                if own.is_some_and(|k| [k.width, k.height] == [width, height]) =>
            {
                own.unwrap_or(Intrinsics::from_horizontal_fov(width, height, 1.0))
            }
            _ => {
                return Err(PyValueError::new_err(
                    "render: expected intrinsics and size, as the scene has no camera of this size",
                ));
            }
        };
        let method = match renderer {
            "projected" => RenderMethod::PROJECTED,
            "exact" => RenderMethod::EXACT,
            _ => {
                return Err(PyValueError::new_err(format!(
                    "renderer: expected \"projected\" or \"exact\", found {renderer:?}"
                )));
            }
        };
        let pose: DMat4 = pose_matrix(pose)?;
        let pose = Pose::from_opencv(pose).map_err(value_error)?;
        let options = RenderOptions::evaluation(method, background);
        let set = self.splat_set(py);
        let Rendered { color, coverage, depth, .. } =
            py.detach(|| self.lock().renderer.render(&set, &Camera { intrinsics, pose }, &options));
        let picture = PyDict::new(py);
        let pixel = |(row, column, i)| color.at(column, row)[i];
        let shape = (color.height, color.width, 3);
        picture.set_item("color", Array3::from_shape_fn(shape, pixel).into_pyarray(py))?;
        let plane = |image: &Image<f32>| {
            let pixel = |(row, column)| *image.at(column, row);
            Array2::from_shape_fn((image.height, image.width), pixel).into_pyarray(py)
        };
        picture.set_item("depth", plane(&depth))?;
        picture.set_item("coverage", plane(&coverage))?;
        Ok(picture)
    }
}
